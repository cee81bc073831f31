"""Write the tables of docs/data.md.

    python docs/make/data_page.py [--data FOLDER] [--results RESULTS] [--train-missing]

FOLDER is that of `pter record`, RESULTS what the scripts of agents/stock/offline have written; with --train-missing
they run first for the seeds that are missing, about 25 minutes of a core for all. Without one of them its table stays,
and rows of other seeds do.
"""

import json
import os
import subprocess
import sys
from pathlib import Path

import tyro
from pages import ROOT, table, write_block
from stock_pages import put_results, read_page

from pter_gym.datasets import LEVELS, dataset_id
from pter_gym.datasets.files import CARD, DATA

PAGE = ROOT / "docs" / "data.md"
SCRIPTS = ROOT / "agents" / "stock" / "offline"
SCENARIOS = ("standard", "everything")
TRAINED = (("bc", "expert"), ("bc", "replay"), ("td3_bc", "replay"))
"""Algorithm, and level of the data."""

SEEDS = range(5)


def summary(data: Path, name: str) -> dict:
    """Return what the card of a data set says in front."""
    line = next(line for line in (data / name / CARD).read_text("utf-8").splitlines() if line.startswith("pter: "))
    return json.loads(line.removeprefix("pter: "))["summary"]


def shown(score: list[float], factor: float, digits: int) -> str:
    """Return a mean and its interval."""
    value, low, high = (f"{factor * each:.{digits}f}" for each in score)
    return f"{value} ({low} … {high})".replace("-", "−")


def sets_table(data: Path) -> str:
    """One line for each data set."""
    rows = []
    for name in (dataset_id(scenario, level) for scenario in SCENARIOS for level in LEVELS):
        found = summary(data, name)
        size = (data / name / "data" / DATA).stat().st_size / 1e6
        scores = (("mean_return", 1.0, 1), ("arrived", 100.0, 1), ("distance_m", 1000.0, 1))
        cells = [shown(found[score], factor, digits) for score, factor, digits in scores]
        rows.append([f"`{name}`", f"{found['steps']:,}", f"{found['episodes']:,}", *cells, f"{size:.0f}"])
    head = ["Data set", "Control steps", "Episodes", "Mean return", "Arrive [%]", "Distance [mm]", "MB"]
    return table(head, rows)


def train(data: Path, results: Path) -> None:
    """Let the scripts run for the seeds that are missing."""
    there = read_page(PAGE.read_text("utf-8"))
    for algorithm, level in TRAINED:
        for seed in SEEDS:
            if seed not in there.get(f"{algorithm.replace('_', '-')}-{level}", {}):
                script, name = SCRIPTS / f"{algorithm}.py", dataset_id("standard", level)
                command = [sys.executable, str(script), name, "--seed", str(seed), "--out", str(results)]
                subprocess.run(command, check=True, env={**os.environ, "MINARI_DATASETS_PATH": str(data)})


def main(data: Path | None = None, results: Path | None = None, train_missing: bool = False) -> None:
    """Write the tables of docs/data.md, each if there is what it is made from."""
    if data is not None:
        write_block(PAGE, "sets", sets_table(data))
    if train_missing and data is not None and results is not None:
        train(data, results)
    if results is not None:
        put_results(PAGE, results)


if __name__ == "__main__":
    tyro.cli(main)
