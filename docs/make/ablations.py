"""Train `ppo` with other hyper-parameters, five seeds each, and put what comes out into docs/agents.md.

    NUMBA_NUM_THREADS=1 nice python docs/make/ablations.py RUNS
    python docs/make/ablations.py RUNS --no-train

RUNS holds a folder for each run. A run that is finished is not repeated, and one that was stopped goes on. The scores
are of validation draws, since the benchmark takes no policy with other sensors. Needs the agents extra.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from statistics import median
from textwrap import fill
from typing import Any

import tyro
from pages import AGENTS, put_block, table

from pter_agents.algorithms import load_settings
from pter_agents.training import PROGRESS, RUN, Arguments, RunFolder, check_same
from pter_agents.training import train as train_run
from pter_gym.benchmark.ranking import COMPLETION, PACE_ERROR
from pter_gym.benchmark.statistics import bootstrap_interval, mean
from pter_gym.scenarios import PACES

EPISODES = 128

VARIANTS: dict[str, dict[str, Any]] = {
    "as usual": {},
    "encoders alone": {"blind": ("torque",)},
    "torque and force sensors": {"sensors": "force"},
    "sensors 20 ms late": {"delay": 2},
    "what was 1 and 3 control steps ago, too": {"history": (1, 3)},
    "noise that is new at each step": {"persistence": 0.0, "deviation": 0.57, "deviation_end": 0.11},
    "starts at rest alone": {"starts": "rest"},
}
"""Hyper-parameters of each that are not the usual ones. White noise has the deviation that lasting noise comes to."""

HEADER = ["Variant", "Path error [mm]", "95 % interval of the mean [mm]", "Ranks", "Medium pace by seed [mm]"]

Scores = dict[str, dict[str, float]]


def arguments(algorithm: str, settings: Any, scenario: str, steps: int, seed: int) -> Arguments:
    """What to train."""
    return Arguments(
        algorithm=algorithm,
        scenario=scenario,
        pace="all",
        steps=steps,
        seed=seed,
        settings=settings,
        validation_episodes=EPISODES,
        validate_every=10_000,  # at the end alone
    )


def results(planned: Mapping[tuple[str, Path], Arguments], *, train: bool) -> dict[str, list[Scores]]:
    """Train what is missing of runs by name and folder, unless told not to; return the last scores of finished ones."""
    found: dict[str, list[Scores]] = {}
    for (name, folder), given in planned.items():
        if train:
            finish(folder, given)
        if is_finished(folder, given):
            found.setdefault(name, []).append(list(reached(folder).values())[-1])
            print(f"{name}, seed {given.seed}: {folder}", flush=True)
    return found


def finish(folder: Path, given: Arguments) -> None:
    """Train unless that was done."""
    if not is_finished(folder, given):
        train_run(given, folder, resume=(folder / RUN).exists())


def is_finished(folder: Path, given: Arguments) -> bool:
    """Whether a run has all its steps; one with other hyper-parameters is refused."""
    if (folder / RUN).exists():
        check_same(RunFolder(folder).read()[0], given)
    return int(max(reached(folder), key=int, default="0")) >= given.steps


def reached(folder: Path) -> dict[str, Scores]:
    """The scores of a run by its steps."""
    file = folder / PROGRESS
    return json.loads(file.read_text("utf-8")) if file.exists() else {}


def ranks(scores: dict[str, float]) -> bool:
    """Whether validation scores at a pace keep the leaderboard's limits."""
    off = max(scores["mean_pace_error"], scores["segment_pace_error"])
    return scores["completed"] >= COMPLETION and off <= PACE_ERROR


def row(variant: str, found: Sequence[Scores]) -> list[str]:
    """One line of the table: medians and intervals over the seeds at each pace."""
    errors = {pace: [1000.0 * each[pace]["path_error_m"] for each in found] for pace in PACES}
    intervals = [bootstrap_interval(each, mean) for each in errors.values()]
    ranked = sum(all(ranks(each[pace]) for pace in PACES) for each in found)
    return [
        variant,
        ", ".join(f"{median(each):.1f}" for each in errors.values()),
        ", ".join(f"{low:.1f} … {high:.1f}" for _, low, high in intervals),
        f"{ranked} of {len(found)}",
        ", ".join(f"{each:.1f}" for each in errors["medium"]),
    ]


def main(
    runs: tyro.conf.Positional[Path],
    scenario: str = "standard",
    steps: int = 5_000_000,
    seeds: int = 5,
    train: bool = True,
    write: bool = True,
) -> None:
    """Train what is missing, unless told not to, and write the table of what is finished into the page, or print it."""
    changed: dict[str, Any] = {name: replace(load_settings("ppo"), **change) for name, change in VARIANTS.items()}
    planned = {
        (name, runs / f"{scenario}-{number}-seed{seed}"): arguments("ppo", settings, scenario, steps, seed)
        for seed in range(seeds)  # one seed of all variants before the next
        for number, (name, settings) in enumerate(changed.items())
    }
    found = results(planned, train=train)
    head = (
        f"`ppo` on `{scenario}`, {steps / 1e6:g} M steps, {seeds} seeds, {EPISODES} validation draws at each pace; "
        f"medians over the seeds at {', '.join(PACES)} pace, and how many seeds keep the limits of a rank at each:"
    )
    rows = [row(variant, scores) for variant, scores in found.items()]
    put_block(AGENTS, "ablations", f"{fill(head, 120)}\n\n{table(HEADER, rows, '---')}", write=write)


if __name__ == "__main__":
    tyro.cli(main)
