"""What Frama-C proves of exported C: a row for each policy, type of numbers and weights.

    python benchmarks/proofs.py [--policies NAME …]

Needs `frama-c` (Debian's frama-c-base); about half an hour. docs/development/exported-c.md has the
table.
"""

from tempfile import TemporaryDirectory
from typing import Any, get_args

import tyro

from pter_gym.benchmark import find_policy
from pter_gym.errors import ProofError
from pter_gym.policies import shipped_policies
from pter_gym.policies.find import DETECTOR
from pter_gym.policies.tuned import tuned_policies
from pter_gym.tools.deploy import source_of
from pter_gym.tools.deploy.proof import MachineModel, prove

NETWORKS = (*shipped_policies(), f"universal{DETECTOR}")
PAPER = ("impedance", "torque-feedback")
MODELS = get_args(MachineModel)


def proven(source: Any, model: MachineModel) -> str:
    """Return the seconds of a proof, or the number of its alarms."""
    with TemporaryDirectory() as folder:
        source.write(folder, driver=True)
        try:
            return f"{prove(folder, machine=model).seconds:.0f} s"
        except ProofError as error:
            return f"{len(str(error).splitlines()) - 1} alarms"


def main(policies: tuple[str, ...] = (*PAPER, *tuned_policies(), *NETWORKS)) -> None:
    """Print the table."""
    print(f"| Policy | Numbers | Weights | {' | '.join(f'`{model}`' for model in MODELS)} |")
    print(f"|---|---|---|{'---:|' * len(MODELS)}")
    for name in policies:
        policy = find_policy(name)
        rounded = ("int8",) if name in NETWORKS else ()
        kinds: Any = [("double", "float"), ("float", "float"), *(("float", w) for w in rounded)]
        for numbers, weights in kinds:
            source = source_of(policy, name=name, numbers=numbers, weights=weights)
            cells = " | ".join(proven(source, model) for model in MODELS)
            print(f"| `{name}` | {numbers} | {weights} | {cells} |", flush=True)


if __name__ == "__main__":
    tyro.cli(main)
