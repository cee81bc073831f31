"""Episodes for offline learning: whole, from training episodes, with the environment's bits."""

from collections.abc import Iterator
from typing import Any

import gymnasium
import numpy as np
import pytest

import pter_gym  # noqa: F401  (registers the environments)
from pter_gym.errors import ParameterError
from pter_gym.params import BASELINE
from pter_gym.policies._acting import load_policy
from pter_gym.tasks.path_following import observation_layout
from pter_gym.tools.datasets import recording
from pter_gym.tools.datasets.recording import (
    EPISODES_OF_A_SEED,
    LEVELS,
    RecordedEpisode,
    environment_of,
    record_transitions,
    reference_score,
)

STEPS = 400


@pytest.fixture(scope="module", autouse=True)
def few_worlds() -> Iterator[None]:
    """Record with eight worlds at once, not 128: episodes do not depend on their number."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(recording, "WORLDS", 8)
        yield


@pytest.fixture(scope="module", params=LEVELS)
def found(request: pytest.FixtureRequest) -> tuple[str, list[RecordedEpisode]]:
    return request.param, record_transitions("hands", request.param, STEPS, seed=3)


def test_episodes_are_whole_and_enough(found: tuple[str, list[RecordedEpisode]]) -> None:
    _, episodes = found
    first = 3 * EPISODES_OF_A_SEED
    assert [each.seed for each in episodes] == list(range(first, first + len(episodes)))
    assert STEPS <= sum(len(each.rewards) for each in episodes) < STEPS + 1000
    for each in episodes:
        assert each.observations.shape == (
            len(each.rewards) + 1,
            len(observation_layout(BASELINE, "torque")),
        )
        assert each.actions.shape == (len(each.rewards), 4)
        assert (each.observations.dtype, each.actions.dtype, each.rewards.dtype) == (
            np.float32,
            np.float32,
            np.float64,
        )
        over = each.terminations | each.truncations
        assert over.nonzero()[0].tolist() == [len(each.rewards) - 1]
        assert np.abs(each.actions).max() <= 1.0


def test_the_actions_give_the_same_bits_in_an_environment_of_ones_own(
    found: tuple[str, list[RecordedEpisode]],
) -> None:
    name, arguments = environment_of("hands", 3)
    env = gymnasium.make(name, **arguments)
    for each in (found[1][0], found[1][-1]):
        obs, _ = env.reset(seed=each.seed)
        rows, rewards, ends = [obs], [], (False, False)
        info = {"is_success": False}
        for action in each.actions:
            obs, reward, *ends, info = env.step(action)
            rows.append(obs)
            rewards.append(reward)
        assert np.array(rows).tobytes() == each.observations.tobytes()
        assert rewards == each.rewards.tolist()
        assert tuple(ends) == (each.terminations[-1], each.truncations[-1])
        assert info["is_success"] == each.arrived


def test_levels_have_the_same_episodes_and_seeds_have_others() -> None:
    expert, chance = (
        record_transitions("hands", level, 1, seed=0)[0] for level in ("expert", "random")
    )
    assert expert.observations[0].tobytes() == chance.observations[0].tobytes()
    other = record_transitions("hands", "random", 1, seed=1)[0]
    assert other.observations[0].tobytes() != chance.observations[0].tobytes()


def test_policies_begin_anew_with_each_episode() -> None:
    """The 12 episodes of eight worlds have the actions of the policy, which remembers, alone."""
    name, arguments = environment_of("hands", 3)
    env = gymnasium.make(name, **arguments)
    episodes = record_transitions("hands", "expert", 4000, seed=3)
    assert len(episodes) > 9
    policy = load_policy("residual", env)
    for each in episodes[-2:]:
        obs, _ = env.reset(seed=each.seed)
        policy.reset()
        for action in each.actions:
            np.testing.assert_allclose(policy(obs), action, atol=1e-5)
            obs = env.step(action)[0]


@pytest.mark.parametrize(
    ("field", "arguments"),
    [
        ("scenario", {"scenario": "standart"}),
        ("level", {"level": "experts"}),
        ("steps", {"steps": 0}),
        ("seed", {"seed": -1}),
        ("seed", {"seed": 2**32}),
    ],
)
def test_a_wrong_argument_is_named(field: str, arguments: dict[str, Any]) -> None:
    with pytest.raises(ParameterError, match=field):
        record_transitions(**{"scenario": "standard", "level": "random", "steps": 1, **arguments})


def test_reference_scores_are_those_of_the_evaluation_environment() -> None:
    low, high = (reference_score("standard", level, 1) for level in ("random", "expert"))
    assert low < 5.0 < 70.0 < high <= 100.0
