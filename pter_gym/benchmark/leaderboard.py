"""The leaderboard: policies in order of rank, as a table and as JSON."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from rich.markup import escape
from rich.table import Table

from pter_gym._internal.terminal import terminal
from pter_gym._version import __version__
from pter_gym.benchmark.ranking import Standing, find_standings
from pter_gym.benchmark.runs import ScenarioRun
from pter_gym.scenarios import PACES

FULL = 200
"""Fewest episodes for a rank that is not provisional."""


class Column(NamedTuple):
    """A score in the table: its title as ``rich`` prints it, its factor from SI, its text by value, low and high."""

    score: str
    title: str
    factor: float
    text: str


MILLIMETRES = 1000.0

COLUMNS = (
    Column("path_error_m", "path error\n\\[mm]", MILLIMETRES, "{:.1f} ({:.1f}…{:.1f})"),
    Column("worst_path_error_m", "worst\n1/20\n\\[mm]", MILLIMETRES, "{:.1f}"),
    Column("later_path_error_m", "after\n1/10\n\\[mm]", MILLIMETRES, "{:.1f}"),
    Column("rms_error_m", "rms\n\n\\[mm]", MILLIMETRES, "{:.1f}"),
    Column("completed", "completed\n\n\\[%]", 100.0, "{:.3g}"),
    Column("mean_pace_error", "mean\npace\n\\[±%]", 100.0, "{:.3g}"),
    Column("segment_pace_error", "segm.\npace\n\\[±%]", 100.0, "{:.3g}"),
)
"""The columns of the table after rank and policy."""


@dataclass(frozen=True)
class Leaderboard:
    """The policies on one set of episodes at one pace, the best first, unranked ones last.

    Attributes
    ----------
    scenario, pace
        Names.
    episodes
        How many of the scenario's episodes were run.
    seed
        Seed of fresh episodes; None for the stored ones.
    standings
        One per policy.
    version
        Of the package that made the runs.
    """

    scenario: str
    pace: str
    episodes: int
    seed: int | None
    standings: tuple[Standing, ...]
    version: str = __version__

    @property
    def provisional(self) -> bool:
        """Whether there are too few episodes for final ranks."""
        return self.episodes < FULL

    def has_episodes_of(self, run: ScenarioRun) -> bool:
        """Return whether a run, at whatever pace, had the same episodes."""
        mine = (self.version, self.scenario, self.episodes, self.seed)
        return mine == (run.version, run.scenario, run.episodes, run.seed)

    def as_json(self) -> dict[str, Any]:
        """Return this leaderboard's entry in ``benchmark.json``, in SI."""
        return {
            "version": self.version,
            "scenario": self.scenario,
            "pace": self.pace,
            "pace_m_s": PACES[self.pace],
            "episodes": self.episodes,
            "seed": self.seed,
            "provisional": self.provisional,
            "policies": {standing.policy: standing.as_json() for standing in self.standings},
        }


def leaderboards(runs: Sequence[ScenarioRun]) -> tuple[Leaderboard, ...]:
    """Return a leaderboard for each scenario, pace and set of episodes; runs of other versions are not mixed."""
    groups: dict[tuple[str, str, int, int, float], list[ScenarioRun]] = {}
    for run in runs:
        seed = -1 if run.seed is None else run.seed
        groups.setdefault((run.version, run.scenario, run.episodes, seed, PACES[run.pace]), []).append(run)
    return tuple(rank(groups[place]) for place in sorted(groups))


def rank(runs: Sequence[ScenarioRun]) -> Leaderboard:
    """Return the leaderboard of runs on one set of episodes at one pace; a policy's training seeds count as one."""
    run = runs[0]
    return Leaderboard(run.scenario, run.pace, run.episodes, run.seed, find_standings(runs), run.version)


def table(board: Leaderboard) -> Table:
    """Return a leaderboard for an 80-column terminal, with 95 % intervals, and below it why others are not ranked."""
    kind = "provisional, " if board.provisional else ""
    which = "episodes" if board.seed is None else f"fresh episodes, seed {board.seed}"
    notes = [f"– {each.policy}: {each.reason}" for each in board.standings if each.reason]
    shown = Table(
        title=f"{board.scenario}, {board.pace} ({PACES[board.pace]:g} m/s), {kind}{board.episodes} {which}",
        caption=escape("\n".join(notes)),
        caption_justify="left",
        box=None,
        padding=(0, 1),
        collapse_padding=True,
        pad_edge=False,
    )
    for header in ("#", "policy", *(column.title for column in COLUMNS)):
        shown.add_column(header, justify="left" if header == "policy" else "right", no_wrap=True)
    for standing in board.standings:
        place = "–" if standing.rank is None else str(standing.rank)
        shown.add_row(place, escape(standing.policy), *(_cell(standing, column) for column in COLUMNS))
    return shown


def _cell(standing: Standing, column: Column) -> str:
    """Return a score as the table shows it; path errors mean nothing if the policy never arrives."""
    if column.factor == MILLIMETRES and standing.scores["completed"].value == 0.0:
        return "–"
    return column.text.format(*(column.factor * each for each in standing.scores[column.score]))


def print_boards(runs: Sequence[ScenarioRun]) -> None:
    """Print the leaderboards of runs to the terminal."""
    for board in leaderboards(runs):
        terminal().print(table(board), "")
