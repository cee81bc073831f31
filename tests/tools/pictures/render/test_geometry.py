"""The mechanism in the world and the world on the screen, without drawing."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pter_gym.tools.pictures.render.geometry import (
    five_bar,
    path_points,
    workspace,
)

from pter_gym.params import Arm
from pter_gym.paths import Line

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


@pytest.mark.parametrize("direction", [0.0, 0.5, -2.0])
def test_workspace_is_a_band_around_the_path(direction: float):
    path = Line(x=0.1, y=0.4, direction=direction, length=0.3)
    ahead = np.array([math.cos(direction), math.sin(direction)])
    from_start = workspace(path, 0.2) - (path.x, path.y)
    along, across = from_start @ ahead, from_start @ (-ahead[1], ahead[0])
    np.testing.assert_allclose(np.abs(across), 0.2)
    assert (along.min(), along.max()) == pytest.approx((-0.2, 0.3))
    np.testing.assert_allclose(path_points(path)[[0, -1]], [path.point(0.0), path.point(0.3)])
