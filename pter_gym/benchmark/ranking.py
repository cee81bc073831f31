"""Where ranks are decided: policies by path error, if they arrive and keep the pace."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from pter_gym.benchmark.metrics import METRICS
from pter_gym.benchmark.runs import Planning, ScenarioRun, join_seeds, without_copies
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


def find_standings(runs: Sequence[ScenarioRun]) -> tuple[Standing, ...]:
    """Rank runs on the same episodes at the same pace, the best first; a policy's training seeds count as one."""
    seeds: dict[str, list[ScenarioRun]] = {}
    for run in without_copies(runs)[0]:
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
    return tuple(standings)


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


def _judge(run: ScenarioRun) -> Standing:
    scores = {
        name: bootstrap_interval(run.scores[name], mean if metric.mean else interquartile_mean, strata=run.strata)
        for name, metric in METRICS.items()
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


def _percent(interval: Interval) -> str:
    return f"{100 * interval.value:.3g} %"
