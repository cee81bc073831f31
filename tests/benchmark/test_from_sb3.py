"""Models of Stable-Baselines3 and sb3-contrib in the benchmark, trained for a moment."""

from types import SimpleNamespace
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium import spaces
from gymnasium.wrappers.vector import NormalizeObservation

from pter_gym._engine.batch import Batch
from pter_gym._engine.world import SKIP
from pter_gym.benchmark import from_actions, from_sb3, run_scenario
from pter_gym.controllers import bind
from pter_gym.envs import PathFollowingEnv
from pter_gym.envs._vector import PathFollowingVectorEnv
from pter_gym.errors import ParameterError
from pter_gym.params import BASELINE
from pter_gym.tasks.path_following import COLUMN, PathFollowing, Sensors, observation_layout
from rollouts import run

pytestmark = pytest.mark.agents
sb3 = pytest.importorskip("stable_baselines3")
vec_env = pytest.importorskip("stable_baselines3.common.vec_env")
contrib = pytest.importorskip("sb3_contrib")
from pter_gym.envs.sb3 import make_sb3_vec_env  # noqa: E402  (needs Stable-Baselines3)


def small(**more: int) -> dict[str, Any]:
    """Settings of a small network; algorithms write into them."""
    return {"policy_kwargs": {"net_arch": [8], **more}, "device": "cpu", "seed": 0}


ON_POLICY: dict[str, Any] = {"n_steps": 32, "batch_size": 32}
KINDS = {
    "PPO": lambda env: sb3.PPO("MlpPolicy", env, **small(), **ON_POLICY),
    "TQC": lambda env: contrib.TQC("MlpPolicy", env, **small(), learning_starts=16),
    "RecurrentPPO": lambda env: contrib.RecurrentPPO(
        "MlpLstmPolicy", env, **small(lstm_hidden_size=8), **ON_POLICY
    ),
}


def trained(kind: str, unit: str = "normalised", sensors: Sensors = "torque") -> tuple[Any, Any]:
    """A model and what normalised its observations."""
    venv = vec_env.VecNormalize(
        make_sb3_vec_env(2, action_unit=unit, sensors=sensors), clip_obs=3.0
    )
    return KINDS[kind](venv).learn(64), venv


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "unit"), [("PPO", "volt"), ("TQC", "normalised"), ("RecurrentPPO", "normalised")]
)
def test_a_model_acts_as_in_its_own_environment(kind: str, unit: Any) -> None:
    model, venv = trained(kind, unit)
    statistics = venv.obs_rms.mean.copy(), venv.obs_rms.var.copy(), venv.obs_rms.count
    task, seeds = PathFollowing(start_offset=0.01), [5, 6, 7]
    ours = run(Batch(BASELINE, task, 3), from_sb3(model, venv), seeds, [40] * 3).telemetry
    batch = Batch(BASELINE, task, 3, action_unit=unit)
    obs, rows = batch.reset(seeds)
    state, begins = None, np.ones(3, np.bool_)
    for row in ours:
        np.testing.assert_array_equal(row, rows)
        actions, state = model.predict(venv.normalize_obs(obs), state, begins, deterministic=True)
        obs, _, _, _, (rows,) = batch.step(actions, SKIP)
        begins[:] = False
    assert len(ours) > 6
    assert statistics[2] == venv.obs_rms.count
    np.testing.assert_array_equal(statistics[:2], (venv.obs_rms.mean, venv.obs_rms.var))


@pytest.mark.parametrize("skip", [1, 3])
@pytest.mark.parametrize(
    "options",
    [
        {"base": "single-dof-tuned", "reach": 3.7},
        {"history": (1, 4)},
        {"history": (2,), "action_unit": "volt", "sensors": "encoders"},
        {"base": "single-dof-tuned", "history": (1, 10)},
    ],
    ids=lambda each: ", ".join(each),
)
def test_a_model_corrects_and_looks_back_as_in_its_own_environment(
    options: dict[str, Any], skip: int
) -> None:
    own: dict[str, Any] = {**options, "frame_skip": skip}
    venv = vec_env.VecNormalize(make_sb3_vec_env(2, **own), clip_obs=3.0)
    model = KINDS["PPO"](venv).learn(64)
    task, seeds = PathFollowing(start_offset=0.01), [5, 6, 7]
    ours = run(Batch(BASELINE, task, 3), from_sb3(model, venv), seeds, [42] * 3).telemetry
    batch = PathFollowingVectorEnv(3, task=task, **own).batch
    obs, _ = batch.reset(seeds)
    for row in ours[skip::skip]:
        actions, _ = model.predict(venv.normalize_obs(obs), deterministic=True)
        obs, _, _, _, (rows,) = batch.step(actions, SKIP)
        before = COLUMN.terms.tracking  # reward terms add up over the held steps
        np.testing.assert_array_equal(row[:, :before], rows[:, :before])
    assert len(ours) > (42 if "base" in options else 20) // skip  # alone it arrives too fast


