"""Train `ppo` with other inputs, and put what comes out into docs/agents.md.

    OMP_NUM_THREADS=1 NUMBA_NUM_THREADS=1 nice python docs/make/ablations.py RUNS
    python docs/make/ablations.py RUNS --no-train

RUNS holds a folder for each run. A run that is finished is not repeated, and one that was stopped goes on. Needs the
agents extra; a run of 3 M steps takes one to two minutes of one core.
"""

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from textwrap import fill
from typing import Any

import tyro
from pages import AGENTS, put_block

from pter_agents.algorithms import load_settings
from pter_agents.training import PROGRESS, RUN, Arguments, RunFolder, check_same
from pter_agents.training import train as train_run
from pter_gym.benchmark import PACES

EPISODES = 128

VARIANTS: dict[str, dict[str, Any]] = {
    "torque sensors, as usual": {},
    "encoders alone": {"blind": ("torque",)},
    "torque and force sensors": {"sensors": "force"},
    "force sensors": {"sensors": "force", "blind": ("torque",)},
    "torque sensors, no history": {"history": ()},
}
"""Hyper-parameters of each that are not the usual ones."""

Scores = dict[str, dict[str, float]]


def arguments(variant: str, scenario: str, seed: int, steps: int) -> Arguments:
    """What to train."""
    settings: Any = replace(load_settings("ppo"), **VARIANTS[variant])
    return Arguments(
        algorithm="ppo",
        scenario=scenario,
        pace="all",
        steps=steps,
        seed=seed,
        settings=settings,
        validation_episodes=EPISODES,
        validate_every=10_000,  # at the end alone
    )


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


def three(found: Sequence[Scores], name: str, factor: float, digits: int) -> str:
    """The mean over seeds at each pace."""
    means = (factor * sum(each[pace][name] for each in found) / len(found) for pace in PACES)
    return ", ".join(f"{mean:.{digits}f}" for mean in means)


def row(variant: str, found: Sequence[Scores]) -> str:
    """One line of the table."""
    cells = [
        three(found, "path_error_m", 1000.0, 1),
        three(found, "completed", 100.0, 0),
        three(found, "mean_pace_error", 100.0, 0),
        three(found, "segment_pace_error", 100.0, 0),
        "; ".join(three([each], "path_error_m", 1000.0, 1) for each in found),
    ]
    return f"| {variant} | {' | '.join(cells)} |\n"


def main(
    runs: tyro.conf.Positional[Path],
    scenario: str = "standard",
    steps: int = 3_000_000,
    seeds: int = 2,
    train: bool = True,
    write: bool = True,
) -> None:
    """Train what is missing, unless told not to, and write the table of what is finished into the page, or print it."""
    folders: dict[str, list[Path]] = {}
    for seed in range(seeds):  # one seed of all variants before the next
        for number, variant in enumerate(VARIANTS):
            folder, given = runs / f"{scenario}-{number}-seed{seed}", arguments(variant, scenario, seed, steps)
            if train:
                finish(folder, given)
            if is_finished(folder, given):
                folders.setdefault(variant, []).append(folder)
                print(f"{variant}, seed {seed}: {folder}", flush=True)
    head = (
        f"`ppo` on `{scenario}`, {steps / 1e6:g} M steps, {EPISODES} validation draws at each pace; means over the "
        "training seeds, from 0 on, at slow, medium and brisk pace:"
    )
    text = (
        f"{fill(head, 120)}\n\n| The network sees | Path error [mm] | Arrives [%] | Mean pace off [%] "
        "| Segments off [%] | Path error by seed [mm] |\n|---|---|---|---|---|---|\n"
    )
    for variant, own in folders.items():
        text += row(variant, [list(reached(folder).values())[-1] for folder in own])
    put_block(AGENTS, "ablations", text, write=write)


if __name__ == "__main__":
    tyro.cli(main)
