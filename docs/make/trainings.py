"""Trainings with several seeds, for the tables of docs/agents.md. Needs the extra `agents`.

    NUMBA_NUM_THREADS=1 python docs/make/trainings.py ablations RUNS
    NUMBA_NUM_THREADS=1 python docs/make/trainings.py algorithms RUNS
    NUMBA_NUM_THREADS=1 python docs/make/trainings.py seeds RUNS [--algorithm residual --scenario all --seeds 5]

RUNS contains a folder for each run. What is missing there is trained first, and a run that was stopped goes on;
`--no-train` makes the table of what is finished.
"""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from statistics import median
from textwrap import fill
from typing import Any

import tyro
from pages import put_block, table

from pter_agents.algorithms import load_settings
from pter_agents.exporting import export_run
from pter_agents.training import PROGRESS, RUN, Arguments, RunFolder, check_same
from pter_agents.training import train as train_run
from pter_agents.worlds import ALL, MIXED
from pter_gym.benchmark import Leaderboard, leaderboards, run_scenario
from pter_gym.benchmark.ranking import COMPLETION, PACE_ERROR
from pter_gym.benchmark.statistics import bootstrap_interval, mean
from pter_gym.policies import read_policy
from pter_gym.scenarios import PACES

PAGE = "docs/agents.md"
DRAWS = 128
"""Validation draws at each pace behind a line of the first two tables."""

VARIANTS: dict[str, dict[str, Any]] = {
    "as usual": {},
    "encoders alone": {"blind": ("torque",)},
    "torque and force sensors": {"sensors": "force"},
    "sensors 20 ms late": {"delay": 2},
    "what was 1 and 3 control steps ago, too": {"history": (1, 3)},
    "noise that is new at each step": {"persistence": 0.0, "deviation": 0.57, "deviation_end": 0.11},
    "starts at rest alone": {"starts": "rest"},
}
"""Settings of `ppo` that differ from the usual ones. White noise has the deviation that lasting noise comes to."""

BESIDE = {"recurrent": 2_000_000, "sac": 200_000, "tqc": 200_000}
"""Control steps of the algorithms beside `ppo`, some minutes of one core each."""

Scores = dict[str, dict[str, float]]
"""By pace and score."""


def validated(run: Path) -> tuple[int, Scores]:
    """Return after how many steps a run was validated last, and its scores then."""
    file = run / PROGRESS
    found = json.loads(file.read_text("utf-8")) if file.exists() else {}
    steps = max(found, key=int, default="0")
    return int(steps), found.get(steps, {})


def finish(folder: Path, given: Arguments, *, train: bool) -> bool:
    """Train what is missing of a run, if that is wanted, and return whether it is finished."""
    begun = (folder / RUN).exists()
    if begun:
        check_same(RunFolder(folder).read()[0], given)
    if train and validated(folder)[0] < given.steps:
        train_run(given, folder, resume=begun)
    return validated(folder)[0] >= given.steps


def ranks(scores: Mapping[str, float]) -> bool:
    """Whether validation scores at a pace keep the leaderboard's limits."""
    off = max(scores["mean_pace_error"], scores["segment_pace_error"])
    return scores["completed"] >= COMPLETION and off <= PACE_ERROR


def validation_row(name: str, found: Sequence[Scores]) -> list[str]:
    """Medians and intervals over the seeds at each pace."""
    errors = {pace: [1000.0 * each[pace]["path_error_m"] for each in found] for pace in PACES}
    intervals = [bootstrap_interval(each, mean) for each in errors.values()]
    ranked = sum(all(ranks(each[pace]) for pace in PACES) for each in found)
    return [
        name,
        ", ".join(f"{median(each):.1f}" for each in errors.values()),
        ", ".join(f"{low:.1f} … {high:.1f}" for _, low, high in intervals),
        f"{ranked} of {len(found)}",
        ", ".join(f"{each:.1f}" for each in errors["medium"]),
    ]


def validation_table(first: str, planned: Mapping[str, Sequence[tuple[Path, Arguments]]], *, train: bool) -> str:
    """Train what is missing, one seed of all names before the next, and return a line for each name."""
    found: dict[str, list[Scores]] = {name: [] for name in planned}
    for turn in zip(*planned.values(), strict=True):
        for name, (folder, given) in zip(planned, turn, strict=True):
            if finish(folder, given, train=train):
                found[name].append(validated(folder)[1])
    header = [first, "Path error [mm]", "95 % interval of the mean [mm]", "Seeds ranked", "Medium pace by seed [mm]"]
    return table(header, (validation_row(name, scores) for name, scores in found.items() if scores), "---")


def arguments(algorithm: str, steps: int, seed: int, settings: Any) -> Arguments:
    """What to train on `standard`, validated at the end alone."""
    return Arguments(
        algorithm=algorithm,
        scenario="standard",
        pace="all",
        steps=steps,
        seed=seed,
        settings=settings,
        validation_episodes=DRAWS,
        validate_every=10_000,
    )


