"""Policies in environments: new episodes are noticed, units are the environment's, what cannot be right is refused."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium import spaces, wrappers
from gymnasium.vector import AutoresetMode
from gymnasium.wrappers.vector import NormalizeObservation, RecordEpisodeStatistics
from hypothesis import given
from hypothesis import strategies as st
from pter_gym.policies._cards import fields_of

import pter_gym
from pter_gym._compiled.layout import Layout
from pter_gym._engine.batch import Batch
from pter_gym.benchmark import find_policy, from_sb3
from pter_gym.controllers._predictive.policies import Decide, Predictive
from pter_gym.envs._acting import ActingPolicy, nominal_machine, normalised
from pter_gym.envs._vector import PathFollowingVectorEnv
from pter_gym.errors import ActionError, ParameterError, ResetNeededError
from pter_gym.params import BASELINE, DELRIN_THEORETICAL, Machine
from pter_gym.policies import Card, Input, Interface, write_policy
from pter_gym.scenarios import find_scenario
from pter_gym.tasks.path_following import STARTS, PathFollowing, observation_layout

LAYOUT = observation_layout(BASELINE, "torque")
REMEMBER = ("residual", "torque-feedback-tuned", "lstm")
LOW = np.full(4, -1.0, np.float32)
ENDS_SOON = PathFollowing(truncation_error=0.02, starts=STARTS["path"])
"""The tip begins anywhere and is off the path after some control steps, whose number depends on the seed."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A policy of random numbers with an LSTM, as ``pter export`` would write it."""
    path = tmp_path_factory.mktemp("policies")
    inputs = (Input("normal_error", 0.0, 0.01), Input("speed_across", 0.0, 0.1))
    card = Card("lstm", fields_of(LAYOUT), 24.0, Interface(inputs, 12.0, averages=(5,)), (4,), "", lstm=3)
    rng = np.random.default_rng(1)
    write_policy(card, {name: rng.normal(size=shape).astype("f4") for name, shape in card.shapes.items()}, "", path)
    return path


def written(name: str, folder: Path) -> str:
    return str(folder / name) if name == "lstm" else name


def make(**keywords: Any) -> Any:
    plain = {"action_unit": "volt", "frame_skip": 1}
    return gymnasium.make("PTER/Standard-v0", pace="medium", contexts=8, **plain | keywords)


def play(env: Any, policy: Callable[[Any], Any], seed: int, steps: int = 25) -> np.ndarray:
    """The voltages of the first control steps of an episode."""
    observation, _ = env.reset(seed=seed)
    volts: list[np.ndarray] = []
    for _ in range(steps):
        observation, *_, info = env.step(policy(observation))
        volts.append(env.unwrapped.telemetry_layout.physical(info["telemetry"], "volts_1"))
    return np.array(volts)


@pytest.mark.parametrize("name", REMEMBER)
def test_an_episode_is_what_it_is_with_a_policy_that_has_seen_nothing(name: str, folder: Path) -> None:
    env = make()
    policy = pter_gym.load_policy(written(name, folder), env)
    again = [play(env, policy, seed) for seed in (0, 1, 0)]
    fresh = [play(env, pter_gym.load_policy(written(name, folder), env), seed) for seed in (0, 1, 0)]
    np.testing.assert_array_equal(again, fresh)
    np.testing.assert_array_equal(again[0], again[2])
    held_wrongly: Any = find_policy(written(name, folder)).bind(BASELINE, LAYOUT)
    assert not np.array_equal([play(env, held_wrongly, seed) for seed in (0, 1, 0)], fresh)


def make_worlds(mode: AutoresetMode | None, n: int = 4) -> Any:
    """Worlds whose episodes end at different times; without a mode, environments one by one."""
    if mode is not None:
        return PathFollowingVectorEnv(n, task=ENDS_SOON, autoreset_mode=mode)
    one = gymnasium.make_vec("PTER/PathFollowing-v0", n, vectorization_mode="sync", task=ENDS_SOON)
    return RecordEpisodeStatistics(one)


