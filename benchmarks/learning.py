"""How soon `pter train ppo` ranks, and how well: `python benchmarks/learning.py SEED …`.

Trains with the default settings, or those of `--config FILE`, and validates every 16 rollouts.
Prints for each seed the seconds of the training alone, by the clock, until the first policy that is
ranked at every pace and until the first whose mean error is no larger than that of `ppo-standard`,
and path errors on 200 fresh test episodes, which `ppo-standard` has as well. With `--stop` a
training ends with the second of these policies.
"""

import math
from dataclasses import replace
from statistics import geometric_mean, median
from time import perf_counter

import tyro

from pter_agents.draws import PaceScores, validate, validation_episodes
from pter_agents.ppo import PPO
from pter_agents.settings import TrainingArguments, load_settings
from pter_gym.benchmark import find_policy, run_scenario
from pter_gym.benchmark.boards import is_ranked

VALIDATE_EVERY = 16
"""Rollouts between two validations."""


def error(scores: PaceScores) -> float:
    """Return the geometric mean of the path errors at all paces [m]."""
    return geometric_mean(each["path_error_m"] for each in scores.values())


def main(
    seeds: tyro.conf.Positional[tuple[int, ...]],
    config: str | None = None,
    steps: int = 20_000_000,
    fresh: int = 1,
    stop: bool = False,
):
    """Print a row for each seed."""
    given = TrainingArguments(
        algorithm="ppo",
        scenario="standard",
        pace="all",
        steps=steps,
        seed=0,
        settings=load_settings("ppo", config),
    )
    episodes = validation_episodes(given)
    known = error(validate(find_policy("ppo-standard"), episodes))
    reached: list[tuple[float, ...]] = []
    for seed in seeds:
        model = PPO(replace(given, seed=seed))
        model.advance()  # compiles
        spent, rank, good = 0.0, math.inf, math.inf
        while model.steps < steps and not (stop and good < math.inf):
            began = perf_counter()
            model.advance()
            spent += perf_counter() - began
            if not model.steps // model.rollout % VALIDATE_EVERY and good == math.inf:
                scores = validate(model.policy(), episodes)
                if all(map(is_ranked, scores.values())):
                    rank = min(rank, spent)
                    good = spent if error(scores) <= known else good
        policies = {"mine": model.policy(), "ppo-standard": "ppo-standard"}
        runs = run_scenario("standard", policies, seed=fresh)
        mine, shipped = (
            [1e3 * float(run.scores["path_error_m"].mean()) for run in runs if run.policy == name]
            for name in policies
        )
        reached.append((rank, good, spent, *mine))
        row, usual = (" / ".join(f"{each:.2f}" for each in errors) for errors in (mine, shipped))
        print(
            f"{seed}: rank {rank:.0f} s, as good {good:.0f} s, {spent:.0f} s: {row} mm for {usual}",
            flush=True,
        )
    middle = [median(column) for column in zip(*reached, strict=True)]
    print(
        "median: rank {:.0f} s, as good {:.0f} s, {:.0f} s: {:.2f} / {:.2f} / {:.2f} mm".format(
            *middle
        )
    )


if __name__ == "__main__":
    tyro.cli(main)
