"""Training on the machines that fit a log against training on the one in their middle.

    python benchmarks/draws.py [SEEDS]

A machine with hidden numbers (that of `promise.py` with seed 0) is logged and identified. Policies
that correct a law are then trained on it, and on the machines that fit the log, with 5 seeds each.
Prints the mean of the worst twentieth of path errors on 200 such machines, which no training had,
and the mean on the hidden machine. Takes about two minutes of processor time for each training.
"""

import sys
from dataclasses import replace
from pathlib import Path

from promise import SHORT, hidden

from pter_agents.draws import VALIDATION_SEED, draws_for
from pter_agents.ppo import PPO
from pter_agents.settings import TrainingArguments, load_settings

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from oracle.experiment import record_log
from pter_gym.benchmark import Episodes, evaluate
from pter_gym.benchmark.boards import worst_twentieth
from pter_gym.params import BASELINE, Machine
from pter_gym.scenarios import PACES
from pter_gym.tools.identification import identify

STEPS, DRAWS = 4_000_000, 200


def main(seeds: int) -> None:
    """Print a row for each training."""
    own = hidden(0)
    spread = identify(record_log(own, SHORT, seed=0), BASELINE).machines
    assert not isinstance(spread, Machine)
    tests: dict[str, Episodes] = {}
    for pace in PACES:
        machines, tasks = zip(
            *draws_for("standard", pace, spread).pairs(DRAWS, VALIDATION_SEED), strict=True
        )
        resets, strata = tuple(range(DRAWS)), ("",) * DRAWS
        tests[pace] = Episodes("standard", machines, tasks, resets, strata, spread.machine)
    for seed in range(1, 1 + seeds):
        for name, machine in (("point", spread.machine), ("draws", spread)):
            arguments = TrainingArguments(
                algorithm="residual",
                scenario="standard",
                pace="all",
                steps=STEPS,
                seed=seed,
                settings=load_settings("residual"),
                machine=machine,
            )
            model = PPO(arguments)
            while model.steps < STEPS:
                model.advance()
            policy, worst, mean = model.policy(), list[str](), list[str]()
            for episodes in tests.values():
                errors = evaluate(policy, episodes)["path_error_m"]
                worst.append(f"{1e3 * worst_twentieth(errors):.2f}")
                there = replace(episodes, machines=(own,) * DRAWS)
                on_own = evaluate(policy, there)["path_error_m"]
                mean.append(f"{1e3 * float(on_own.mean()):.2f}")
            print(f"{name} {seed}: {'/'.join(worst)}, hidden {'/'.join(mean)} mm", flush=True)


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 5)
