"""The differentiable environment: the bits of the door, and the gradient of paired runs of it."""

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest

from pter_gym import initial_state
from pter_gym._engine.judgement import judge_step, locate
from pter_gym._engine.world import ROW
from pter_gym.errors import ParameterError
from pter_gym.params import BASELINE
from pter_gym.paths import Sine
from pter_gym.tasks.path_following import Failure, PathFollowing

jax = pytest.importorskip("jax")
jnp = jax.numpy

from pter_gym.envs import jax as jax_env  # noqa: E402  (needs JAX)
from pter_gym.gradients import env as env_module  # noqa: E402
from pter_gym.gradients.env import make  # noqa: E402
from pter_gym.gradients.jax import make_rollout  # noqa: E402

WORLDS = 45
QUICK = {"xla_backend_optimization_level": 0, "xla_llvm_disable_expensive_passes": True}
CREEPING = replace(BASELINE, clutch=replace(BASELINE.clutch, band="printed"))
KINDS: dict[str, dict[str, Any]] = {
    "standard": {"env_id": "PTER/Standard-v0"},
    "paths": {"env_id": "PTER/Paths-v0", "observe_context": True},
    "materials": {"env_id": "PTER/Materials-v0", "frame_skip": 1},
    "voltages": {
        "task": PathFollowing(path=Sine()),
        "machine": replace(BASELINE, clutch=replace(BASELINE.clutch, lag="voltage")),
        "action_unit": "volt",
    },
}


def simulated(env: Any, state: Any, obs: Any, gains: Any, shifts: Any) -> Any:
    """Observations, rewards and ends of worlds, each under a linear policy of its own with
    shifts."""
    space = env.action_space()
    middle, half = 0.5 * (space.low + space.high), 0.5 * (space.high - space.low)

    def step(carry: Any, shift: Any) -> Any:
        state, obs = carry
        action = middle + half * jnp.tanh(jnp.einsum("nij,nj->ni", gains, obs) + shift)
        obs, state, reward, terminated, truncated, _ = jax.vmap(env.step, in_axes=(None, 0, 0))(
            None, state, action
        )
        return (state, obs), (obs, reward, terminated | truncated)

    return jax.lax.scan(step, (state, obs), shifts)[1]


def drawn(env: Any, steps: int) -> tuple[Any, Any, Any, Any]:
    """State and observation of worlds, their gains and shifts."""
    rng = np.random.default_rng(1)
    obs, state = jax.vmap(env.reset_to_seed)(7 + np.arange(WORLDS))
    gains = 0.1 * rng.normal(size=(WORLDS, 4, obs.shape[1]))
    return (
        state,
        obs,
        jnp.asarray(gains, float),
        jnp.asarray(rng.normal(-0.7, 0.3, (steps, WORLDS, 4)), float),
    )


