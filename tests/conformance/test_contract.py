"""The contract with Gymnasium, Stable-Baselines3 and those who seed, and what an observation and a reward are."""

import warnings
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import pter_gym
from pter_gym.scenarios import SCENARIOS
from pter_gym.tasks.path_following import PathFollowing, RewardWeights

ID = "PTER/PathFollowing-v0"
IDS = (ID, *(scenario.id for scenario in SCENARIOS.values()))


def test_each_scenario_is_registered_under_its_id() -> None:
    assert {name for name in gymnasium.registry if name.startswith("PTER/")} == set(IDS)
    assert pter_gym.__version__


@pytest.mark.parametrize("name", IDS)
def test_gymnasiums_checker_is_silent(name: str) -> None:
    options: dict[str, Any] = {} if name == ID else {"contexts": 8}
    env = gymnasium.make(name, action_unit="normalised", observe_context=True, sensors="force", **options)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(env.unwrapped, skip_render_check=True)


def test_the_checker_of_stable_baselines3_is_silent() -> None:
    checker = pytest.importorskip("stable_baselines3.common.env_checker")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        checker.check_env(gymnasium.make("PTER/Standard-v0", contexts=8))


def test_spec_round_trip() -> None:
    spec = gymnasium.make(ID, action_unit="normalised").spec
    assert spec is not None
    again = gymnasium.envs.registration.EnvSpec.from_json(spec.to_json())
    assert gymnasium.make(again).action_space == gymnasium.spaces.Box(-1.0, 1.0, (4,), np.float32)


@pytest.mark.parametrize("name", [ID, "PTER/Standard-v0"])
def test_a_generator_seeds_an_environment_and_its_seed_repeats_the_episode(name: str) -> None:
    task: Any = {"task": PathFollowing(start_offset=0.02)} if name == ID else {"contexts": 8}
    starts = []
    for seed in (7, 7, 8):
        env: Any = gymnasium.make(name, **task)
        env.unwrapped.np_random = np.random.default_rng(seed)
        starts.append(env.reset()[0].tobytes())
        env.unwrapped.np_random = np.random.default_rng(seed)
        assert env.reset()[0].tobytes() == starts[-1]
        following = env.reset()[0].tobytes()
        assert env.reset(seed=env.unwrapped.np_random_seed)[0].tobytes() == starts[-1]
        assert env.reset()[0].tobytes() == following != starts[-1]
    assert starts[0] == starts[1] != starts[2]
    env = gymnasium.make(name, **task)
    start, _ = env.reset()
    assert env.reset(seed=env.unwrapped.np_random_seed)[0].tobytes() == start.tobytes()


def test_an_environment_of_the_same_id_shares_its_contexts() -> None:
    one, two = (gymnasium.make("PTER/Tremor-v0", contexts=16).unwrapped for _ in range(2))
    assert all(a[1] is b[1] for a, b in zip(one.batch.pairs, two.batch.pairs, strict=True))  # type: ignore[attr-defined]


@pytest.mark.parametrize("sensors", ["encoders", "torque", "force"])
def test_observation_layout_names_every_entry(sensors: str) -> None:
    env: Any = gymnasium.make(ID, sensors=sensors)
    layout = env.unwrapped.observation_layout
    assert len(layout) == env.observation_space.shape[0]
    values = layout.as_dict(env.reset(seed=0)[0])
    assert values["pace"] == pytest.approx(0.5)
    assert values["progress"] == pytest.approx(0.0, abs=1e-7)
    assert values["cos_a"] ** 2 + values["sin_a"] ** 2 == pytest.approx(1.0, abs=1e-6)


def test_both_action_units_reach_the_same_voltages() -> None:
    volt, normalised = gymnasium.make(ID), gymnasium.make(ID, action_unit="normalised")
    volt.reset(seed=0), normalised.reset(seed=0)
    for k in range(20):
        action = np.array([1.0, 0.5 * (k % 5) - 1.0, 0.0, -1.0], np.float32)
        one, two = volt.step(24.0 * ((action + 1.0) / 2.0) ** 2), normalised.step(action)
        assert one[0].tobytes() == two[0].tobytes()


def test_a_free_arm_passes_the_end_beside_it_and_terminates() -> None:
    env = gymnasium.make(ID, max_episode_steps=1000)
    env.reset(seed=0)
    terminated = truncated = False
    while not (terminated or truncated):
        _, _, terminated, truncated, info = env.step(np.zeros(4, np.float32))
    assert (terminated, truncated, info["is_success"]) == (True, False, False)


def test_reward_is_the_sum_of_its_terms() -> None:
    env: Any = gymnasium.make(ID, task=PathFollowing(reward=RewardWeights(effort=2.0)))
    env.reset(seed=0)
    _, reward, _, _, info = env.step(np.full(4, 6.0, np.float32))
    row = env.unwrapped.telemetry_layout.as_dict(info["telemetry"])
    terms = [row[f"reward_{name}"] for name in ("tracking", "pace", "acceleration", "effort", "failure")]
    assert reward == pytest.approx(sum(terms), rel=1e-15)
    assert terms[0] > 0.0
    assert all(term <= 0.0 for term in terms[1:])
    assert row["reward_effort"] == pytest.approx(-0.01 * 2.0 * (6.0 / 24.0) ** 2, rel=1e-12)


def test_rounding_beyond_the_bounds_is_clipped() -> None:
    env: Any = gymnasium.make(ID).unwrapped
    env.reset(seed=0)
    ulp = float(np.spacing(np.float32(24.0)))
    obs = env.step(np.array([24.0 + 4.0 * ulp, -4.0 * ulp, 0.0, 24.0]))[0]
    first = env.observation_layout.index("volts_1")
    assert obs[first : first + 4].tolist() == [1.0, 0.0, 0.0, 1.0]


@pytest.mark.parametrize("kind", [np.int64, np.uint8, np.array])
def test_a_seed_may_be_any_integer(kind: Any) -> None:
    env = gymnasium.make(ID)
    assert env.reset(seed=kind(3))[0].tobytes() == env.reset(seed=3)[0].tobytes()
