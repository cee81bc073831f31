"""Leaderboards: policies ranked by mean path error if they arrive and keep the pace, as tables and as JSON."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
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
    probability_of_improvement,
    rate_interval,
    worst_twentieth_interval,
)
from pter_gym.benchmark.runs import ScenarioRun
from pter_gym.benchmark.scores import SCORES, Scores
from pter_gym.benchmark.tuned import TUNED
from pter_gym.scenarios import PACES

COMPLETION = 0.99
"""Fraction of completed episodes that a policy with a rank needs. A policy is undecided if its interval holds this."""

LOST = 0.05
"""Path error [m] of the worst twentieth of the episodes from which on a policy ranks behind those with less. So a
policy that gets lost in one of twenty episodes ranks below all that never do."""

PACE_ERROR = 0.15
"""Largest pace errors of a policy with a rank, as means over the episodes."""

FULL = 200
"""Fewest episodes for a rank that is not provisional."""


class Column(NamedTuple):
    """A score in the table: its title as ``rich`` prints it, its factor from SI, format, and if with interval."""

    score: str
    title: str
    factor: float
    text: str
    with_interval: bool = False


MILLIMETRES = 1000.0

COLUMNS = (
    Column("path_error_m", "path error\n\\[mm]", MILLIMETRES, ".1f", with_interval=True),
    Column("worst_path_error_m", "worst\n1/20\n\\[mm]", MILLIMETRES, ".1f"),
    Column("later_path_error_m", "after\n1/10\n\\[mm]", MILLIMETRES, ".1f"),
    Column("rms_error_m", "rms\n\n\\[mm]", MILLIMETRES, ".1f"),
    Column("completed", "completed\n\n\\[%]", 100.0, ".3g"),
    Column("mean_pace_error", "mean\npace\n\\[±%]", 100.0, ".3g"),
    Column("segment_pace_error", "segm.\npace\n\\[±%]", 100.0, ".3g"),
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
        From 1, or None if not ranked; policies share a rank if the interval of their difference contains 0.
    reason
        Why it is not ranked, in words.
    undecided
        Whether it has a rank but may miss ``COMPLETION``, which is in the interval of its completed episodes.
    scores
        Scores over all episodes, as ``summarise`` returns them.
    difference
        Path error minus the best policy's [m]; None without a best policy.
    probability
        Probability of a smaller path error than the best policy's on the same episode; None without a best policy.
    """

    policy: str
    rank: int | None
    reason: str | None
    undecided: bool
    scores: dict[str, Interval]
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


class SuiteScore(NamedTuple):
    """A policy over the suite: its path errors divided by the mean of the best tuned law at the same scenario and pace.

    ``ratios`` has the shape (S, N) for S training seeds and the N episodes of all scenarios and paces, as
    ``performance_profile`` takes them; ``ratio`` is their interquartile mean.
    """

    ratio: Interval
    ratios: Array


def leaderboards(runs: Sequence[ScenarioRun]) -> tuple[Leaderboard, ...]:
    """Return a leaderboard for each scenario, pace and set of episodes; runs of other versions are not mixed."""
    groups: dict[tuple[str, str, int, int, float], list[ScenarioRun]] = {}
    for run in runs:
        seed = -1 if run.seed is None else run.seed
        groups.setdefault((run.version, run.scenario, run.episodes, seed, PACES[run.pace]), []).append(run)
    return tuple(rank(groups[place]) for place in sorted(groups))


def rank(runs: Sequence[ScenarioRun]) -> Leaderboard:
    """Return the leaderboard of runs on one set of episodes at one pace; a policy's training seeds count as one.

    A policy shares the rank of the leading one unless the interval of their difference excludes 0, or only one of them
    is ``lost``.
    """
    run, strata = runs[0], runs[0].strata
    judged = sorted((_judge(name, scores, run) for name, scores in stack_seeds(runs).items()), key=_place)
    leader, number = judged[0], 1
    (first, best), standings = leader, list[Standing]()
    for place, (standing, errors) in enumerate(judged):
        difference = difference_interval(errors, leader[1], strata)
        if not standing.reason and (standing.lost != leader[0].lost or not difference.holds(0.0)):
            leader, number = (standing, errors), place + 1
        against: dict[str, Interval] = {}
        if place and not first.reason:
            against["difference"] = difference_interval(errors, best, strata)
            against["probability"] = probability_of_improvement(errors, best)
        standings.append(replace(standing, rank=None if standing.reason else number, **against))
    return Leaderboard(run.scenario, run.pace, run.episodes, run.seed, tuple(standings), run.version)


