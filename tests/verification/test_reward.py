"""The reward is what its page says, found again from the telemetry of episodes."""

import math
from itertools import pairwise

import numpy as np
import pytest

from pter_gym._engine.batch import Batch
from pter_gym.hands import MultiSineHand
from pter_gym.params import BASELINE
from pter_gym.tasks.path_following import COLUMN, TELEMETRY, PathFollowing
from pter_gym.tasks.path_following._pace import ALLOWANCE
from pter_gym.tasks.path_following._reward import (
    ERROR_WIDTH,
    MAX_PACE_RATIO,
    PACE_WINDOW,
    PERFECT,
    PRECISION_WIDTH,
    REST,
    RewardWeights,
)

PERIOD = 0.01


def expected(rows: np.ndarray, task: PathFollowing) -> dict[str, list[float]]:
    """What each control step pays and costs; rows (steps + 1, columns) from a reset on."""
    length, pace, weight = task.path.length, task.pace, task.reward
    names = ("tracking", "precision", "pace", "effort", "failure")
    terms: dict[str, list[float]] = {name: [] for name in names}
    mean = 1.0
    for step, (before, after) in enumerate(pairwise(rows), 1):
        ratio = (after[COLUMN.arc_length] - before[COLUMN.arc_length]) / (PERIOD * pace)
        mean += (1.0 - math.exp(-PERIOD / PACE_WINDOW)) * (ratio - mean)
        if (
            after[COLUMN.reached] <= 0.01 * length
            and step * PERIOD <= ALLOWANCE + 0.01 * length / pace
        ):
            mean = max(mean, 1.0)
        share = max(mean, 0.0) ** 3 if mean < 1.0 else mean**-4
        new = (after[COLUMN.reached] - before[COLUMN.reached]) / length
        distance = abs(after[COLUMN.normal_error])
        terms["tracking"].append(weight.tracking * new * share * math.exp(-distance / ERROR_WIDTH))
        terms["precision"].append(
            weight.precision * new * share * math.exp(-distance / PRECISION_WIDTH)
        )
        off = REST * (1.0 - max(mean, 0.0)) ** 2 if mean < 1.0 else min(mean, MAX_PACE_RATIO) - 1.0
        terms["pace"].append(-weight.pace * off * PERIOD * pace / length)
        strain = np.mean((after[COLUMN.volts.x1 : COLUMN.volts.x4 + 1] / 24.0) ** 2)
        terms["effort"].append(-weight.effort * strain * PERIOD * pace / length)
        paid = sum(terms["tracking"]) + sum(terms["precision"])
        has_failed = after[COLUMN.terminated] and not after[COLUMN.is_success]
        terms["failure"].append(-weight.failure * paid if has_failed else 0.0)
    return terms


@pytest.mark.parametrize(
    "weights", [RewardWeights(), RewardWeights(tracking=300.0, precision=700.0, pace=50.0)]
)
@pytest.mark.parametrize("volts", [0.0, 3.0, 8.0])
def test_a_step_pays_what_the_page_says_from_the_first_on(
    volts: float, weights: RewardWeights
) -> None:
    task = PathFollowing(reward=weights)
    batch = Batch(BASELINE, task, 1, telemetry=True)
    _, first = batch.reset([3])
    rows = [first[0]]
    rng = np.random.default_rng(0)
    for _ in range(60):
        found = batch.step(rng.uniform(0.0, 2.0 * volts, (1, 4)))
        rows.append(found.telemetry[0, 0])
        if found.flags[:2].any():
            break
    seen = np.array(rows)
    assert len(seen) > 20
    for name, values in expected(seen, task).items():
        np.testing.assert_allclose(
            seen[1:, TELEMETRY.index(f"reward_{name}")], values, rtol=1e-9, atol=1e-12
        )


def test_waiting_at_the_start_costs_after_the_allowance() -> None:
    task = PathFollowing(hand=MultiSineHand(push=0.0, amplitudes=(0.0,) * 5))
    batch = Batch(BASELINE, task, 1, telemetry=True)
    batch.reset([3])
    cost = TELEMETRY.index("reward_pace")
    costs = [batch.step(np.full((1, 4), 24.0)).telemetry[0, 0, cost] for _ in range(40)]
    excused = math.floor((ALLOWANCE + 0.01 * task.path.length / task.pace) / PERIOD)
    assert costs[:excused] == excused * [0.0]
    standstill = -0.1 * PERFECT * REST * PERIOD * task.pace / task.path.length
    mean = np.exp(-PERIOD / PACE_WINDOW * np.arange(1, 1 + 40 - excused))
    np.testing.assert_allclose(costs[excused:], standstill * (1.0 - mean) ** 2, rtol=1e-9)
