"""JAX has the bits of ``make_vec`` under ``jit``, ``vmap`` and ``scan``; what it refuses."""

import subprocess
import sys
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple

import gymnasium
import numpy as np
import pytest

from documents import DOCS, blocks_of, run_program
from pter_gym.controllers import PerClutch, Policy, compiled
from pter_gym.errors import ActionError, ParameterError
from pter_gym.params import BASELINE
from pter_gym.paths import Sine
from pter_gym.scenarios.distributions import OneOf, Vary
from pter_gym.tasks.path_following import Failure, PathFollowing
from rollouts import releasing

jax = pytest.importorskip("jax")
jnp = jax.numpy

from pter_gym.envs.jax import EnvParams, EnvState, make  # noqa: E402  (needs JAX)

WORLDS = 45
"""Two blocks, the second one not full."""

KINDS: dict[str, dict[str, Any]] = {
    "standard": {"env_id": "PTER/Standard-v0", "contexts": 8},
    "all that is stored, held": {
        "env_id": "PTER/Everything-v0",
        "contexts": 8,
        "pace": "brisk",
        "sensors": "force",
        "frame_skip": 3,
        "observe_context": True,
    },
    "one task with a corridor": {
        "machine": replace(BASELINE, clutch=replace(BASELINE.clutch, hysteresis=1.2)),
        "task": PathFollowing(
            path=Sine(),
            truncation_error=0.05,
            free_left=0.01,
            free_right=0.01,
            failures=(Failure(clutch=2, torque=0.3, after=0.2), Failure(clutch=4, volts=2.0)),
        ),
        "max_episode_steps": 60,
        "action_unit": "volt",
    },
    "other clutches": {"machine": "two-brakes", "action_unit": "volt"},
    "a base": {
        "env_id": "PTER/Standard-v0",
        "contexts": 8,
        "base": "single-dof-tuned",
        "reach": 24.0,
        "max_episode_steps": 60,
    },
    "a history of sensors with delay": {
        "env_id": "PTER/Everything-v0",
        "contexts": 8,
        "sensors": "encoders",
        "history": (1, 3, 10),
        "failures": [Vary(Failure(clutch=1, torque=0.0), clutch=OneOf((1, 2, 3, 4)))],
        "max_episode_steps": 20,
    },
    "a base and a history": {
        "env_id": "PTER/Standard-v0",
        "contexts": 8,
        "base": releasing("single-dof-tuned"),
        "history": (2, 7),
        "max_episode_steps": 30,
    },
    "a base, held": {"base": "impedance", "frame_skip": 3, "max_episode_steps": 20},
}


def test_the_five_results_of_the_page_are_those_of_gymnax() -> None:
    """As its wrappers call it: jitted, with the environment as a static argument."""
    (block,) = (each for each in blocks_of(DOCS / "your-algorithm.md") if "FiveResults" in each)
    own, params = make("PTER/Standard-v0", contexts=8)
    five: Any = run_program([block], "page", env=own)["env"]
    assert five.action_space(params).shape == (4,)
    keys = jax.random.split(jax.random.key(0), WORLDS)
    _, state = jax.vmap(five.reset, in_axes=(0, None))(keys, params)

    @partial(jax.jit, static_argnums=0)
    def steps(env: Any, state: Any) -> Any:
        def step(state: Any, _: None) -> Any:
            by_world = jax.vmap(env.step, in_axes=(0, 0, 0, None))
            obs, state, *rest = by_world(keys, state, jnp.zeros((WORLDS, 4)), params)
            return state, (obs, *rest)

        return jax.lax.scan(step, state, length=40)[1]

    _, rewards, done, info = steps(five, state)
    assert rewards.shape == done.shape == (40, WORLDS)
    np.testing.assert_array_equal(done, info["terminated"] | info["truncated"])
    assert done.any()


def vector(env_id: str = "PTER/PathFollowing-v0", num_envs: int = WORLDS, **keywords: Any) -> Any:
    return gymnasium.make_vec(
        env_id, num_envs, autoreset_mode="SAME_STEP", telemetry=False, **keywords
    )


def many(env: Any) -> Any:
    return jax.vmap(env.step, in_axes=(None, 0, 0, None))


