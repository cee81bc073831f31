"""An action has an entry for each clutch of the machine, whatever makes the environment."""

from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from pter_gym import load_policy
from pter_gym.errors import ActionError, ParameterError
from pter_gym.params import MACHINES

COUNTS = {"two-brakes": 2, "brakes-and-coupling": 3, "baseline": 4}
ID = "PTER/PathFollowing-v0"


@pytest.mark.parametrize("name", [ID, "PTER/Standard-v0", "PTER/Wall-v0"])
def test_actions_are_normalised_by_default(name: str):
    space: Any = gymnasium.make(name).action_space
    assert (space.low.tolist(), space.high.tolist()) == ([-1.0] * 4, [1.0] * 4)


@pytest.mark.parametrize("name", COUNTS)
def test_single_and_vector_environments_have_an_entry_for_each_clutch(name: str):
    count = COUNTS[name]
    env = gymnasium.make(ID, machine=name, max_episode_steps=40)
    envs = gymnasium.make_vec(ID, num_envs=3, machine=name, max_episode_steps=40)
    assert env.action_space.shape == envs.single_action_space.shape == (count,)
    check_env(env.unwrapped, skip_render_check=True)
    env.reset(seed=6)
    with pytest.raises(ActionError, match=rf"\({count},\)"):
        env.step(np.zeros(count + 1, np.float32))


@pytest.mark.agents
@pytest.mark.parametrize("name", COUNTS)
def test_the_interface_for_stable_baselines3_steps_as_the_vector_environment(name: str):
    make_sb3_vec_env = pytest.importorskip(
        "pter_gym.envs.sb3", exc_type=ImportError
    ).make_sb3_vec_env
    worlds = make_sb3_vec_env(3, machine=name)
    envs = gymnasium.make_vec(ID, num_envs=3, machine=name)
    assert worlds.action_space.shape == (COUNTS[name],)
    worlds.seed(5)
    np.testing.assert_array_equal(worlds.reset(), envs.reset(seed=5)[0])
    actions = np.full((3, COUNTS[name]), -0.4, np.float32)
    np.testing.assert_array_equal(worlds.step(actions)[0], envs.step(actions)[0])


def test_an_empty_slot_has_no_voltage():
    env: Any = gymnasium.make(ID, machine="two-brakes")
    env.reset(seed=1)
    info = env.step(np.array([0.2, 0.5], np.float32))[4]
    volts = [env.unwrapped.telemetry_layout.index(f"volts_{x}") for x in (1, 2, 3, 4)]
    assert info["telemetry"][volts] == pytest.approx([24 * 0.6**2, 24 * 0.75**2, 0.0, 0.0])


def test_laws_and_functions_act_on_their_machine():
    env = gymnasium.make(ID, machine="two-brakes", action_unit="volt")
    observation = env.reset(seed=1)[0]
    assert load_policy("impedance", env)(observation).shape == (2,)
    assert load_policy(lambda obs: np.full((len(obs), 2), 3.0), env)(observation).tolist() == [
        3.0,
        3.0,
    ]
    with pytest.raises(ParameterError, match="2 volts"):
        load_policy(lambda obs: np.zeros((len(obs), 4)), env)(observation)
    with pytest.raises(ParameterError, match="clutches"):
        load_policy("ppo-standard", gymnasium.make(ID, machine="two-brakes", frame_skip=3))


def test_machines_of_one_batch_have_equally_many_clutches():
    with pytest.raises(ParameterError, match="clutches"):
        gymnasium.make_vec(
            ID, num_envs=2, machine=[MACHINES["two-brakes"], MACHINES["brakes-and-coupling"]]
        )


def test_jax_env_takes_an_entry_for_each_clutch():
    name = "two-brakes"
    jax = pytest.importorskip("jax")
    jax_env = pytest.importorskip("pter_gym.envs.jax")
    env, params = jax_env.make(ID, machine=name)
    assert env.num_actions == env.action_space().shape[0] == COUNTS[name]
    envs = gymnasium.make_vec(ID, num_envs=1, machine=name, autoreset_mode="SAME_STEP")
    rows, (obs, state) = envs.reset(seed=3)[0], env.reset_to_seed(3, params)
    for _ in range(10):
        np.testing.assert_array_equal(rows[0], obs)
        action = np.full(COUNTS[name], -0.4, np.float32)
        rows = envs.step(action[None])[0]
        obs, state, *_ = env.step(None, state, jax.numpy.asarray(action), params)