@pytest.mark.parametrize("mode", [*AutoresetMode, None], ids=str)
@pytest.mark.parametrize("name", REMEMBER)
def test_worlds_that_begin_at_different_times_are_forgotten_one_by_one(
    mode: AutoresetMode | None, name: str, folder: Path
) -> None:
    env = make_worlds(mode)
    policy = pter_gym.load_policy(written(name, folder), env)
    alone, never_told = (
        [find_policy(written(name, folder)).bind(BASELINE, LAYOUT) for _ in range(4)] for _ in range(2)
    )
    observations, infos = env.reset(seed=range(4) if mode else 0)
    begun, apart = 0, 0.0
    for _ in range(80):
        starts = infos["telemetry"][:, 0] == 0.0
        begun += 0 < starts.sum() < 4
        for world in np.flatnonzero(starts):
            alone[world].reset()  # type: ignore[attr-defined]
        volts = policy(observations)
        np.testing.assert_allclose(volts, [act(row) for act, row in zip(alone, observations, strict=True)], atol=1e-4)
        told = [act(row) for act, row in zip(never_told, observations, strict=True)]
        apart = max(apart, float(np.abs(volts - told).max()))
        observations, _, terminated, truncated, infos = env.step(volts)
        if mode is AutoresetMode.DISABLED and (terminated | truncated).any():
            observations, infos = env.reset(options={"reset_mask": terminated | truncated})
            infos["telemetry"] = np.where((terminated | truncated)[:, None], infos["telemetry"], 1.0)
    assert begun >= 2, "episodes should begin at different times"
    assert apart > 0.01, "it should matter"
    env.close()


def test_actions_are_in_the_unit_of_the_environment() -> None:
    observations, volts = find_observations(8), {}
    for unit in ("volt", "normalised"):
        env = gymnasium.make_vec("PTER/Standard-v0", 8, contexts=8, action_unit=unit, frame_skip=1)
        env.reset(seed=0)
        action = pter_gym.load_policy("residual", env)(observations)
        assert env.action_space.contains(action)
        volts[unit] = action if unit == "volt" else 24.0 * ((action + 1.0) / 2.0) ** 2
        env.step(action)
    np.testing.assert_allclose(volts["normalised"], volts["volt"], atol=2e-5)
    assert np.ptp(volts["volt"]) > 1.0


def find_observations(count: int) -> np.ndarray:
    """What worlds of the standard scenario see at the start."""
    env = gymnasium.make_vec("PTER/Standard-v0", count, contexts=8)
    return env.reset(seed=5)[0]


@given(volts=st.floats(0.0, 24.0, width=32))
def test_a_normalised_action_is_its_voltage(volts: float) -> None:
    action = normalised(np.array([volts]), 24.0)
    assert action.dtype == np.float32
    assert -1.0 <= action[0] <= 1.0
    assert 24.0 * ((float(action[0]) + 1.0) / 2.0) ** 2 == pytest.approx(volts, abs=2e-6)


def test_missed_steps_are_refused_until_a_reset() -> None:
    env = make()
    policy = pter_gym.load_policy("residual", env)
    observation, _ = env.reset(seed=0)
    for _ in range(2):
        observation, *_ = env.step(policy(observation))
    observation, *_ = env.step(env.action_space.low)
    with pytest.raises(ResetNeededError, match="acted last at step 1 of world 0, which is at step 3 now"):
        policy(observation)
    policy.reset()
    fresh = pter_gym.load_policy("residual", env)(observation)
    np.testing.assert_array_equal(policy(observation), fresh)
    observation, _ = env.reset(seed=0)
    observation, *_ = env.step(env.action_space.low)
    with pytest.raises(ResetNeededError, match="missed control steps"):
        policy(observation)


