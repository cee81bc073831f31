"""A tolerance limit of a policy's error over the machines and hands that fit a log."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np
from scipy import stats

from pter_gym._internal.checks import whole_number
from pter_gym.benchmark.boards import reason_unranked
from pter_gym.benchmark.episodes import Episodes, find_episodes
from pter_gym.benchmark.rollout import evaluate
from pter_gym.controllers import AnyPolicy
from pter_gym.errors import ParameterError
from pter_gym.hands import HandSpread, Operator, find_hands
from pter_gym.params import Machine, MachineSpread
from pter_gym.scenarios import find_scenario
from pter_gym.scenarios.distributions import Pair, drawn
from pter_gym.scenarios.paces import find_pace
from pter_gym.tasks.path_following import PathFollowing

_STATS: Any = stats

SHARE, CONFIDENCE = 0.95, 0.95
"""Share of what fits a log for which a promise holds, and the confidence with which it does."""

MIN_DRAWS = math.ceil(math.log(1.0 - CONFIDENCE) / math.log(SHARE))
"""Fewest draws of which the largest is such a limit: SHARE to their number is < 1 − CONFIDENCE."""

SEED = 2
"""Seed of what is drawn, and of the episodes on which all of it is scored."""


@dataclass(frozen=True)
class Promise:
    """A policy on the machines, or the hands, that fit a log.

    Attributes
    ----------
    scenario, policy, draws
        Names, and the number of draws.
    error_m
        Mean path error [m] that at most ``1 - SHARE`` of them exceed, with ``CONFIDENCE``.
    ranked
        Share of the draws with which the policy is ranked.
    of
        What is drawn, in words.
    """

    scenario: str
    policy: str
    draws: int
    error_m: float
    ranked: float
    of: str = "machines"

    @property
    def sentence(self) -> str:
        """The promise in words."""
        return (
            f"On {100 * SHARE:.0f} % of the {self.of} that fit your log, {self.policy} has an "
            f"error of at most {1e3 * self.error_m:.1f} mm on {self.scenario} (with "
            f"{100 * CONFIDENCE:.0f} % confidence, from {self.draws} samples); it is ranked on "
            f"{100 * self.ranked:.0f} %."
        )


def make_promise(
    policy: AnyPolicy,
    name: str,
    machines: Machine | MachineSpread,
    scenario: str,
    pace: str,
    *,
    draws: int = 200,
    episodes: int = 4,
    hand: Operator | HandSpread | str | None = None,
) -> Promise:
    """Score a policy on drawn machines and hands, all on the same episodes.

    The policy knows the machine in the middle.

    Raises
    ------
    ParameterError
        If there are fewer than ``MIN_DRAWS`` draws, or another number is out of range.
    """
    if whole_number("draws", draws) < MIN_DRAWS:
        raise ParameterError(f"draws must be at least {MIN_DRAWS}, got {draws}")
    of_log = find_scenario(scenario, machines, hand=hand).draws
    hands = None if hand is None else find_hands(hand)
    some = find_episodes(scenario, pace, SEED, of_log.middle, hand).first(episodes)
    rng = np.random.default_rng(SEED)
    pairs = [each for _ in range(draws) for each in fitting(machines, hands, some.tasks, rng)]
    scores = evaluate(policy, Episodes.from_pairs(scenario, of_log, pairs, some.seeds * draws))
    each = {name: values.reshape(draws, episodes) for name, values in scores.items()}
    errors = np.sort(each["path_error_m"].mean(axis=1))
    ranked = [
        reason_unranked({name: values[k] for name, values in each.items()}, find_pace(pace)) is None
        for k in range(draws)
    ]
    limit = float(errors[order_of(draws) - 1])
    kinds = {"machines": machines, "hands": hands}
    of = " and ".join(name for name, each in kinds.items() if hasattr(each, "draw"))
    return Promise(scenario, name, draws, limit, float(np.mean(ranked)), of)


def fitting(
    machines: Machine | MachineSpread,
    hands: Operator | HandSpread | None,
    tasks: Sequence[PathFollowing],
    rng: np.random.Generator,
) -> list[Pair]:
    """Return tasks with a machine and a hand that fit a log, the same in all of them."""
    machine: Any = drawn(machines, rng)
    if isinstance(hands, HandSpread):
        arm = hands.draw(rng).impedance
        tasks = [
            replace(task, hand=replace(cast("Any", task.hand), impedance=arm)) for task in tasks
        ]
    return [(machine, task) for task in tasks]


def order_of(draws: int) -> int:
    """Return the number k of the sorted errors that is the limit, from 1.

    The k-th smallest of n draws is below the quantile of ``SHARE`` with P(B(n, SHARE) ≥ k), so k is
    the least for which that is at most 1 - ``CONFIDENCE`` (Wilks, Annals of Mathematical Statistics
    12, 1941).
    """
    return int(_STATS.binom.ppf(CONFIDENCE, draws, SHARE)) + 1