def ablations(
    runs: tyro.conf.Positional[Path], steps: int = 5_000_000, seeds: int = 5, train: bool = True, write: bool = True
) -> None:
    """`ppo` with other settings."""
    planned = {
        name: [
            (
                runs / f"standard-{number}-seed{seed}",
                arguments("ppo", steps, seed, replace(load_settings("ppo"), **change)),
            )
            for seed in range(seeds)
        ]
        for number, (name, change) in enumerate(VARIANTS.items())
    }
    head = (
        f"`ppo` on `standard`, {steps / 1e6:g} M steps, {seeds} seeds, {DRAWS} validation draws at each pace; medians "
        f"over the seeds at {', '.join(PACES)} pace, and how many seeds keep the limits of a rank at each:"
    )
    content = f"{fill(head, 120)}\n\n{validation_table('Variant', planned, train=train)}"
    put_block(PAGE, "ablations", content, write=write)


def algorithms(runs: tyro.conf.Positional[Path], seeds: int = 5, train: bool = True, write: bool = True) -> None:
    """The algorithms beside `ppo`, from scratch."""
    planned = {
        f"`{name}`, {steps / 1e6:g} M steps": [
            (runs / f"{name}-seed{seed}", arguments(name, steps, seed, load_settings(name))) for seed in range(seeds)
        ]
        for name, steps in BESIDE.items()
    }
    head = (
        f"`standard`, {seeds} seeds, {DRAWS} validation draws at each pace; medians over the seeds at "
        f"{', '.join(PACES)} pace, and how many seeds keep the limits of a rank at each:"
    )
    content = f"{fill(head, 120)}\n\n{validation_table('Algorithm', planned, train=train)}"
    put_block(PAGE, "algorithms", content, write=write)


def by_validation(run: Path) -> float:
    """The geometric mean over the paces of a run's path errors on validation draws [m]."""
    scores = validated(run)[1].values()
    return math.exp(sum(math.log(each["path_error_m"]) for each in scores) / len(scores))


def errors_on(boards: Sequence[Leaderboard], name: str) -> str:
    """The path errors of a policy [mm] on the leaderboards of a scenario, in brackets where it has no rank."""
    standings = [next(each for each in board.standings if each.policy == name) for board in boards]
    errors = [(f"{1000.0 * each.scores['path_error_m'].value:.1f}", each.rank is not None) for each in standings]
    return ", ".join(error if ranked else f"({error})" for error, ranked in errors)


def seeds(
    runs: tyro.conf.Positional[Path],
    algorithm: str = "ppo",
    scenario: str = "standard",
    steps: int = 20_000_000,
    seeds: int = 10,
    train: bool = True,
    write: bool = True,
) -> None:
    """One policy from several seeds, each on fresh episodes whose seed follows from it."""
    found: dict[str, Path] = {}
    for seed in range(seeds):
        folder, settings = runs / f"{algorithm}-{scenario}-{seed}", load_settings(algorithm)
        given = Arguments(algorithm=algorithm, scenario=scenario, pace="all", steps=steps, seed=seed, settings=settings)
        if finish(folder, given, train=train):
            found[folder.name] = folder
            export_run(folder, runs / "policies", name=folder.name)
    policies = {name: read_policy(name, runs / "policies") for name in found}
    scenarios = MIXED if scenario == ALL else (scenario,)
    boards = {each: leaderboards(run_scenario(each, policies, fresh="derived")) for each in scenarios}
    ordered = sorted(found, key=lambda name: by_validation(found[name]))
    middle = ordered[(len(ordered) - 1) // 2]
    told = ", ".join(f"{own[0].episodes} of `{each}`" for each, own in boards.items())
    head = (
        f"`pter train {algorithm} --scenario {scenario} --steps {steps}`: path errors in mm at {', '.join(PACES)} pace "
        f"on fresh episodes, {told}. In parentheses: not ranked. *Validation*: the geometric mean of the three path "
        "errors on training-side draws, by which the median seed is chosen."
    )
    rows: list[list[str]] = []
    for name, run in found.items():
        number = name.rpartition("-")[2]
        label = f"**{number}**, the median" if name == middle else number
        rows.append([label, *(errors_on(own, name) for own in boards.values()), f"{1000 * by_validation(run):.2f}"])
    content = f"{fill(head, 120)}\n\n{table(['Seed', *scenarios, 'Validation'], rows, '---')}"
    put_block(PAGE, f"seeds: {algorithm} {scenario}", content, write=write)


if __name__ == "__main__":
    tyro.extras.subcommand_cli_from_dict({each.__name__: each for each in (ablations, algorithms, seeds)})
