"""An action has an entry for each clutch of the machine, whatever makes the environment.

``tests/verification/test_arrangements.py`` steps machines of other clutches than PTER's."""

from typing import Any

import gymnasium
import numpy as np
import pytest

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
    env = gymnasium.make(ID, machine=name)
    envs = gymnasium.make_vec(ID, num_envs=3, machine=name)
    assert env.action_space.shape == envs.single_action_space.shape == (count,)
    env.reset(seed=6)
    with pytest.raises(ActionError, match=rf"\({count},\)"):
        env.unwrapped.step(np.zeros(count + 1, np.float32))


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
