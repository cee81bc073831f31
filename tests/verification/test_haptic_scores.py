"""Scores of rendering against series whose scores are known in closed form."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad

from benchmark.handmade import TASK, episode
from pter_gym.benchmark.scores import score
from pter_gym.errors import ParameterError
from pter_gym.haptics import (
    apparent_stiffness,
    force_error,
    impedance,
    mean_resisting_force,
    spectral_arc_length,
    z_width,
)
from pter_gym.paths import Line

PERIOD = 0.01
TIME = PERIOD * np.arange(400)
"""Four seconds: whole numbers of periods of the frequencies below."""


def test_errors_are_told_apart_by_direction() -> None:
    desired = np.tile([1.0, 2.0], (50, 1))
    assert force_error(desired + np.array([3.0, 4.0]), desired, (0.0, 2.0)) == pytest.approx(
        (4.0, 3.0)
    )
    at = 2.0 * np.pi * np.arange(360) / 360
    heading = np.stack([np.cos(at), np.sin(at)], axis=-1)
    assert force_error(5.0 * heading, 0.0 * heading, heading) == pytest.approx((5.0, 0.0))
    assert force_error(np.tile([5.0, 0.0], (360, 1)), 0.0 * heading, heading) == pytest.approx(
        [5.0 / math.sqrt(2.0)] * 2
    )


def test_dry_friction_resists_with_its_force_and_a_damper_by_the_speed() -> None:
    speed = np.abs(np.sin(2.0 * np.pi * TIME))
    assert mean_resisting_force(-7.0 * speed, speed) == pytest.approx(7.0)
    assert mean_resisting_force(-3.0 * speed**2, speed, 0.0) == pytest.approx(
        3.0 * speed[speed > 0.0].mean()
    )
    still = np.stack([speed, 0.0 * speed, np.where(TIME < 1.0, 0.5, np.nan)], axis=1)
    np.testing.assert_allclose(mean_resisting_force(-2.0 * still, still), [2.0, 0.0, 2.0])


def test_a_spring_behind_the_surface_is_a_wall_of_its_stiffness() -> None:
    depth = 0.01 * np.sin(2.0 * np.pi * TIME)
    assert apparent_stiffness(np.where(depth > 0.0, 800.0 * depth, 5.0), depth) == pytest.approx(
        800.0
    )
    ramp = np.arange(1.0, 11.0)
    assert apparent_stiffness(2.0 * ramp + 7.0, ramp) == pytest.approx(2.0 + 7.0 * 55 / 385), (
        "least squares"
    )
    assert math.isnan(apparent_stiffness(depth, -np.abs(depth)))


@pytest.mark.parametrize("frequency", [0.5, 2.0, 5.0])
def test_impedances_and_the_width_between_them(frequency: float) -> None:
    omega = 2.0 * math.pi * frequency
    position, velocity = np.sin(omega * TIME + 0.3) / omega, np.cos(omega * TIME + 0.3)
    acceleration = -(omega**2) * position

    def found(force: np.ndarray) -> float:
        return impedance(force, velocity, PERIOD, frequency)

    free = found(2.0 * acceleration + 3.0 * velocity)
    assert found(3.0 * velocity) == pytest.approx(3.0)
    assert free == pytest.approx(math.hypot(3.0, 2.0 * omega))
    assert found(900.0 * position) == pytest.approx(900.0 / omega)
    assert z_width(900.0, 900.0 / omega / 100.0, frequency) == pytest.approx(40.0)
    assert z_width(900.0, free, frequency) == pytest.approx(20.0 * math.log10(900.0 / omega / free))


# --- SPARC ---


def test_the_authors_example() -> None:
    """Of their program github.com/siva82kb/SPARC, which prints this number for it."""
    assert (
        f"{spectral_arc_length(np.exp(-5.0 * np.arange(-1.0, 1.0, PERIOD) ** 2), PERIOD):.5f}"
        == "-1.41403"
    )


@pytest.mark.parametrize(
    ("width", "fall"), [(0.05, math.log(20.0)), (0.2, math.log(20.0)), (0.03, None)]
)
def test_the_arc_of_a_gaussian(width: float, fall: float | None) -> None:
    """Its spectrum is exp(−(ωσ)²/2), up to the threshold, whatever the width, or else to the
    highest frequency."""
    a = fall or 0.5 * (2.0 * math.pi * 10.0 * width) ** 2
    arc, _ = quad(lambda u: math.hypot(1.0, 2.0 * a * u * math.exp(-a * u * u)), 0.0, 1.0)
    speed = np.exp(-0.5 * ((TIME - 2.0) / width) ** 2)
    for scale in (1.0, 40.0):
        assert spectral_arc_length(scale * speed, PERIOD) == pytest.approx(-arc, rel=2e-3)


def test_a_movement_in_parts_is_less_smooth_and_rest_is_zero() -> None:
    def parts(count: int) -> np.ndarray:
        return sum(np.exp(-0.5 * ((TIME - 1.0 - 0.8 * k) / 0.15) ** 2) for k in range(count))

    found = [spectral_arc_length(parts(count), PERIOD) for count in (1, 2, 3)]
    assert found == sorted(found, reverse=True)
    assert spectral_arc_length(0.0 * TIME, PERIOD) == 0.0
    assert spectral_arc_length([0.3], PERIOD) == pytest.approx(-1.0), "a flat spectrum"
    for nothing in ([], [1.0, math.nan], 0.3):
        with pytest.raises(ParameterError, match="speed must be"):
            spectral_arc_length(nothing, PERIOD)


# --- in the benchmark ---


def test_scores_of_an_episode() -> None:
    """A push of 5 N at 0.5 m/s against 2 W, then two thirds of it; the row of the reset counts for
    nothing."""
    rows = episode(
        90, force_x=3.0, force_y=4.0, tip_velocity_y=0.5, power_1=-0.5, power_3=-1.5, arc_length=0.0
    )
    rows[61:, [12, 13]] *= 2.0 / 3.0
    rows[0, [12, 13]] = 100.0
    found = score(rows, TASK)
    assert (found.mean_force_n, found.peak_force_n) == pytest.approx((5.0 * 8.0 / 9.0, 5.0))
    assert found.resisting_force_n == pytest.approx(4.0)


@pytest.mark.parametrize(("side", "sign"), [("free_left", -1.0), ("free_right", 1.0)])
def test_a_hand_against_the_edge_of_a_fixture_feels_its_stiffness(side: str, sign: float) -> None:
    """A spring of 700 N/m into the wall, whatever the push along it; samples outside and just
    inside do not count."""
    wall = replace(TASK, path=Line(direction=0.4), **{side: 0.1})
    depth = np.concatenate([np.zeros(20), np.linspace(5e-5, 9e-5, 10), np.linspace(1e-3, 8e-3, 40)])
    into = np.where(depth > 1e-4, 700.0 * depth, 50.0)
    x = 30.0 * math.cos(0.4) - sign * into * math.sin(0.4)
    y = 30.0 * math.sin(0.4) + sign * into * math.cos(0.4)
    rows = episode(69, force_x=x, force_y=y, normal_error=sign * depth, arc_length=0.2)
    assert score(rows, wall).apparent_stiffness_n_m == pytest.approx(700.0)
    assert score(rows[:30], wall).apparent_stiffness_n_m == 0.0, "never touched"
    assert score(rows, TASK).apparent_stiffness_n_m is None