@pytest.mark.parametrize(
    "kind",
    [pytest.param(x, marks=pytest.mark.long if x == "other clutches" else ()) for x in KINDS],
)
def test_worlds_have_the_bits_of_the_vector_environment(kind: str) -> None:
    with jax.enable_x64(kind == "standard"):
        env, params = make(**KINDS[kind])
        worlds = vector(**KINDS[kind])
        space, rng = worlds.single_action_space, np.random.default_rng(4)
        assert env.action_space().shape == (env.num_actions,) == space.shape
        low, high = space.low[0], space.low[0] + 0.6 * (space.high[0] - space.low[0])
        actions = rng.uniform(low, high, (150, WORLDS, *space.shape)).astype(np.float32)
        obs, state = jax.vmap(env.reset_to_seed)(7 + np.arange(WORLDS))
        np.testing.assert_array_equal(obs, worlds.reset(seed=7)[0])

        def step(state: Any, action: Any) -> Any:
            obs, state, *rest = many(env)(None, state, action, params)
            return state, (obs, *rest)

        _, found = jax.jit(partial(jax.lax.scan, step))(state, actions)
        ended = 0
        for t, action in enumerate(actions):
            obs, rewards, terminated, truncated, infos = worlds.step(action)
            np.testing.assert_array_equal(found[0][t], obs)
            by_steps = env.env.base is not None or env.env.history
            sums = by_steps and env.frame_skip > 1  # of rounded rewards
            rounded = 2.0**-24 * (2 * env.frame_skip if sums else 0)
            np.testing.assert_allclose(found[1][t], rewards.astype(np.float32), rounded, rounded)
            np.testing.assert_array_equal(found[2][t], terminated)
            np.testing.assert_array_equal(found[3][t], truncated)
            told = {name: each[t] for name, each in found[4].items()}
            done = terminated | truncated
            np.testing.assert_array_equal(told["terminated"] | told["truncated"], done)
            np.testing.assert_array_equal(told["final_observation"][~done], obs[~done])
            for world in np.flatnonzero(done):
                np.testing.assert_array_equal(
                    told["final_observation"][world], infos["final_obs"][world]
                )
                assert told["is_success"][world] == infos["final_info"]["is_success"][world]
            ended += int(done.sum())
        assert ended > WORLDS


@pytest.mark.parametrize("scenario", ["Standard", "Everything"])
def test_the_truth_is_that_of_the_vector_environment(scenario: str) -> None:
    """Rounded to 32 bits toward zero, and to 0 where it is tiny."""
    env, params = make(f"PTER/{scenario}-v0", contexts=8)
    worlds = vector(f"PTER/{scenario}-v0", contexts=8, privileged=True)
    _, state = jax.vmap(env.reset_to_seed)(7 + np.arange(WORLDS))
    _, infos = worlds.reset(seed=7)
    for _ in range(3):
        found = jax.vmap(env.privileged, in_axes=(0, None))(state, params)
        np.testing.assert_allclose(found, infos["privileged"], rtol=2.0**-23, atol=1e-37)
        *_, infos = worlds.step(np.zeros((WORLDS, 4), np.float32))
        _, state, *_ = many(env)(None, state, jnp.zeros((WORLDS, 4)), params)
    with pytest.raises(ParameterError, match="privileged must not be given"):
        make(privileged=True)


