"""The worlds of a training as pure JAX functions, for training in one compiled call.

Differences between trainings are in ``SharedConstants`` and not in the code, except for a base's
gains, so one compilation serves them all."""

from typing import Any, NamedTuple

import jax
import numpy as np
from jax import numpy as jnp

from pter_agents.worlds import Training
from pter_gym._engine.world import ROW
from pter_gym._engine.xla import rounded, words_of
from pter_gym.controllers._network import INPUT_LIMIT
from pter_gym.envs.jax import AnyState, EnvParams, JaxEnv
from pter_gym.policies._interface import input_names, input_values
from pter_gym.tasks.path_following._context import CONTEXT

CONTEXT_AT, ENERGY_MAX = int(ROW.context_at), int(CONTEXT.task.energy_max)


class ScaledAction(NamedTuple):
    """Indices of the entries that are seen, (K,), and the centres and scales of their inputs."""

    entries: jax.Array
    center: jax.Array
    scale: jax.Array


class SharedConstants(NamedTuple):
    """What the worlds of a training share.

    Attributes
    ----------
    params
        Parameters of the environment.
    obs_scales
        Units of the observation's entries.
    constants
        Constants of ``params``, float32.
    present, truth
        Inputs of the policy, and those of the value network alone.
    shares
        Weights of the present in the averages, (A,).
    """

    params: EnvParams
    obs_scales: jax.Array
    constants: jax.Array
    present: ScaledAction
    truth: ScaledAction
    shares: jax.Array


class RolloutState(NamedTuple):
    """The changing state; the first axis is always the worlds.

    Attributes
    ----------
    env
        State of the environment.
    rows, means
        The policy's inputs at each of the last steps, the latest first, and the averages.
    known
        The current inputs of the value network alone.
    """

    env: AnyState
    rows: jax.Array
    means: jax.Array
    known: jax.Array


class Step(NamedTuple):
    """Result of a step of N worlds; ``last_obs`` is from before a reset, ``paces`` commanded."""

    rewards: jax.Array
    paces: jax.Array
    terminated: jax.Array
    truncated: jax.Array
    last_obs: jax.Array


class JaxWorlds:
    """Worlds as the networks of a policy meet them.

    Attributes
    ----------
    shared
        Arguments of the functions besides the state.
    effortless
        The same for worlds in which voltage costs nothing.
    """

    def __init__(self, training: Training) -> None:
        interface, env, truth = training.interface, training.env, training.truth
        self._env = JaxEnv(env)
        self._layout = env.observation_layout
        self._pace = self._layout.names.index("pace")
        self._ages = np.array((0, *interface.history))
        names = input_names(self._layout, residual=False)
        places, centers, scales = zip(
            *((names.index(each.name), each.center, each.scale) for each in interface.inputs),
            strict=True,
        )
        self.shared = SharedConstants(
            self._env.default_params,
            jnp.asarray(self._layout.scales, jnp.float32),
            jnp.asarray(env.batch.kernel_arrays()["constants"], jnp.float32),
            _scaled(places, centers, scales),
            _scaled(truth.entries, truth.center, truth.scale),
            jnp.asarray(1.0 / np.array(interface.averages), jnp.float32),
        )
        constants = words_of(training.effortless.batch.kernel_arrays()["constants"])
        params = self.shared.params._replace(constants=constants)
        self.effortless = self.shared._replace(params=params)

    def reset(self, shared: SharedConstants, seeds: jax.Array) -> RolloutState:
        """Return new worlds from the two halves of each world's seed, uint32 (N, 2)."""
        obs, env = jax.vmap(self._env.reset_to_seed, (0, None))(seeds, shared.params)
        count, inputs = len(obs), len(shared.present.entries)
        state = RolloutState(
            env,
            jnp.zeros((count, int(self._ages[-1]) + 1, inputs)),
            jnp.zeros((count, len(shared.shares), inputs)),
            self._truth(shared, env.world),
        )
        return self._see(shared, state, obs, jnp.ones(count, bool))

    def step(
        self, shared: SharedConstants, state: RolloutState, actions: jax.Array
    ) -> tuple[RolloutState, Step]:
        """Advance all worlds by one step, actions (N, clutches)."""
        step = jax.vmap(self._env.step, (None, 0, 0, None))
        obs, env, rewards, terminated, truncated, info = step(
            None, state.env, actions, shared.params
        )
        state = state._replace(env=env, known=self._truth(shared, env.world))
        after = self._see(shared, state, obs, terminated | truncated)
        last_obs = info["final_observation"]
        paces = last_obs[:, self._pace] * shared.obs_scales[self._pace]
        return after, Step(rewards, paces, terminated, truncated, last_obs)

    def inputs(self, state: RolloutState) -> jax.Array:
        """Return the networks' inputs, (N, size): the policy's, then the value network's own."""
        seen = jnp.concatenate([state.rows[:, self._ages], state.means], axis=1)
        return jnp.concatenate([seen.reshape(len(seen), -1), state.known], axis=1)

    def last_inputs(
        self, shared: SharedConstants, before: RolloutState, obs: jax.Array
    ) -> jax.Array:
        """Return the networks' inputs for a last observation, from the state one step earlier."""
        return self.inputs(self._see(shared, before, obs, jnp.zeros(len(obs), bool)))

    def _see(
        self, shared: SharedConstants, state: RolloutState, obs: jax.Array, fresh: jax.Array
    ) -> RolloutState:
        """Add an observation to the past; in a new world, the past equals this observation."""
        values = input_values(obs * shared.obs_scales, self._layout)
        present = _scale(values[:, shared.present.entries], shared.present)[:, None]
        rows = jnp.concatenate([present, state.rows[:, :-1]], axis=1)
        means = state.means + shared.shares[:, None] * (present - state.means)
        column = fresh[:, None, None]
        return state._replace(
            rows=jnp.where(column, present, rows), means=jnp.where(column, present, means)
        )

    def _truth(self, shared: SharedConstants, world: jax.Array) -> jax.Array:
        """Return the entries of ``Batch.truth``, scaled."""
        rows = world.shape[1] // 2
        entries = shared.truth.entries
        own = jnp.minimum(entries, rows - 1)
        state = rounded(
            jnp.stack([world[:, 2 * own], world[:, 2 * own + 1]], axis=-1).reshape(len(world), -1)
        )
        at = rounded(world[:, 2 * CONTEXT_AT : 2 * CONTEXT_AT + 2]).astype(jnp.int32)
        number = jnp.maximum(entries - rows, 0)
        context = shared.constants[at + number + (number >= ENERGY_MAX)]
        return _scale(jnp.where(entries < rows, state, context), shared.truth)


def _scaled(entries: Any, center: Any, scale: Any) -> ScaledAction:
    return ScaledAction(
        jnp.asarray(entries, jnp.int32),
        jnp.asarray(center, jnp.float32),
        jnp.asarray(scale, jnp.float32),
    )


def _scale(values: jax.Array, to: ScaledAction) -> jax.Array:
    return jnp.clip((values - to.center) / to.scale, -INPUT_LIMIT, INPUT_LIMIT)
