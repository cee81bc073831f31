"""One runner for policies of all kinds: laws in the kernel, networks and plain callables."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from pter_gym._engine.batch import Batch
from pter_gym.benchmark import PACES, find_policy
from pter_gym.benchmark.simulation import run, simulate, time_limit
from pter_gym.controllers import Free, Impedance, PaceSchedule, bind
from pter_gym.errors import ParameterError
from pter_gym.params import BASELINE
from pter_gym.scenarios import find_scenario
from pter_gym.tasks.path_following import PathFollowing

SEEDS = [3, 4, 5]


def drawn(scenario: str, pace: str) -> tuple[Sequence[Any], Sequence[Any]]:
    machines, tasks = zip(
        *find_scenario(scenario).draws.pairs(3, 8, pace), strict=True
    )
    return machines, tasks


def test_a_schedule_is_its_controller_at_a_knot_that_holds_and_between_its_knots() -> None:
    found: Any = find_policy("impedance")
    for pace, speed in PACES.items():
        batch = Batch(*drawn("standard", pace))
        one, other = (simulate(batch, policy, SEEDS, 400) for policy in (found, found.at(speed)))
        assert one.tobytes() == other.tobytes()
    slow, medium = (found.at(PACES[pace]).damping_tangential for pace in ("slow", "medium"))
    half = Impedance(damping_tangential=0.5 * (slow + medium))
    batch = Batch(BASELINE, PathFollowing(pace=0.185), 1)
    np.testing.assert_allclose(
        *(simulate(batch, law, [1], 50) for law in (found, half)), rtol=1e-3, atol=1e-3
    )
    with pytest.raises(ParameterError, match="hold"):
        PaceSchedule(((0.1, Impedance()), (0.2, Impedance())), hold=0.5)


class Counting:
    """Releases all clutches, and counts its episodes and decisions."""

    def __init__(self) -> None:
        self.resets = self.decisions = 0

    def reset(self) -> None:
        self.resets += 1

    def __call__(self, obs: NDArray[np.float32]) -> NDArray[np.float64]:
        self.decisions += 1
        return np.zeros((len(obs), 4))


def test_a_callable_is_reset_with_episodes_and_moves_as_the_compiled_law() -> None:
    batch = Batch(BASELINE, PathFollowing(), 3)
    mine = Counting()
    plain = bind(mine, BASELINE, batch.layout)
    rows = simulate(batch, plain, SEEDS, 15)
    assert (mine.resets, mine.decisions) == (1, 15)
    assert not plain.compiled
    np.testing.assert_array_equal(rows, simulate(batch, Free(), SEEDS, 15))


def test_a_run_stops_when_all_have_ended_or_reached_their_limit() -> None:
    machines, tasks = drawn("standard", "brisk")
    batch = Batch(machines, tasks)
    limits = [time_limit(task) for task in tasks]
    by_steps = run(batch, Counting(), SEEDS, limits)
    assert by_steps.ended.all()
    assert by_steps.steps < max(limits)
    strided = run(batch, Free(), SEEDS, limits, columns=[0, 1], stride=16)
    assert strided.ended.all()
    assert strided.telemetry.shape == (strided.steps + 1, 3, 2)
    assert strided.steps % 16 == 0
    np.testing.assert_array_equal(
        strided.telemetry[: by_steps.steps + 1], by_steps.telemetry[..., :2]
    )
