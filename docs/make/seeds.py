"""Train one policy from several seeds, run each on the stored episodes, and put what comes out into docs/agents.md.

    OMP_NUM_THREADS=1 NUMBA_NUM_THREADS=1 python docs/make/seeds.py RUNS
    python docs/make/seeds.py RUNS --no-train

RUNS holds a folder for each run. A run that is finished is not repeated, and one that was stopped goes on. Needs the
agents extra; 30 M steps of `ppo` take a quarter of an hour of one core.
"""

from pathlib import Path
from tempfile import TemporaryDirectory
from textwrap import fill
from typing import Any

import tyro
from ablations import finish, is_finished
from pages import AGENTS, put_block, table

from pter_agents.algorithms import load_settings
from pter_agents.exporting import export_run
from pter_agents.training import Arguments
from pter_gym.benchmark import PACES, leaderboards, run_scenario
from pter_gym.policies import load_policy

NAME = "seed"
SCORES = (("path_error_m", 1000.0, 1), ("completed", 100.0, 1), ("segment_pace_error", 100.0, 0))
HEADER = ["Seed", "Path error [mm]", "Arrives [%]", "Segments off [%]"]


def stored_scores(run: Path, scenario: str) -> list[dict[str, Any]]:
    """The scores of a run's policy on the stored episodes, for each pace."""
    with TemporaryDirectory() as folder:
        export_run(run, Path(folder), name=NAME)
        boards = leaderboards(run_scenario(scenario, {NAME: load_policy(NAME, Path(folder))}))
    return [board.as_json()["policies"][NAME] for board in boards]


def row(seed: int, found: list[dict[str, Any]]) -> list[str]:
    """One line of the table."""
    cells = (
        ", ".join(f"{factor * scores[name]['value']:.{digits}f}" for scores in found) for name, factor, digits in SCORES
    )
    return [str(seed), *cells]


def main(
    runs: tyro.conf.Positional[Path],
    algorithm: str = "ppo",
    scenario: str = "standard",
    steps: int = 30_000_000,
    seeds: int = 5,
    train: bool = True,
    write: bool = True,
) -> None:
    """Train what is missing, unless told not to, and write the table of what is finished into the page, or print it."""
    rows: list[list[str]] = []
    for seed in range(seeds):
        folder = runs / f"{algorithm}-{scenario}-seed{seed}"
        given = Arguments(
            algorithm=algorithm,
            scenario=scenario,
            pace="all",
            steps=steps,
            seed=seed,
            settings=load_settings(algorithm),
        )
        if train:
            finish(folder, given)
        if is_finished(folder, given):
            rows.append(row(seed, stored_scores(folder, scenario)))
            print(f"seed {seed}: {folder}", flush=True)
    head = f"`{algorithm}` on `{scenario}`, {steps / 1e6:g} M steps, the stored episodes at {', '.join(PACES)} pace:"
    text = f"{fill(head, 120)}\n\n{table(HEADER, rows, '---')}"
    put_block(AGENTS, "seeds", text, write=write)


if __name__ == "__main__":
    tyro.cli(main)
