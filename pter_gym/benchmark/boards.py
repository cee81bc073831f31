"""Leaderboards: ranks on a scenario at a pace, and the table that ``pter benchmark`` prints."""

import itertools
import math
import textwrap
from collections.abc import Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from operator import attrgetter
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from rich.cells import cell_len, set_cell_size
from rich.console import Console

from pter_gym._version import __version__
from pter_gym.benchmark.cells import WIDTH, in_brackets, millimetres, percent, shorten
from pter_gym.benchmark.intervals import Interval, largest_rate, mean_interval
from pter_gym.benchmark.scores import CONFIDENCE, POLICY, SCORES, ScenarioRun, WorstHand
from pter_gym.errors import printable
from pter_gym.scenarios import SCENARIOS
from pter_gym.scenarios.paces import find_pace, title_of_pace
from pter_gym.tasks.path_following import Failure

COMPLETION = 0.99
"""Smallest share of completed episodes of a ranked policy."""

PACE_ERROR = 0.15
"""Largest mean of each of the two pace errors of a ranked policy."""

PACE_ERRORS = ("mean_pace_error", "segment_pace_error")
"""The scores that are these errors."""

EPISODE_SET = attrgetter("version", "scenario", "digest", "episodes", "seed", "failures")
"""What runs and leaderboards on the same episodes share, at whatever pace."""

PATH_ERROR = attrgetter("path_error_m")

DETAILS = {
    "worst 1/20": ("worst_path_error_m", 1e3),
    "rms": ("rms_error_m", 1e3),
    "off pace": ("mean_pace_error", 1e2),
    "segments": ("segment_pace_error", 1e2),
    "peak acc.": ("peak_acceleration_m_s2", 1.0),
}
"""Columns of ``--details``: a score of each and its factor from SI."""

DETAILS_NOTE = """\
worst 1/20: mean path error of the worst twentieth of the episodes [mm]
rms: root mean square of the distance from the path [mm]
off pace, segments: pace error of the whole path, and of its ten segments [%]
peak acc.: largest acceleration of the tip in an episode [m/s²]
"""

MIN_NAME = 12
"""Fewest characters of a policy's name in a table."""

INCOMPLETE, UNEVEN = "incomplete", "uneven"
"""Why a policy has no rank: it completes too few episodes, or its segments are off the pace."""

WHAT = {UNEVEN: "segments "}
"""What is off the pace, if not the whole path."""

SUPERSCRIPTS = str.maketrans("0123456789", "⁰¹²³⁴⁵⁶⁷⁸⁹")


class MissedLimit(NamedTuple):
    """Why a policy is not ranked: a word for the table, and the score that misses its limit."""

    word: str
    score: float

    def __str__(self) -> str:
        """Return the reason as a predicate."""
        if self.word == INCOMPLETE:
            share = percent(self.score, digits=4)
            return f"completes {share} of the episodes ({percent(COMPLETION)} needed)"
        off = f"{WHAT.get(self.word, '')}{percent(self.score)} off the pace"
        return f"is {self.word}: {off} ({percent(PACE_ERROR)} allowed)"


@dataclass(frozen=True)
class Standing:
    """One policy on a leaderboard.

    Attributes
    ----------
    policy
        Its name.
    rank
        From 1, by the mean path error; None if it is not ranked.
    reason
        Why it is not ranked.
    error
        Mean path error [m] with its interval.
    scores
        The mean of each score, and of the path error over the worst twentieth of the episodes.
    errors
        Path errors [m], (S, N) for S training seeds and N episodes.
    worst
        The worst hand for the training seed that has the worst, where one was searched.
    """

    policy: str
    rank: int | None
    reason: MissedLimit | None
    error: Interval
    scores: Mapping[str, float]
    errors: NDArray[np.float64] = field(compare=False, repr=False)
    worst: WorstHand | None = field(default=None, repr=False)

    def as_json(self) -> dict[str, Any]:
        """Return its entry in ``benchmark.json``, in SI."""
        reason = self.reason and str(self.reason)
        means = {name: mean for name, mean in self.scores.items() if name != "path_error_m"}
        entry = {"rank": self.rank, "reason": reason, "path_error_m": self.error._asdict(), **means}
        if self.worst:
            entry["worst_hand"] = self.worst.as_json()
        return entry


