"""Policies in environments: reset by their user, actions in the environment's unit, errors."""

import pickle
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium import spaces, wrappers
from gymnasium.vector import AutoresetMode
from gymnasium.wrappers.vector import NormalizeObservation, RecordEpisodeStatistics

import pter_gym
from pter_gym._compiled.layout import Layout
from pter_gym.benchmark import find_policy, from_sb3, run_scenario
from pter_gym.controllers import Impedance, Policy, bind
from pter_gym.errors import ActionError, ParameterError
from pter_gym.params import BASELINE, DELRIN_THEORETICAL, MACHINES, Machine
from pter_gym.params._named import nominal_machine
from pter_gym.paths import Circle
from pter_gym.policies import read_policy, write_policy
from pter_gym.policies._base_law import REACH, BaseLaw
from pter_gym.tasks.path_following import STARTS, PathFollowing, observation_layout
from pter_gym.tasks.path_following._actions import action_of, volts_of

ID = "PTER/PathFollowing-v0"
LAYOUT = observation_layout(BASELINE, "torque")
ENDS_SOON = PathFollowing(truncation_error=0.02, starts=STARTS["path"])
"""The tip begins anywhere and is off the path after a number of steps that the seed decides."""


def count(observations: np.ndarray, memory: np.ndarray) -> np.ndarray:
    """Give the number of the decisions in each episode as the voltage."""
    memory += 1
    return np.repeat(memory % 24, 4, axis=1)


COUNTER = Policy.from_function(count, LAYOUT, start=lambda worlds: np.zeros((worlds, 1)))


def make_worlds(backend: str, mode: AutoresetMode, skip: int) -> Any:
    options = {"task": ENDS_SOON, "frame_skip": skip, "action_unit": "volt"}
    if backend == "native":
        return gymnasium.make_vec(ID, 4, autoreset_mode=mode, **options)
    vector = (
        gymnasium.vector.SyncVectorEnv if backend == "sync" else gymnasium.vector.AsyncVectorEnv
    )
    return RecordEpisodeStatistics(
        vector([partial(gymnasium.make, ID, **options)] * 4, autoreset_mode=mode)
    )


@pytest.mark.parametrize("skip", [1, 3])
@pytest.mark.parametrize("mode", AutoresetMode, ids=lambda mode: mode.name)
@pytest.mark.parametrize("backend", ["native", "sync", "async"])
def test_a_policy_acts_in_each_world_as_alone(backend: str, mode: AutoresetMode, skip: int) -> None:
    env = make_worlds(backend, mode, skip)
    policies = [pter_gym.load_policy(each, env) for each in (COUNTER, "torque-feedback-tuned")]
    alone: Any = bind(find_policy("torque-feedback-tuned"), BASELINE, LAYOUT)
    memories = [alone.start(1) for _ in range(4)]
    observations, _ = env.reset(seed=0)
    begun, ended, age, starts = np.ones(4, bool), np.zeros(4, bool), np.zeros(4), 0
    for _ in range(60):
        for policy in policies:
            policy.reset(begun)
        age = np.where(begun, 1, age + 1)
        counted, volts = (policy(observations) for policy in policies)
        np.testing.assert_array_equal(counted[:, 0], age % 24)
        for world in np.flatnonzero(begun):
            memories[world] = alone.start(1)
        pairs = zip(observations, memories, strict=True)
        expected = np.concatenate([alone.act(row[None], memory) for row, memory in pairs])
        np.testing.assert_array_equal(volts, expected.astype(np.float32))
        observations, _, terminated, truncated, _ = env.step(volts)
        begun = ended if mode is AutoresetMode.NEXT_STEP else terminated | truncated
        ended = terminated | truncated
        if mode is AutoresetMode.DISABLED and ended.any():
            observations, _ = env.reset(options={"reset_mask": ended})
        starts += 0 < begun.sum() < 4
    assert starts >= 2, "episodes should begin at different times"
    env.close()


def test_actions_are_in_the_unit_of_the_environment() -> None:
    volts = {}
    for unit in ("volt", "normalised"):
        env = gymnasium.make("PTER/Standard-v0", contexts=8, action_unit=unit)
        action = pter_gym.load_policy("torque-feedback-tuned", env)(env.reset(seed=0)[0])
        assert env.action_space.contains(action)
        volts[unit] = action if unit == "volt" else 24.0 * ((action + 1.0) / 2.0) ** 2
    np.testing.assert_allclose(volts["normalised"], volts["volt"], atol=2e-5)


@pytest.mark.parametrize("bounds", [(-1.0, 1.0), (0.0, 24.0), (-2.0, 5.0)])
def test_actions_and_voltages_undo_each_other(bounds: tuple[float, float]) -> None:
    volts = np.linspace(0.0, 24.0, 97)
    actions = action_of(volts, *bounds, 24.0)
    assert (actions[0], actions[-1]) == bounds
    np.testing.assert_allclose(volts_of(actions, *bounds, 24.0), volts, atol=1e-4)  # type: ignore[arg-type]
    assert volts_of(0.0, -1.0, 1.0, 24.0) == 6.0


