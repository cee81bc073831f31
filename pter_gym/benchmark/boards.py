"""Leaderboards: policies ranked by mean path error if they arrive and keep the pace, as tables and as JSON."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
from rich.markup import escape
from rich.table import Table

from pter_gym._internal.terminal import terminal
from pter_gym._version import __version__
from pter_gym.benchmark.intervals import (
    Array,
    Interval,
    Strata,
    difference_interval,
    interquartile_mean_interval,
    mean_interval,
    performance_profile,
    probability_of_improvement,
    rate_interval,
    worst_twentieth_interval,
)
from pter_gym.benchmark.scores import SCORES, ScenarioRun, Scores
from pter_gym.benchmark.tuned import TUNED
from pter_gym.scenarios import find_pace, title_of_pace

COMPLETION = 0.99
"""Fraction of completed episodes that a policy with a rank needs.

A policy is undecided if its interval holds this.
"""

LOST = 0.05
"""Path error [m] of the worst twentieth of the episodes from which on a policy ranks behind those
with less. So a policy that gets lost in one of twenty episodes ranks below all that never do."""

PACE_ERROR = 0.15
"""Largest pace errors of a policy with a rank, as means over the episodes."""

IN_TIMES = 1.5
"""Ratio of a mean pace to the commanded one, or its inverse, from which on it is told as a multiple."""

UNRANKED = "†"
"""Mark of a policy that is not ranked."""

PROFILED = (0.5, 1.0, 2.0)
"""Ratios to the best tuned law's error at which the table of the suite has the profile of a policy."""

FULL = 200
"""Fewest episodes for a rank that is not provisional."""


class BoardColumn(NamedTuple):
    """A score in the table: its title as ``rich`` prints it, its factor from SI, format, and if with interval."""

    score: str
    title: str
    factor: float = 1000.0
    text: str = ".1f"
    with_interval: bool = False


COLUMNS = (
    BoardColumn("path_error_m", "path error\n\\[mm]", with_interval=True),
    BoardColumn("worst_path_error_m", "worst\n1/20\n\\[mm]"),
    BoardColumn("later_path_error_m", "after\n1/10\n\\[mm]"),
    BoardColumn("rms_error_m", "rms\n\n\\[mm]"),
    BoardColumn("completed", "com-\npleted\n\\[%]", 100.0, ".3g"),
    BoardColumn("mean_pace_error", "mean\npace\n\\[±%]", 100.0),
    BoardColumn("segment_pace_error", "segm.\npace\n\\[±%]", 100.0),
)
"""The columns of the table after rank and policy."""


@dataclass(frozen=True)
class Standing:
    """One policy on a leaderboard.

    Attributes
    ----------
    policy
        Its name.
    rank
        From 1, or None if not ranked; policies share a rank if the interval of their difference
        contains 0.
    reason
        Why it is not ranked, in words.
    undecided
        Whether it has a rank but may miss ``COMPLETION``, which is in the interval of its completed
        episodes.
    scores
        Scores over all episodes, as ``summarise`` returns them.
    errors
        Path errors [m], (S, N) for S training seeds and N episodes.
    difference, probability
        Path error minus the best policy's [m], and the probability of a smaller one on the same
        episode; None without a best policy.
    """

    policy: str
    rank: int | None
    reason: str | None
    undecided: bool
    scores: dict[str, Interval]
    errors: Array = field(compare=False, repr=False)
    difference: Interval | None = None
    probability: Interval | None = None

    @property
    def lost(self) -> bool:
        """Whether it strays so far in the worst twentieth of the episodes that it ranks behind policies that do not."""
        return self.scores["worst_path_error_m"].value >= LOST

    def as_json(self) -> dict[str, Any]:
        """Return its entry in ``benchmark.json``, in SI."""
        return {
            "rank": self.rank,
            "reason": self.reason,
            "undecided": self.undecided,
            **{name: interval._asdict() for name, interval in self.scores.items()},
            "difference_to_best_m": self.difference and self.difference._asdict(),
            "probability_of_improvement": self.probability and self.probability._asdict(),
        }


