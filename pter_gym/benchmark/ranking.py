"""Where ranks are decided: policies by path error, if they arrive and keep the pace."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

from pter_gym.benchmark._runs import Planning, ScenarioRun, join_seeds, without_copies
from pter_gym.benchmark.metrics import METRICS
from pter_gym.benchmark.statistics import (
    Interval,
    bootstrap_interval,
    difference_interval,
    interquartile_mean,
    mean,
    probability_of_improvement,
)
from pter_gym.scenarios import PACES

COMPLETION = 0.99
"""Smallest fraction of completed episodes of a policy with a rank."""

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

    def as_json(self) -> dict[str, Any]:
        """Return what ``benchmark.json`` holds of it, in SI."""
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
    """Rank runs on the same episodes at the same pace, the best first; a policy's training seeds count as one."""
    seeds: dict[str, list[ScenarioRun]] = {}
    for run in without_copies(runs)[0]:
        seeds.setdefault(run.conditions.policy, []).append(run)
    judged = sorted(((_judge(run), run) for run in map(join_seeds, seeds.values())), key=_place)
    first, best = judged[0]
    standings: list[Standing] = []
    for place, (standing, run) in enumerate(judged):
        against = {} if first.reason or run is best else _against(run, best)
        standings.append(replace(standing, rank=None if standing.reason else place + 1, **against))
    return tuple(standings)


def reason_below(scores: dict[str, Interval], pace: float) -> str | None:
    """Return in words why a policy with these scores at a pace [m/s] has no rank, or None if it has one."""
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
    """Return what a policy scored, and why it has no rank if it has none; the rank comes later."""
    scores = {
        name: bootstrap_interval(run.scores[name], mean if metric.mean else interquartile_mean, strata=run.strata)
        for name, metric in METRICS.items()
    }
    at = run.conditions
    privileged = PRIVILEGED if run.planning and run.planning.privileged else None
    reasons = [reason for reason in (privileged, reason_below(scores, PACES[at.pace])) if reason]
    return Standing(at.policy, at.identity, None, "; ".join(reasons) or None, scores, planning=run.planning)


def _place(judged: tuple[Standing, ScenarioRun]) -> tuple[bool, float, str]:
    standing, _ = judged
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
