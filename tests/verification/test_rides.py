"""Rides that are linearised (docs/make/rides.py): the environment's motion, its derivatives, and those of the score."""

from functools import cache
from typing import Any

import numpy as np
import pytest
from bound import score_of
from rides import STATE, Linear, Ridden, Rides

from pter_gym._engine.batch import Batch
from pter_gym.benchmark._recorded import Travel
from pter_gym.benchmark.episodes import find_episodes
from pter_gym.benchmark.simulation import simulate, time_limit
from pter_gym.benchmark.tuned import find_tuned
from pter_gym.scenarios import SCENARIOS
from pter_gym.tasks.path_following import COLUMN

WORLDS = 6
FINEST = 2.0**-10
"""Voltages of this step are float32 numbers [V]."""

pytestmark = pytest.mark.slow


class Recorded:
    """Rides of a tuned law, and the same ones at its voltages."""

    def __init__(self, scenario: str) -> None:
        self.episodes = find_episodes(scenario, "medium", 7).first(WORLDS)
        batch = Batch(self.episodes.machines, self.episodes.tasks)
        limit = max(map(time_limit, self.episodes.tasks))
        law = find_tuned("single-dof-tuned", scenario)
        self.telemetry = simulate(batch, law, self.episodes.seeds, limit)
        volts = np.nan_to_num(self.telemetry[1:, :, [*COLUMN.volts]])
        self.rides = Rides(self.episodes.machines, self.episodes.tasks, self.episodes.seeds, 1)
        self.ridden = self.ride(volts)
        self.linear: Linear = self.rides.linearise(self.ridden)

    def ride(self, volts: Any) -> Ridden:
        """Return rides at voltages (T, W, 4)."""
        return Ridden(*(each[:, 0] for each in self.rides.follow(volts[:, None])))


recorded = cache(Recorded)


@pytest.mark.parametrize("scenario", SCENARIOS)
def test_a_ride_at_recorded_voltages_has_the_bits_of_the_record(scenario: str):
    found = recorded(scenario)
    for name in ("time", "arc_length", "normal_error"):
        expected = found.telemetry[..., getattr(COLUMN, name)]
        np.testing.assert_array_equal(getattr(found.ridden, name), expected)


@pytest.mark.parametrize("scenario", SCENARIOS)
def test_what_is_differentiated_is_the_motion_of_the_environment(scenario: str):
    """Each control step, from the state in which the environment began it."""
    assert recorded(scenario).linear.apart < 1e-12


@pytest.mark.parametrize("scenario", SCENARIOS)
def test_derivatives_are_those_of_paired_rides(scenario: str):
    """Of arc length and normal error after 30 control steps, along a random direction of the voltages.

    It is 0.01 V long, and the motion bends over volts: central differences err by a few millionths.
    """
    found, steps, rng = recorded(scenario), 30, np.random.default_rng(0)
    volts = np.round(found.ridden.volts / FINEST) * FINEST
    direction = FINEST * rng.integers(-1, 2, volts[:steps].shape)
    direction[(volts[:steps] < FINEST) | (volts[:steps] > 24.0 - FINEST)] = 0.0
    linear = found.rides.linearise(found.ride(volts))
    ends = []
    for sign in (1.0, -1.0):
        moved = volts.copy()
        moved[:steps] += sign * direction
        ridden = found.ride(moved)
        ends.append(np.stack([ridden.arc_length[steps], ridden.normal_error[steps]], axis=-1))
    change = np.zeros((WORLDS, STATE))
    for a, b, volt in zip(linear.a[:steps], linear.b[:steps], direction, strict=True):
        change = np.einsum("wij,wj->wi", a, change) + np.einsum("wij,wj->wi", b, volt)
    expected = np.einsum("wij,wj->wi", linear.c[steps], change)
    differences = 0.5 * (ends[0] - ends[1])
    np.testing.assert_allclose(expected, differences, rtol=1e-5, atol=1e-15)


@pytest.mark.parametrize("scenario", ["standard", "paths"])
def test_the_score_that_is_differentiated_is_that_of_the_benchmark(scenario: str):
    """Where the tip never steps back and the pace is kept."""
    jax = pytest.importorskip("jax")
    found = recorded(scenario)
    ridden, tasks = found.ridden, found.episodes.tasks
    travel = Travel(ridden.time, ridden.arc_length, ridden.normal_error, ridden.success, tasks)
    forward = (np.nan_to_num(np.diff(ridden.arc_length, axis=0)) >= 0.0).all(axis=0)
    kept = np.maximum(travel.mean_pace_error(), travel.segment_pace_error()) < 0.15
    (worlds,) = np.nonzero(forward & kept & travel.completed())
    assert len(worlds) > 0
    for world in worlds:
        last = int(np.isfinite(ridden.time[:, world]).sum())
        given = ridden.arc_length[:last, world], ridden.normal_error[:last, world]
        with jax.enable_x64(True):
            score = score_of(*given, tasks[world].path.length, tasks[world].pace, tasks[world].control_period)
        np.testing.assert_allclose(score, travel.path_error()[world], rtol=1e-9)
