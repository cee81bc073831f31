"""Episodes for offline learning: whole, from training draws, the environment's own bits, and by their level."""

from collections.abc import Iterator

import gymnasium
import numpy as np
import pytest

import pter_gym  # noqa: F401  (registers the environments)
from pter_gym.errors import ParameterError
from pter_gym.params import BASELINE
from pter_gym.policies import policies_in, read_policy
from pter_gym.tasks.path_following import observation_layout
from pter_gym.tools.datasets import LEVELS, Episode, actors_of, record_episodes, recording
from pter_gym.tools.datasets.levels import STAGES, stages
from pter_gym.tools.datasets.recording import EPISODES_OF_A_SEED, environment_of

STEPS = 400


@pytest.fixture(scope="module", autouse=True)
def few_worlds() -> Iterator[None]:
    """Record with eight worlds at once, not 128: an episode does not depend on how many there are."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(recording, "WORLDS", 8)
        yield


@pytest.fixture(scope="module", params=LEVELS)
def found(request: pytest.FixtureRequest) -> tuple[str, list[Episode]]:
    return request.param, record_episodes("hands", request.param, STEPS, seed=3)


def test_episodes_are_whole_and_enough(found: tuple[str, list[Episode]]) -> None:
    level, episodes = found
    first = 3 * EPISODES_OF_A_SEED
    assert [each.seed for each in episodes] == list(range(first, first + len(episodes)))
    assert STEPS <= sum(len(each.rewards) for each in episodes) < STEPS + 1000 * len(actors_of("hands", level))
    for each in episodes:
        assert each.observations.shape == (len(each.rewards) + 1, len(observation_layout(BASELINE, "torque")))
        assert each.actions.shape == (len(each.rewards), 4)
        assert (each.observations.dtype, each.actions.dtype, each.rewards.dtype) == (np.float32, np.float32, np.float64)
        over = each.terminations | each.truncations
        assert over.nonzero()[0].tolist() == [len(each.rewards) - 1]
        assert np.abs(each.actions).max() <= 1.0


def test_the_actions_give_the_same_bits_in_an_environment_of_ones_own(found: tuple[str, list[Episode]]) -> None:
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
    expert, chance = (record_episodes("hands", level, 1, seed=0)[0] for level in ("expert", "random"))
    assert expert.observations[0].tobytes() == chance.observations[0].tobytes()
    other = record_episodes("hands", "random", 1, seed=1)[0]
    assert other.observations[0].tobytes() != chance.observations[0].tobytes()


def test_the_same_command_gives_the_same_bits() -> None:
    one, two = (record_episodes("hands", "replay", 100, seed=1) for _ in range(2))
    assert len(one) == len(two)
    for a, b in zip(one, two, strict=True):
        assert a.actions.tobytes() == b.actions.tobytes()
        assert a.observations.tobytes() == b.observations.tobytes()


def test_all_stages_are_there_and_said_what_they_are() -> None:
    told = stages()
    names = [each["name"] for each in told["stages"]]
    assert tuple(names) == policies_in(STAGES)
    assert set(told["medium"].values()) <= set(names)
    for each in told["stages"]:
        about = read_policy(STAGES / each["name"]).about
        assert about["steps"] == each["steps"]
        assert about["settings"]["persistence"] == told["persistence"]
        assert about["scenario"] == "PTER/Everything-v0"
    deviations = [each["deviation"] for each in told["stages"]]
    assert deviations == sorted(deviations, reverse=True)


def test_what_is_wrong_is_named() -> None:
    with pytest.raises(ParameterError, match="did you mean 'standard'"):
        record_episodes("standart", "random", 1)
    with pytest.raises(ParameterError, match=r"level must be among .*did you mean 'expert'"):
        record_episodes("standard", "experts", 1)
    with pytest.raises(ParameterError, match="steps must be"):
        record_episodes("standard", "random", 0)
    for seed in (-1, 2**31):
        with pytest.raises(ParameterError, match="seed must be"):
            record_episodes("standard", "random", 1, seed=seed)
