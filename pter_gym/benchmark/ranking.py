"""Ranking: by mean path error, for policies that arrive and keep the pace; those that get lost come last."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

from pter_gym.benchmark._runs import Planning, ScenarioRun, join_seeds, without_copies
from pter_gym.benchmark.episodes import DERIVED
from pter_gym.benchmark.metrics import Scores
from pter_gym.benchmark.statistics import (
    Array,
    Interval,
    Strata,
    bootstrap_interval,
    difference_interval,
    probability_of_improvement,
    unpaired_interval,
    worst_twentieth,
)
from pter_gym.scenarios import PACES

COMPLETION = 0.99
"""Smallest fraction of completed episodes of a policy with a rank."""

LOST = 0.05
"""Path error [m] of the worst twentieth of the episodes from which on a policy ranks behind those with less. If it is
off by as much in one of twenty episodes, or more, it stands below all that never are."""

PACE_ERROR = 0.15
"""Largest pace errors of a policy with a rank, as means over the episodes."""

PRIVILEGED = "privileged: it knows machine, hand and future, which no controller can; a bound"
"""Why a policy that knows the future has no rank."""


@dataclass(frozen=True)
class Standing:
    """One policy on a leaderboard.

    Attributes
    ----------
    policy
        Its name.
    identity
        Hash of its content, if that can be determined.
    rank
        From 1, or None if not ranked; policies share a rank if the interval of their difference contains 0.
    reason
        Why it is not ranked, in words.
    scores
        Scores over all episodes, as ``summarise`` returns them.
    difference
        Path error minus the best policy's [m], paired if they ran on the same episodes; None without a best policy.
    probability
        Probability of a smaller path error than the best policy's on the same episode; None without a best policy, or
        if policies ran on different episodes.
    planning
        For a policy that plans.
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
    def lost(self) -> bool:
        """Whether it strays so far in the worst twentieth of the episodes that it ranks behind policies that do not."""
        return self.scores["worst_path_error_m"].value >= LOST

    @property
    def privileged(self) -> bool:
        """Whether it uses information that no controller can have."""
        return self.planning is not None and self.planning.privileged

    @property
    def label(self) -> str:
        """Its name as shown with scores."""
        return f"{self.policy} (privileged)" if self.privileged else self.policy

    def as_json(self) -> dict[str, Any]:
        """Return its entry in ``benchmark.json``, in SI."""
        return {
            "rank": self.rank,
            "reason": self.reason,
            "privileged": self.privileged,
            "planning": self.planning and asdict(self.planning),
            "identity": self.identity,
            **{name: interval._asdict() for name, interval in self.scores.items()},
            "difference_to_best_m": self.difference and self.difference._asdict(),
            "probability_of_improvement": self.probability and self.probability._asdict(),
        }


def find_standings(runs: Sequence[ScenarioRun]) -> tuple[Standing, ...]:
    """Rank runs on one set of episodes at one pace, the best first; a policy's training seeds count as one.

    A policy shares the rank of the leading one unless the interval of their difference excludes 0, or only one of them
    is ``lost``.
    """
    seeds: dict[str, list[ScenarioRun]] = {}
    for run in without_copies(runs)[0]:
        seeds.setdefault(run.conditions.policy, []).append(run)
    judged = sorted(((_judge(run), run) for run in map(join_seeds, seeds.values())), key=_place)
    first, best = judged[0]
    standings: list[Standing] = []
    leader, rank = judged[0], 1
    for place, (standing, run) in enumerate(judged):
        against = {} if first.reason or run is best else _against(run, best)
        apart = standing.lost != leader[0].lost or not _holds_zero(_difference(run, leader[1]))
        if apart and not standing.reason:
            leader, rank = (standing, run), place + 1
        standings.append(replace(standing, rank=None if standing.reason else rank, **against))
    return tuple(standings)


def _holds_zero(interval: Interval) -> bool:
    return interval.low <= 0.0 <= interval.high


def summarise(scores: Scores, strata: Strata = None) -> dict[str, Interval]:
    """Return the mean of each score over the episodes, and ``worst_path_error_m``, the mean of the worst twentieth."""
    means = {name: bootstrap_interval(values, strata=strata) for name, values in scores.items()}
    return {**means, "worst_path_error_m": bootstrap_interval(scores["path_error_m"], worst_twentieth, strata=strata)}


def reason_below(scores: dict[str, Interval], pace: float) -> str | None:
    """Return in words why a policy with these scores at a pace [m/s] is not ranked, or None if it is."""
    reasons: list[str] = []
    completed, mean_pace, segments = (
        scores[name].value for name in ("completed", "mean_pace_error", "segment_pace_error")
    )
    limit = f"limit {100 * PACE_ERROR:g} %"
    if completed < COMPLETION:
        reasons.append(f"arrives in {100 * completed:.3g} % of the episodes ({100 * COMPLETION:g} % needed)")
    if mean_pace > PACE_ERROR:
        speed = scores["mean_pace_m_s"].value
        way = "fast" if speed > pace else "slow"
        reasons.append(f"too {way}: mean pace {speed:.2g} for {pace:g} m/s, {100 * mean_pace:.3g} % off ({limit})")
    if segments > PACE_ERROR:
        reasons.append(f"uneven: segments {100 * segments:.3g} % off the pace ({limit})")
    return "; ".join(reasons) or None


def _judge(run: ScenarioRun) -> Standing:
    """Return a policy's standing, with the reason if it is not ranked; ranks are assigned later."""
    scores = summarise(run.scores, run.strata)
    at = run.conditions
    privileged = PRIVILEGED if run.planning and run.planning.privileged else None
    reasons = [reason for reason in (privileged, reason_below(scores, PACES[at.pace])) if reason]
    return Standing(at.policy, at.identity, None, "; ".join(reasons) or None, scores, planning=run.planning)


def _place(judged: tuple[Standing, ScenarioRun]) -> tuple[bool, bool, float, str]:
    standing, _ = judged
    return standing.reason is not None, standing.lost, standing.scores["path_error_m"].value, standing.policy


def _against(run: ScenarioRun, best: ScenarioRun) -> dict[str, Interval]:
    """Compare path errors with those of the best policy."""
    difference = {"difference": _difference(run, best)}
    if run.conditions.fresh == DERIVED:
        return difference
    mine, other = _on_each(run), _on_each(best)
    strata = run.strata[: len(mine)]
    return {**difference, "probability": probability_of_improvement(mine, other, strata=strata)}


def _difference(run: ScenarioRun, other: ScenarioRun) -> Interval:
    """Return the path error of one policy minus another's, paired if they ran on the same episodes."""
    if run.conditions.fresh == DERIVED:
        errors, others = (each.scores["path_error_m"] for each in (run, other))
        return unpaired_interval(errors, others, strata=(run.strata, other.strata))
    mine = _on_each(run)
    return difference_interval(mine, _on_each(other), strata=run.strata[: len(mine)])


def _on_each(run: ScenarioRun) -> Array:
    """Return the path error on each episode; for several seeds, their mean."""
    return run.scores["path_error_m"].reshape(-1, run.conditions.episodes).mean(axis=0)
