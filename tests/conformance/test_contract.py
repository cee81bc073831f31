"""The environment's contract with Gymnasium and Stable-Baselines3, and with those who hand it bad input."""

import warnings
from dataclasses import replace
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import pter_gym  # noqa: F401  (registers the environment)
from pter_gym._compiled.layout import Layout
from pter_gym.errors import ActionError, ParameterError, ResetNeededError
from pter_gym.params import BASELINE, Arm, Clutch, Hand, Machine, TorqueCurve
from pter_gym.paths import Line
from pter_gym.tasks.path_following import PathFollowing, RewardWeights, Starts

ID = "PTER/PathFollowing-v0"
SENSORS = ("encoders", "torque", "force")


@pytest.mark.parametrize("sensors", SENSORS)
def test_gymnasium_checker_is_silent(sensors: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(gymnasium.make(ID, action_unit="normalised", sensors=sensors).unwrapped, skip_render_check=True)


def test_gymnasium_checker_wishes_only_for_a_normalised_box_in_volts() -> None:
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        check_env(gymnasium.make(ID).unwrapped, skip_render_check=True)
    assert len(caught) == 1
    assert "symmetric and normalized" in str(caught[0].message)


def test_spec_round_trip() -> None:
    spec = gymnasium.make(ID, action_unit="normalised").spec
    assert spec is not None
    again = gymnasium.envs.registration.EnvSpec.from_json(spec.to_json())
    assert gymnasium.make(again).action_space == gymnasium.spaces.Box(-1.0, 1.0, (4,), np.float32)


@pytest.mark.parametrize("sensors", SENSORS)
def test_observation_layout_names_every_entry(sensors: str) -> None:
    env = gymnasium.make(ID, sensors=sensors)
    layout: Layout = env.unwrapped.observation_layout  # pyright: ignore[reportAttributeAccessIssue]
    assert len(layout) == env.observation_space.shape[0]  # pyright: ignore[reportOptionalSubscript]
    obs, _ = env.reset(seed=0)
    values = layout.as_dict(obs)
    assert values["pace"] == pytest.approx(0.5)
    assert values["progress"] == pytest.approx(0.0, abs=1e-7)
    assert values["cos_a"] ** 2 + values["sin_a"] ** 2 == pytest.approx(1.0, abs=1e-6)


def test_both_action_units_reach_the_same_voltages() -> None:
    volt = gymnasium.make(ID)
    normalised = gymnasium.make(ID, action_unit="normalised")
    volt.reset(seed=0)
    normalised.reset(seed=0)
    for k in range(20):
        action = np.array([1.0, 0.5 * (k % 5) - 1.0, 0.0, -1.0], np.float32)
        one = volt.step(24.0 * ((action + 1.0) / 2.0) ** 2)
        two = normalised.step(action)
        assert one[0].tobytes() == two[0].tobytes()


def test_free_arm_reaches_the_end_and_terminates() -> None:
    env = gymnasium.make(ID, max_episode_steps=1000)
    env.reset(seed=0)
    for _ in range(1000):
        _, _, terminated, truncated, info = env.step(np.zeros(4, np.float32))
        if terminated:
            break
    assert terminated
    assert not truncated
    assert info["is_success"] is False, "a free arm passes the end 0.3 m beside it"


def test_reward_is_the_sum_of_its_terms() -> None:
    env = gymnasium.make(ID, task=PathFollowing(reward=RewardWeights(effort=2.0)))
    layout: Layout = env.unwrapped.telemetry_layout  # pyright: ignore[reportAttributeAccessIssue]
    env.reset(seed=0)
    _, reward, _, _, info = env.step(np.full(4, 6.0, np.float32))
    row = layout.as_dict(info["telemetry"])
    terms = [row[f"reward_{name}"] for name in ("tracking", "pace", "acceleration", "effort", "failure")]
    assert reward == pytest.approx(sum(terms), rel=1e-15)
    assert terms[0] > 0.0
    assert all(term <= 0.0 for term in terms[1:])
    assert row["reward_effort"] == pytest.approx(-0.01 * 2.0 * (6.0 / 24.0) ** 2, rel=1e-12)


BAD_ACTIONS: dict[str, Any] = {
    "nan": np.array([1.0, np.nan, 1.0, 1.0], np.float32),
    "infinite": np.array([1.0, 1.0, np.inf, 1.0], np.float32),
    "negative": np.array([-0.01, 1.0, 1.0, 1.0], np.float32),
    "too large": np.array([1.0, 1.0, 1.0, 24.001], np.float32),
    "eight ulp too large": np.array([1.0, 1.0, 1.0, 24.0 + 8 * np.spacing(np.float32(24.0))], np.float32),
    "too short": np.ones(3, np.float32),
    "two rows": np.ones((2, 4), np.float32),
    "text": np.array(["a", "b", "c", "d"]),
    "nothing": None,
}


@pytest.mark.parametrize("action", BAD_ACTIONS.values(), ids=BAD_ACTIONS)
def test_a_bad_action_is_refused_and_nothing_moves(action: Any) -> None:
    env: Any = gymnasium.make(ID).unwrapped
    env.reset(seed=0)
    env.step(np.full(4, 5.0, np.float32))
    before = env.batch.get_state()
    with pytest.raises(ActionError, match="action"):
        env.step(action)
    assert same(before, env.batch.get_state())


def test_rounding_beyond_the_bounds_is_clipped() -> None:
    env: Any = gymnasium.make(ID).unwrapped
    env.reset(seed=0)
    ulp = float(np.spacing(np.float32(24.0)))
    obs = env.step(np.array([24.0 + 4.0 * ulp, -4.0 * ulp, 0.0, 24.0]))[0]
    first = env.observation_layout.index("volts_1")
    assert obs[first : first + 4].tolist() == [1.0, 0.0, 0.0, 1.0]


def test_step_before_reset_and_after_the_end() -> None:
    env: Any = gymnasium.make(ID).unwrapped
    with pytest.raises(ResetNeededError):
        env.step(np.zeros(4, np.float32))
    env.reset(seed=0)
    while not env.step(np.zeros(4, np.float32))[2]:
        pass
    before = env.batch.get_state()
    with pytest.raises(ResetNeededError):
        env.step(np.zeros(4, np.float32))
    assert same(before, env.batch.get_state())


def test_an_unknown_reset_option_is_refused() -> None:
    env = gymnasium.make(ID)
    with pytest.raises(ParameterError, match=r"options.*speed"):
        env.reset(seed=0, options={"speed": 1.0})


@pytest.mark.parametrize("options", [5, 0, "speed", {5: 1, "speed": 2}])
@pytest.mark.parametrize("make", [gymnasium.make, gymnasium.make_vec])
def test_options_of_another_kind_are_refused(options: Any, make: Any) -> None:
    with pytest.raises(ParameterError, match="options must be"):
        make(ID).reset(seed=0, options=options)


@pytest.mark.parametrize("seed", [-1, 1.5, "one", True, 2**64])
def test_a_bad_seed_is_refused(seed: Any) -> None:
    env = gymnasium.make(ID)
    with pytest.raises(ParameterError, match="seed"):
        env.reset(seed=seed)


@pytest.mark.parametrize("kind", [np.int64, np.uint8, np.array])
def test_a_seed_may_be_any_integer(kind: Any) -> None:
    env = gymnasium.make(ID)
    assert env.reset(seed=kind(3))[0].tobytes() == env.reset(seed=3)[0].tobytes()


def same(one: dict[str, np.ndarray], two: dict[str, np.ndarray]) -> bool:
    """Whether two states hold the same bits."""
    return one.keys() == two.keys() and all(one[name].tobytes() == two[name].tobytes() for name in one)


def _clutch(**changes: Any) -> Clutch:
    return replace(BASELINE.clutch, **changes)


BAD_PARAMETERS: dict[str, Any] = {
    "length_a": lambda: Arm(length_a=0.0),
    "length_b": lambda: Arm(length_b=float("nan")),
    "inertia_a": lambda: Arm(inertia_a=-1.0),
    "inertia_b": lambda: Arm(inertia_b="heavy"),  # pyright: ignore[reportArgumentType]
    "coupling": lambda: Arm(inertia_a=1.0, inertia_b=1.0, coupling=1.0),
    "slope": lambda: TorqueCurve(slope=0.0, knee=1.0, curvature=0.0),
    "knee": lambda: TorqueCurve(slope=1.0, knee=-1.0, curvature=0.0),
    "curvature": lambda: TorqueCurve(slope=1.0, knee=1.0, curvature=float("inf")),
    "dynamic": lambda: _clutch(dynamic=TorqueCurve(slope=1.0, knee=0.0, curvature=-0.1)),
    "breakaway": lambda: _clutch(breakaway=3.0),
    "time_constant": lambda: _clutch(time_constant=0.0),
    "voltage_max": lambda: _clutch(voltage_max=-24.0),
    "lag": lambda: _clutch(lag="pressure"),
    "mass": lambda: Hand(mass=-1.0),
    "damping": lambda: Hand(damping=float("nan")),
    "hand.stiffness": lambda: replace(BASELINE, hand=Hand(stiffness=1e6)),
    "slip_threshold": lambda: replace(BASELINE, slip_threshold=0.0),
    "substep": lambda: replace(BASELINE, substep=0.0),
    "arm": lambda: Machine(arm=None, clutch=BASELINE.clutch),  # pyright: ignore[reportArgumentType]
    "length": lambda: Line(length=0.0),
    "direction": lambda: Line(direction=float("inf")),
    "pace": lambda: PathFollowing(pace=0.0),
    "control_period": lambda: PathFollowing(control_period=-0.01),
    "error_max": lambda: PathFollowing(error_max=0.0),
    "singularity_margin": lambda: PathFollowing(singularity_margin=1.0),
    "start_offset": lambda: PathFollowing(start_offset=0.3),
    "arrival": lambda: PathFollowing(arrival=0.0),
    "tracking": lambda: RewardWeights(tracking=-1.0),
    "gripped": lambda: Starts(moving=0.6, gripped=0.5),
    "starts": lambda: PathFollowing(starts="path"),  # pyright: ignore[reportArgumentType]
    "path": lambda: PathFollowing(path="line"),  # pyright: ignore[reportArgumentType]
}


@pytest.mark.parametrize(("field", "build"), BAD_PARAMETERS.items(), ids=BAD_PARAMETERS)
def test_a_bad_parameter_is_named(field: str, build: Any) -> None:
    with pytest.raises(ParameterError, match=rf"\.{field} must be"):
        build()


def test_what_only_machine_and_task_together_show() -> None:
    from pter_gym._engine.batch import Batch

    reach = BASELINE.arm.length_a + BASELINE.arm.length_b
    with pytest.raises(ParameterError, match="control_period"):
        Batch(replace(BASELINE, substep=1e-6), PathFollowing(control_period=0.02))
    with pytest.raises(ParameterError, match="path must be within reach"):
        Batch(BASELINE, PathFollowing(path=Line(x=0.0, y=1.01 * reach, length=0.01)))
    with pytest.raises(ParameterError, match="path must be within reach"):
        Batch(BASELINE, PathFollowing(path=Line(x=0.0, y=0.997 * reach, length=0.01)))
    with pytest.raises(ParameterError, match=r"start_offset must be so small .* got 0\.03"):
        Batch(BASELINE, PathFollowing(start_offset=0.03))
    small = replace(BASELINE, arm=replace(BASELINE.arm, length_a=0.035, length_b=0.05))
    beside = PathFollowing(path=Line(x=0.0, y=0.025, length=0.005), start_offset=0.05)
    with pytest.raises(ParameterError, match="start_offset must be so small"):  # starts on both sides of the base
        Batch(small, beside)
    Batch(small, replace(beside, start_offset=0.005))
    even = replace(BASELINE, arm=replace(BASELINE.arm, length_a=0.5, length_b=0.5))
    with pytest.raises(ParameterError, match="path must be within reach"):  # for some millimetres, at the base
        Batch(even, PathFollowing(path=Line(x=-0.8965, y=5e-4, length=1.8), singularity_margin=0.004))
    with pytest.raises(ParameterError, match=r"hand\.stiffness"):
        Batch(replace(BASELINE, hand=Hand(stiffness=100.0)), PathFollowing())
    with pytest.raises(ParameterError, match="substep"):
        Batch([BASELINE, replace(BASELINE, substep=0.0005)], PathFollowing())
    with pytest.raises(ParameterError, match="num_worlds"):
        Batch([], PathFollowing())