@dataclass(frozen=True)
class Leaderboard:
    """The policies, the best first and unranked ones last, on so many episodes of a scenario at a
    pace.

    ``seed`` is that of fresh episodes, None for the stored ones; ``version`` that of the package
    that made the runs; ``digest`` that of a scenario of one's own.
    """

    scenario: str
    pace: str
    episodes: int
    seed: int | None
    standings: tuple[Standing, ...]
    version: str = __version__
    digest: str = ""

    @property
    def provisional(self) -> bool:
        """Whether there are too few episodes for final ranks."""
        return self.episodes < FULL

    def has_episodes_of(self, run: ScenarioRun) -> bool:
        """Return whether a run, at whatever pace, had the same episodes."""
        names = ("version", "scenario", "digest", "episodes", "seed")
        return all(getattr(self, name) == getattr(run, name) for name in names)

    def as_json(self) -> dict[str, Any]:
        """Return this leaderboard's entry in ``benchmark.json``, in SI."""
        return {
            **{
                name: getattr(self, name)
                for name in (
                    "version",
                    "scenario",
                    "digest",
                    "pace",
                    "episodes",
                    "seed",
                    "provisional",
                )
            },
            "pace_m_s": find_pace(self.pace),
            "policies": {standing.policy: standing.as_json() for standing in self.standings},
        }


class SuiteScore(NamedTuple):
    """A policy over the suite: its path errors divided by the mean of the best tuned law at the
    same scenario and pace.

    ``ratios`` has the shape (S, N) for S training seeds and the N episodes of all scenarios and
    paces, as ``performance_profile`` takes them; ``ratio`` is their interquartile mean.
    """

    ratio: Interval
    ratios: Array


def leaderboards(runs: Sequence[ScenarioRun]) -> tuple[Leaderboard, ...]:
    """Return a leaderboard for each scenario, pace and set of episodes; runs of other versions are not mixed."""
    groups: dict[tuple[str, str, str, int, int, float], list[ScenarioRun]] = {}
    for run in runs:
        seed = -1 if run.seed is None else run.seed
        place = run.version, run.scenario, run.digest, run.episodes, seed, find_pace(run.pace)
        groups.setdefault(place, []).append(run)
    return tuple(rank(groups[place]) for place in sorted(groups))


def rank(runs: Sequence[ScenarioRun]) -> Leaderboard:
    """Return the leaderboard of runs on one set of episodes at one pace; a policy's training seeds
    count as one.

    A policy shares the rank of the leading one unless the interval of their difference excludes 0,
    or only one of them is ``lost``.
    """
    run, strata = runs[0], runs[0].strata
    judged = sorted(
        (_judge([r for r in runs if r.policy == name]) for name in {r.policy for r in runs}),
        key=_place,
    )
    first, leader, number = judged[0], judged[0], 1
    standings: list[Standing] = []
    for place, standing in enumerate(judged):
        difference = difference_interval(standing.errors, leader.errors, strata)
        if not standing.reason and (standing.lost != leader.lost or not difference.holds(0.0)):
            leader, number = standing, place + 1
        against: dict[str, Interval] = {}
        if place and not first.reason:
            against["difference"] = difference_interval(standing.errors, first.errors, strata)
            against["probability"] = probability_of_improvement(standing.errors, first.errors)
        standings.append(replace(standing, rank=None if standing.reason else number, **against))
    return Leaderboard(
        run.scenario, run.pace, run.episodes, run.seed, tuple(standings), run.version, run.digest
    )


def suites(boards: Iterable[Leaderboard]) -> list[tuple[Leaderboard, ...]]:
    """Return the leaderboards with a tuned law of each version and seed of the episodes; one's own
    are apart.

    Of several at a scenario and pace, that of the most episodes counts.
    """
    groups: dict[tuple[str, str, int | None], dict[tuple[str, str], Leaderboard]] = {}
    for board in sorted(boards, key=lambda board: board.episodes):
        if any(standing.policy in TUNED for standing in board.standings):
            groups.setdefault((board.version, board.digest, board.seed), {})[
                board.scenario, board.pace
            ] = board
    return [tuple(group.values()) for group in groups.values()]


