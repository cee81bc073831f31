"""The worlds of a training run as a policy's networks see them: pure functions of JAX.

Trainings differ in ``SharedConstants`` and not in the code, except for a base's gains, so one
compilation serves them all.
"""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import NamedTuple, cast

import jax
import numpy as np
from gymnasium.vector import AutoresetMode
from jax import numpy as jnp
from numpy.typing import ArrayLike, NDArray

from pter_agents.draws import DEVICES, training_draws
from pter_agents.settings import NO_BASE, TrainingArguments
from pter_gym._engine.storage import constants_of
from pter_gym._engine.xla import words_of
from pter_gym.controllers import PaceSchedule, Scaled
from pter_gym.controllers._network import INPUT_LIMIT
from pter_gym.controllers._policy import clutch_rows
from pter_gym.envs._vector import PathFollowingVectorEnv
from pter_gym.envs.jax import AnyState, EnvParams, JaxEnv, truth_of
from pter_gym.errors import ParameterError
from pter_gym.policies import Input, Interface, TrainedController
from pter_gym.policies._base_law import find_base_law
from pter_gym.policies._interface import input_names, input_values
from pter_gym.policies.find import find_policy
from pter_gym.scenarios.distributions import Pair

FIXED = {"normal_error": 0.01, "pace_error": 0.5, "speed_across": 0.1}
"""Chosen scales [m, 1, m/s]: random actions make these far larger than a good policy does."""

SAMPLE_WORLDS, SAMPLE_STEPS = 256, 200

DEVIATION = 0.4
"""Standard deviation of the random actions."""


class Selection(NamedTuple):
    """Indices of the entries that are seen, (K,), and the centres and scales of their inputs."""

    entries: jax.Array
    center: jax.Array
    scale: jax.Array

    @classmethod
    def of(cls, entries: ArrayLike, center: ArrayLike, scale: ArrayLike) -> "Selection":
        """Return a selection as arrays of 32 bits."""
        numbers = (jnp.asarray(each, jnp.float32) for each in (center, scale))
        return cls(jnp.asarray(entries, jnp.int32), *numbers)

    def inputs(self, values: jax.Array) -> jax.Array:
        """Return the inputs for the values of the entries, (N, K)."""
        return jnp.clip((values - self.center) / self.scale, -INPUT_LIMIT, INPUT_LIMIT)


class SharedConstants(NamedTuple):
    """What the worlds of a training share: ``EnvParams``, their constants as float32, units of the
    observation's entries, inputs of the policy and those of the value network alone, and weights of
    the present in the averages, (A,)."""

    params: EnvParams
    constants: jax.Array
    obs_scales: jax.Array
    present: Selection
    truth: Selection
    shares: jax.Array