def test_load_policy_on_a_user_path_has_the_gains_of_its_benchmark() -> None:
    env = gymnasium.make("PTER/Standard-v0", path="circle", pace="slow", starts="rest", contexts=1)

    def last(policy: Any) -> list[float]:
        acting = pter_gym.load_policy(policy, env)
        observation, _ = env.reset(seed=0)
        for _ in range(60):
            observation, *_ = env.step(acting(observation))
        return observation.tolist()

    named, ours, others = map(
        last,
        (
            "single-dof-tuned",
            *(find_policy("single-dof-tuned", scenario=each) for each in ("paths", "standard")),
        ),
    )
    assert named == ours != others


def worlds_of_sb3(**arguments: Any) -> Any:
    pytest.importorskip("stable_baselines3")
    from pter_gym.envs.sb3 import make_sb3_vec_env

    return make_sb3_vec_env(2, **arguments)


@pytest.mark.parametrize(
    ("make", "gains"),
    [
        (lambda: gymnasium.make(ID), "standard"),
        (lambda: gymnasium.make(ID, scenario="paths", action_unit="volt", frame_skip=1), "paths"),
        (lambda: gymnasium.make(ID, task=PathFollowing(path=Circle(), error_max=0.1)), "paths"),
        (lambda: gymnasium.make_vec("PTER/Hands-v0", 2), "hands"),
        (lambda: gymnasium.make_vec("PTER/Hands-v0", 2, vectorization_mode="sync"), "hands"),
        (lambda: worlds_of_sb3(scenario="everything"), "everything"),
        (lambda: worlds_of_sb3(), "standard"),
    ],
)
def test_a_law_has_the_gains_for_what_the_environment_draws(make: Any, gains: str) -> None:
    env = make()
    named, expected, *others = (
        pter_gym.load_policy(policy, env)._policy.law.gains.tolist()  # type: ignore[union-attr]
        for policy in (
            "single-dof-tuned",
            *(find_policy("single-dof-tuned", each) for each in (gains, *OTHERS[gains])),
        )
    )
    assert named == expected
    assert expected not in others
    env.close()


OTHERS = {
    "standard": ("everything",),
    "paths": ("standard",),
    "hands": ("paths",),
    "everything": ("standard",),
}