def suite_scores(boards: Sequence[Leaderboard]) -> dict[str, SuiteScore]:
    """Return the score over some leaderboards, each with a tuned law, of every policy that is on all; best first."""
    parts: dict[str, list[Array]] = {}
    for board in boards:
        law = min(float(each.errors.mean()) for each in board.standings if each.policy in TUNED)
        for standing in board.standings:
            parts.setdefault(standing.policy, []).append(standing.errors / law)
    strata = [(board.scenario, board.pace) for board in boards for _ in range(board.episodes)]
    scores: dict[str, SuiteScore] = {}
    for name, found in parts.items():
        if len(found) == len(boards) and len({len(ratios) for ratios in found}) == 1:
            ratios = np.concatenate(found, axis=1)
            scores[name] = SuiteScore(interquartile_mean_interval(ratios, strata), ratios)
    return dict(sorted(scores.items(), key=lambda item: item[1].ratio.value))


def summarise(scores: Scores, strata: Strata = None) -> dict[str, Interval]:
    """Return the mean of each score, and ``worst_path_error_m``, the mean of the worst twentieth of
    the episodes.

    Scores have the shape (N,), or (S, N) for S training seeds on the same episodes.
    """
    means = {
        name: rate_interval(values) if values.dtype == np.bool_ else mean_interval(values, strata)
        for name, values in scores.items()
    }
    return {**means, "worst_path_error_m": worst_twentieth_interval(scores["path_error_m"])}


def reason_below(scores: dict[str, Interval], pace: float) -> str | None:
    """Return in words why a policy with these scores at a pace [m/s] is not ranked, or None if it is."""
    reasons: list[str] = []
    completed = scores["completed"]
    mean_pace, segments = (scores[name].value for name in ("mean_pace_error", "segment_pace_error"))
    ratio, limit = scores["mean_pace_m_s"].value / pace, f"limit {100 * PACE_ERROR:g} %"
    if completed.value < COMPLETION and not completed.holds(COMPLETION):
        reasons.append(
            f"completes {100 * completed.value:.3g} % of the episodes ({100 * COMPLETION:g} % needed)"
        )
    if mean_pace > PACE_ERROR and abs(ratio - 1.0) > PACE_ERROR:
        reasons.append(f"{tempo(ratio)} ({limit})")
    elif mean_pace > PACE_ERROR:
        reasons.append(f"{100 * mean_pace:.0f} % off the pace per episode ({limit})")
    elif segments > PACE_ERROR:
        reasons.append(f"uneven: segments {100 * segments:.1f} % off the pace ({limit})")
    return "; ".join(reasons) or None


def tempo(ratio: float) -> str:
    """Return a mean pace over the commanded one in words, such as ``17 × too fast``."""
    if ratio == 0.0:
        return "never moves"
    times, direction = max(ratio, 1.0 / ratio), "fast" if ratio > 1.0 else "slow"
    if times < IN_TIMES:
        return f"{100 * (times - 1):.0f} % too {direction}"
    return f"{_times(times)} × too {direction}"


def pace_error(scores: Mapping[str, Interval], name: str, pace: float) -> str:
    """Return a pace error [%], or far from the commanded pace [m/s] the ratio of the mean pace: ``×17`` or ``÷3.1``."""
    ratio = scores["mean_pace_m_s"].value / pace
    if 1.0 / IN_TIMES < ratio < IN_TIMES:
        return f"{100 * scores[name].value:.1f}"
    if name != "mean_pace_error" or ratio == 0.0:
        return "–"
    return f"×{_times(ratio)}" if ratio > 1.0 else f"÷{_times(1.0 / ratio)}"


def with_interval(
    interval: tuple[float | None, ...], text: str = ".1f", factor: float = 1.0
) -> str:
    """Return a value and its 95 % interval, if it has one, as in ``1.6 (1.5 … 1.7)``."""
    value, low, high = (None if end is None else format(factor * end, text) for end in interval)
    return f"{value} ({low} … {high})" if low else str(value)


