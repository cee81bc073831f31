"""Who guides the hand best at a commanded pace: policies by path error, if they arrive and keep the pace."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

from rich.table import Table

from pter_gym._version import __version__
from pter_gym.benchmark.metrics import SCORES
from pter_gym.benchmark.pacing import PACES
from pter_gym.benchmark.runs import Planning, ScenarioRun, join_seeds
from pter_gym.benchmark.statistics import (
    Interval,
    bootstrap_interval,
    difference_interval,
    interquartile_mean,
    mean,
    probability_of_improvement,
)

COMPLETION = 0.99
"""Smallest fraction of completed episodes of a policy with a rank."""

PACE_ERROR = 0.15
"""Largest pace errors of a policy with a rank, as means over the episodes."""

FULL = 200
"""Fewest episodes for a rank that is not provisional."""

PRIVILEGED = "privileged: it knows machine, hand and future, which no controller can; a bound"
"""Why a policy that knows the future has no rank."""

MEANS = ("completed", "mean_pace_error", "segment_pace_error", "saturated", "stuck")
"""Scores whose mean over the episodes counts; of the others it is the interquartile mean."""


@dataclass(frozen=True)
class Standing:
    """One policy on a leaderboard.

    Attributes
    ----------
    policy
        Its name.
    identity
        What it is, if anybody can tell.
    rank
        From 1 on, or None below the line.
    reason
        Why it has no rank, in words.
    scores
        Of all episodes together, under the names of ``Score``.
    difference
        Path error less that of the best policy on the same episodes [m]; None without a best one.
    probability
        Of a smaller path error than the best policy's on the same episode; None without a best one.
    planning
        Of a policy that plans.
    """

    policy: str
    identity: str | None
    rank: int | None
    reason: str | None
    scores: dict[str, Interval]
    difference: Interval | None = None
    probability: Interval | None = None
    planning: Planning | None = None

    @property
    def privileged(self) -> bool:
        """Whether it knows what no controller can know."""
        return self.planning is not None and self.planning.privileged

    @property
    def label(self) -> str:
        """Its name where scores are shown."""
        return f"{self.policy} (privileged)" if self.privileged else self.policy


@dataclass(frozen=True)
class Leaderboard:
    """The policies on the same episodes at one pace, the best first, those below the line last.

    Attributes
    ----------
    scenario, pace
        Names.
    episodes, data
        How many of the stored episodes were run, and the SHA-256 of the stored ones.
    config_hash
        SHA-256 of all that the scores depend on besides the policies.
    standings
        One per policy.
    """

    scenario: str
    pace: str
    episodes: int
    data: str
    config_hash: str
    standings: tuple[Standing, ...]

    @property
    def provisional(self) -> bool:
        """Whether there are too few episodes for ranks that count."""
        return self.episodes < FULL

    def has_episodes_of(self, run: ScenarioRun) -> bool:
        """Tell whether a run, at whatever pace, had the same episodes."""
        at = run.conditions
        return (self.scenario, self.episodes, self.data) == (at.scenario, at.episodes, at.data)

    def as_json(self) -> dict[str, Any]:
        """Return what ``benchmark.json`` holds of this leaderboard, in SI."""
        return {
            "scenario": self.scenario,
            "pace": self.pace,
            "pace_m_s": PACES[self.pace],
            "episodes": self.episodes,
            "episodes_sha256": self.data,
            "version": __version__,
            "config_hash": self.config_hash,
            "provisional": self.provisional,
            "policies": {standing.policy: _standing_json(standing) for standing in self.standings},
        }


def leaderboards(runs: Sequence[ScenarioRun]) -> tuple[Leaderboard, ...]:
    """Return a leaderboard for each scenario, pace and set of episodes among runs of the same code."""
    groups: dict[tuple[str, float, int, str], list[ScenarioRun]] = {}
    for run in runs:
        at = run.conditions
        groups.setdefault((at.scenario, PACES[at.pace], at.episodes, at.data), []).append(run)
    return tuple(rank(groups[place]) for place in sorted(groups))


def rank(runs: Sequence[ScenarioRun]) -> Leaderboard:
    """Return the leaderboard of runs on the same episodes at the same pace; a policy's training seeds count as one."""
    seeds: dict[str, list[ScenarioRun]] = {}
    for run in runs:
        seeds.setdefault(run.conditions.policy, []).append(run)
    runs = [join_seeds(each) for each in seeds.values()]
    judged = [_judge(run) for run in runs]
    order = sorted(range(len(runs)), key=lambda k: _place(judged[k]))
    best = runs[order[0]] if judged[order[0]].reason is None else None
    standings: list[Standing] = []
    for place, k in enumerate(order):
        found = judged[k]
        against = {} if best is None or best is runs[k] else _against(runs[k], best)
        standings.append(replace(found, rank=None if found.reason else place + 1, **against))
    at = runs[0].conditions
    return Leaderboard(at.scenario, at.pace, at.episodes, at.data, at.config_hash, tuple(standings))