def test_one_world_is_a_row_of_many_and_vmap_may_be_nested() -> None:
    env, params = make("PTER/Hands-v0", contexts=8)
    keys = jax.random.split(jax.random.key(3), 6)
    actions = jnp.linspace(0.0, 8.0, 24).reshape(6, 4)
    alone = jax.jit(lambda key, action: env.step(None, env.reset(key)[1], action))
    ones = [alone(key, action) for key, action in zip(keys, actions, strict=True)]
    flat = many(env)(None, jax.vmap(env.reset)(keys)[1], actions, params)
    grid = jax.vmap(many(env), in_axes=(None, 0, 0, None))
    states = jax.vmap(jax.vmap(env.reset))(keys.reshape(2, 3))[1]
    nested = grid(None, states, actions.reshape(2, 3, 4), params)
    for k, one in enumerate(ones):
        for a, b, c in zip(*map(jax.tree.leaves, (one, flat, nested)), strict=True):
            np.testing.assert_array_equal(a, b[k])
            np.testing.assert_array_equal(a, c[k // 3, k % 3])


def test_many_actions_may_be_tried_from_one_state() -> None:
    env, _ = make("PTER/Standard-v0", contexts=8)
    _, state = env.reset(jax.random.key(1))
    actions = jnp.linspace(0.0, 24.0, 12).reshape(3, 4)
    tried = jax.vmap(env.step, in_axes=(None, None, 0))(None, state, actions)
    for k, action in enumerate(actions):
        for one, row in zip(
            *map(jax.tree.leaves, (env.step(None, state, action), tried)), strict=True
        ):
            np.testing.assert_array_equal(one, row[k])


def test_a_seed_of_64_bits_is_passed_in_halves() -> None:
    env, _ = make()
    seed = 3 + (5 << 32)
    obs, state = env.reset_to_seed(np.array([3, 5], np.uint32))
    np.testing.assert_array_equal(obs, vector(num_envs=1).reset(seed=[seed])[0][0])
    np.testing.assert_array_equal(state.episode, [3, 5, 0, 0])
    keys = jax.vmap(env.reset)(jax.random.split(jax.random.key(0), 8))[1].episode
    assert len({tuple(each) for each in np.asarray(keys)[:, :2].tolist()}) == 8


def test_states_are_updated_in_place_when_they_are_donated() -> None:
    env, params = make("PTER/Standard-v0", contexts=8)
    _, state = jax.vmap(env.reset)(jax.random.split(jax.random.key(0), 256))
    where = state.world.unsafe_buffer_pointer()
    step = jax.jit(
        lambda state, action: many(env)(None, state, action, params)[1], donate_argnums=0
    )
    after = step(state, jnp.zeros((256, 4)))
    assert state.world.is_deleted()
    assert after.world.unsafe_buffer_pointer() == where


def test_actions_beyond_the_bounds_are_clipped_and_others_are_told() -> None:
    env, _ = make("PTER/Standard-v0", contexts=8)
    _, state = env.reset(jax.random.key(2))
    wild, tame = (env.step(None, state, jnp.full(4, value)) for value in (50.0, 1.0))
    for one, other in zip(*map(jax.tree.leaves, (wild, tame)), strict=True):
        np.testing.assert_array_equal(one, other)
    obs, after, reward, *_ = env.step(None, state, jnp.array([0.0, jnp.nan, 0.0, 0.0]))
    assert np.isnan(obs).all()
    assert np.isnan(reward)
    free = env.step(None, state, jnp.full(4, -1.0))[1]
    np.testing.assert_array_equal(after.world, free.world)


def test_constants_shared_by_worlds_are_an_argument() -> None:
    env, params = make("PTER/Standard-v0", contexts=8)
    other, changed = make("PTER/Standard-v0", contexts=8, context_seed=1)
    key, action = jax.random.key(5), jnp.zeros(4)
    _, state = env.reset(key, changed)
    np.testing.assert_array_equal(
        env.step(key, state, action, changed)[0], other.step(key, state, action)[0]
    )
    stacked: Any = jax.tree.map(lambda *each: jnp.stack(each), params, changed)
    assert isinstance(stacked, EnvParams)
    assert np.isnan(
        jax.vmap(env.step, in_axes=(None, None, None, 0))(key, state, action, stacked)[0]
    ).all()


def test_steps_and_resets_in_branches_have_the_bits_of_those_that_are_chosen_afterwards() -> None:
    env, _ = make("PTER/Standard-v0", contexts=8)
    _, states = jax.vmap(env.reset)(jax.random.split(jax.random.key(0), 6))
    choices = jnp.arange(6) % 3

    def outcomes(state: Any) -> tuple[Any, ...]:
        return (
            lambda: state,
            lambda: env.step(None, state, jnp.zeros(4))[1],
            lambda: env.reset_to_seed(state.episode[:2] + jnp.uint32(9))[1],
        )

    def condition(state: Any, choice: Any) -> Any:
        wait, step, restart = outcomes(state)
        return jax.lax.cond(choice == 0, wait, lambda: jax.lax.cond(choice == 1, step, restart))

    def switch(state: Any, choice: Any) -> Any:
        return jax.lax.switch(choice, outcomes(state))

    def chosen(state: Any, choice: Any) -> Any:
        return jax.tree.map(
            lambda *each: jnp.select([choice == k for k in range(3)], each),
            *(f() for f in outcomes(state)),
        )

    expected = jax.tree.leaves(jax.vmap(chosen)(states, choices))
    for branching in (condition, switch):
        for one, two in zip(
            jax.tree.leaves(jax.vmap(branching)(states, choices)), expected, strict=True
        ):
            np.testing.assert_array_equal(one, two)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"env_id": "CartPole-v1"}, "env_id"),
        ({"env_id": "PTER/Standard-v0", "num_envs": 3}, "num_envs"),
        ({"env_id": "PTER/Standard-v0", "frame_skip": 0}, "frame_skip"),
    ],
)
def test_bad_arguments_are_refused(wrong: dict[str, Any], message: str) -> None:
    with pytest.raises(ParameterError, match=message):
        make(**wrong)


