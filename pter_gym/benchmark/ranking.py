"""Ranking: by mean path error, for policies that arrive and keep the pace; those that get lost come last."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pter_gym.benchmark.metrics import Scores
from pter_gym.benchmark.runs import ScenarioRun, join_seeds
from pter_gym.benchmark.statistics import (
    Array,
    Interval,
    Strata,
    bootstrap_interval,
    difference_interval,
    probability_of_improvement,
    worst_twentieth,
)
from pter_gym.scenarios import PACES

COMPLETION = 0.99
"""Smallest fraction of completed episodes of a policy with a rank."""

LOST = 0.05
"""Path error [m] of the worst twentieth of the episodes from which on a policy ranks behind those with less. So a
policy that gets lost in one of twenty episodes ranks below all that never do."""

PACE_ERROR = 0.15
"""Largest pace errors of a policy with a rank, as means over the episodes."""


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
    for run in runs:
        seeds.setdefault(run.policy, []).append(run)
    judged = sorted(((_judge(members), _on_each(members)) for members in seeds.values()), key=_place)
    strata = runs[0].strata
    first, best = judged[0]
    standings: list[Standing] = []
    leader, rank = judged[0], 1
    for place, (standing, errors) in enumerate(judged):
        interval = difference_interval(errors, leader[1], strata=strata)
        apart = standing.lost != leader[0].lost or not interval.low <= 0.0 <= interval.high
        if apart and not standing.reason:
            leader, rank = (standing, errors), place + 1
        against: dict[str, Interval] = {}
        if place and not first.reason:
            against["difference"] = difference_interval(errors, best, strata=strata)
            against["probability"] = probability_of_improvement(errors, best, strata=strata)
        standings.append(replace(standing, rank=None if standing.reason else rank, **against))
    return tuple(standings)


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
        reasons.append(f"completes {100 * completed:.3g} % of the episodes ({100 * COMPLETION:g} % needed)")
    if mean_pace > PACE_ERROR:
        speed = scores["mean_pace_m_s"].value
        way = "fast" if speed > pace else "slow"
        reasons.append(f"too {way}: mean pace {speed:.2g} for {pace:g} m/s, {100 * mean_pace:.3g} % off ({limit})")
    if segments > PACE_ERROR:
        reasons.append(f"uneven: segments {100 * segments:.3g} % off the pace ({limit})")
    return "; ".join(reasons) or None


def _judge(members: Sequence[ScenarioRun]) -> Standing:
    """Return a policy's standing, with the reason if it is not ranked; ranks are assigned later."""
    run = join_seeds(members)
    scores = summarise(run.scores, run.strata)
    return Standing(run.policy, None, reason_below(scores, PACES[run.pace]), scores)


def _place(judged: tuple[Standing, Array]) -> tuple[bool, bool, float, str]:
    standing, _ = judged
    return standing.reason is not None, standing.lost, standing.scores["path_error_m"].value, standing.policy


def _on_each(members: Sequence[ScenarioRun]) -> Array:
    """Return the path error on each episode, as the mean over training seeds."""
    return np.mean([run.scores["path_error_m"] for run in members], axis=0)
