"""A tolerance limit of a policy's error over the machines that fit a log."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import stats

from pter_gym._internal.checks import whole_number
from pter_gym.benchmark.boards import reason_unranked
from pter_gym.benchmark.episodes import Episodes, find_episodes
from pter_gym.benchmark.rollout import evaluate
from pter_gym.controllers import AnyPolicy
from pter_gym.errors import ParameterError
from pter_gym.hands import Operator
from pter_gym.params import MachineSpread
from pter_gym.scenarios._suite import by_hand
from pter_gym.scenarios.paces import find_pace

_STATS: Any = stats

SHARE, CONFIDENCE = 0.95, 0.95
"""Share of the machines for which a promise holds, and the confidence with which it does."""

MIN_DRAWS = math.ceil(math.log(1.0 - CONFIDENCE) / math.log(SHARE))
"""Fewest draws of which the largest is such a limit: SHARE to their number is < 1 − CONFIDENCE."""

SEED = 2
"""Seed of the drawn machines, and of the episodes on which all of them are scored."""


@dataclass(frozen=True)
class Promise:
    """A policy on the machines that fit a log.

    Attributes
    ----------
    scenario, policy, draws
        Names, and the number of machines.
    error_m
        Mean path error [m] that at most ``1 - SHARE`` of the machines exceed, with ``CONFIDENCE``.
    ranked
        Share of the drawn machines with which the policy is ranked.
    """

    scenario: str
    policy: str
    draws: int
    error_m: float
    ranked: float

    @property
    def sentence(self) -> str:
        """The promise in words."""
        return (
            f"On {100 * SHARE:.0f} % of the machines that fit your log, {self.policy} has an error "
            f"of at most {1e3 * self.error_m:.1f} mm on {self.scenario} (with "
            f"{100 * CONFIDENCE:.0f} % confidence, from {self.draws} samples); it is ranked on "
            f"{100 * self.ranked:.0f} %."
        )


def make_promise(
    policy: AnyPolicy,
    name: str,
    machines: MachineSpread,
    scenario: str,
    pace: str,
    *,
    draws: int = 200,
    episodes: int = 4,
    hand: Operator | str | None = None,
) -> Promise:
    """Score a policy, which knows the estimate, on drawn machines, all on the same episodes.

    Raises
    ------
    ParameterError
        If there are fewer than ``MIN_DRAWS`` draws, or another number is out of range.
    """
    if whole_number("draws", draws) < MIN_DRAWS:
        raise ParameterError(f"draws must be at least {MIN_DRAWS}, got {draws}")
    some = find_episodes(scenario, pace, SEED, machines.machine, hand).first(episodes)
    rng = np.random.default_rng(SEED)
    drawn = [machines.draw(rng) for _ in range(draws)]
    pairs = [(machine, task) for machine in drawn for task in some.tasks]
    of_log = by_hand(scenario, machines, hand).draws
    scores = evaluate(policy, Episodes.from_pairs(scenario, of_log, pairs, some.seeds * draws))
    each = {name: values.reshape(draws, episodes) for name, values in scores.items()}
    errors = np.sort(each["path_error_m"].mean(axis=1))
    ranked = [
        reason_unranked({name: values[k] for name, values in each.items()}, find_pace(pace)) is None
        for k in range(draws)
    ]
    limit = float(errors[order_of(draws) - 1])
    return Promise(scenario, name, draws, limit, float(np.mean(ranked)))


def order_of(draws: int) -> int:
    """Return the number k of the sorted errors that is the limit, from 1.

    The k-th smallest of n draws is below the quantile of ``SHARE`` with P(B(n, SHARE) ≥ k), so k is
    the least for which that is at most 1 - ``CONFIDENCE`` (Wilks, Annals of Mathematical Statistics
    12, 1941).
    """
    return int(_STATS.binom.ppf(CONFIDENCE, draws, SHARE)) + 1