class RolloutState(NamedTuple):
    """What changes, worlds first: the environment, the policy's inputs now and at each earlier step
    that it sees, their averages, and the current inputs of the value network alone."""

    env: AnyState
    seen: jax.Array
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
    env, interface, size
        The worlds as Gymnasium has them, the policy's inputs and outputs, and the number of inputs
        of the value network.
    teacher
        The policy to imitate, with the same inputs and outputs, if there is one.

    Raises
    ------
    ParameterError
        If the teacher has others.
    """

    def __init__(self, arguments: TrainingArguments) -> None:
        s = arguments.settings
        self.env = env = _make_env(arguments, s.worlds)
        self._env = JaxEnv(env)
        forgets = replace(arguments, settings=replace(s, history=()))
        present = _make_env(forgets, SAMPLE_WORLDS)
        self._layout = present.observation_layout
        self._pace = self._layout.names.index("pace")
        inputs, truth = _sample(present, arguments.seed)
        teacher = _find_teacher(s.teacher, inputs) if s.teacher else None
        if teacher:
            inputs = teacher.interface.inputs
        nominal = env.nominal_machine
        if isinstance(env.base, Scaled):
            self._env.bind_base([machine for machine, _ in env.batch.pairs])
        self.interface = Interface(
            inputs,
            s.reach,
            cast("PaceSchedule | Scaled | None", env.base),
            s.history,
            s.averages,
            env.base is None,
            s.frame_skip,
            nominal.clutch.voltage_max,
            clutch_rows(nominal),
            trained=DEVICES.trained if s.devices else (),
        )
        self.teacher = teacher
        if teacher:
            _check_teacher(teacher, self.interface)
        self.size = self.interface.size + len(truth.entries)
        centers, scales = zip(*((each.center, each.scale) for each in inputs), strict=True)
        self._first = SharedConstants(
            self._env.default_params,
            jnp.zeros(0),
            jnp.asarray(self._layout.scales, jnp.float32),
            Selection.of(range(len(inputs)), centers, scales),
            truth,
            jnp.asarray(1.0 / np.array(s.averages), jnp.float32),
        )
        self._room = 0

    def shared(self, hands: Sequence[Pair] = (), *, effort: bool = True) -> SharedConstants:
        """Return what worlds share that draw from the pairs of the environment.

        As many of these, evenly spread, give way to ``hands``; without ``effort``, voltage costs
        nothing.
        """
        pairs = self.env.batch.pairs
        total, kept = len(pairs), max(0, len(pairs) - len(hands))
        pairs = [*(pairs[k * total // kept] for k in range(kept)), *hands][:total]
        if not effort:
            free = ((machine, task, replace(task.reward, effort=0.0)) for machine, task in pairs)
            pairs = [(machine, replace(task, reward=reward)) for machine, task, reward in free]
        constants = constants_of(pairs)
        if len(constants) > self._room:  # one size for all hands saves compilations
            self._room = len(constants) + (len(constants) // 4 if hands else 0)
        constants = np.pad(constants, (0, self._room - len(constants)))
        params = self._first.params._replace(constants=words_of(constants))
        return self._first._replace(params=params, constants=jnp.asarray(constants, jnp.float32))

    def reset(self, shared: SharedConstants, seeds: jax.Array) -> RolloutState:
        """Return new worlds from the two halves of each world's seed, uint32 (N, 2)."""
        obs, env = jax.vmap(self._env.reset_to_seed, (0, None))(seeds, shared.params)
        count, inputs = len(obs), len(shared.present.entries)
        state = RolloutState(
            env,
            jnp.zeros((count, 1 + len(self.interface.history), inputs)),
            jnp.zeros((count, len(shared.shares), inputs)),
            _truth(shared, env.world),
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
        state = state._replace(env=env, known=_truth(shared, env.world))
        after = self._see(shared, state, obs, terminated | truncated)
        last_obs = info["final_observation"]
        paces = last_obs[:, self._pace] * shared.obs_scales[self._pace]
        return after, Step(rewards, paces, terminated, truncated, last_obs)

    def inputs(self, state: RolloutState) -> jax.Array:
        """Return the networks' inputs, (N, size): the policy's, then the value network's own."""
        seen = jnp.concatenate([state.seen, state.means], axis=1)
        return jnp.concatenate([seen.reshape(len(seen), -1), state.known], axis=1)

    def last_inputs(
        self, shared: SharedConstants, before: RolloutState, obs: jax.Array
    ) -> jax.Array:
        """Return the networks' inputs for a last observation, from the state one step earlier."""
        return self.inputs(self._see(shared, before, obs, jnp.zeros(len(obs), bool)))

    def _see(
        self, shared: SharedConstants, state: RolloutState, obs: jax.Array, fresh: jax.Array
    ) -> RolloutState:
        """Take an observation in; in a new world, its averages equal it."""
        instants = obs.reshape(-1, len(self._layout)) * shared.obs_scales
        values = input_values(instants, self._layout)[:, shared.present.entries]
        seen = shared.present.inputs(values).reshape(state.seen.shape)
        means = state.means + shared.shares[:, None] * (seen[:, :1] - state.means)
        return state._replace(seen=seen, means=jnp.where(fresh[:, None, None], seen[:, :1], means))


def _find_teacher(name: str, ours: Iterable[Input]) -> TrainedController:
    """Return a policy whose inputs are in the order of ours, or raise a ParameterError."""
    teacher = find_policy(name)
    if not isinstance(teacher, TrainedController):
        raise ParameterError(f"teacher must be a trained policy, got {name!r:.200}")
    theirs = teacher.interface.inputs
    numbers = {each.name: number for number, each in enumerate(theirs)}
    wanted = [each.name for each in ours]
    if {*wanted} != {*numbers}:
        raise ParameterError(f"teacher must have the inputs {wanted}, got {[*numbers]}")
    order = [numbers[each] for each in wanted]
    (weight, bias), *others = teacher.layers
    columns = [first + each for first in range(0, weight.shape[1], len(theirs)) for each in order]
    interface = replace(teacher.interface, inputs=tuple(theirs[each] for each in order))
    first = np.ascontiguousarray(weight[:, columns]), bias
    return replace(teacher, interface=interface, layers=(first, *others))


def _check_teacher(teacher: TrainedController, ours: Interface) -> None:
    """Raise a ParameterError unless a teacher's outputs mean what ours do."""
    theirs = replace(teacher.interface, base=ours.base, trained=ours.trained)
    for name, mine in vars(ours).items():
        if mine != (other := getattr(theirs, name)):
            raise ParameterError(f"teacher must have {name} {mine!r:.200}, got {other!r:.200}")


def _truth(shared: SharedConstants, world: jax.Array) -> jax.Array:
    """Return the inputs of the value network alone: entries of ``Batch.truth``."""
    return shared.truth.inputs(truth_of(world, shared.constants, shared.truth.entries))


def _make_env(arguments: TrainingArguments, count: int) -> PathFollowingVectorEnv:
    """Return worlds that are reset in the same step in which they end."""
    s = arguments.settings
    alone = s.base == NO_BASE
    return PathFollowingVectorEnv(
        count,
        scenario=training_draws(arguments),
        contexts=s.contexts,
        context_seed=arguments.seed,
        base=None if alone else find_base_law(s.base, arguments.gains),
        reach=None if alone else s.reach,
        history=[s.frame_skip * steps for steps in s.history],
        max_episode_steps=s.episode,
        frame_skip=s.frame_skip,
        autoreset_mode=AutoresetMode.SAME_STEP,
        telemetry=False,
        num_threads=1,
    )


def _sample(env: PathFollowingVectorEnv, seed: int) -> tuple[tuple[Input, ...], Selection]:
    """Return the inputs and the truth, with mean and standard deviation under random actions."""
    layout, rng = env.observation_layout, np.random.default_rng(seed)
    obs, _ = env.reset(seed=seed)
    seen: list[NDArray[np.float64]] = []
    true: list[NDArray[np.float64]] = []
    for _ in range(SAMPLE_STEPS):
        seen.append(input_values(obs * layout.scales, layout))
        true.append(env.batch.truth())
        actions = DEVIATION * rng.standard_normal((len(obs), env.batch.num_actions))
        obs = env.step(np.clip(actions, -1.0, 1.0).astype(np.float32))[0]
    center, scale, varies = _moments(np.concatenate(seen))
    inputs = (
        Input(name, 0.0, FIXED[name])
        if name in FIXED
        else Input(name, float(f"{c:.4g}"), float(f"{s:.4g}") if v else 1.0)
        for name, c, s, v in zip(
            input_names(layout, residual=False), center, scale, varies, strict=True
        )
    )
    center, scale, varies = _moments(np.concatenate(true))
    told = env.batch.truth_entries[varies]
    return tuple(inputs), Selection.of(told, center[varies], scale[varies])


def _moments(
    values: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
    """Return mean and standard deviation of each column, and whether it varies."""
    deviation = values.std(axis=0)
    return values.mean(axis=0), deviation, deviation > 1e-6 * (1.0 + np.abs(values).max(axis=0))
