"""How soon `pter train ppo` ranks, and what it reaches: `python benchmarks/learning.py SEED …`.

Trains with the default settings, or those of `--config FILE`, and validates every 32 rollouts until
the first rank. Prints for each seed the processor seconds of the training alone until the first
policy that is ranked at every pace, those of the whole training, and path errors on 200 fresh test
episodes, which `ppo-standard` has as well.
"""

from statistics import median
from time import process_time

import tyro

from pter_agents.ppo import PPO
from pter_agents.settings import TrainingArguments, load_settings
from pter_agents.training import progress_of
from pter_agents.validation import Validation
from pter_agents.worlds import make_training
from pter_gym.benchmark import run_scenario
from pter_gym.scenarios import PACES

VALIDATE_EVERY = 32
"""Rollouts between two validations until the first rank."""


def main(
    seeds: tyro.conf.Positional[tuple[int, ...]],
    config: str | None = None,
    steps: int = 20_000_000,
    fresh: int = 1,
):
    """Print a row for each seed."""
    validation = Validation("standard", tuple(PACES), 64)
    settings = load_settings("ppo", config)
    reached: list[tuple[float, ...]] = []
    for seed in seeds:
        given = TrainingArguments(
            algorithm="ppo",
            scenario="standard",
            pace="all",
            steps=steps,
            seed=seed,
            settings=settings,
        )
        model = PPO(settings, make_training(given), steps, seed)
        model.advance()  # compiles
        spent, first = 0.0, float("inf")
        while model.steps < steps:
            began = process_time()
            model.advance()
            spent += process_time() - began
            if first == float("inf") and not model.steps // model.rollout % VALIDATE_EVERY:
                scores = validation.scores(model.policy()).values()
                first = spent if all(progress_of(each)["ranked"] for each in scores) else first
        policies = {"mine": model.policy(), "ppo-standard": "ppo-standard"}
        runs = run_scenario("standard", policies, seed=fresh)
        mine, shipped = (
            [1e3 * float(run.scores["path_error_m"].mean()) for run in runs if run.policy == name]
            for name in policies
        )
        reached.append((first, spent, *mine))
        row = " / ".join(f"{error:.2f}" for error in mine)
        known = " / ".join(f"{error:.2f}" for error in shipped)
        print(f"{seed}: rank {first:.0f} s, {spent:.0f} s: {row} mm for {known}", flush=True)
    middle = [median(column) for column in zip(*reached, strict=True)]
    print("median: rank {:.0f} s, {:.0f} s: {:.2f} / {:.2f} / {:.2f} mm".format(*middle))


if __name__ == "__main__":
    tyro.cli(main)
