"""Score the policies of the pages on fresh episodes of all scenarios, and write the pages that show them.

    python docs/make/scores.py RESULTS

The episodes follow from the code, so each change of `pter_gym` asks for this once more: six minutes. What
is in RESULTS already is not simulated again. `images.py` and `moving_pictures.py` draw what no score decides.
"""

from pathlib import Path

import against_tuned
import classical_pages
import scenario_pages
import tyro
from pages import LEFT_OUT

from pter_gym.benchmark.tuned import TUNED
from pter_gym.commands.main import main as pter
from pter_gym.policies import shipped_policies
from pter_gym.scenarios import SCENARIOS

POLICIES = (*LEFT_OUT, "impedance", "torque-feedback", *TUNED, *shipped_policies())


def score(scenario: str, results: Path, *options: str) -> None:
    """Run the policies on a scenario."""
    status = pter(
        ["benchmark", "--scenario", scenario, "--policies", ",".join(POLICIES), "--out", str(results), *options]
    )
    if status:
        raise SystemExit(status)


def main(results: tyro.conf.Positional[Path]) -> None:
    """Score on all scenarios, on the stored episodes of one too, then write the tables and README's picture."""
    score(scenario_pages.PICTURED, results)
    for scenario in SCENARIOS:
        score(scenario, results, "--fresh", "derived")
    scenario_pages.main(results)
    classical_pages.main(results)
    against_tuned.main(results)


if __name__ == "__main__":
    tyro.cli(main)
