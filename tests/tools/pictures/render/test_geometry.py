"""The mechanism in the world and the world on the screen, without drawing."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pter_gym.params import BASELINE, Arm
from pter_gym.paths import Line
from pter_gym.tools.pictures.render.geometry import (
    Box,
    View,
    arrow,
    fit,
    five_bar,
    path_points,
    thinned,
    workspace,
    world_box,
)

SCREEN = Box(10, 20, 410, 320)
ARM = Arm(length_a=0.5, length_b=0.3)

finite = st.floats(-10.0, 10.0)


def test_five_bar_at_a_known_pose():
    bars = five_bar(ARM, 0.0, 0.5 * math.pi)
    np.testing.assert_allclose(bars.base, (0.0, 0.0))
    np.testing.assert_allclose(bars.elbow_a, (0.5, 0.0), atol=1e-16)
    np.testing.assert_allclose(bars.elbow_b, (0.0, 0.3), atol=1e-16)
    np.testing.assert_allclose(bars.tip, (0.5, 0.3), atol=1e-16)


@given(finite, finite)
def test_opposite_bars_are_parallel_and_equal(theta_a: float, theta_b: float):
    bars = five_bar(ARM, theta_a, theta_b)
    np.testing.assert_allclose(bars.tip - bars.elbow_b, bars.elbow_a - bars.base, atol=1e-15)
    np.testing.assert_allclose(bars.tip - bars.elbow_a, bars.elbow_b - bars.base, atol=1e-15)
    assert math.hypot(*bars.elbow_a) == pytest.approx(ARM.length_a)
    assert math.hypot(*bars.elbow_b) == pytest.approx(ARM.length_b)


def test_view_turns_y_upside_down_and_keeps_right_angles():
    view = View(scale=100.0, origin=(50.0, 60.0))
    np.testing.assert_array_equal(view.pixels((0.0, 0.0)), (50.0, 60.0))
    np.testing.assert_array_equal(view.pixels([(1.0, 0.0), (0.0, 1.0)]), [(150.0, 60.0), (50.0, -40.0)])


@given(finite, finite, st.floats(0.1, 10.0), st.floats(0.1, 10.0))
def test_a_world_fills_the_screen_and_is_centred(left: float, low: float, width: float, height: float):
    view = fit(Box(left, low, left + width, low + height), SCREEN)
    (x0, y0), (x1, y1) = view.pixels([(left, low + height), (left + width, low)])
    assert (x0 + x1, y0 + y1) == pytest.approx((SCREEN.left + SCREEN.right, SCREEN.low + SCREEN.high))
    used = (x1 - x0) / (SCREEN.right - SCREEN.left), (y1 - y0) / (SCREEN.high - SCREEN.low)
    assert max(used) == pytest.approx(1.0)


@pytest.mark.parametrize("direction", [0.0, 0.5, -2.0])
def test_workspace_is_a_band_around_the_path(direction: float):
    path = Line(x=0.1, y=0.4, direction=direction, length=0.3)
    ahead = np.array([math.cos(direction), math.sin(direction)])
    from_start = workspace(path, 0.2) - (path.x, path.y)
    along, across = from_start @ ahead, from_start @ (-ahead[1], ahead[0])
    np.testing.assert_allclose(np.abs(across), 0.2)
    assert (along.min(), along.max()) == pytest.approx((-0.2, 0.3))
    np.testing.assert_allclose(path_points(path)[[0, -1]], [path.point(0.0), path.point(0.3)])


@pytest.mark.parametrize("direction", [0.0, 0.5 * math.pi])
def test_world_box_holds_drive_workspace_and_elbows(direction: float):
    path = Line(x=-0.2, y=0.5, direction=direction, length=0.2)
    box = world_box(BASELINE.arm, path, 0.1)
    for x, y in [(0.0, 0.0), *workspace(path, 0.1)]:
        assert box.left <= x <= box.right
        assert box.low <= y <= box.high
    assert box.right >= 0.8 * BASELINE.arm.length_a


def test_arrow_points_from_tail_to_head():
    outline = arrow(np.array([1.0, 1.0]), np.array([1.0, 31.0]), 4.0)
    assert outline.shape == (7, 2)
    np.testing.assert_allclose(outline[3], (1.0, 31.0))
    np.testing.assert_allclose(outline[[0, 6]].mean(axis=0), (1.0, 1.0))
    assert np.ptp(outline[:, 0]) == pytest.approx(3.5 * 4.0)
    assert arrow(np.zeros(2), np.array([1.0, 0.0]), 4.0)[:, 0].min() >= 0.0


def test_thinned_keeps_the_ends_and_the_distance():
    line = np.stack([np.linspace(0.0, 10.0, 101), np.zeros(101)], axis=1)
    kept = thinned(line, 2.0)
    np.testing.assert_array_equal(kept[[0, -1]], line[[0, -1]])
    assert len(kept) <= 7
    assert np.diff(kept[:, 0]).max() <= 2.0 + 0.1
    np.testing.assert_array_equal(thinned(np.zeros((50, 2)), 2.0), np.zeros((2, 2)))
    assert thinned(np.zeros((0, 2)), 2.0).shape == (0, 2)
