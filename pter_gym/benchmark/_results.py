"""A folder of results: one file for each run, and ``benchmark.json``, which is made again from all of them.

Files are written whole or not at all, so an interrupted benchmark goes on where it stopped, and several benchmarks may
write to one folder at once: each run has its own file, and the summary is read and written under a lock. A file that is
damaged, edited, copied or renamed is left out, with the reason, and does not affect the others.
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
    """A file that is left out, and why."""

    file: str
    reason: str


class Contents(NamedTuple):
    """What a folder holds: the runs that count, and the files that do not."""

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
        """Make the folder if need be, or raise a ParameterError if nothing can be written to it, or only elsewhere."""
        self._refuse_links("*", "runs/*")
        make_folder(self.path / "runs")

    def _refuse_links(self, *patterns: str) -> None:
        """Raise a ParameterError where a link would have something written to another place."""
        for each in (path for pattern in patterns for path in self.path.glob(pattern) if path.is_symlink()):
            raise ParameterError(f"results must be in a folder without symbolic links, {str(each)!r} is one")

    def use_up(self, scenario: str, fresh: int) -> None:
        """Note that code of others begins to ride the episodes of a seed; raise a ParameterError if any has before."""
        (self.path / "used").mkdir(exist_ok=True)
        try:
            (self.path / "used" / f"{scenario}{episodes_suffix(fresh)}").touch(exist_ok=False)
        except FileExistsError:
            raise ParameterError(
                f"fresh must be a seed of {scenario!r} that no isolated policy has ridden, even in a run that failed; "
                f"{fresh} is used up in {str(self.path)!r}"
            ) from None

    def find(self, conditions: Conditions) -> ScenarioRun | None:
        """Return the finished run under just these conditions, or None; there is none without an identity."""
        try:
            run = read_run(run_path(self.path, conditions))
        except DataError:
            return None
        return run if conditions.identity is not None and run.conditions == conditions else None

    def add(self, run: ScenarioRun) -> None:
        """Keep a run; one under the same names is replaced."""
        write_run(self.path, run)

    def end_seeds(self, conditions: Conditions) -> None:
        """Delete the runs of training seeds from this one on: they are of an earlier policy of the same name."""
        while (path := run_path(self.path, conditions)).is_file():
            path.unlink(missing_ok=True)
            conditions = replace(conditions, seed=conditions.seed + 1)

    def read(self) -> Contents:
        """Return the runs that count, and each other file with the reason why it does not."""
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
    """Return a file that is left out; a name that no terminal can print is written in ASCII."""
    short = reason if len(reason) <= LONGEST else f"{reason[:LONGEST]}…"
    return LeftOut(*(text if text.isprintable() else ascii(text) for text in (file, short)))
