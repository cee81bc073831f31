"""Virtual fixtures: corridor and wall are paths with a free band, where there is no error."""

import math
from typing import Any

import gymnasium
import numpy as np
import pytest

from pter_gym.benchmark.rollout import record_episode
from pter_gym.controllers import Free
from pter_gym.errors import ParameterError
from pter_gym.params import BASELINE
from pter_gym.paths import Circle, Line
from pter_gym.tasks.path_following import PathFollowing, Sensing
from pter_gym.tasks.path_following._position import FreeBand, beyond_band
from pter_gym.tasks.path_following._telemetry import COLUMN


@pytest.mark.parametrize(
    ("offset", "beyond"),
    [(0.0, 0.0), (0.02, 0.0), (-0.03, 0.0), (0.025, 0.005), (-0.05, -0.02), (0.019, 0.0)],
)
def test_the_error_counts_from_the_edge_of_the_band(offset: float, beyond: float):
    assert beyond_band(offset, FreeBand(right=0.03, left=0.02)) == pytest.approx(beyond, abs=1e-15)
    assert beyond_band(offset, FreeBand(0.0, 0.0)) == offset


def test_telemetry_observation_and_reward_count_from_the_band():
    """The hand alone carries the tip out of the band; within it every step pays as on the path."""
    line, task = Line(), PathFollowing(free_left=0.01, free_right=0.02)
    rows = record_episode(Free(), BASELINE, task, 0).telemetry
    plain = record_episode(Free(), BASELINE, PathFollowing(), 0).telemetry
    count = min(len(rows), len(plain))
    tips, (x, y), heading = rows[:, [*COLUMN.tip]], line.point(0.0), line.heading(0.0)
    offset = (tips[:, 1] - y) * math.cos(heading) - (tips[:, 0] - x) * math.sin(heading)
    np.testing.assert_allclose(
        rows[:, COLUMN.normal_error], offset - np.clip(offset, -0.02, 0.01), atol=1e-12
    )
    np.testing.assert_array_equal(tips[:count], plain[:count, [*COLUMN.tip]])
    inside = (np.abs(offset[1:count]) > 1e-4) & (rows[1:count, COLUMN.normal_error] == 0.0)
    tracking = COLUMN.terms.tracking
    assert np.all(rows[1:count, tracking][inside] > plain[1:count, tracking][inside])


def test_a_wide_band_about_a_tight_circle_is_refused():
    env: Any = gymnasium.make(
        "PTER/PathFollowing-v0", task=PathFollowing(path=Circle(), error_max=0.05, free_left=0.05)
    )
    env.close()
    with pytest.raises(ParameterError, match="error_max"):
        gymnasium.make(
            "PTER/PathFollowing-v0", task=PathFollowing(path=Circle(), error_max=0.1, free_left=0.2)
        )


def test_velocities_from_encoders_are_differences_of_their_readings():
    step = 2.0 * math.pi / 4096
    sensing = Sensing(angle_resolution=step, encoder_velocity=True)
    env: Any = gymnasium.make("PTER/PathFollowing-v0", task=PathFollowing(sensing=sensing))
    layout = env.unwrapped.observation_layout
    obs = env.reset(seed=1)[0]
    before, coarse = np.zeros(2), []
    # an arm that nothing holds back is soon beyond the bounds of an observation
    for k in range(15):
        at = np.array(
            [
                math.atan2(layout.physical(obs, f"sin_{x}"), layout.physical(obs, f"cos_{x}"))
                for x in "ab"
            ]
        )
        speed = np.array([layout.physical(obs, f"omega_{x}") for x in "ab"])
        if k:
            # float32 observations
            np.testing.assert_allclose(speed, (at - before) / 0.01, atol=2e-3)
        coarse.append(speed / (step / 0.01))
        before = at
        obs = env.step(-np.ones(4, np.float32))[0]
    counts = np.array(coarse)
    np.testing.assert_allclose(counts, np.round(counts), atol=0.02)
    assert len(np.unique(np.round(counts))) > 5