@pytest.mark.slow
def test_two_lines_score_a_model() -> None:
    model, venv = trained("RecurrentPPO", sensors="force")
    ways = (from_sb3(model, venv), from_sb3(model, venv), from_sb3(model))
    first, *again = (run_scenario("standard", {"mine": way}, ["brisk"], episodes=2) for way in ways)
    for other in again:
        np.testing.assert_array_equal(
            first[0].scores["path_error_m"], other[0].scores["path_error_m"]
        )


class Remembering:
    """Acts as a recurrent model: its state counts a world's decisions in the episode."""

    def __init__(self, **more: Any) -> None:
        self.env = make_sb3_vec_env(1, **{"sensors": "encoders", **more})
        self.observation_space = self.env.observation_space
        self.action_space = self.env.action_space

    def predict(
        self, obs: Any, state: Any, episode_start: Any, deterministic: bool
    ) -> tuple[Any, Any]:
        assert deterministic
        assert episode_start.shape == (len(obs),)
        count = np.where(episode_start, 0.0, 0.0 if state is None else state) + 1.0
        return np.stack(
            [count, -np.ones(len(obs)), np.zeros(len(obs)), 10.0 * np.ones(len(obs))], axis=1
        ), count


def test_states_belong_to_worlds_and_begin_again_at_a_reset() -> None:
    controller = from_sb3(Remembering(action_unit="volt"))
    assert controller.sensors == "encoders"
    layout = observation_layout(BASELINE, "encoders")
    policy = bind(controller, BASELINE, layout)
    for worlds in (3, 1):
        memory, obs = policy.start(worlds), np.zeros((worlds, len(layout)), np.float32)
        volts = np.array([policy.act(obs, memory) for _ in range(3)])
        expected = np.arange(1, 4)[:, None] * np.ones(worlds)
        np.testing.assert_allclose(volts[..., 0], expected)
        np.testing.assert_allclose(volts[0][:, 1:], np.tile([0.0, 0.0, 10.0], (worlds, 1)))
    memory = policy.start(2)
    policy.act(np.zeros((2, len(layout)), np.float32), memory)
    memory[1:] = policy.start(2)[1:]
    np.testing.assert_allclose(
        policy.act(np.zeros((2, len(layout)), np.float32), memory)[:, 0], [2.0, 1.0]
    )


@pytest.mark.parametrize(("unit", "low", "high"), [("normalised", -1.0, 1.0), ("volt", 0.0, 24.0)])
def test_actions_beyond_the_bounds_are_clipped_to_them(unit: str, low: float, high: float) -> None:
    """A square folds what lies beyond: −1.8 is to be 0 V, not the 3.84 V of its mirror image."""
    inside = np.full((2, 4), (low + high) / 2.0)
    given = {"below": low - 0.8, "low": low, "above": high + 0.7, "high": high}
    found: dict[str, Any] = {}
    for name, action in given.items():
        model = SimpleNamespace(
            **vars(Remembering(action_unit=unit)),
            predict=lambda *_, action=action, **__: (
                np.where(np.arange(4) < 2, action, inside),
                None,
            ),
        )
        policy = from_sb3(model).bind(BASELINE, observation_layout(BASELINE, "encoders"))
        obs = np.zeros((2, len(policy.layout)), np.float32)
        found[name] = policy.act(obs, policy.start(2))
    np.testing.assert_array_equal(found["below"], found["low"])
    np.testing.assert_array_equal(found["above"], found["high"])
    np.testing.assert_array_equal(found["low"][:, :2], 0.0)
    np.testing.assert_array_equal(found["high"][:, :2], BASELINE.clutch.voltage_max)


def test_normalisation_by_gymnasium_wrappers_is_used() -> None:
    env = NormalizeObservation(PathFollowingVectorEnv(4, sensors="encoders"))
    env.reset(seed=0)
    for _ in range(20):
        env.step(env.action_space.sample())
    env.update_running_mean = False
    seen: list[Any] = []
    model = Remembering()
    policy = from_sb3(model, env).bind(BASELINE, observation_layout(BASELINE, "encoders"))
    predict = model.predict
    model.predict = lambda obs, **given: (seen.append(obs), predict(obs, **given))[1]  # type: ignore[method-assign]
    raw = env.env.reset(seed=3)[0]
    policy.act(raw, policy.start(len(raw)))
    np.testing.assert_allclose(seen[0], env.observations(raw), rtol=1e-6)
    assert seen[0].dtype == np.float32


