"""Stable-Baselines3's ``VecEnv`` over the batch: contract, wrappers, algorithms, same episodes."""

import subprocess
import sys
from dataclasses import replace
from typing import Any

import gymnasium
import numpy as np
import pytest

import pter_gym
from pter_gym.benchmark import from_sb3
from pter_gym.errors import ActionError, ParameterError
from pter_gym.hands import MultiSineHand
from pter_gym.params import BASELINE
from pter_gym.paths import Line
from pter_gym.policies import read_policy
from pter_gym.tasks.path_following import STARTS, PathFollowing
from rollouts import Acting

pytestmark = pytest.mark.agents

algorithms = pytest.importorskip("stable_baselines3")
vec_env = pytest.importorskip("stable_baselines3.common.vec_env")

ID = "PTER/PathFollowing-v0"
COUNT = 6
LIMIT = 19
TASK = PathFollowing(
    path=Line(length=0.55), start_offset=0.02, hand=MultiSineHand(random_phases=True)
)


def make(count: int = COUNT, **options: Any) -> Any:
    from pter_gym.envs.sb3 import make_sb3_vec_env

    return make_sb3_vec_env(count, task=TASK, **{"max_episode_steps": LIMIT, **options})


def actions(steps: int = 250, count: int = COUNT) -> np.ndarray:
    """Random normalised actions, half of them without voltage, so episodes end in both ways."""
    rng = np.random.default_rng(11)
    drawn = 2.0 * np.sqrt(rng.uniform(0.0, 1.0, (steps, count, 4))) - 1.0
    return np.where(rng.random((steps, count, 1)) < 0.5, -1.0, drawn).astype(np.float32)


def test_same_episodes_as_stable_baselines_own_vec_env_of_single_environments() -> None:
    ours = make()
    theirs = vec_env.DummyVecEnv(
        [
            lambda: algorithms.common.monitor.Monitor(
                gymnasium.make(ID, task=TASK, max_episode_steps=LIMIT)
            )
        ]
        * COUNT
    )
    ours.seed(40)
    theirs.seed(40)
    assert ours.reset().tobytes() == theirs.reset().tobytes()
    returns = np.zeros((2, COUNT))
    ends = {"terminated": 0, "truncated": 0}
    for row in actions():
        obs, rewards, dones, infos = ours.step(row)
        their_obs, their_rewards, their_dones, their_infos = theirs.step(row)
        for mine, other in ((obs, their_obs), (rewards, their_rewards), (dones, their_dones)):
            assert (mine.dtype, mine.tobytes()) == (other.dtype, other.tobytes())
        returns += [rewards, their_rewards]
        for info, their_info, done in zip(infos, their_infos, dones, strict=True):
            assert info["TimeLimit.truncated"] is their_info["TimeLimit.truncated"]
            assert (
                ("terminal_observation" in info) == ("terminal_observation" in their_info) == done
            )
            if done:
                assert (
                    info["terminal_observation"].tobytes()
                    == their_info["terminal_observation"].tobytes()
                )
                assert info["is_success"] is their_info["is_success"]
                mine, other = info["episode"], their_info["episode"]
                assert (mine.keys(), mine["r"], mine["l"]) == (other.keys(), other["r"], other["l"])
                ends["truncated" if info["TimeLimit.truncated"] else "terminated"] += 1
    assert returns[0].tobytes() == returns[1].tobytes()
    assert min(ends.values()) > 3, ends


def test_seed_holds_for_one_reset() -> None:
    env = make()
    assert env.seed(7) == list(range(7, 7 + COUNT))
    first = env.reset()
    second = env.reset()
    assert first.tobytes() != second.tobytes()
    env.seed(7)
    assert env.reset().tobytes() == first.tobytes()
    assert env.reset().tobytes() == second.tobytes()


def test_reset_infos_options_and_attributes() -> None:
    env = make()
    env.reset()
    assert env.reset_infos == [{}] * COUNT
    assert len({id(info) for info in env.reset_infos}) == COUNT
    assert env.get_attr("num_envs", [0, 2]) == [COUNT, COUNT]
    assert env.get_attr("render_mode") == [None] * COUNT
    assert env.env_is_wrapped(gymnasium.Wrapper) == [False] * COUNT
    assert env.env_is_wrapped(algorithms.common.monitor.Monitor) == [True] * COUNT
    assert env.has_attr("autoreset_mode")
    assert not env.has_attr("gravity")
    with pytest.raises(ParameterError, match="num_envs"):
        env.set_attr("num_envs", 3)
    wrong: list[Any] = [{"speed": 1.0}, 5]
    for options in wrong:
        env.set_options(options)
        with pytest.raises(ParameterError, match="options"):
            env.reset()
        env.reset()  # what was refused is forgotten
    env.seed(-5)
    with pytest.raises(ParameterError, match="seed"):
        env.reset()
    env.reset()