@dataclass(frozen=True)
class Leaderboard:
    """Policies on episodes of a scenario at a pace, ordered by their mean path error.

    ``seed`` is that of test episodes, None for the stored ones; ``version`` that of the package
    that made the runs; ``digest`` that of a user's scenario; ``strata`` labels of the episodes;
    ``failures`` what fails in all of them.
    """

    scenario: str
    pace: str
    episodes: int
    seed: int | None
    standings: tuple[Standing, ...]
    version: str = __version__
    digest: str = ""
    strata: tuple[str, ...] = field(default=(), compare=False, repr=False)
    failures: tuple[Failure, ...] = ()

    @property
    def title(self) -> str:
        """The episodes in words."""
        kind = "test episodes" if self.seed is None else f"test episodes (seed {self.seed})"
        return f"{self.scenario}, {self.episodes:,} {kind}"

    def as_json(self) -> dict[str, Any]:
        """Return this leaderboard's entry in ``benchmark.json``, in SI."""
        names = ("version", "scenario", "digest", "pace", "episodes", "seed")
        return {
            **{name: getattr(self, name) for name in names},
            "pace_m_s": find_pace(self.pace),
            "policies": {standing.policy: standing.as_json() for standing in self.standings},
        }


def leaderboards(runs: Iterable[ScenarioRun]) -> tuple[Leaderboard, ...]:
    """Return a leaderboard for each set of episodes and pace, the slowest first.

    The suite's scenarios come first, in their order. Runs of different versions of the package are
    kept apart. If a name denotes different policies at different paces, their digests become part
    of it.
    """
    groups: dict[tuple[Any, ...], list[ScenarioRun]] = {}
    for run in _told_apart(list(runs)):
        groups.setdefault((*EPISODE_SET(run), find_pace(run.pace)), []).append(run)
    places = {name: place for place, name in enumerate(SCENARIOS)}

    def order(group: tuple[Any, ...]) -> list[Any]:
        return [
            places.get(group[1], len(places)),
            *(-1 if part is None else part for part in group),
        ]

    return tuple(rank(groups[group]) for group in sorted(groups, key=order))


def _told_apart(runs: Sequence[ScenarioRun]) -> Iterator[ScenarioRun]:
    """Yield runs; policies that differ behind one name on a scenario get names of their own."""
    digests: dict[tuple[Any, ...], dict[str, list[str]]] = {}
    for run in runs:
        at_pace = digests.setdefault((*EPISODE_SET(run), run.policy), {})
        at_pace.setdefault(run.pace, []).append(run.origin.get(POLICY, "unknown"))
    for run in runs:
        at_pace = digests[*EPISODE_SET(run), run.policy]
        differ = len({tuple(sorted(each)) for each in at_pace.values()}) > 1
        known = min(at_pace[run.pace])
        yield replace(run, policy=f"{run.policy} ({known})") if differ else run


def rank(runs: Sequence[ScenarioRun]) -> Leaderboard:
    """Return the leaderboard of runs on one set of episodes at one pace.

    The training seeds of a policy count as one policy.
    """
    by_policy: dict[str, list[ScenarioRun]] = {}
    for run in runs:
        by_policy.setdefault(run.policy, []).append(run)
    ordered = sorted(
        map(_judge, by_policy.values()), key=lambda each: (each.error.value, each.policy)
    )
    places = itertools.count(1)
    standings = (each if each.reason else replace(each, rank=next(places)) for each in ordered)
    run = runs[0]
    return Leaderboard(
        run.scenario,
        run.pace,
        run.episodes,
        run.seed,
        tuple(standings),
        run.version,
        run.digest,
        run.strata,
        run.failures,
    )


