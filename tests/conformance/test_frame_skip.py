"""A held action: the same bits as one that is given again and again, on all doors, until the episode ends."""

from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

import pter_gym
from pter_gym._engine.batch import Batch
from pter_gym._engine.world import ROW
from pter_gym.benchmark import from_actions
from pter_gym.benchmark.simulation import run
from pter_gym.controllers import Impedance, bind
from pter_gym.params import BASELINE
from pter_gym.scenarios import SCENARIOS
from pter_gym.tasks.path_following import COLUMN, PathFollowing

WORLDS = 37
"""Two blocks, the second one not full."""

DECISIONS = 120


def actions_of(seed: int, skip: int) -> np.ndarray[Any, np.dtype[np.float32]]:
    """Weak voltages, with which worlds leave the path and arrive at different times, (DECISIONS, WORLDS, 4)."""
    rng = np.random.default_rng([seed, skip])
    return rng.uniform(0.0, 9.0, (DECISIONS, WORLDS, 4)).astype(np.float32)


def draws(seed: int) -> Any:
    return SCENARIOS["everything"].randomisation("brisk", contexts=7, seed=seed)


class Repeating:
    """A single environment in which each action is given ``skip`` times, or until the episode ends."""

    def __init__(self, seed: int, world_seed: int, skip: int) -> None:
        self.env: Any = gymnasium.make("PTER/PathFollowing-v0", randomisation=draws(seed)).unwrapped
        self.skip = skip
        self.obs, _ = self.env.reset(seed=world_seed)

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        total = 0.0
        for _ in range(self.skip):
            obs, reward, terminated, truncated, info = self.env.step(action)
            total = reward + total
            if terminated or truncated:
                break
        return obs, total, terminated, truncated, info


@settings(max_examples=4, deadline=None, phases=[Phase.explicit, Phase.generate])
@given(
    seed=st.integers(0, 2**31),
    skip=st.integers(1, 9),
    mode=st.sampled_from([AutoresetMode.SAME_STEP, AutoresetMode.NEXT_STEP]),
    threads=st.integers(1, 2),
)
def test_worlds_are_those_of_repeated_actions(seed: int, skip: int, mode: AutoresetMode, threads: int) -> None:
    vector: Any = gymnasium.make_vec(
        "PTER/PathFollowing-v0",
        num_envs=WORLDS,
        randomisation=draws(seed),
        frame_skip=skip,
        autoreset_mode=mode,
        max_episode_steps=None,
        num_threads=threads,
    )
    obs, _ = vector.reset(seed=seed)
    singles = [Repeating(seed, seed + world, skip) for world in range(WORLDS)]
    np.testing.assert_array_equal(obs, [each.obs for each in singles])
    ended = np.zeros(WORLDS, np.bool_)
    ends = 0
    for actions in actions_of(seed, skip):
        obs, rewards, terminated, truncated, infos = vector.step(actions)
        for world, each in enumerate(singles):
            if ended[world]:
                first, info = each.env.reset()
                assert (obs[world].tobytes(), rewards[world]) == (first.tobytes(), 0.0)
                assert not terminated[world]
                ended[world] = False
                continue
            last, reward, *flags, info = each.step(actions[world])
            assert (rewards[world], terminated[world], truncated[world]) == (reward, *flags)
            told = infos["telemetry"][world]
            if any(flags) and mode == AutoresetMode.SAME_STEP:
                assert infos["final_obs"][world].tobytes() == last.tobytes()
                assert infos["final_info"]["telemetry"][world].tobytes() == info["telemetry"].tobytes()
                last, info = each.env.reset()
            assert obs[world].tobytes() == last.tobytes()
            assert told.tobytes() == info["telemetry"].tobytes()
            ended[world] = any(flags) and mode == AutoresetMode.NEXT_STEP
            ends += any(flags)
    assert ends > 0
    vector.close()