@pytest.mark.parametrize(
    "wide", [False, pytest.param(True, marks=pytest.mark.long)], ids=["32 bits", "64 bits"]
)
def test_a_step_has_the_bits_of_jax_env(wide: bool) -> None:
    with jax.enable_x64(wide):
        ours, (theirs, _) = (
            make("PTER/Standard-v0")[0],
            jax_env.make("PTER/Standard-v0", sensors="encoders"),
        )
        found = [jax.jit(partial(simulated, env))(*drawn(env, 60)) for env in (ours, theirs)]
    assert np.asarray(found[0][2]).sum() > WORLDS
    for one, other in zip(*found, strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.slow
def test_a_step_has_the_gradient_of_paired_steps() -> None:
    """After friction has drifted for a while and clutches have failed, where none sticks.

    Differences over ε and 2·ε tell what curvature makes of them. Totals are added up in float64,
    since those of float32 would be rounded by as much as the 10⁻³ that are allowed.
    """
    failures = Failure(clutch=2, torque=0.7, after=0.3), Failure(clutch=4, volts=2.0, after=0.2)
    machine, task = (
        replace(BASELINE, substep=0.005),
        PathFollowing(friction_drift=1.0, failures=failures),
    )
    env, _ = make(machine=machine, task=task, frame_skip=1)
    step = jax.jit(partial(env.step, None))
    rng, action = np.random.default_rng(5), np.array([-0.4, -0.5, -0.6, -0.3], np.float32)
    obs, state = env.reset_to_seed(3)
    for _ in range(40):
        obs, state, *_ = step(state, action)
    by = jnp.asarray(rng.normal(size=obs.shape), jnp.float32)

    def total(step: Any, action: Any) -> Any:
        seen, _, reward, *_ = step(state, action)
        return by @ seen + reward

    derivative = jax.jit(jax.grad(partial(total, partial(env.step, None))))
    differentiate = derivative.lower(action).compile(compiler_options=QUICK)
    z = rng.normal(size=4).astype(np.float32)

    def exact(action: Any) -> float:
        seen, _, reward, *_ = step(state, action)
        return float(np.asarray(by, np.float64) @ np.asarray(seen) + np.asarray(reward))

    near, far = (
        (exact(action + size * z) - exact(action - size * z)) / (2.0 * size)
        for size in (0.02, 0.04)
    )
    found = float(differentiate(action) @ z)
    assert abs(found - near) <= abs(far - near) + 1e-3 * abs(near)
    assert abs(far - near) < 0.01 * abs(near)


@pytest.mark.slow
def test_a_rollout_has_the_gradient_of_paired_rollouts() -> None:
    """By voltages, push and a length; with the kernels that steps use."""
    rng = np.random.default_rng(3)
    with jax.enable_x64(True):
        roll, by = make_rollout(), rng.normal(size=(7, 2))
        state = initial_state(BASELINE, (0.5, 2.0), (0.8, -0.3), np.ones(4))

        def total(volts: Any, push: Any, length: Any) -> Any:
            motion = roll(state, volts, push, numbers={"arm.length_a": length})
            return (by * motion.omega).sum() + (by * motion.tip_velocity).sum()

        inputs = rng.uniform(0.5, 3.0, (6, 4)), np.array([20.0, -10.0]), np.array(0.28)
        differentiate = jax.jit(jax.value_and_grad(total, (0, 1, 2))).lower(*inputs)
        run = differentiate.compile(compiler_options=QUICK)
        z = [rng.normal(size=each.shape) for each in inputs]
        found = sum(float(np.vdot(one, dx)) for one, dx in zip(run(*inputs)[1], z, strict=True))

        def value(step: float) -> float:
            return float(run(*(x + step * dx for x, dx in zip(inputs, z, strict=True)))[0])

        near, far = ((value(size) - value(-size)) / (2.0 * size) for size in (1e-5, 2e-5))
    assert abs(found - near) <= abs(far - near) + 1e-8 * abs(near)
    assert abs(far - near) < 1e-6 * abs(near)


JUDGE, LOCATE = (env_module._twin(stage) for stage in (judge_step, locate))


def _pay_torque(w: Any, i: int, *others: float) -> None:
    JUDGE(w, i, *others)
    w[ROW.reward, i] = w[ROW.reward, i] + w[ROW.torque.x1, i]


def _pay_span(w: Any, i: int, *others: float) -> None:
    JUDGE(w, i, *others)
    w[ROW.reward, i] = 2.0 * w[ROW.span, i] * w[ROW.reward, i]


def _forget_reached(w: Any, i: int, constants: Any) -> None:
    reached = w[ROW.reached, i]
    LOCATE(w, i, constants)
    w.rows[int(ROW.reached)] = reached
    w.written.remove(ROW.reached)


@pytest.mark.parametrize(
    ("stage", "function", "told"),
    [
        ("judge_step", _pay_torque, "torque_1 must not"),
        ("judge_step", _pay_span, "span must not"),
        ("locate", _forget_reached, "reached must not"),
    ],
)
def test_a_step_that_uses_what_is_not_computed_here_is_refused(
    stage: str, function: Any, told: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(env_module, stage, function)
    with pytest.raises(ParameterError, match=told):
        make()


@pytest.mark.long
@pytest.mark.parametrize(("kind", "wide"), [("standard", False), *((kind, True) for kind in KINDS)])
def test_the_gradient_by_a_policy_is_that_of_paired_runs(kind: str, wide: bool) -> None:
    """For each world along a random direction of its gains, four steps long, where no run ends.

    Differences over ε and 2·ε tell what curvature, and rounding of observations and actions, make
    of them; rounding of the scalar itself adds half a unit of each term. With 32 bits the adjoint
    begins at rounded states, and sums of some hundred operations lose up to 10⁻³ of its scale. A
    world may cross a switch."""
    with jax.enable_x64(wide):
        env, _ = make(**KINDS[kind], episode_end="constant")
        state, obs, gains, shifts = drawn(env, 4)
        rng = np.random.default_rng(2)
        by = jnp.asarray(0.1 * rng.normal(size=(4, *obs.shape)), float)
        run = jax.jit(lambda gains: simulated(env, state, obs, gains, shifts))

        def total(gains: Any) -> Any:
            seen, rewards, _ = simulated(env, state, obs, gains, shifts)
            return (by * seen).sum() + rewards.sum()

        gradient = np.asarray(jax.jit(jax.grad(total))(gains), float)

        def values(gains: Any) -> Any:
            seen, rewards, over = (np.asarray(each, float) for each in run(gains))
            terms = np.concatenate([np.asarray(by, float) * seen, rewards[..., None]], axis=2)
            return terms.sum((0, 2)), np.abs(terms).sum((0, 2)), over.any(0)

        z, step = rng.normal(size=gains.shape), 2e-4
        differences, rounding, usable = [], 0.0, True
        for size in (step, 2.0 * step):
            moved = [
                jnp.asarray(np.asarray(gains) + sign * size * z, float) for sign in (1.0, -1.0)
            ]
            (high, scale, over), (low, _, too) = map(values, moved)
            differences.append((high - low) / (2.0 * size))
            rounding = np.maximum(rounding, np.finfo(np.float32).eps * scale / (2.0 * size))
            usable &= ~(over | too)
        found = (gradient * z).sum((1, 2))
        loss = 0.0 if wide else 1e-3 * np.abs(gradient * z).sum((1, 2))
        bound = np.abs(differences[1] - differences[0]) + rounding + loss
        close = np.abs(found - differences[0]) <= bound
    assert usable.sum() > 0.5 * WORLDS
    assert close[usable].mean() > 0.95
    assert np.median(bound[usable] / np.abs(found[usable])) < 0.02


@pytest.mark.long
def test_the_end_of_an_episode_cuts_the_gradient() -> None:
    env, _ = make("PTER/Standard-v0", max_episode_steps=2, episode_end="constant")
    _, state = env.reset_to_seed(3)

    def earned(action: Any) -> Any:
        """The rewards of two episodes of two steps."""

        def step(state: Any, _: Any) -> Any:
            _, state, reward, *_ = env.step(None, state, action)
            return state, reward

        return jax.lax.scan(step, state, length=4)[1]

    by = jax.jit(jax.grad(lambda action, pays: earned(action) @ pays))
    found = [by(jnp.full(4, -0.2), pays) for pays in np.eye(4, dtype=np.float32)]
    assert [bool(np.any(each)) for each in found] == [True, False, True, False]


@pytest.mark.long
def test_a_gradient_through_the_end_of_an_episode_raises() -> None:
    env, _ = make("PTER/Standard-v0", max_episode_steps=1)
    _, state = env.reset_to_seed(3)

    def told(action: Any, weight: Any, final: Any) -> Any:
        _, _, reward, _, _, info = env.step(None, state, action)
        return weight * reward + final @ info["final_observation"]

    by, action, size = jax.grad(told), jnp.full(4, -0.2), len(env.observation_layout)
    with pytest.raises(ParameterError, match="gradient"):
        by(action, 1.0, jnp.zeros(size))
    of_three = jax.jit(jax.vmap(by, (None, 0, 0)))
    weights, finals = jnp.zeros(3), jnp.zeros((3, size))
    assert not np.any(of_three(action, weights, finals))
    for through in ((weights.at[1].set(1.0), finals), (weights, finals.at[1, 0].set(1.0))):
        with pytest.raises(
            (ValueError, jax.errors.JaxRuntimeError), match="ParameterError: gradient"
        ):
            jax.block_until_ready(of_three(action, *through))


@pytest.mark.parametrize(
    ("wrong", "told"),
    [
        ({"sensors": "torque"}, "sensors"),
        ({"machine": "couplings-2-1"}, "machine"),
        ({"env_id": "PTER/Everything-v0"}, "hand"),
        ({"episode_end": "ignore"}, "episode_end"),
        ({"base": "impedance"}, "base, reach"),
        ({"history": (1,)}, "history"),
        ({"machine": CREEPING}, "band"),
    ],
)
def test_environments_without_a_derivative_are_refused(wrong: dict[str, Any], told: str) -> None:
    with pytest.raises(ParameterError, match=told):
        make(**wrong)


def test_bad_input_is_refused() -> None:
    env, _ = make()
    _, state = env.reset_to_seed(0)
    with pytest.raises(ParameterError, match="action"):
        env.step(None, state, np.ones(4, int))
    with pytest.raises(ParameterError, match="state"):
        env.step(None, jax_env.EnvState(*state[:2]), np.ones(4))
