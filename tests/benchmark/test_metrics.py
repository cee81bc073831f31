"""Scores against episodes whose scores are known."""

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from pter_gym.benchmark.metrics import CUTOFF, START_UP, low_pass, path_error, score
from pter_gym.tasks.path_following import TELEMETRY, PathFollowing

TASK = PathFollowing()
LENGTH = TASK.path.length
Array = NDArray[np.float64]


def episode(steps: int, **columns: Array | float) -> Array:
    """Telemetry (steps + 1, fields) with given columns, the rest zero, time running."""
    rows = np.zeros((steps + 1, len(TELEMETRY)))
    rows[:, TELEMETRY.index("time")] = TASK.control_period * np.arange(steps + 1)
    for name, values in columns.items():
        rows[:, TELEMETRY.index(name)] = values
    return rows


def test_constant_error_at_constant_speed() -> None:
    steps = 98
    s = np.linspace(0.0, LENGTH, steps + 1)
    rows = episode(steps, arc_length=s, normal_error=-0.02, tip_x=s, tip_velocity_x=0.5, dissipated=0.1)
    rows[-1, TELEMETRY.index("is_success")] = 1.0
    found = score(rows, TASK)
    assert found.path_error_m == pytest.approx(0.02)
    assert found.mean_error_m == pytest.approx(0.02)
    assert found.mean_speed_m_s == pytest.approx(0.5)
    assert found.path_length_m == pytest.approx(LENGTH)
    assert found.duration_s == pytest.approx(0.98)
    assert found.dissipated_j == pytest.approx(0.1 * (steps + 1))
    assert found.completed is True
    assert found.peak_acceleration_m_s2 == 0.0


def test_path_error_of_a_triangle() -> None:
    s = np.linspace(0.0, 1.0, 10_001)
    error = np.where(s < 0.5, s, 1.0 - s)
    assert path_error(s, error, 1.0, 0.25) == pytest.approx(0.25, abs=1e-4)


def test_a_policy_that_stops_pays_for_the_rest() -> None:
    s = np.array([0.0, 0.1, 0.1, 0.1])
    assert path_error(s, np.zeros(4), 0.5, 0.25) == pytest.approx((0.4 * 0.25) / 0.5)
    assert path_error(s, np.array([0.0, 0.0, 0.3, 0.0]), 0.5, 0.25) == pytest.approx((0.4 * 0.3) / 0.5)


def test_an_excursion_at_a_standstill_and_a_step_back_are_not_free() -> None:
    s = np.array([0.0, 0.5, 0.5, 0.5, 1.0])
    calm = path_error(s, np.zeros(5), 1.0, 0.25)
    standing = path_error(s, np.array([0.0, 0.0, 0.2, 0.0, 0.0]), 1.0, 0.25)
    back = path_error(np.array([0.0, 0.5, 0.4, 0.5, 1.0]), np.array([0.0, 0.0, 0.2, 0.0, 0.0]), 1.0, 0.25)
    assert calm == 0.0
    assert standing == back == pytest.approx(0.1)


def test_start_up_is_left_out_of_accelerations_but_not_of_raw_ones() -> None:
    steps = 100
    acceleration = np.zeros(steps + 1)
    acceleration[5] = 100.0
    acceleration[60:] = 3.0
    found = score(episode(steps, acceleration_x=acceleration, arc_length=0.0), TASK)
    assert found.raw_peak_acceleration_m_s2 == 100.0
    assert found.peak_acceleration_m_s2 == pytest.approx(3.0, rel=1e-6)
    settled = low_pass(acceleration[1:, None], TASK.control_period)[round(START_UP / TASK.control_period) :]
    assert found.mean_acceleration_m_s2 == pytest.approx(np.abs(settled).mean())


def test_low_pass_is_first_order() -> None:
    period = 1e-4
    response = low_pass(np.ones((2000, 1)), period)[:, 0]
    time = period * np.arange(1, 2001)
    np.testing.assert_allclose(response, 1.0 - np.exp(-2.0 * math.pi * CUTOFF * time), atol=1e-12)


def test_nothing_to_score() -> None:
    with pytest.raises(ValueError, match="at least one step"):
        score(episode(0), TASK)