def _judge(runs: Sequence[ScenarioRun]) -> Standing:
    """Return the standing of a policy, without its rank, from the runs of its training seeds."""
    names = [name for name in SCORES if all(name in run.scores for run in runs)]
    scores = {name: np.stack([run.scores[name] for run in runs]) for name in names}
    means, errors = mean_scores(scores), scores["path_error_m"]
    error = mean_interval(errors, runs[0].strata)
    reason = reason_unranked(scores, find_pace(runs[0].pace), runs[0].strata)
    worst = max((run.worst for run in runs if run.worst), key=PATH_ERROR, default=None)
    return Standing(runs[0].policy, None, reason, error, means, errors, worst)


def mean_scores(scores: Mapping[str, ArrayLike]) -> dict[str, float]:
    """Return the mean of each score over its episodes, (N,), or training seeds and these, (S, N).

    ``worst_path_error_m`` is the mean of the largest twentieth of all path errors.
    """
    means = {name: mean_of(values) for name, values in scores.items()}
    return {**means, "worst_path_error_m": worst_twentieth(scores["path_error_m"])}


def mean_of(values: ArrayLike) -> float:
    """Return the mean of all values."""
    return np.asarray(values, np.float64).mean().item()


def worst_twentieth(values: ArrayLike) -> float:
    """Return the mean of the largest ⌈n/20⌉ of n values."""
    ordered = np.sort(np.ravel(values))
    return float(ordered[-math.ceil(len(ordered) / 20) :].mean())


def over_limits(scores: Mapping[str, float]) -> dict[str, float]:
    """Return by how much the scores that a rank depends on are beyond their limits, ≤ 0 within."""
    return {
        "completed": COMPLETION - scores["completed"],
        **{name: scores[name] - PACE_ERROR for name in PACE_ERRORS},
    }


def is_ranked(means: Mapping[str, float]) -> bool:
    """Return whether mean scores are within the limits of a rank, whatever their intervals."""
    return all(excess <= 0.0 for excess in over_limits(means).values())


def reason_unranked(
    scores: Mapping[str, ArrayLike], pace: float, strata: Sequence[Hashable] = ()
) -> MissedLimit | None:
    """Return why a policy with these scores at a pace [m/s] is not ranked; None if it is.

    Scores and strata are as in ``mean_interval``. A mean is beyond its limit only if its whole
    interval is, so that other episodes would hardly rank another policy.
    """
    errors = {name: mean_interval(scores[name], strata) for name in PACE_ERRORS}
    at_best = {name: each.value if each.low is None else each.low for name, each in errors.items()}
    over = over_limits({"completed": largest_rate(scores["completed"]), **at_best})
    missed = next((name for name, excess in over.items() if excess > 0.0), None)
    if missed is None:
        return None
    if missed == "completed":
        return MissedLimit(INCOMPLETE, mean_of(scores["completed"]))
    off = mean_of(scores["mean_pace_m_s"]) / pace - 1.0
    word = "off pace" if abs(off) <= PACE_ERROR / 2 else "too fast" if off > 0 else "too slow"
    return MissedLimit(UNEVEN if missed == "segment_pace_error" else word, errors[missed].value)


# --- printing ---


def print_boards(runs: Iterable[ScenarioRun], *, details: bool = False) -> None:
    """Print a table for each scenario in the runs; with ``details``, more scores at each pace."""
    text = boards_text(leaderboards(runs), details=details)
    Console(highlight=False).out(printable(text))


def boards_text(boards: Sequence[Leaderboard], *, details: bool = False) -> str:
    """Return leaderboards as text for 80 columns: a table for each scenario, then details."""
    tables: list[str] = []
    for _, same in itertools.groupby(boards, EPISODE_SET):
        at_paces = list(same)
        tables += [_table(at_paces), *_worst(at_paces)]
        tables += map(_details, at_paces) if details else []
    return "\n".join([*tables, *([DETAILS_NOTE] if details else [])])


