"""On a Ray cluster of two nodes: workers have the worlds of one batch, bit for bit; RLlib and Tune train on them."""

import importlib.util
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import gymnasium
import numpy as np
import pytest
from numpy.typing import NDArray

import pter_gym
from pter_gym.benchmark import score_episodes
from pter_gym.benchmark.simulation import simulate, time_limit
from pter_gym.controllers import Free, Locked
from pter_gym.engine.batch import Batch
from pter_gym.envs.scenario import training_draws

pytestmark = [pytest.mark.agents, pytest.mark.long]
ray = pytest.importorskip("ray")

SCRIPTS = Path(__file__).parents[2] / "agents" / "at_scale"
UNUSED = 2**31 + 2
"""Seed of training draws that no script trains on."""


def load(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, SCRIPTS / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    """Two nodes of one core each, on this machine's own network alone."""
    from ray.cluster_utils import Cluster

    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("RAY_USAGE_STATS_ENABLED", "0")
        patch.setenv("HOME", str(tmp_path_factory.mktemp("home")))  # Ray writes the token of its clusters there
        node = {"num_cpus": 1, "node_ip_address": "127.0.0.1", "object_store_memory": 2**27}
        nodes = Cluster(initialize_head=True, head_node_args={**node, "include_dashboard": False})
        try:
            nodes.add_node(**node)
            ray.init(nodes.address)
            yield ray
        finally:
            ray.shutdown()
            nodes.shutdown()


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
def test_workers_have_the_worlds_of_one_batch(cluster: Any, policy: str) -> None:
    script = load("ray_rollouts")
    found = script.main(workers=2, worlds=24, policy=policy, seed=5)
    assert len(np.unique(found)) == 48
    whole = returns_of(gymnasium.make_vec("PTER/Standard-v0", 48), policy, seed=5)
    np.testing.assert_array_equal(found, whole)


def test_workers_are_on_different_nodes(cluster: Any) -> None:
    script = load("ray_rollouts")
    workers = [script.Worker.remote(2, "free") for _ in range(2)]
    places = [worker.__ray_call__.remote(lambda _: ray.get_runtime_context().get_node_id()) for worker in workers]
    assert len(set(ray.get(places))) == 2