@pytest.mark.parametrize("skip", [1, 4])
def test_a_single_environment_holds_its_action(skip: int) -> None:
    env: Any = gymnasium.make("PTER/PathFollowing-v0", randomisation=draws(1), frame_skip=skip)
    repeating = Repeating(1, 5, skip)
    obs, _ = env.reset(seed=5)
    assert obs.tobytes() == repeating.obs.tobytes()
    for action in actions_of(1, skip)[:, 0]:
        one, two = env.step(action), repeating.step(action)
        assert one[0].tobytes() == two[0].tobytes()
        assert one[1:4] == two[1:4]
        assert one[4]["telemetry"].tobytes() == two[4]["telemetry"].tobytes()
        if one[2] or one[3]:
            return
    pytest.fail("the episode has not ended")


def test_ids_of_scenarios_hold_theirs_too() -> None:
    single: Any = gymnasium.make("PTER/Standard-v0")
    vector: Any = gymnasium.make_vec("PTER/Standard-v0", num_envs=1)
    first, _ = single.reset(seed=2)
    np.testing.assert_array_equal(vector.reset(seed=2)[0][0], first)
    action = np.full(4, -0.5, np.float32)
    obs, reward, *_ = single.step(action)
    rows, rewards, *_ = vector.step(action[None])
    assert rows[0].tobytes() == obs.tobytes()
    assert rewards[0] == reward
    assert single.unwrapped.batch.get_state()["worlds"][0, ROW.step, 0] == 3


@pytest.mark.parametrize("mode", ["SAME_STEP", "NEXT_STEP"])
def test_the_limit_counts_steps_of_the_environment(mode: str) -> None:
    single: Any = gymnasium.make("PTER/PathFollowing-v0", frame_skip=4, max_episode_steps=5)
    vector: Any = gymnasium.make_vec(
        "PTER/PathFollowing-v0", num_envs=1, frame_skip=4, max_episode_steps=5, autoreset_mode=mode
    )
    single.reset(seed=0)
    vector.reset(seed=0)
    locked = np.full(4, 24.0, np.float32)
    ones = [single.step(locked)[3] for _ in range(5)]
    many = [bool(vector.step(locked[None])[3][0]) for _ in range(5)]
    assert ones == many == [False] * 4 + [True]


def noted(seen: list[Any]) -> Any:
    """A function that remembers what it sees, and gives another voltage each time."""

    def act(obs: Any) -> Any:
        seen.append(obs)
        return np.full((len(obs), 4), 0.25 * len(seen), np.float32)

    return act


@pytest.mark.parametrize("skip", [1, 3])
def test_a_policy_is_asked_as_often_as_it_was_trained(skip: int) -> None:
    env: Any = gymnasium.make("PTER/PathFollowing-v0", frame_skip=skip)
    asked: list[Any] = []
    policy = from_actions(noted(asked), env)
    assert policy.frame_skip == skip
    ridden = run(Batch(BASELINE, PathFollowing(), 2), policy, [3, 4], [18, 18]).telemetry
    expected = 0.25 * (1.0 + np.arange(18) // skip)
    np.testing.assert_array_equal(ridden[1:, :, COLUMN.volts[0]], np.repeat(expected[:, None], 2, axis=1))
    acting = pter_gym.load_policy(from_actions(noted(seen := []), env), env)
    obs, _ = env.reset(seed=3)
    acting.reset()
    for k in range(18 // skip):
        assert obs.tobytes() == asked[k][0].tobytes()
        obs, *_, info = env.step(acting(obs))
        assert info["telemetry"].tobytes() == ridden[(k + 1) * skip, 0].tobytes()
    assert len(seen) == len(asked) == 18 // skip


def test_a_law_may_decide_less_often_than_the_kernel_asks_it() -> None:
    batch = Batch(BASELINE, PathFollowing(), 1)
    law = bind(Impedance(), BASELINE, batch.layout)
    law.frame_skip = 5
    volts = run(batch, law, [1], [50]).telemetry[1:, 0][:, [*COLUMN.volts]]
    changes = np.flatnonzero(np.diff(volts, axis=0).any(axis=1)) + 1
    assert len(changes) > 3
    assert (changes % 5 == 0).all()
