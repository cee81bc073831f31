"""Stable-Baselines3's algorithms on our worlds: what they are shown, and that the actor is their mean action."""

from dataclasses import asdict
from typing import Any

import numpy as np
import pytest

pytestmark = pytest.mark.agents

torch = pytest.importorskip("torch")
pytest.importorskip("stable_baselines3")
pytest.importorskip("sb3_contrib")

from pter_agents import prepare, training  # noqa: E402
from pter_agents.algorithms import load_settings, settings_from  # noqa: E402
from pter_agents.stable import StableWorlds  # noqa: E402

SMALL = {"worlds": 16, "steps": 8, "contexts": 4, "hidden": [8], "value_hidden": [8], "minibatch": 32, "episode": 20}
FEW = {
    "sac": {"updates": 4, "buffer": 256},
    "tqc": {"updates": 4, "buffer": 256},
    "recurrent": {"epochs": 2, "lstm": 6},
}


def make(algorithm: str, **changes: Any) -> tuple[Any, Any]:
    """A model and its worlds."""
    settings = settings_from(algorithm, {**asdict(load_settings(algorithm)), **SMALL, **FEW[algorithm], **changes})
    given = training.Arguments(
        algorithm=algorithm, scenario="standard", pace="all", steps=1000, seed=2, settings=settings
    )
    draws = training.make_draws(given)
    worlds = training.make_training_worlds(given, draws, prepare.make_interface(settings, "standard", draws, 2))
    return training.make_model(given, worlds), worlds


def test_they_are_shown_the_worlds() -> None:
    (_, worlds), (_, others) = make("sac"), make("sac")
    shown = StableWorlds(worlds, 5, 0.5)
    assert shown.reset().tobytes() == others.reset(5).tobytes()
    rng = np.random.default_rng(0)
    ends = 0
    for _ in range(25):
        actions = rng.uniform(-1.0, 1.0, (16, 4)).astype(np.float32)
        inputs, rewards, done, infos = shown.step(actions)
        step = others.step(actions)
        assert inputs.tobytes() == step.inputs.tobytes()
        assert inputs.shape == (16, *shown.observation_space.shape)
        np.testing.assert_allclose(rewards, 0.5 * step.rewards, rtol=1e-6)
        assert np.flatnonzero(done).tolist() == step.ended.tolist()
        for row, world in enumerate(step.ended.tolist()):
            assert infos[world]["terminal_observation"].tobytes() == step.last[row].tobytes()
            assert infos[world]["TimeLimit.truncated"] == step.truncated[world]
        assert sum("terminal_observation" in info for info in infos) == len(step.ended)
        ends += len(step.ended)
    assert ends >= 16


@pytest.mark.parametrize("algorithm", FEW)
def test_the_actor_is_the_mean_action(algorithm: str) -> None:
    model, worlds = make(algorithm, start=0.4)
    if algorithm == "recurrent":
        inputs = np.zeros((3, worlds.size), np.float32)
        np.testing.assert_allclose(model.actor()(inputs, model.actor().begin(3))[0], 0.4, atol=0.01)
    model.advance()
    actor = model.actor()
    memory, theirs = actor.begin(5), None
    rng = np.random.default_rng(1)
    for _ in range(4):
        inputs = rng.normal(size=(5, worlds.size)).astype(np.float32)
        expected, theirs = model.algorithm.predict(inputs, theirs, deterministic=True)
        outputs, memory = actor(inputs, memory)
        np.testing.assert_allclose(outputs.clip(-1.0, 1.0), expected, atol=1e-6)
        np.testing.assert_allclose(actor.exact()(inputs, memory)[0], actor(inputs, memory)[0], atol=1e-6)
    assert memory.shape == (5, 12 if algorithm == "recurrent" else 0)


@pytest.mark.parametrize("algorithm", ["sac", "tqc"])
def test_gradient_steps_follow_each_rollout_and_all_networks_learn(algorithm: str) -> None:
    model, _ = make(algorithm, entropy=0.2, discount=0.9, soft_update=0.5)
    before = {name: tensor.clone() for name, tensor in model.algorithm.policy.state_dict().items()}
    logged = model.advance()
    after = model.algorithm.policy.state_dict()
    assert (model.steps, logged["train/n_updates"]) == (128, 4)
    assert logged["train/ent_coef"] == pytest.approx(0.2, rel=0.01)
    assert all((before[name] != after[name]).any() for name in before)
    assert len(model.get_state()["kept"]["rewards"]) == 8
    for _ in range(2):
        model.advance()
    kept = model.get_state()
    assert (len(kept["kept"]["rewards"]), kept["next"]) == (16, 8)