def suite_scores(runs: Sequence[ScenarioRun]) -> dict[str, SuiteScore]:
    """Return the score over the suite of each policy that was run wherever a tuned law was, best first.

    Runs are those of stored episodes; of several at a scenario and pace, those of the most episodes count.
    """
    groups: dict[tuple[str, str], dict[str, Scores]] = {}
    strata: list[str] = []
    for board in sorted({(run.episodes, run.scenario, run.pace) for run in runs if run.seed is None}):
        mine = [run for run in runs if (run.episodes, run.scenario, run.pace) == board and run.seed is None]
        if any(run.policy in TUNED for run in mine):
            groups[board[1:]] = stack_seeds(mine)
    found: dict[str, list[Array]] = {}
    for (scenario, pace), policies in groups.items():
        errors = {name: scores["path_error_m"] for name, scores in policies.items()}
        law = min(float(errors[name].mean()) for name in errors if name in TUNED)
        for name, values in errors.items():
            found.setdefault(name, []).append(values / law)
        strata += [f"{scenario}, {pace}"] * next(iter(errors.values())).shape[1]
    whole = {
        name: np.concatenate(parts, axis=1)
        for name, parts in found.items()
        if len(parts) == len(groups) and len({len(part) for part in parts}) == 1
    }
    scores = {name: SuiteScore(interquartile_mean_interval(ratios, strata), ratios) for name, ratios in whole.items()}
    return dict(sorted(scores.items(), key=lambda item: item[1].ratio.value))


def stack_seeds(runs: Sequence[ScenarioRun]) -> dict[str, Scores]:
    """Return the scores of each policy on one set of episodes, (S, N) for S training seeds."""
    seeds: dict[str, list[ScenarioRun]] = {}
    for run in runs:
        seeds.setdefault(run.policy, []).append(run)
    return {
        policy: {name: np.stack([run.scores[name] for run in members]) for name in SCORES}
        for policy, members in seeds.items()
    }


def summarise(scores: Scores, strata: Strata = None) -> dict[str, Interval]:
    """Return the mean of each score, and ``worst_path_error_m``, the mean of the worst twentieth of the episodes.

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
    limit = f"limit {100 * PACE_ERROR:g} %"
    if completed.value < COMPLETION and not completed.holds(COMPLETION):
        reasons.append(f"completes {100 * completed.value:.3g} % of the episodes ({100 * COMPLETION:g} % needed)")
    if mean_pace > PACE_ERROR:
        speed = scores["mean_pace_m_s"].value
        way = "fast" if speed > pace else "slow"
        reasons.append(f"too {way}: mean pace {speed:.2g} for {pace:g} m/s, {100 * mean_pace:.3g} % off ({limit})")
    if segments > PACE_ERROR:
        reasons.append(f"uneven: segments {100 * segments:.3g} % off the pace ({limit})")
    return "; ".join(reasons) or None


def table(board: Leaderboard) -> Table:
    """Return a leaderboard for an 80-column terminal, with 95 % intervals, and below it why others are not ranked."""
    kind = "provisional, " if board.provisional else ""
    which = "episodes" if board.seed is None else f"fresh episodes, seed {board.seed}"
    notes = [f"– {each.policy}: {each.reason}" for each in board.standings if each.reason]
    if undecided := [f"{each.policy} ({_range(each)})" for each in board.standings if each.undecided]:
        notes.append(f"? may complete less than {100 * COMPLETION:g} %: {', '.join(undecided)}")
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
        place = "–" if standing.rank is None else f"{standing.rank}{'?' if standing.undecided else ''}"
        shown.add_row(place, escape(standing.policy), *(_cell(standing, column) for column in COLUMNS))
    return shown


def print_boards(runs: Sequence[ScenarioRun]) -> None:
    """Print the leaderboards of runs to the terminal."""
    for board in leaderboards(runs):
        terminal().print(table(board), "")


def _range(standing: Standing) -> str:
    _, low, high = standing.scores["completed"]
    return f"{100 * (low or 0.0):.3g}…{100 * (high or 0.0):.3g} %"


def _cell(standing: Standing, column: Column) -> str:
    """Return a score as the table shows it; path errors mean nothing if the policy never arrives."""
    if column.factor == MILLIMETRES and standing.scores["completed"].value == 0.0:
        return "–"
    value, low, high = (
        None if end is None else format(column.factor * end, column.text) for end in standing.scores[column.score]
    )
    return f"{value} ({low}…{high})" if column.with_interval and low else str(value)


def _judge(policy: str, scores: Scores, run: ScenarioRun) -> tuple[Standing, Array]:
    """Return a policy's standing and its path errors, (S, N); ranks are assigned later."""
    summary = summarise(scores, run.strata)
    reason = reason_below(summary, PACES[run.pace])
    undecided = reason is None and summary["completed"].holds(COMPLETION)
    return Standing(policy, None, reason, undecided, summary), scores["path_error_m"]


def _place(judged: tuple[Standing, Array]) -> tuple[bool, bool, float, str]:
    standing, _ = judged
    return standing.reason is not None, standing.lost, standing.scores["path_error_m"].value, standing.policy
