"""A folder of results: one file for each run, and ``benchmark.json``, rebuilt from all of them.

Files are written atomically, so an interrupted benchmark resumes where it stopped, and several benchmarks may write to
one folder at once: each run has its own file, and the summary is read and written under a lock. A damaged, edited,
copied or renamed file is left out, with the reason, and does not affect the others.
"""

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

from pter_gym._internal.files import FilePath, find_path, write_text_atomic
from pter_gym._internal.locks import locked
from pter_gym._internal.terminal import make_folder
from pter_gym.benchmark._gaps import find_gaps
from pter_gym.benchmark._run_files import episodes_suffix, read_run, run_path, write_run
from pter_gym.benchmark._runs import Conditions, ScenarioRun, code_digest, without_copies
from pter_gym.benchmark.leaderboard import Leaderboard, leaderboards
from pter_gym.benchmark.statistics import LEVEL, RESAMPLES, SEED
from pter_gym.errors import DataError, ParameterError

SUMMARY = "benchmark.json"
LOCK = ".lock"

LONGEST = 300
"""Most characters of a reason."""


class LeftOut(NamedTuple):
    """A file that was left out, and why."""

    file: str
    reason: str


class Contents(NamedTuple):
    """The content of a folder: the runs that count, and the files that do not."""

    runs: tuple[ScenarioRun, ...]
    left_out: tuple[LeftOut, ...]

    def as_json(self) -> dict[str, Any]:
        """Return what ``benchmark.json`` holds, in SI."""
        return {
            "code": code_digest(),
            "bootstrap": {"level": LEVEL, "resamples": RESAMPLES, "seed": SEED},
            "leaderboards": [board.as_json() for board in leaderboards(self.runs)],
            "gaps": [gap.as_json() for gap in find_gaps(self.runs)],
            "left_out": [each._asdict() for each in self.left_out],
        }


@dataclass(frozen=True)
class ResultsFolder:
    """A folder of results.

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
        self._refuse_links("*", "runs/*")
        make_folder(self.path / "runs")

    def _refuse_links(self, *patterns: str) -> None:
        """Raise a ParameterError if a link would redirect writes to another place."""
        for each in (path for pattern in patterns for path in self.path.glob(pattern) if path.is_symlink()):
            raise ParameterError(f"results must be in a folder without symbolic links, {str(each)!r} is one")

    def use_up(self, scenario: str, fresh: int) -> None:
        """Record that someone else's code starts on a seed's episodes; raise a ParameterError if any has before."""
        (self.path / "used").mkdir(exist_ok=True)
        try:
            (self.path / "used" / f"{scenario}{episodes_suffix(fresh)}").touch(exist_ok=False)
        except FileExistsError:
            raise ParameterError(
                f"fresh must be a seed of {scenario!r} that no isolated policy has ridden, even in a run that failed; "
                f"{fresh} is used up in {str(self.path)!r}"
            ) from None

    def find(self, conditions: Conditions) -> ScenarioRun | None:
        """Return the finished run under exactly these conditions, or None; None without an identity."""
        try:
            run = read_run(run_path(self.path, conditions))
        except DataError:
            return None
        return run if conditions.identity is not None and run.conditions == conditions else None

    def add(self, run: ScenarioRun) -> None:
        """Store a run, replacing one with the same names."""
        write_run(self.path, run)

    def end_seeds(self, conditions: Conditions) -> None:
        """Delete the runs of this and later training seeds: they are from an earlier policy of the same name."""
        while (path := run_path(self.path, conditions)).is_file():
            path.unlink(missing_ok=True)
            conditions = replace(conditions, seed=conditions.seed + 1)

    def read(self) -> Contents:
        """Return the runs that count, and every other file with the reason why it does not."""
        runs: list[ScenarioRun] = []
        left_out: list[LeftOut] = []
        for path in sorted((self.path / "runs").glob("*.json")):
            try:
                runs.append(read_run(path))
            except DataError as error:
                left_out.append(_left_out(path.name, str(error).removeprefix(f"{path.name}: ")))
        kept, copies = without_copies(runs)
        for run, seed in copies:
            left_out.append(_left_out(run_path(self.path, run.conditions).name, f"it is the policy of seed {seed}"))
        return Contents(kept, tuple(sorted(left_out)))

    def runs(self) -> tuple[ScenarioRun, ...]:
        """Return all runs that count."""
        return self.read().runs

    def summarise(self) -> tuple[Leaderboard, ...]:
        """Write ``benchmark.json`` from all runs in the folder and return its leaderboards."""
        self._refuse_links("*")
        with locked(self.path / LOCK):
            contents = self.read()
            write_text_atomic(self.summary, json.dumps(contents.as_json(), indent=2, allow_nan=False) + "\n")
        return leaderboards(contents.runs)


def _left_out(file: str, reason: str) -> LeftOut:
    """Return a left-out file; a name that a terminal cannot print is written in ASCII."""
    short = reason if len(reason) <= LONGEST else f"{reason[:LONGEST]}…"
    return LeftOut(*(text if text.isprintable() else ascii(text) for text in (file, short)))
