"""The environment under Stable-Baselines3: its checker and its monitor."""

import warnings
from typing import Any

import gymnasium
import numpy as np
import pytest

pytestmark = pytest.mark.agents


def make_env() -> Any:
    """The environment as Stable-Baselines3's algorithms want it."""
    from stable_baselines3.common.monitor import Monitor

    return Monitor(gymnasium.make("pter_gym:PTER/PathFollowing-v0", action_unit="normalised"))


def test_checker_is_silent():
    checker = pytest.importorskip("stable_baselines3.common.env_checker")

    with warnings.catch_warnings():
        warnings.simplefilter("error")
        checker.check_env(make_env().unwrapped)


def test_monitor_reports_the_episode():
    pytest.importorskip("stable_baselines3")
    env = make_env()
    env.reset(seed=3)
    total, length, done, info = 0.0, 0, False, {}
    while not done:
        _, reward, terminated, truncated, info = env.step(-np.ones(4, dtype=np.float32))
        total, length, done = total + float(reward), length + 1, terminated or truncated
    assert info["episode"]["l"] == length
    assert info["episode"]["r"] == pytest.approx(total, abs=1e-6)
