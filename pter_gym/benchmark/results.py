"""A folder of results: a JSON file for each run, and ``benchmark.json``, the leaderboards of all of them."""

import json
import logging
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np

from pter_gym._internal.files import FilePath, find_path, write_text_atomic
from pter_gym._internal.reading import MOST_JSON, parse_json, read_bytes, reading
from pter_gym._internal.terminal import make_folder
from pter_gym.benchmark.leaderboard import Leaderboard, leaderboards
from pter_gym.benchmark.metrics import SCORES
from pter_gym.benchmark.runs import Sample, ScenarioRun
from pter_gym.benchmark.statistics import LEVEL, RESAMPLES
from pter_gym.errors import DataError, ParameterError

SUMMARY = "benchmark.json"

NAMES = ("version", "scenario", "pace", "policy", "training_seed", "seed")
"""What a file says about a run, beside its numbers."""


@dataclass(frozen=True)
class ResultsFolder:
    """A folder of results.

    Files are written atomically, and several benchmarks may write to one folder at once.

    Attributes
    ----------
    path
        Where it is.
    """

    path: Path

    def __init__(self, path: FilePath) -> None:
        object.__setattr__(self, "path", find_path("path", path))

    @property
    def summary(self) -> Path:
        """The file with all leaderboards."""
        return self.path / SUMMARY

    def make(self) -> None:
        """Make the folder if needed; raise a ParameterError if it is not writable, or if links lead elsewhere."""
        for path in (*self.path.glob("*"), *self.path.glob("runs/*")):
            if path.is_symlink():
                raise ParameterError(f"results must be in a folder without symbolic links, {str(path)!r} is one")
        make_folder(self.path / "runs")

    def add(self, runs: Sequence[ScenarioRun]) -> None:
        """Store the runs of all training seeds of one policy at one pace, replacing earlier ones of the same name."""
        for run in runs:
            write_run(self.path, run)
        number = len(runs)
        while (path := run_path(self.path, runs[0], number)).is_file():
            path.unlink(missing_ok=True)
            number += 1

    def files(self) -> tuple[Path, ...]:
        """Return the files of runs."""
        return tuple(sorted((self.path / "runs").glob("*.json")))

    def runs(self) -> tuple[ScenarioRun, ...]:
        """Return all runs; a file that cannot be read is left out, with a warning from the logger ``pter_gym``."""
        runs: list[ScenarioRun] = []
        for path in self.files():
            try:
                runs.append(read_run(path))
            except DataError as error:
                logging.getLogger("pter_gym").warning("left out %s", error)
        return tuple(runs)

    def summarise(self) -> tuple[Leaderboard, ...]:
        """Write ``benchmark.json`` from all runs in the folder and return its leaderboards."""
        self.make()
        boards = leaderboards(self.runs())
        content = {
            "intervals": {"level": LEVEL, "resamples": RESAMPLES},
            "leaderboards": [board.as_json() for board in boards],
        }
        write_text_atomic(self.summary, json.dumps(content, indent=2, allow_nan=False) + "\n")
        return boards


def run_path(folder: FilePath, run: ScenarioRun, training_seed: int | None = None) -> Path:
    """Return the file of a run in a folder of results, by default of its own training seed."""
    number = run.training_seed if training_seed is None else training_seed
    fresh = "" if run.seed is None else f"-seed{run.seed}"
    trained = f"-training{number}" if number else ""
    name = f"{run.scenario}-{run.pace}-{run.policy}-{run.episodes}{fresh}{trained}"
    return find_path("folder", folder) / "runs" / f"{quote(name, safe=' ')}.json"


def write_run(folder: FilePath, run: ScenarioRun) -> None:
    """Write a run to its file atomically, a line for each entry and each score."""
    content: dict[str, Any] = {
        **{name: getattr(run, name) for name in NAMES},
        "episodes": run.episodes,
        "strata": run.strata,
        **{name: run.scores[name].tolist() for name in SCORES},
        "samples": [
            {"episode": each.episode, "tip_m": each.tip.tolist(), "theta_rad": each.theta.tolist()}
            for each in run.samples
        ],
    }
    lines = (f"{json.dumps(name)}: {json.dumps(part, allow_nan=False)}" for name, part in content.items())
    write_text_atomic(run_path(folder, run), "{\n" + ",\n".join(lines) + "\n}\n")


def read_run(path: FilePath) -> ScenarioRun:
    """Return the run in a file.

    Raises
    ------
    DataError
        If the file cannot be read or holds something else; it names the file.
    """
    path = find_path("path", path)
    with reading(path.name):
        content = parse_json(read_bytes(path, MOST_JSON))
        run = ScenarioRun(
            **{name: content[name] for name in NAMES},
            strata=tuple(content["strata"]),
            scores={name: _numbers(content[name], (len(content["strata"]),), name) for name in SCORES},
            samples=tuple(
                Sample(each["episode"], *(_numbers(each[name], (-1, 2), name) for name in ("tip_m", "theta_rad")))
                for each in content["samples"]
            ),
        )
        if run_path(path.parents[1], run).name != path.name:
            raise ValueError(f"policy must be that of the file's name, got {run.policy!r:.200}")
        return run


def _numbers(values: Any, shape: tuple[int, ...], name: str) -> Any:
    """Return an array of numbers or of booleans, or raise a ValueError unless it has the shape."""
    array = np.array(values)
    if array.dtype.kind not in "bif" or array.ndim != len(shape) or array.shape[-1] != shape[-1]:
        raise ValueError(f"{name} must be numbers of the shape {shape}, got the shape {array.shape}")
    return array