def test_other_models_and_wrappers_are_refused() -> None:
    bad = {
        "observation_space": spaces.Box(-1.0, 1.0, (5,)),
        "action_space": spaces.Box(-1.0, 1.0, (5,)),
        " action_space": spaces.Box(-np.inf, np.inf, (4,)),
    }
    for name, space in bad.items():
        with pytest.raises(ParameterError, match=name.strip()):
            from_sb3(SimpleNamespace(**{**vars(Remembering()), name.strip(): space}))
    with pytest.raises(ParameterError, match="observation_space"):
        from_sb3(object(), env=Remembering().env)
    with pytest.raises(ParameterError, match="vec_normalize"):
        from_sb3(Remembering(), gymnasium.Env())
    with pytest.raises(ParameterError, match="observations"):
        from_sb3(Remembering()).bind(BASELINE, observation_layout(BASELINE, "force"))
    env = PathFollowingEnv(sensors="encoders")
    for wrapper in (
        gymnasium.wrappers.ClipAction(env),
        gymnasium.wrappers.TransformObservation(env, lambda obs: obs, env.observation_space),
    ):
        with pytest.raises(ParameterError, match=type(wrapper).__name__):
            from_sb3(Remembering(), env=vec_env.DummyVecEnv([lambda wrapper=wrapper: wrapper]))


class Halving(vec_env.VecEnvWrapper):
    """Wraps actions as a user may."""

    def step_async(self, actions: Any) -> None:
        self.venv.step_async(0.5 * actions)

    def reset(self) -> Any:
        return self.venv.reset()

    def step_wait(self) -> Any:
        return self.venv.step_wait()


@pytest.mark.parametrize(
    "wrapper",
    [
        lambda: gymnasium.wrappers.FrameStackObservation(PathFollowingEnv(), 2),
        lambda: gymnasium.wrappers.TimeAwareObservation(gymnasium.make("PTER/PathFollowing-v0")),
        lambda: vec_env.VecFrameStack(make_sb3_vec_env(2), 2),
    ],
    ids=["FrameStackObservation", "TimeAwareObservation", "VecFrameStack"],
)
def test_what_cannot_be_scored_is_refused_before_training(wrapper: Any) -> None:
    """With the option that replaces it."""
    env = wrapper()
    model = sb3.PPO("MlpPolicy", env, **small(), **ON_POLICY)
    for make in (lambda: from_sb3(model), lambda: from_actions(np.zeros_like, env)):
        with pytest.raises(ParameterError, match=r"history=\(1, 2, 3\)"):
            make()


def test_a_policy_made_before_the_training_is_the_trained_one() -> None:
    venv = vec_env.VecNormalize(make_sb3_vec_env(2, history=(1,)))
    model = KINDS["PPO"](venv)
    before = from_sb3(model)
    model.learn(64)
    layout = observation_layout(BASELINE, "torque")
    obs = np.linspace(-1.0, 1.0, 3 * len(layout), dtype=np.float32).reshape(3, -1)
    volts = []
    for controller in (before, from_sb3(model)):
        policy = bind(controller, BASELINE, layout)
        volts.append(policy.act(obs, policy.start(3)))
    np.testing.assert_array_equal(*volts)


def test_wrappers_of_many_worlds_are_refused_by_name_and_lookers_on_are_not() -> None:
    venv = make_sb3_vec_env(1, sensors="encoders")
    for wrapper in (Halving(venv), vec_env.VecFrameStack(venv, 2)):
        for env in (wrapper, vec_env.VecCheckNan(wrapper)):
            with pytest.raises(ParameterError, match=type(wrapper).__name__):
                from_sb3(Remembering(), env=env)
    from_sb3(Remembering(), env=vec_env.VecCheckNan(venv))


@pytest.mark.parametrize("sensors", ["encoders", "torque"])
def test_what_a_loaded_model_sees_and_corrects_is_asked_for(sensors: Sensors) -> None:
    """Encoders with a base's voltages have as many entries as torque sensors without a base."""
    model = SimpleNamespace(**vars(Remembering(sensors=sensors, base="impedance")))
    env = vars(model).pop("env")
    model.predict = lambda obs, **_: (np.zeros((len(obs), 4)), None)
    for make in (
        lambda: from_sb3(model),
        lambda: from_sb3(model, frame_skip=1),
        lambda: from_actions(np.zeros_like, SimpleNamespace(**vars(model))),
    ):
        with pytest.raises(ParameterError, match="env must be"):
            make()
    policy = from_sb3(model, env=env)
    assert policy.sensors == sensors
    corrected, law = (
        run_scenario("standard", {"one": each}, ["medium"], episodes=1)[0].scores
        for each in (policy, env.get_attr("base")[0])
    )
    assert corrected["path_error_m"] == law["path_error_m"]


def test_the_period_of_a_model_is_that_of_its_environment() -> None:
    venv = make_sb3_vec_env(2, sensors="encoders", frame_skip=3)
    assert from_actions(np.zeros_like, venv).frame_skip == 3
    assert from_sb3(Remembering(), env=venv).frame_skip == 3
    assert from_sb3(Remembering(), vec_env.VecNormalize(venv), env=None).frame_skip == 1
    assert from_sb3(Remembering(), frame_skip=2).frame_skip == 2
