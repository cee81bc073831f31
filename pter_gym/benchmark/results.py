"""A folder of results: one file for each run, and ``benchmark.json``, which is made again from all of them.

Files are written whole or not at all, so an interrupted benchmark goes on where it stopped, and several benchmarks may
write to one folder at once: each run has its own file, and the summary is read and written under a lock.
"""

import json
from dataclasses import dataclass
from pathlib import Path

from filelock import FileLock

from pter_gym.benchmark.leaderboard import Leaderboard, leaderboards
from pter_gym.benchmark.runs import Conditions, ScenarioRun, code_digest, read_run, run_path, write_run
from pter_gym.benchmark.statistics import LEVEL, RESAMPLES, SEED
from pter_gym.internal.files import write_text_atomic
from pter_gym.internal.terminal import make_folder

SUMMARY = "benchmark.json"
LOCK = ".lock"


@dataclass(frozen=True)
class ResultsFolder:
    """A folder of results.

    Attributes
    ----------
    path
        Where it is.
    """

    path: Path

    @property
    def summary(self) -> Path:
        """The file with all leaderboards."""
        return self.path / SUMMARY

    def make(self) -> None:
        """Make the folder if need be, or raise a ParameterError if it cannot be written to."""
        make_folder(self.path / "runs")

    def find(self, conditions: Conditions) -> ScenarioRun | None:
        """Return the finished run under just these conditions, or None."""
        if conditions.key is None:
            return None
        run = read_run(run_path(self.path, conditions))
        return run if run is not None and run.conditions == conditions else None

    def add(self, run: ScenarioRun) -> None:
        """Keep a run; one under the same names is replaced."""
        write_run(self.path, run)

    def runs(self) -> tuple[ScenarioRun, ...]:
        """Return all runs that were made with the present code."""
        found = (read_run(path) for path in sorted((self.path / "runs").glob("*.json")))
        return tuple(run for run in found if run is not None and run.conditions.code == code_digest())

    def summarise(self) -> tuple[Leaderboard, ...]:
        """Write ``benchmark.json`` from all runs in the folder and return its leaderboards."""
        with FileLock(self.path / LOCK):
            runs = self.runs()
            boards = leaderboards(runs)
            used = {path.name for path in (run_path(self.path, run.conditions) for run in runs)}
            content = {
                "bootstrap": {"level": LEVEL, "resamples": RESAMPLES, "seed": SEED},
                "leaderboards": [board.as_json() for board in boards],
                "left_out": sorted(p.name for p in (self.path / "runs").glob("*.json") if p.name not in used),
            }
            write_text_atomic(self.summary, json.dumps(content, indent=2, allow_nan=False) + "\n")
        return boards
