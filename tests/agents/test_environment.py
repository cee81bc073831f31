"""The environment under Stable-Baselines3: its checker is silent and an algorithm learns from it."""

import subprocess
import sys
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


@pytest.mark.slow
def test_ppo_learns_for_two_rollouts():
    algorithms = pytest.importorskip("stable_baselines3")
    model = algorithms.PPO("MlpPolicy", make_env(), n_steps=256, batch_size=64, n_epochs=2, seed=0, device="cpu")
    before = [p.detach().clone() for p in model.policy.parameters()]
    model.learn(total_timesteps=512)
    after = list(model.policy.parameters())
    assert model.num_timesteps == 512
    assert all(p.isfinite().all() for p in after)
    assert any((a != b).any() for a, b in zip(after, before, strict=True))


def test_missing_stable_baselines_says_what_to_install():
    program = (
        "import sys; sys.modules['stable_baselines3'] = None\n"
        "from pter_agents.command import train\n"
        "from pter_gym.errors import DependencyError\n"
        "try: train('ppo', smoke=True)\n"
        "except DependencyError as error: print(error)\n"
    )
    result = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert "'.[agents]'" in result.stdout