def others_text(there: Iterable[ScenarioRun], shown: Sequence[ScenarioRun]) -> str:
    """Return a note on runs of the same episodes beside those that are shown, or nothing."""
    known = {(run.policy, run.pace) for run in shown}
    others: dict[str, dict[str, None]] = {}
    for run in there:
        if EPISODE_SET(run) == EPISODE_SET(shown[0]) and (run.policy, run.pace) not in known:
            others.setdefault(run.policy, {})[run.pace] = None
    listed = "; ".join(f"{name} at {', '.join(paces)}" for name, paces in others.items())
    return _fill(f"Also in the folder, of other commands: {listed}.") if others else ""


def in_order(boards: Sequence[Leaderboard]) -> dict[str, list[Standing | None]]:
    """Return the standing of each policy at each pace of a scenario, in the order of the table.

    It is that of the mean path error over the paces; policies that lack a pace come last.
    """
    at_paces = [{each.policy: each for each in board.standings} for board in boards]
    names = dict.fromkeys(name for standings in at_paces for name in standings)
    rows = {name: [standings.get(name) for standings in at_paces] for name in names}

    def place(name: str) -> tuple[bool, float, str]:
        errors = [each.error.value for each in rows[name] if each]
        return len(errors) < len(boards), sum(errors) / len(errors), name

    return {name: rows[name] for name in sorted(names, key=place)}


def _table(boards: Sequence[Leaderboard]) -> str:
    """Return the table of a scenario, with a column for each pace, and the notes below it."""
    rows = in_order(boards)
    footnotes: dict[tuple[str, str], list[str]] = {}
    for name, standings in rows.items():
        for board, standing in zip(boards, standings, strict=True):
            if standing and standing.reason and standing.reason.word != INCOMPLETE:
                shares = footnotes.setdefault((name, standing.reason.word), [])
                shares.append(f"{percent(standing.reason.score)} ({board.pace})")
    marks = {key: str(k).translate(SUPERSCRIPTS) for k, key in enumerate(footnotes, start=1)}
    columns = [
        _column(title_of_pace(board.pace), [_cell(each[k], marks) for each in rows.values()])
        for k, board in enumerate(boards)
    ]
    numbers = itertools.count(1)
    places = [
        next(numbers) if any(each and each.rank for each in standings) else "–"
        for standings in rows.values()
    ]
    notes = [_completion(rows)]
    for (name, word), shares in footnotes.items():
        off = f"{WHAT.get(word, '')}{', '.join(shares)} off the pace"
        notes.append(f"{marks[name, word]} {name} is {word}: {off}; {percent(PACE_ERROR)} allowed.")
    if any(each and len(each.errors) > 1 for standings in rows.values() for each in standings):
        notes.append("Intervals are over training seeds for policies that have several.")
    lines = _lines(["   ", *(f"{place:>2} " for place in places)], ["", *rows], columns)
    title = f"{boards[0].title}: path error [mm], 95 % interval"
    return "\n".join([title, "", *lines, "", *map(_fill, notes), ""])


def _fill(note: str) -> str:
    """Return a sentence in lines, none of which begins with a unit."""
    text = textwrap.fill(
        note.replace(" %", "\0%"), WIDTH, subsequent_indent="  ", break_on_hyphens=False
    )
    return text.replace("\0", " ")