def reason_below(scores: dict[str, Interval], pace: float) -> str | None:
    """Return in words why a policy with these scores at a pace [m/s] has no rank, or None if it has one."""
    reasons: list[str] = []
    limit = f"limit {100 * PACE_ERROR:g} %"
    completed = scores["completed"].value
    if completed < COMPLETION:
        reasons.append(f"arrives in {100 * completed:.3g} % of the episodes ({100 * COMPLETION:g} % needed)")
    if scores["mean_pace_error"].value > PACE_ERROR:
        speed = scores["mean_pace_m_s"].value
        way = "fast" if speed > pace else "slow"
        off = _percent(scores["mean_pace_error"])
        reasons.append(f"too {way}: mean pace {speed:.2g} for {pace:g} m/s, {off} off ({limit})")
    if scores["segment_pace_error"].value > PACE_ERROR:
        reasons.append(f"uneven: segments {_percent(scores['segment_pace_error'])} off the pace ({limit})")
    return "; ".join(reasons) or None


def table(board: Leaderboard) -> Table:
    """Return a leaderboard for a terminal of 80 columns: intervals of 95 %, and below it why others have no rank."""
    kind = "provisional, " if board.provisional else ""
    shown = Table(
        title=f"{board.scenario}, {board.pace} ({PACES[board.pace]:g} m/s), {kind}{board.episodes} episodes",
        caption=_caption(board),
        caption_justify="left",
        box=None,
        padding=(0, 1),
        collapse_padding=True,
        pad_edge=False,
    )
    shown.add_column("#", justify="right")
    shown.add_column("policy", no_wrap=True)
    for header in (
        "path error\n\\[mm]",
        "at the\nend\n\\[%]",
        "mean\npace\n\\[±%]",
        "segment\npace\n\\[±%]",
        "rms acc.\n\\[m/s²]",
        "smooth-\nness",
    ):
        shown.add_column(header, justify="right", no_wrap=True)
    for standing in board.standings:
        s = standing.scores
        shown.add_row(
            "–" if standing.rank is None else str(standing.rank),
            standing.label,
            "{:.1f} ({:.1f}…{:.1f})".format(*(1000 * x for x in s["path_error_m"])),
            f"{100 * s['completed'].value:.3g}",
            f"{100 * s['mean_pace_error'].value:.3g}",
            f"{100 * s['segment_pace_error'].value:.3g}",
            f"{s['rms_acceleration_m_s2'].value:.2f}",
            f"{s['smoothness'].value:.1f}",
        )
    return shown


def _caption(board: Leaderboard) -> str:
    lines = [f"– {standing.policy}: {standing.reason}" for standing in board.standings if standing.reason]
    lines += [
        f"{standing.policy}: {p.rollouts:,} plans of {p.horizon_s:g} s, {p.decision_ms:.1f} ms a decision"
        for standing in board.standings
        if (p := standing.planning)
    ]
    return "\n".join(lines)


def _judge(run: ScenarioRun) -> Standing:
    scores = {
        name: bootstrap_interval(run.scores[name], mean if name in MEANS else interquartile_mean, strata=run.strata)
        for name in SCORES
    }
    at = run.conditions
    reasons = [PRIVILEGED] if run.planning and run.planning.privileged else []
    reasons += [reason] if (reason := reason_below(scores, PACES[at.pace])) else []
    return Standing(at.policy, at.identity, None, "; ".join(reasons) or None, scores, planning=run.planning)


def _place(standing: Standing) -> tuple[bool, float, str]:
    return standing.reason is not None, standing.scores["path_error_m"].value, standing.policy


def _against(run: ScenarioRun, best: ScenarioRun) -> dict[str, Interval]:
    """Compare path errors on the same episodes; of several seeds it is their mean on an episode that counts."""
    count = run.conditions.episodes
    mine, other = (r.scores["path_error_m"].reshape(-1, count).mean(axis=0) for r in (run, best))
    strata = run.strata[:count]
    return {
        "difference": difference_interval(mine, other, strata=strata),
        "probability": probability_of_improvement(mine, other, strata=strata),
    }


def _standing_json(standing: Standing) -> dict[str, Any]:
    return {
        "rank": standing.rank,
        "reason": standing.reason,
        "privileged": standing.privileged,
        "planning": standing.planning and asdict(standing.planning),
        "identity": standing.identity,
        **{name: interval._asdict() for name, interval in standing.scores.items()},
        "difference_to_best_m": standing.difference and standing.difference._asdict(),
        "probability_of_improvement": standing.probability and standing.probability._asdict(),
    }


def _percent(interval: Interval) -> str:
    return f"{100 * interval.value:.3g} %"