BESIDE_A_GPU = """
import os
os.environ["XLA_FLAGS"] = (
    os.environ.get("XLA_FLAGS", "") + " --xla_force_host_platform_device_count=2"
)
import jax
import numpy as np

here, gpu = jax.local_devices(backend="cpu")
jax.config.update("jax_default_device", gpu)
jax.default_backend = lambda: "gpu"
from pter_gym.envs.jax import make

env, params = make()
key = jax.device_put(jax.random.key(0), gpu)
obs, state = env.reset(key, params)
action = jax.device_put(np.ones(env.num_actions, np.float32), gpu)
_, after, *_ = env.step(key, state, action)
_, compiled = jax.jit(env.reset)(jax.random.key(0), params)
_, again, *_ = jax.jit(env.step)(None, compiled, jax.device_put(action, here), params)
closed = jax.jit(lambda key: env.reset(key, params))(jax.random.key(0))
nothing = np.zeros(env.num_actions, np.float32)
many = jax.jit(jax.vmap(lambda key: env.step(None, env.reset(key)[1], nothing)))
closed = closed, many(jax.random.split(jax.random.key(0), 3))
for array in jax.tree.leaves((params, obs, state, after, compiled, again, closed)):
    assert array.devices() == {here}, array.devices()
np.testing.assert_array_equal(after.world, again.world)
"""


@pytest.mark.long
def test_beside_a_gpu_worlds_run_on_the_cpu() -> None:
    """A second device of the CPU stands for the GPU that JAX takes by default."""
    subprocess.run([sys.executable, "-c", BESIDE_A_GPU], check=True)


def test_jax_without_a_cpu_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(**_: object) -> None:
        raise RuntimeError("Unknown backend cpu")

    monkeypatch.setattr(jax, "local_devices", refuse)
    with pytest.raises(ParameterError, match="platforms must include cpu"):
        make()


def test_a_state_is_a_tree_of_two_arrays() -> None:
    env, params = make()
    obs, state = env.reset(jax.random.key(0), params)
    assert isinstance(state, EnvState)
    assert env.observation_space(params).contains(np.asarray(obs))
    assert env.action_space(params).shape == (env.num_actions,)
    assert obs.shape == (len(env.observation_layout),)


# --- what is refused where it is traced ---


@pytest.mark.parametrize("seed", [1.7, True, -1, 2**32, [1, 2, 3], np.float32(1.0)])
def test_a_seed_that_is_no_whole_number_is_refused(seed: Any) -> None:
    env, _ = make()
    with pytest.raises(ParameterError, match="seed"):
        env.reset_to_seed(seed)
    with pytest.raises(ParameterError, match="seed"):
        jax.jit(env.reset_to_seed)(jnp.asarray(1.7))


@pytest.mark.parametrize(
    "action", [0.5, np.zeros(3), np.zeros((2, 4)), np.ones(4, bool), np.ones(4, complex), "volts"]
)
def test_an_action_of_another_shape_or_type_is_refused(action: Any) -> None:
    env, _ = make()
    _, state = env.reset(jax.random.key(0))
    with pytest.raises(ActionError, match="action"):
        env.step(None, state, action)


def test_states_and_params_of_other_environments_are_refused() -> None:
    env, _ = make("PTER/Standard-v0", contexts=8)
    other, params = make("PTER/Everything-v0", contexts=8, sensors="force")
    _, state = env.reset(jax.random.key(0))
    with pytest.raises(ParameterError, match="state must be"):
        env.step(None, other.reset(jax.random.key(0))[1], jnp.zeros(4))
    with pytest.raises(ParameterError, match="state must be"):
        env.step(None, jax.tree.map(lambda part: jnp.stack([part, part]), state), jnp.zeros(4))
    with pytest.raises(ParameterError, match="params must be"):
        env.step(None, state, jnp.zeros(4), params)


def test_damaged_worlds_return_nan_and_change_no_other() -> None:
    env, _ = make("PTER/Standard-v0", contexts=8)
    _, state = env.reset(jax.random.key(0))
    rng, n = np.random.default_rng(0), 70
    worlds = np.repeat(np.asarray(state.world)[None], n, 0)
    bad = np.arange(n) % 7 == 3
    worlds[bad] = rng.integers(0, 2**32, (int(bad.sum()), worlds.shape[1]), np.uint32)
    worlds[3] = 0  # never reset
    states = EnvState(jnp.asarray(worlds), jnp.repeat(state.episode[None], n, 0))
    obs, after, rewards, ended, *_ = jax.vmap(env.step, in_axes=(None, 0, None))(
        None, states, jnp.zeros(4)
    )
    expected = env.step(None, state, jnp.zeros(4))
    assert np.isnan(obs[bad]).all()
    assert np.isnan(rewards[bad]).all()
    assert not ended[bad].any()
    np.testing.assert_array_equal(after.world[bad], worlds[bad])
    np.testing.assert_array_equal(obs[~bad], np.repeat(expected[0][None], (~bad).sum(), 0))


