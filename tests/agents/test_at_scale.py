"""On a Ray cluster: two workers have the worlds of one batch, bit for bit; RLlib and Tune train on them."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from numpy.typing import NDArray

import pter_gym
from documents import load_script
from pter_gym.benchmark import examine

pytestmark = [pytest.mark.agents, pytest.mark.long]
ray = pytest.importorskip("ray")

SCRIPTS = Path(__file__).parents[2] / "agents" / "at_scale"


@pytest.fixture(autouse=True)
def importable(monkeypatch: pytest.MonkeyPatch) -> None:
    """As the folder of a script is when it runs."""
    monkeypatch.syspath_prepend(SCRIPTS)


@pytest.fixture(scope="module")
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """A cluster with room for two workers, on this machine's own network alone."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("RAY_USAGE_STATS_ENABLED", "0")
        patch.setenv("HOME", str(tmp_path_factory.mktemp("home")))  # Ray writes the token of its clusters there
        ray.init(num_cpus=2, include_dashboard=False, _node_ip_address="127.0.0.1")
        yield
        ray.shutdown()


def returns_of(env: Any, policy: str, seed: int) -> NDArray[np.float64]:
    """The return of the first episode of each world, added up as they come."""
    acting = pter_gym.load_policy(policy, env)
    obs, _ = env.reset(seed=seed)
    found = np.zeros(env.num_envs)
    alive = np.ones(env.num_envs, bool)
    while alive.any():
        obs, rewards, terminated, truncated, _ = env.step(acting(obs))
        found[alive] += rewards[alive]
        alive &= ~(terminated | truncated)
    return found


@pytest.mark.parametrize("policy", ["residual", "impedance-tuned"])
def test_workers_have_the_worlds_of_one_batch(cluster: None, policy: str) -> None:
    script = load_script(SCRIPTS / "ray_rollouts.py")
    found = script.main(workers=2, worlds=24, policy=policy, seed=5)
    assert len(np.unique(found)) == 48
    whole = returns_of(gymnasium.make_vec("PTER/Standard-v0", 48, frame_skip=1), policy, seed=5)
    np.testing.assert_array_equal(found, whole)


def test_a_minute_of_rllib_beats_doing_nothing(cluster: None) -> None:
    """Neither released nor locked clutches bring the arm along the path; what has learnt does, and nearer to it."""
    verdicts = examine({"learnt": load_script(SCRIPTS / "rllib_ppo.py").learn(seed=0)})
    others = verdicts["free"], verdicts["locked"]
    assert verdicts["learnt"].path_error_m < 0.5 * min(each.path_error_m for each in others)
    assert verdicts["learnt"].completed > 0.9 > max(each.completed for each in others)


def test_tune_tries_settings_and_finds_the_best(cluster: None, tmp_path: Path) -> None:
    found = load_script(SCRIPTS / "ray_tune.py").search(trials=2, steps=8_000, out=tmp_path)
    assert len(found) == 2
    assert not found.errors
    rows = found.get_dataframe()
    assert rows["config/lr"].nunique() == rows["config/gamma"].nunique() == 2
    assert rows["env_runners/num_env_steps_sampled_lifetime"].min() >= 8_000
    best = found.get_best_result()
    assert best.metrics["env_runners"]["episode_return_mean"] == rows["env_runners/episode_return_mean"].max()