def table(board: Leaderboard) -> Table:
    """Return a leaderboard for an 80-column terminal, with 95 % intervals, and below it why others are not ranked."""
    kind = "provisional, " if board.provisional else ""
    notes = [f"{UNRANKED} {each.policy}: {each.reason}" for each in board.standings if each.reason]
    if undecided := [each for each in board.standings if each.undecided]:
        ranges = (f"{each.policy} ({_percent(each.scores['completed'])} %)" for each in undecided)
        notes.append(f"? may complete less than {100 * COMPLETION:g} %: {', '.join(ranges)}")
    shown = _table(
        f"{board.scenario}, {title_of_pace(board.pace)}, {kind}{board.episodes} {_kind(board.seed)}",
        "\n".join(notes),
        ["#", "policy", *(column.title for column in COLUMNS)],
    )
    for standing in board.standings:
        place = (
            UNRANKED
            if standing.rank is None
            else f"{standing.rank}{'?' if standing.undecided else ''}"
        )
        cells = (_cell(standing.scores, column, find_pace(board.pace)) for column in COLUMNS)
        shown.add_row(place, escape(standing.policy), *cells)
    return shown


def suite_table(boards: Sequence[Leaderboard]) -> Table:
    """Return the scores over the suite of leaderboards as a table."""
    shown = _table(
        f"suite, {'stored episodes' if boards[0].seed is None else _kind(boards[0].seed)}",
        "Interquartile mean of path error ÷ mean path error of the best tuned law, and share of episodes within, over "
        f"{', '.join(f'{board.scenario} {board.pace}' for board in boards)}",
        ["policy", "error ÷\nbest tuned law's", *(f"≤ {each:g}\n\\[%]" for each in PROFILED)],
    )
    for name, (ratio, ratios) in suite_scores(boards).items():
        shares = performance_profile(ratios, PROFILED).fraction
        shown.add_row(
            escape(name), with_interval(ratio, ".3g"), *(f"{100 * share:.0f}" for share in shares)
        )
    return shown


def print_boards(runs: Sequence[ScenarioRun]) -> None:
    """Print the leaderboards of runs to the terminal, and the scores over those with a tuned law, if several."""
    boards = leaderboards(runs)
    print_tables(boards, suites(boards))


def print_tables(boards: Iterable[Leaderboard], of_suites: Iterable[Sequence[Leaderboard]]) -> None:
    """Print leaderboards to the terminal, and the scores over suites of several."""
    tables = [*map(table, boards), *(suite_table(suite) for suite in of_suites if len(suite) > 1)]
    for shown in tables:
        terminal().print(shown, "")


def _table(title: str, caption: str, headers: Sequence[str]) -> Table:
    """Return an empty table, narrow enough for 80 columns."""
    shown = Table(
        title=escape(title),
        caption=escape(caption),
        caption_justify="left",
        box=None,
        padding=(0, 1),
        collapse_padding=True,
        pad_edge=False,
    )
    for header in headers:
        shown.add_column(header, justify="left" if header == "policy" else "right", no_wrap=True)
    return shown


def _kind(seed: int | None) -> str:
    return "episodes" if seed is None else f"fresh episodes, seed {seed}"


def _times(ratio: float) -> str:
    return f"{ratio:.{0 if ratio >= 9.95 else 1}f}"


def _percent(rate: Interval) -> str:
    return " … ".join(f"{100 * (end or 0.0):.3g}" for end in rate[1:])


def _cell(scores: Mapping[str, Interval], column: BoardColumn, pace: float) -> str:
    """Return a score as the table shows it; path errors mean nothing if the policy never arrives."""
    if column.score.endswith("pace_error"):
        return pace_error(scores, column.score, pace)
    if column.score.endswith("_error_m") and scores["completed"].value == 0.0:
        return "–"
    found = scores[column.score]
    ends = found if column.with_interval else (found.value, None, None)
    return with_interval(ends, column.text, column.factor)


def _judge(runs: Sequence[ScenarioRun]) -> Standing:
    """Return the standing of a policy from the runs of its training seeds; ranks are assigned later."""
    names = [name for name in SCORES if all(name in run.scores for run in runs)]
    scores = {name: np.stack([run.scores[name] for run in runs]) for name in names}
    summary = summarise(scores, runs[0].strata)
    reason = reason_below(summary, find_pace(runs[0].pace))
    undecided = reason is None and summary["completed"].holds(COMPLETION)
    return Standing(runs[0].policy, None, reason, undecided, summary, scores["path_error_m"])


def _place(standing: Standing) -> tuple[bool, bool, float, str]:
    return (
        standing.reason is not None,
        standing.lost,
        standing.scores["path_error_m"].value,
        standing.policy,
    )