def test_a_world_that_draws_from_other_constants_returns_nan() -> None:
    env, _ = make("PTER/Standard-v0", contexts=8)
    _, fewer = make("PTER/Standard-v0", contexts=2)
    _, state = env.reset_to_seed(3)
    assert np.isnan(env.step(None, state, jnp.zeros(4), fewer)[0]).all()
    assert np.isnan(env.reset_to_seed(3, fewer)[0]).all()


class Count(NamedTuple):
    """Control steps in worlds that are to fail; far below zero in others."""

    steps: float


@compiled
def failing(obs: Any, scales: Any, gains: Any, memory: Any) -> PerClutch:
    """30 V; from the fourth step on NaN, or beyond the memory, where a world starts low."""
    begins = memory[0] == 0.0
    memory[0] = -1e9 if begins and obs[0] >= gains[0] else memory[0] + 1.0
    fails = memory[0] > 3.0
    beyond = int(memory[0]) if fails and gains[1] > 0.0 else 0
    volts = np.nan if fails and gains[1] == 0.0 else 30.0
    return PerClutch(volts, 2.0 + 0.0 * memory[beyond], 0.0, 0.0)


@dataclass(frozen=True)
class Failing:
    """The law above in worlds whose first entry is below a limit."""

    below: float
    reads_beyond: bool = False

    def bind(self, machine: Any, layout: Any) -> Policy:
        gains = [self.below, float(self.reads_beyond)]
        return Policy.from_law(failing, gains, machine, layout, memory=Count)


NEVER = -np.inf


def failing_kind(below: float, reads_beyond: bool = False) -> dict[str, Any]:
    base = Failing(below, reads_beyond)
    return {"env_id": "PTER/Standard-v0", "contexts": 8, "base": base, "starts": "path"}


def test_a_base_is_clipped_to_the_machines_range() -> None:
    """As one of 24 V is; with a reach of 8 V, an action of −1 then leaves 16 V."""
    env, _ = make(**failing_kind(NEVER))
    worlds = vector(**failing_kind(NEVER))
    _, state = jax.vmap(env.reset_to_seed)(np.arange(WORLDS))
    worlds.reset(seed=0)
    action = np.full((WORLDS, 4), -1.0, np.float32)
    for _ in range(3):
        obs, state, *_ = many(env)(None, state, action, None)
        found = worlds.step(action)[0]
        np.testing.assert_array_equal(obs, found)
    layout = env.observation_layout
    volts = layout.index("volts_1")
    np.testing.assert_allclose(found[:, volts] * layout.scales[volts], 16.0, rtol=1e-6)


@pytest.mark.parametrize("reads_beyond", [False, True])
def test_a_law_that_fails_in_one_world_leaves_the_others_as_they_are(reads_beyond: bool) -> None:
    sound, _ = make(**failing_kind(NEVER))
    first, state = jax.vmap(sound.reset_to_seed)(np.arange(WORLDS))
    limit = float(first[:, 0].mean())
    env, _ = make(**failing_kind(limit, reads_beyond))
    _, other = jax.vmap(env.reset_to_seed)(np.arange(WORLDS))
    action = jnp.zeros((WORLDS, 4))
    failed = np.zeros(WORLDS, bool)
    for _ in range(6):
        obs, state, rewards, *_ = many(sound)(None, state, action, None)
        seen, other, found, *_ = many(env)(None, other, action, None)
        failed |= np.isnan(seen).any(axis=1) | np.isnan(found)
        np.testing.assert_array_equal(seen[~failed], obs[~failed])
        np.testing.assert_array_equal(found[~failed], rewards[~failed])
    np.testing.assert_array_equal(failed, first[:, 0] < limit)
    assert 0 < failed.sum() < WORLDS


def test_params_of_other_machines_or_actions_are_refused() -> None:
    env, _ = make()
    state = env.reset_to_seed(0)[1]
    for kind in ({"action_unit": "volt"}, {"machine": "double-brakes"}):
        other = make(**kind)[1]
        with pytest.raises(ParameterError, match="params must be of machines and actions"):
            env.step(None, state, jnp.zeros(4), other)
        with pytest.raises(ParameterError, match="params must be of machines and actions"):
            jax.jit(env.step)(None, state, jnp.zeros(4), other)