def test_another_environments_observations_are_refused() -> None:
    env, other = make(), make()
    policy = pter_gym.load_policy("residual", env)
    with pytest.raises(ResetNeededError, match="never reset"):
        policy(other.reset(seed=1)[0])
    policy(env.reset(seed=0)[0])
    with pytest.raises(ParameterError, match="observation must be the latest of the environment"):
        policy(other.step(env.action_space.low)[0])


@pytest.mark.parametrize(
    "wrong", [lambda o: (o, {}), lambda o: o[None], lambda o: o[:-1], lambda _: None, lambda _: "x"]
)
def test_observations_have_the_shape_of_the_environments(wrong: Callable[[Any], Any]) -> None:
    env = make()
    policy = pter_gym.load_policy("residual", env)
    shape = re.escape(str(env.observation_space.shape))
    with pytest.raises(ParameterError, match=rf"observation must be an array of the shape {shape}, got"):
        policy(wrong(env.reset(seed=0)[0]))


@pytest.mark.parametrize(
    ("wrap", "name"),
    [
        (wrappers.ClipAction, "ClipAction"),
        (lambda env: wrappers.RescaleAction(env, LOW, -LOW), "RescaleAction"),
        (wrappers.NormalizeObservation, "NormalizeObservation"),
        (lambda env: wrappers.RecordEpisodeStatistics(wrappers.FrameStackObservation(env, 3)), "FrameStackObservation"),
        (lambda _: NormalizeObservation(gymnasium.make_vec("PTER/PathFollowing-v0", 2)), "NormalizeObservation"),
    ],
)
def test_what_changes_observations_or_actions_is_refused(wrap: Callable[[Any], Any], name: str) -> None:
    with pytest.raises(ParameterError, match=f"env must pass on .* its wrapper {name} changes them"):
        pter_gym.load_policy("residual", wrap(make()))


@pytest.mark.parametrize("env", [None, 5, "PTER/Standard-v0", gymnasium.make("CartPole-v1")], ids=str)
def test_other_environments_are_refused(env: Any) -> None:
    with pytest.raises(ParameterError, match="env must be an environment of this package"):
        pter_gym.load_policy("residual", env)


def test_worlds_elsewhere_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    env = PathFollowingVectorEnv(1)
    monkeypatch.setattr(env, "device", "cuda")
    with pytest.raises(ParameterError, match=r'env must have its worlds on the CPU.*device="cuda"'):
        ActingPolicy(find_policy("free"), env)


def test_tuned_gains_are_those_of_the_scenario() -> None:
    """The observation is the same, and the gains for hands are not those for the standard."""
    found = [ask("torque-feedback-tuned", scenario) for scenario in ("Standard", "Hands")]
    assert not np.array_equal(*found)


def ask(name: str, scenario: str) -> np.ndarray:
    env = gymnasium.make_vec(f"PTER/{scenario}-v0", 4, pace="medium", contexts=8)
    env.reset(seed=0)
    return pter_gym.load_policy(name, env)(find_observations(4))


def test_the_nominal_machine_is_that_of_the_environment_unless_it_varies() -> None:
    task = PathFollowing()
    drawn = [list(each) for each in zip(*find_scenario("materials").randomisation(contexts=3).pairs(), strict=True)]
    assert nominal_machine([Batch(DELRIN_THEORETICAL, task)]) is DELRIN_THEORETICAL
    assert nominal_machine([Batch([DELRIN_THEORETICAL, BASELINE], task)]) == BASELINE
    assert nominal_machine([Batch(*drawn, 1, draws=True)]) == BASELINE


class Counting:
    """A function with a past: it counts its decisions."""

    def __init__(self) -> None:
        self.count = 0

    def reset(self) -> None:
        self.count = 0

    def __call__(self, observations: np.ndarray) -> np.ndarray:
        self.count += 1
        return np.full((len(observations), 4), float(self.count % 24))


class Forgetting(Counting):
    """The same, which is told which worlds begin."""

    def __init__(self) -> None:
        super().__init__()
        self.masks: list[list[bool]] = []

    def forget(self, worlds: np.ndarray) -> None:
        self.masks.append(worlds.tolist())