@pytest.mark.parametrize("door", ["single", "vector"])
def test_random_voltages_differ_from_episode_to_episode(door: str) -> None:
    env = gymnasium.make(ID) if door == "single" else gymnasium.make_vec(ID, 3)
    policy = pter_gym.load_policy("random", env)
    first = []
    for _ in range(70):
        observation, _ = env.reset(seed=0)
        policy.reset()
        first += np.atleast_2d(policy(observation)).tolist()
    assert len(set(map(tuple, first))) == len(first)
    again = pter_gym.load_policy("random", env)
    again.reset()
    np.testing.assert_array_equal(np.atleast_2d(again(observation)), first[: len(first) // 70])


def test_a_policy_with_another_frame_skip_is_refused() -> None:
    policy: Any = lambda rows: np.zeros((len(rows), 4))  # noqa: E731
    policy.frame_skip = 1
    with pytest.raises(ParameterError, match="frame_skip=1"):
        pter_gym.load_policy(policy, gymnasium.make("PTER/Standard-v0"))


def test_a_trained_policy_acts_at_its_own_control_period_alone(tmp_path: Path) -> None:
    task = PathFollowing(control_period=0.02, pace=0.5)
    env = gymnasium.make(ID, task=task, frame_skip=1)
    trained = read_policy("residual")
    for act in (
        lambda: pter_gym.load_policy(trained, env),
        lambda: run_scenario(task, {"residual": trained}, episodes=1),
    ):
        with pytest.raises(ParameterError, match=r"control_period must be .* 0.01 s, got 0.02"):
            act()
    pter_gym.load_policy("impedance", env)
    interface = replace(trained.interface, control_period=0.02)
    file = write_policy(replace(trained, interface=interface), tmp_path / "slower")
    pter_gym.load_policy(file, env)(env.reset(seed=0)[0])
    with pytest.raises(ParameterError, match=r"0.02 s, got 0.01"):
        pter_gym.load_policy(file, gymnasium.make(ID))


BAD_ENVIRONMENTS: dict[str, Callable[[], Any]] = {
    "clipped": lambda: wrappers.ClipAction(gymnasium.make(ID)),
    "stacked": lambda: wrappers.RecordEpisodeStatistics(
        wrappers.FrameStackObservation(gymnasium.make(ID), 3)
    ),
    "held": lambda: wrappers.MaxAndSkipObservation(gymnasium.make(ID), 2),
    "in another process": lambda: gymnasium.make_vec(
        ID, 1, vectorization_mode="async", wrappers=[wrappers.FlattenObservation]
    ),
    "held in another process": lambda: gymnasium.make_vec(
        ID,
        1,
        vectorization_mode="async",
        wrappers=[partial(wrappers.MaxAndSkipObservation, skip=2)],
    ),
    "normalised": lambda: NormalizeObservation(gymnasium.make_vec(ID, 2)),
    "another": lambda: gymnasium.make("CartPole-v1"),
    "none": lambda: None,
}


@pytest.mark.parametrize("make", BAD_ENVIRONMENTS.values(), ids=BAD_ENVIRONMENTS)
def test_other_environments_and_changing_wrappers_are_refused(make: Callable[[], Any]) -> None:
    with pytest.raises(ParameterError, match="env"):
        pter_gym.load_policy("impedance", make())


def test_bad_observations_masks_and_voltages_are_refused() -> None:
    env = gymnasium.make(ID)
    observation, info = env.reset(seed=0)
    policy = pter_gym.load_policy("impedance", env)
    for wrong in ((observation, info), observation[None], observation[:-1], None, "x"):
        with pytest.raises(ParameterError, match="observation"):
            policy(wrong)
    with pytest.raises(ParameterError, match="worlds"):
        policy.reset(np.ones(2, bool))
    for volts in (np.full((1, 4), np.nan), np.zeros(4), np.zeros((2, 4)), [[0.0] * 4, 1.0], "x"):
        with pytest.raises((ActionError, ParameterError), match=r"policy|lambda"):
            pter_gym.load_policy(lambda _, volts=volts: volts, env)(observation)


def test_voltages_beyond_the_range_are_clipped_with_a_warning() -> None:
    env = gymnasium.make(ID, action_unit="volt")
    observation, _ = env.reset(seed=0)
    policy = pter_gym.load_policy(lambda _: np.array([[30.0, -1.0, 3.0, 24.0]]), env)
    with pytest.warns(UserWarning, match=r"beyond \[0, 24\] V"):
        assert policy(observation).tolist() == [24.0, 0.0, 3.0, 24.0]


def test_the_nominal_machine_is_that_of_the_environment_unless_it_varies() -> None:
    assert nominal_machine({DELRIN_THEORETICAL}) is DELRIN_THEORETICAL
    assert nominal_machine({DELRIN_THEORETICAL, BASELINE}) == BASELINE


ENCODERS_AND_BASE = BaseLaw(
    Impedance(), BASELINE, observation_layout(BASELINE, "encoders"), REACH
).layout
SWAPPED = replace(BASELINE, clutches=(*BASELINE.clutches[1::-1], *BASELINE.clutches[2:]))
TWELVE = replace(BASELINE, clutch=replace(BASELINE.clutch, voltage_max=12.0))


@pytest.mark.parametrize(
    ("machine", "names", "match"),
    [
        (SWAPPED, LAYOUT.names, r"Machine\.clutches"),
        (MACHINES["two-brakes"], LAYOUT.names, r"Machine\.clutches"),
        (TWELVE, LAYOUT.names, r"Clutch\.voltage_max must be 24 V"),
        (BASELINE, ENCODERS_AND_BASE.names, "observations must have the 24 entries"),
    ],
    ids=["swapped", "fewer", "voltage", "entries"],
)
def test_a_bound_policy_acts_for_what_it_is_bound_to_alone(
    machine: Machine, names: tuple[str, ...], match: str
) -> None:
    layout = {LAYOUT.names: LAYOUT, ENCODERS_AND_BASE.names: ENCODERS_AND_BASE}[names]
    bound = Impedance().bind(BASELINE, LAYOUT)
    model = SimpleNamespace(
        observation_space=spaces.Box(-25.0, 25.0, (24,), np.float32),
        action_space=spaces.Box(-1.0, 1.0, (4,), np.float32),
    )
    trained = from_sb3(model, env=gymnasium.make("PTER/PathFollowing-v0"))
    assert bind(bound, BASELINE, LAYOUT) is bound
    assert pickle.loads(pickle.dumps(bound)).machine == BASELINE
    for policy in (bound, trained):
        with pytest.raises(ParameterError, match=match):
            bind(policy, machine, layout)


@dataclass(frozen=True)
class AtOnePeriod:
    """A law that is made for one control period."""

    period: float

    def bind(self, machine: Machine, layout: Layout) -> Policy:
        return replace(Impedance().bind(machine, layout), control_period=self.period)


def test_a_base_acts_at_its_own_control_period() -> None:
    base = AtOnePeriod(0.02)
    with pytest.raises(ParameterError, match=r"control_period must be that of the policy, 0\.02 s"):
        gymnasium.make("PTER/PathFollowing-v0", base=base)
    task = PathFollowing(control_period=0.02)
    gymnasium.make("PTER/PathFollowing-v0", base=base, task=task)