def test_worlds_are_drawn_as_one_picture() -> None:
    pytest.importorskip("pygame")
    env = make(3, render_mode="rgb_array", width=64, height=48)
    env.reset()
    assert env.get_attr("render_mode") == ["rgb_array"] * 3
    assert [image.shape for image in env.get_images()] == [(48, 64, 3)] * 3
    picture = env.render()
    assert picture is not None
    assert picture.shape == (96, 128, 3)


def test_bad_actions_and_a_closed_environment_raise() -> None:
    env = make()
    env.reset()
    with pytest.raises(ActionError, match="shape"):
        env.step(np.zeros((COUNT + 1, 4), np.float32))
    env.close()
    with pytest.raises(gymnasium.error.ClosedEnvironmentError):
        env.step(np.zeros((COUNT, 4), np.float32))


@pytest.mark.slow
def test_sac_learns() -> None:
    pytest.importorskip("torch").set_num_threads(1)
    model = algorithms.SAC(
        "MlpPolicy",
        make(),
        learning_starts=60,
        batch_size=32,
        train_freq=4,
        policy_kwargs={"net_arch": [16, 16]},
        seed=0,
        device="cpu",
    )
    model.learn(total_timesteps=600)
    assert model.num_timesteps == 600
    assert len(model.ep_info_buffer) > 3
    buffer = model.replay_buffer
    # an episode's last transition leads to its last observation, not to the start of the next
    assert buffer.dones[: buffer.pos].any()
    following = buffer.next_observations[: buffer.pos - 1] == buffer.observations[1 : buffer.pos]
    ended = buffer.dones[: buffer.pos - 1].astype(bool) | (buffer.timeouts[: buffer.pos - 1] > 0)
    assert following.all(axis=-1)[~ended].all()
    assert not following.all(axis=-1)[ended].any()


def test_missing_stable_baselines_says_what_to_install() -> None:
    program = (
        "import sys; sys.modules['stable_baselines3'] = None\n"
        "try: import pter_gym.envs.sb3\n"
        "except ImportError as error: print(error)\n"
    )
    result = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    assert "'.[agents]'" in result.stdout


def test_a_trained_policy_acts_in_it_and_is_reset_by_its_user() -> None:
    from pter_gym.envs.sb3 import make_sb3_vec_env

    env = make_sb3_vec_env(
        3, task=replace(TASK, start_offset=0.0, truncation_error=0.02, starts=STARTS["path"])
    )
    watched = vec_env.VecCheckNan(env)
    policy = pter_gym.load_policy("residual", watched)
    bound = read_policy("residual").bind(BASELINE, env.env.observation_layout)
    alone = [Acting(bound) for _ in range(3)]
    watched.seed(0)
    observations, began = watched.reset(), 0
    for _ in range(100):
        chosen = policy(observations)
        volts = [act(row) for act, row in zip(alone, observations, strict=True)]
        np.testing.assert_allclose(24.0 * ((chosen + 1.0) / 2.0) ** 2, volts, atol=1e-3)
        observations, _, done, _ = watched.step(chosen)
        began += 0 < done.sum() < 3
        policy.reset(done)
        for world in np.flatnonzero(done):
            alone[world].reset()
    assert began >= 2
    with pytest.raises(ParameterError, match="VecNormalize"):
        pter_gym.load_policy("residual", vec_env.VecNormalize(env))


@pytest.mark.smoke
@pytest.mark.parametrize("kind", ["batch", "dummy"])
def test_models_of_stable_baselines_bring_that_of_their_environment(kind: str) -> None:
    from stable_baselines3.common.env_util import make_vec_env

    from pter_gym.envs.sb3 import make_sb3_vec_env

    keywords: dict[str, Any] = {"frame_skip": 4}
    made = {
        "batch": lambda: make_sb3_vec_env(2, **keywords),
        "dummy": lambda: make_vec_env("PTER/Standard-v0", 2, env_kwargs=keywords),
    }[kind]()
    model = algorithms.PPO("MlpPolicy", made, n_steps=8, batch_size=8, device="cpu")
    assert from_sb3(model).frame_skip == 4
    assert from_sb3(model, frame_skip=2).frame_skip == 2
    with pytest.raises(ParameterError, match="frame_skip"):
        from_sb3(model, frame_skip=0)
    with pytest.raises(ParameterError, match="frame_skip"):
        pter_gym.load_policy(from_sb3(model), gymnasium.make("PTER/PathFollowing-v0"))