def test_a_function_that_cannot_forget_one_world_is_refused_where_it_would_have_to() -> None:
    env = PathFollowingVectorEnv(2)
    for policy in (Counting(), Forgetting(), lambda rows: np.zeros((len(rows), 4))):
        acting = pter_gym.load_policy(policy, env)
        observations, _ = env.reset(seed=0)
        for _ in range(3):
            observations, *_ = env.step(acting(observations))
        observations, _ = env.reset(options={"reset_mask": np.array([False, True])})
        if type(policy) is Counting:
            assert policy.count == 3
            with pytest.raises(ParameterError, match=r"policy must have a method forget\(worlds\)"):
                acting(observations)
            observations, _ = env.reset(seed=0)
        acting(observations)
        if isinstance(policy, Forgetting):
            assert policy.masks == [[False, True]]
        elif isinstance(policy, Counting):
            assert policy.count == 1


@pytest.mark.parametrize("volts", [np.full((1, 4), 24.1), np.full((1, 4), np.nan), np.zeros(4), np.zeros((2, 4))])
@pytest.mark.parametrize("unit", ["volt", "normalised"])
def test_what_a_function_gives_must_be_voltages(volts: np.ndarray, unit: str) -> None:
    env = make(action_unit=unit)
    with pytest.raises(ActionError, match=r"policy must give voltages of the shape \(1, 4\) within \[0, 24\] V"):
        pter_gym.load_policy(lambda _: volts, env)(env.reset(seed=0)[0])


class Model:
    """What Stable-Baselines3 calls a model."""

    observation_space = spaces.Box(-25.0, 25.0, (len(LAYOUT),))
    action_space = spaces.Box(-1.0, 1.0, (4,))

    def __init__(self) -> None:
        self.starts: list[list[bool]] = []

    def predict(self, obs: Any, state: Any, episode_start: Any, deterministic: bool) -> tuple[Any, Any]:
        self.starts.append(episode_start.tolist())
        return np.full((len(obs), 4), 0.5), state


def test_a_model_is_told_where_episodes_start() -> None:
    env, model = gymnasium.make_vec("PTER/PathFollowing-v0", 2, action_unit="normalised"), Model()
    policy = pter_gym.load_policy(from_sb3(model), env)
    observations, _ = env.reset(seed=0)
    for _ in range(2):
        action = policy(observations)
        observations, *_ = env.step(action)
    policy(env.reset(options={"reset_mask": np.array([False, True])})[0])
    np.testing.assert_allclose(action, 0.5, atol=1e-6)
    assert model.starts == [[True, True], [False, False], [False, True]]


class Told(Predictive):
    """A planner that does not plan: its voltage is the number of the episode."""

    def begin(self, machine: Machine, task: PathFollowing, nominal: Machine, layout: Layout) -> Decide:
        object.__setattr__(self, "begun", getattr(self, "begun", 0) + 1)
        volts = np.full(4, float(self.begun))  # type: ignore[attr-defined]
        return lambda _state, _obs: volts


def test_a_planner_is_told_the_worlds_and_begins_in_those_that_begin() -> None:
    env = PathFollowingVectorEnv(3, sensors="force")
    policy = pter_gym.load_policy(Told(find_policy("free")), env)  # type: ignore[arg-type]
    first = policy(env.reset(seed=0)[0])
    env.step(first)
    second = policy(env.reset(options={"reset_mask": np.array([False, True, False])})[0])
    assert (first[:, 0].tolist(), second[:, 0].tolist()) == ([1.0, 2.0, 3.0], [1.0, 4.0, 3.0])
    several = gymnasium.make_vec("PTER/PathFollowing-v0", 2, vectorization_mode="sync", sensors="force")
    with pytest.raises(ParameterError, match="env must simulate all worlds in one call"):
        pter_gym.load_policy(Told(find_policy("free")), several)  # type: ignore[arg-type]
    with pytest.raises(ParameterError, match='sensors="force"'):
        pter_gym.load_policy("predictive", make())
