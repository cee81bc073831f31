"""The leaderboard: policies in order of rank, as a table and as JSON."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from rich.markup import escape
from rich.table import Table

from pter_gym._internal.terminal import terminal
from pter_gym._version import __version__
from pter_gym.benchmark._runs import ScenarioRun
from pter_gym.benchmark.episodes import DERIVED
from pter_gym.benchmark.ranking import COMPLETION, PACE_ERROR, Standing, find_standings
from pter_gym.scenarios import PACES

__all__ = ["COMPLETION", "FULL", "PACE_ERROR", "Leaderboard", "leaderboards", "rank", "table"]

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
    Column("completed", "at the\nend\n\\[%]", 100.0, "{:.3g}"),
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
    episodes, data
        How many of the episodes were run, and the SHA-256 of all of them; None where each policy has its own.
    config_hash
        SHA-256 of everything that the scores depend on except the policies.
    standings
        One per policy.
    fresh
        Seed of fresh episodes, or ``derived``; None for the stored ones.
    """

    scenario: str
    pace: str
    episodes: int
    data: str | None
    config_hash: str
    standings: tuple[Standing, ...]
    fresh: int | str | None = None

    @property
    def provisional(self) -> bool:
        """Whether there are too few episodes for final ranks."""
        return self.episodes < FULL

    def has_episodes_of(self, run: ScenarioRun) -> bool:
        """Tell whether a run, at whatever pace, had the same episodes."""
        at = run.conditions
        mine = (self.scenario, self.episodes, self.data, self.fresh)
        return mine == (at.scenario, at.episodes, at.shared_data, at.fresh)

    def as_json(self) -> dict[str, Any]:
        """Return this leaderboard's entry in ``benchmark.json``, in SI."""
        return {
            "scenario": self.scenario,
            "pace": self.pace,
            "pace_m_s": PACES[self.pace],
            "episodes": self.episodes,
            "episodes_sha256": self.data,
            "fresh": self.fresh,
            "version": __version__,
            "config_hash": self.config_hash,
            "provisional": self.provisional,
            "policies": {standing.policy: standing.as_json() for standing in self.standings},
        }


def leaderboards(runs: Sequence[ScenarioRun]) -> tuple[Leaderboard, ...]:
    """Return a leaderboard for each scenario, pace and set of episodes in runs of the same code."""
    groups: dict[tuple[str, float, int, str, str], list[ScenarioRun]] = {}
    for run in runs:
        at = run.conditions
        fresh = "" if at.fresh is None else str(at.fresh)
        groups.setdefault((at.scenario, PACES[at.pace], at.episodes, fresh, at.shared_data or ""), []).append(run)
    return tuple(rank(groups[place]) for place in sorted(groups))


def rank(runs: Sequence[ScenarioRun]) -> Leaderboard:
    """Return the leaderboard of runs on one set of episodes at one pace; a policy's training seeds count as one."""
    at = runs[0].conditions
    standings = find_standings(runs)
    return Leaderboard(at.scenario, at.pace, at.episodes, at.shared_data, at.config_hash, standings, at.fresh)


def table(board: Leaderboard) -> Table:
    """Return a leaderboard for an 80-column terminal, with 95 % intervals, and below it why others are not ranked."""
    kind = "provisional, " if board.provisional else ""
    which = "episodes" if board.fresh is None else f"fresh episodes, {seed_text(board.fresh)}"
    notes = [f"– {each.policy}: {each.reason}{_distance(each)}" for each in board.standings if each.reason]
    notes += [
        f"{standing.policy}: {p.rollouts:,} plans of {p.horizon_s:g} s, {p.decision_ms:.1f} ms a decision"
        for standing in board.standings
        if (p := standing.planning)
    ]
    shown = plain_table(
        f"{board.scenario}, {board.pace} ({PACES[board.pace]:g} m/s), {kind}{board.episodes} {which}",
        ["#", "policy", *(column.title for column in COLUMNS)],
        caption=escape("\n".join(notes)),
        caption_justify="left",
    )
    for standing in board.standings:
        place = "–" if standing.rank is None else str(standing.rank)
        texts = [_cell(standing, column) for column in COLUMNS]
        shown.add_row(place, escape(standing.label), *texts)
    return shown


def _never_arrives(standing: Standing) -> bool:
    return standing.scores["completed"].value == 0.0


def _distance(standing: Standing) -> str:
    """Return how far the tip moves under a policy that never arrives."""
    way = standing.scores["path_length_m"].value
    return f"; its tip moves {way:.2g} m on average" if _never_arrives(standing) else ""


def _cell(standing: Standing, column: Column) -> str:
    """Return a score as the table shows it; path errors mean nothing if the policy never arrives."""
    if column.factor == MILLIMETRES and _never_arrives(standing):
        return "–"
    return column.text.format(*(column.factor * each for each in standing.scores[column.score]))


def seed_text(fresh: int | str) -> str:
    """Say which fresh episodes were run."""
    return "drawn for each policy" if fresh == DERIVED else f"seed {fresh}"


def plain_table(title: str, headers: Iterable[str], **options: Any) -> Table:
    """Return an empty, plain table for an 80-column terminal; numbers are right-aligned."""
    shown = Table(title=title, box=None, padding=(0, 1), collapse_padding=True, pad_edge=False, **options)
    for header in headers:
        shown.add_column(header, justify="left" if header in ("pace", "policy") else "right", no_wrap=True)
    return shown


def print_boards(runs: Sequence[ScenarioRun]) -> None:
    """Print the leaderboards of runs to the terminal."""
    for board in leaderboards(runs):
        terminal().print(table(board), "")