def _worst(boards: Sequence[Leaderboard]) -> list[str]:
    """Return the table of the worst hands, if they were searched for."""
    found = [each.worst for board in boards for each in board.standings if each.worst]
    if not found:
        return []
    rows = {
        name: [each.worst if each else None for each in standings]
        for name, standings in in_order(boards).items()
        if any(each and each.worst for each in standings)
    }
    columns = [
        _column(title_of_pace(board.pace), [_worst_cell(each[k]) for each in rows.values()])
        for k, board in enumerate(boards)
    ]
    one = found[0]
    title = f"{boards[0].scenario}, worst hand found in {one.tried:,} episodes: path error [mm]"
    note = (
        f"In brackets, the largest error of {one.random:,} random episodes: with "
        f"{percent(CONFIDENCE)} confidence at most one in {one.one_in:,} is worse. The error "
        "found is a lower bound on the largest one."
        if one.tried > 1
        else "The scenario has only one episode."
    )
    lines = _lines([""] * (1 + len(rows)), ["", *rows], columns)
    return ["\n".join([title, "", *lines, "", _fill(note), ""])]


def _worst_cell(worst: WorstHand | None) -> tuple[str, str]:
    """Return the error with the worst hand, and with the worst random one, as texts."""
    if worst is None:
        return "", ""
    return millimetres(worst.path_error_m), f" ({millimetres(worst.random_error_m)})"


def _details(board: Leaderboard) -> str:
    """Return the table of further scores at a pace."""
    standings = [rows[0] for rows in in_order([board]).values() if rows[0]]
    columns: list[list[str]] = []
    for title, (score, factor) in DETAILS.items():
        texts = [title, *(f"{factor * each.scores[score]:.1f}" for each in standings)]
        columns.append([text.rjust(max(map(len, texts))) for text in texts])
    names = [title_of_pace(board.pace), *(each.policy for each in standings)]
    return "\n".join([*_lines([""] * len(names), names, columns), ""])


def _completion(rows: Mapping[str, Sequence[Standing | None]]) -> str:
    """Return one sentence on how many of the episodes are completed."""
    shares: list[str] = []
    for name, standings in rows.items():
        completed = [each.scores["completed"] for each in standings if each]
        low, high = (f"{100 * end(completed):.4g}" for end in (min, max))
        if min(completed) < 1.0:
            shares.append(f"{name} {low if low == high else f'{low} to {high}'} %")
    if not shares:
        return "All policies complete all episodes."
    others = ", all others 100 %" if len(shares) < len(rows) else ""
    needed = f"a rank needs {percent(COMPLETION)} within the 95 % interval"
    return f"Completed episodes: {', '.join(shares)}{others}; {needed}."


def _cell(standing: Standing | None, marks: Mapping[tuple[str, str], str]) -> tuple[str, str]:
    """Return a mean path error, and its interval or why it has no rank, as texts."""
    if standing is None:
        return "", ""
    decimals = 1 if standing.error.value < 0.01995 else 0
    error, ends = in_brackets(standing.error, decimals)
    if reason := standing.reason:
        mark = marks.get((standing.policy, reason.word), "")
        return error if standing.scores["completed"] else "–", f"  {reason.word} {mark}"
    return error, ends


def _column(title: str, cells: Sequence[Sequence[str]]) -> list[str]:
    """Return a column of errors with what follows each of them, aligned between the two."""
    longest = max(len(error) for error, _ in cells)
    return [title, *(f"{error:>{longest}}{rest}".rstrip() for error, rest in cells)]


def _lines(
    starts: Sequence[str], names: Sequence[str], columns: Sequence[Sequence[str]]
) -> list[str]:
    """Return a table; names that leave too little room for the columns lose their middle."""
    widths = [max(map(len, column)) for column in columns]
    free = WIDTH - sum(widths) - len(starts[0])
    gap = 2 if free - 2 * len(widths) >= max(map(cell_len, names)) else 1
    labels = [shorten(name, max(MIN_NAME, free - gap * len(widths))) for name in names]
    longest = max(map(cell_len, labels))
    labels = [set_cell_size(label, longest) for label in labels]
    return [
        (" " * gap)
        .join([start + set_cell_size(label, longest), *map(str.ljust, cells, widths)])
        .rstrip()
        for start, label, cells in zip(starts, labels, zip(*columns, strict=True), strict=True)
    ]
