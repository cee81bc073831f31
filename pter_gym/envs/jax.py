"""The worlds as pure functions of JAX, in the style of gymnax 1.0, on the same compiled kernel.

``reset`` and ``step`` act on one world; ``jax.vmap`` extends them to many, in one call of the
kernel, and both work under ``jax.jit`` and ``jax.lax.scan``. A world with seed s goes through the
same episodes, bit for bit, as one of ``gymnasium.make_vec`` with that seed.

Worlds run on the CPU, and so does a jitted function that contains a step. If JAX also has a GPU,
networks may use it in separate functions; ``jax.device_put`` moves arrays that are committed to the
GPU.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, partial
from typing import Any, NamedTuple, Protocol, Self, cast

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import ArrayLike, NDArray

from pter_gym.errors import ActionError, ParameterError, needs_extra

try:
    import jax
    from jax import lax, numpy as jnp
    from jax.core import Tracer
    from jax.custom_batching import custom_vmap

    from pter_gym._engine.xla import (
        DECLARED_STEP,
        RESET,
        STEP,
        call_law,
        cpu_device,
        on_cpu,
        register_calls,
        register_law,
        rounded,
        words_of,
    )
except ImportError as error:
    raise ImportError(str(needs_extra("pter_gym.envs.jax", "jax"))) from error

from pter_gym._compiled.layout import Layout
from pter_gym._engine.world import CONFIG_WIDTH, FLAG, FLAGS, ROW
from pter_gym.controllers import Controller
from pter_gym.controllers._law_kernel import guarded
from pter_gym.envs._agent_batch import AgentBatch
from pter_gym.envs._vector import PathFollowingVectorEnv
from pter_gym.params import SLOTS, Machine
from pter_gym.policies._view import BoundView, Memory
from pter_gym.tasks.path_following._context import CONTEXT_WIDTH

__all__ = ["AgentState", "EnvParams", "EnvState", "JaxEnv", "LawParams", "make"]

CONTEXT_AT = int(ROW.context_at)


class EnvState(NamedTuple):
    """What changes in a world: opaque words, which may be stored and copied.

    Attributes
    ----------
    world
        Motion, clutches, hand and place on the path, uint32 (W,).
    episode
        Seed and episode count, uint32 (4,).
    """

    world: jax.Array
    episode: jax.Array


class AgentState(NamedTuple):
    """An ``EnvState`` with what changes in a law that actions correct, and in a history.

    Attributes
    ----------
    world, episode
        Those of ``EnvState``.
    memory
        ``law``, the memory of the law, uint32 (M,), ``base``, its voltages [V], float32 (4,), and
        ``latest``, the latest observations, float32 (steps, entries).
    """

    world: jax.Array
    episode: jax.Array
    memory: Memory[jax.Array, jax.Array]


AnyState = EnvState | AgentState


@jax.tree_util.register_static
@dataclass(frozen=True)
class Kind:
    """What worlds must have in common to share an environment's functions; no array.

    Attributes
    ----------
    clutches
        Connection of each clutch, a row of W.
    voltage_max
        Largest voltage [V].
    bounds
        Lowest and highest entry of an action.
    """

    clutches: tuple[tuple[float, float], ...]
    voltage_max: float
    bounds: tuple[float, float]


class EnvParams(NamedTuple):
    """What worlds share: opaque words.

    Attributes
    ----------
    config
        Bounds, steps and scales, uint32 (C,).
    constants
        The machines and tasks that a world draws from, uint32 (K,).
    kind
        Which environments they are for.
    """

    config: jax.Array
    constants: jax.Array
    kind: Kind


class Shared(NamedTuple):
    """The words that a call of the step kernel gets for all worlds."""

    config: jax.Array
    constants: jax.Array


class LawParams(NamedTuple):
    """What a law shares in all worlds, as words.

    Scales are those of the observation's entries. Gains are uint32 (rows, G): one row for all, or
    one for each pair that worlds draw.
    """

    scales: jax.Array
    gains: jax.Array
    voltage_max: jax.Array


Info = dict[str, jax.Array]

Arrays = Sequence[jax.Array]

Advanced = tuple[AnyState, jax.Array, jax.Array, jax.Array, jax.Array]
"""State, observation, last observation, reward and flags after a step."""


class JaxEnv:
    """Pure functions of one world; make one with ``make``.

    Attributes
    ----------
    env
        One world of the same kind for Gymnasium, which ``pter_gym.benchmark.from_actions`` takes.
    observation_layout
        Names, units and scales of the observation's entries.
    num_actions
        Entries of an action, one for each clutch.
    frame_skip
        Control steps for which an action is held.
    default_params
        What its worlds share.
    """

    name = "PathFollowing"

    def __init__(self, env: PathFollowingVectorEnv) -> None:
        cpu_device()
        step = STEP if env.batch.machine.has_paper_clutches else DECLARED_STEP
        register_calls(step)
        self._step = _stepping(step)
        self.env = env
        self.observation_layout: Layout = env.observation_layout
        self.frame_skip = env.frame_skip
        self.num_actions = env.batch.num_actions
        machine, low = env.batch.machine, env.batch.action_low
        arrays = env.batch.kernel_arrays()
        kind = Kind(
            tuple(clutch.row for clutch in machine.clutches),
            machine.clutch.voltage_max,
            (low, env.batch.action_high),
        )
        self.default_params = EnvParams(
            words_of(arrays["config"]), words_of(arrays["constants"]), kind
        )
        self._empty = words_of(arrays["worlds"][0, :, 0])
        self._view = env.batch.view if isinstance(env.batch, AgentBatch) else None
        in_volts = self._view is not None and self._view.view.unit_of_worlds == "volt"
        self._no_volts = 0.0 if in_volts else low
        if self._view is None:
            return
        blank = self._view.start(1)
        law = words_of(blank.law)
        self._blank = on_cpu(Memory(law, *(jnp.asarray(part) for part in blank[1:])))
        if (base := self._view.base) is not None:
            law = base.law
            self._law = _following(register_law(law.function, guarded(law.function)))
            self._law_params = LawParams(
                words_of(base.policy.layout.scales),
                words_of(law.gains[None]),
                words_of(np.array([machine.clutch.voltage_max])),
            )

    @classmethod
    def from_id(cls, env_id: str, keywords: dict[str, Any], **own: Any) -> Self:
        """Return the environment of an id, with keywords of ``make`` and those of this class."""
        fixed: dict[str, Any] = {"autoreset_mode": "SAME_STEP", "num_envs": 1}
        fixed |= {"telemetry": False, "num_threads": 1}
        for name in (*fixed, "render_mode", "privileged"):
            if name in keywords:
                raise ParameterError(f"{name} must not be given: JAX has its own way")
        if not env_id.startswith("PTER/"):
            raise ParameterError(f"env_id must be an id of PTER, got {env_id!r}")
        env = gymnasium.make_vec(env_id, **fixed, **keywords).unwrapped
        return cls(cast(PathFollowingVectorEnv, env), **own)

    def reset(self, key: jax.Array, params: EnvParams | None = None) -> tuple[jax.Array, AnyState]:
        """Return a world's first observation, float32 (len(observation_layout),), and its state.

        Its seed follows from the key, and its later episodes from its seed.
        """
        return self.reset_to_seed(jax.random.bits(on_cpu(key), (2,), jnp.uint32), params)

    def reset_to_seed(
        self, seed: int | jax.Array | NDArray[np.uint32], params: EnvParams | None = None
    ) -> tuple[jax.Array, AnyState]:
        """Return observation and state of a world as ``gymnasium.make_vec`` resets it to a seed.

        Parameters
        ----------
        seed
            A whole number from 0 to 2³² − 1, or the two halves of a longer one, the lower first,
            uint32 (2,).
        params
            What worlds share; ``default_params`` by default.

        Raises
        ------
        ParameterError
            If the seed is not of this kind, or ``params`` are of an environment with others.
        """
        words = seed_words(seed)
        episode = on_cpu(jnp.zeros(4, jnp.uint32).at[: words.size].set(words))
        world, episode, obs = _one(
            _reset, (self._empty, episode), Shared(*self._shared(params)[:2])
        )
        if self._view is None:
            return obs, EnvState(world, episode)
        obs, memory = self._look(self._view, self._blank, obs, pair_of(world), begins=True)
        return obs, AgentState(world, episode, memory)

    def step(
        self,
        key: jax.Array | None,
        state: AnyState,
        action: jax.Array,
        params: EnvParams | None = None,
    ) -> tuple[jax.Array, AnyState, jax.Array, jax.Array, jax.Array, Info]:
        """Advance a world by ``frame_skip`` control periods; a new episode follows one that ends.

        Parameters
        ----------
        key
            Unused: random numbers follow from the world's seed and episode count.
        state
            The world.
        action
            A number for each clutch; those outside of ``action_space`` are clipped. If one is not
            finite, the clutches get no voltage, and observation and reward are NaN.
        params
            What worlds share; ``default_params`` by default.

        Returns
        -------
        observation, state
            After a reset if the episode has ended.
        reward
            float32 (). With a base or a history, the rewards of the control steps are rounded one
            by one.
        terminated, truncated
            bool ().
        info
            ``terminated``, ``truncated``, ``is_success``, and ``final_observation``, which is from
            before such a reset.

        Raises
        ------
        ActionError
            If the action has another shape or type.
        ParameterError
            If state or params are of an environment of another kind. The numbers in a state cannot
            be checked: a damaged one returns NaN.
        """
        del key
        space = self.action_space()
        action = on_cpu(checked_action(action, (self.num_actions,)))
        self._check_state(state)
        state = on_cpu(state)
        known = jnp.isfinite(action).all()
        clipped = jnp.where(known, jnp.clip(action, space.low, space.high), space.low)
        state, obs, final, reward, flags = self._advance(state, clipped, self._shared(params))
        obs, final, reward = (jnp.where(known, each, jnp.nan) for each in (obs, final, reward))
        terminated, truncated, success = (flags[each] for each in FLAG)
        info = {
            "terminated": terminated,
            "truncated": truncated,
            "is_success": success,
            "final_observation": final,
        }
        return obs, state, reward, terminated, truncated, info

    def privileged(self, state: AnyState, params: EnvParams | None = None) -> jax.Array:
        """Return what no sensor shows of a world, float32 (len(env.privileged_layout),).

        It is in that layout's units and rounded toward zero; if an episode has just ended, it is
        that of the next one.

        Raises
        ------
        ParameterError
            If state or params are of an environment of another kind.
        """
        self._check_state(state)
        constants = rounded(on_cpu(self._shared(params).constants))
        entries = jnp.asarray(self.env.batch.privileged_entries, jnp.int32)
        return truth_of(on_cpu(state.world)[None], constants, entries)[0]

    def action_space(self, params: EnvParams | None = None) -> spaces.Box:  # noqa: ARG002  (as gymnax has it)
        """Return the action space, one of Gymnasium's."""
        return cast(spaces.Box, self.env.single_action_space)

    def observation_space(self, params: EnvParams | None = None) -> spaces.Box:  # noqa: ARG002
        """Return the observation space, one of Gymnasium's."""
        return cast(spaces.Box, self.env.single_observation_space)

    def _advance(self, state: AnyState, given: jax.Array, shared: EnvParams) -> Advanced:
        """Return what a step makes of a world."""
        if (view := self._view) is None:
            return self._control(state, given, shared)

        def control(before: Advanced, _: None) -> tuple[Advanced, None]:
            own = cast(AgentState, before[0])
            rows, memory = view.given(given[None], jax.tree.map(_one_row, own.memory))
            stepped, obs, last, reward, flags = self._control(own, rows[0], shared)
            over, world = _is_over(flags), stepped.world
            final, after = self._look(view, memory, last, pair_of(own.world), begins=False)
            first, begun = self._look(
                view, self._blank, obs, pair_of(world), begins=True, acts=over
            )
            new = jax.tree.map(partial(jnp.where, over), (first, begun), (final, after))
            state = AgentState(*stepped[:2], new[1])
            result = state, new[0], final, before[3] + reward, flags
            return jax.tree.map(partial(jnp.where, _is_over(before[4])), before, result), None

        unseen = jnp.zeros(len(self.observation_layout), jnp.float32)
        start = state, unseen, unseen, jnp.zeros((), jnp.float32), jnp.zeros(FLAGS, bool)
        return lax.scan(control, start, length=self.frame_skip)[0]

    def _control(self, state: AnyState, given: jax.Array, shared: EnvParams) -> Advanced:
        """Return what ``_advance`` does, after a step of the kernel."""
        empty = jnp.full(SLOTS - self.num_actions, self._no_volts, given.dtype)
        own = *state[:2], jnp.concatenate([given, empty])
        world, episode, obs, last, reward, flags = _one(self._step, own, Shared(*shared[:2]))
        return EnvState(world, episode), obs, last, reward, flags

    def _look(
        self,
        view: BoundView,
        memory: Memory[jax.Array, jax.Array],
        obs: jax.Array,
        pair: jax.Array,
        *,
        begins: bool,
        acts: jax.Array | bool = True,
    ) -> tuple[jax.Array, Memory[jax.Array, jax.Array]]:
        """Return what is seen after a look at a pair's world, and the memory, (1, …) before it.

        The base acts where it is true that it ``acts``; elsewhere the result is not used.
        """

        def act(obs: jax.Array, law: jax.Array) -> tuple[jax.Array, jax.Array]:
            base, law = self._law((obs, law, pair[None], jnp.array([acts])), self._law_params)
            return base, law

        after = view.after(memory, obs[None], jnp.array([begins]), act)
        return view.seen(after)[0], Memory(*(part[0] for part in after))

    def bind_base(self, machines: Sequence[Machine]) -> None:
        """Bind the law that actions correct to the machine of each pair that worlds draw."""
        assert self._view is not None
        assert self._view.base is not None
        layout = self._view.base.policy.layout
        laws = [cast("Controller", self.env.base).bind(each, layout).law for each in machines]
        rows = np.array([law.gains for law in laws if law is not None])
        self._law_params = self._law_params._replace(gains=words_of(rows))

    def _check_state(self, state: AnyState) -> None:
        """Raise a ParameterError unless a state is as large as this environment's."""
        expected = [(self._empty.shape, jnp.uint32), ((4,), jnp.uint32)]
        if self._view is not None:
            expected += [(part.shape[1:], part.dtype) for part in self._blank]
        parts = jax.tree.leaves(state)[: len(expected)]
        if [(jnp.shape(part), jnp.result_type(part)) for part in parts] != expected:
            raise ParameterError(
                "state must be one of this environment, of the shapes "
                f"{[shape for shape, _ in expected]}, got {shapes_of(state)}"
            )

    def _shared(self, params: EnvParams | None) -> EnvParams:
        """Return what worlds share, or raise a ParameterError if it is another environment's."""
        usual = self.default_params
        if params is None:
            return usual
        config, constants, kind = params
        fits = jnp.shape(config) == usual.config.shape and jnp.ndim(constants) == 1
        if not fits or {jnp.result_type(part) for part in params[:2]} != {jnp.dtype(jnp.uint32)}:
            raise ParameterError(
                "params must be EnvParams of an environment with these observations and actions, "
                f"of uint32 {usual.config.shape} and (K,), got {shapes_of(params)}"
            )
        if kind != usual.kind:
            raise ParameterError(
                f"params must be of machines and actions of this kind, {usual.kind}, got {kind}"
            )
        return params


def make(env_id: str = "PTER/PathFollowing-v0", **keywords: Any) -> tuple[JaxEnv, EnvParams]:
    """Return an environment of an id, and what its worlds share.

    Parameters
    ----------
    env_id
        An id of ``PTER``, as ``gymnasium.make`` takes it.
    **keywords
        As there: those of the scenario, and ``sensors``, ``action_unit``, ``observe_context``,
        ``frame_skip``, ``base``, ``reach``, ``history`` and ``max_episode_steps``.

    Raises
    ------
    ParameterError
        If an argument is out of range, or JAX has no CPU device.
    """
    env = JaxEnv.from_id(env_id, keywords)
    return env, env.default_params


def pair_of(world: jax.Array) -> jax.Array:
    """Return which of the pairs of machine and task is that of worlds (…, W), float32 (…,)."""
    at = rounded(world[..., 2 * CONTEXT_AT : 2 * CONTEXT_AT + 2])[..., 0]
    return jnp.round(at / CONTEXT_WIDTH)


def truth_of(world: jax.Array, constants: jax.Array, entries: jax.Array) -> jax.Array:
    """Return some rows of worlds and of their contexts, which follow these, float32 (N, entries).

    ``world`` holds the words of N worlds, and ``constants`` float32 (K,) what they share.
    """
    rows = world.shape[1] // 2
    own = jnp.minimum(entries, rows - 1)
    words = jnp.stack([world[:, 2 * own], world[:, 2 * own + 1]], axis=-1)
    state = rounded(words.reshape(len(world), -1))
    at = rounded(world[:, 2 * CONTEXT_AT : 2 * CONTEXT_AT + 2]).astype(jnp.int32)
    context = constants[at + jnp.maximum(entries - rows, 0)]
    return jnp.where(entries < rows, state, context)


def seed_words(seed: int | jax.Array | NDArray[np.uint32]) -> jax.Array:
    """Return a seed as words, uint32 () or (2,), or raise a ParameterError."""
    traced = isinstance(seed, Tracer)
    words = cast("jax.Array", seed if traced else np.asarray(seed))
    whole = jnp.issubdtype(words.dtype, jnp.integer) and words.shape in ((), (2,))
    if not whole or not (traced or ((words >= 0) & (words < 2**32)).all()):
        raise ParameterError(
            "seed must be a whole number within [0, 2³²), or two for the halves of a longer one, "
            f"got {seed!r:.200}"
        )
    return jnp.asarray(words.astype(np.uint32))


def checked_action(action: ArrayLike, shape: tuple[int, ...]) -> jax.Array:
    """Return an action as float32, or raise an ActionError if its shape or type is another."""
    try:
        numbers = jnp.asarray(action)
    except (TypeError, ValueError) as error:
        raise ActionError(f"action must be an array of numbers: {error}") from None
    real = jnp.issubdtype(numbers.dtype, jnp.floating) or jnp.issubdtype(numbers.dtype, jnp.integer)
    if numbers.shape != shape or not real:
        raise ActionError(
            f"action must be real numbers of the shape {shape}, got {numbers.dtype} {numbers.shape}"
        )
    return numbers.astype(jnp.float32)


def shapes_of(tree: object) -> str:
    """Return the shapes and types in a tree, for a message."""
    return f"{[(str(jnp.result_type(part)), jnp.shape(part)) for part in jax.tree.leaves(tree)]}"


class _Call(Protocol):
    """A function of a tuple of per-world arrays, worlds first, and what all worlds share."""

    def __call__(self, own: Arrays, shared: Any, /) -> Arrays: ...


def _many(run: _Call) -> _Call:
    """Return a function of many worlds whose ``vmap`` is itself, on more worlds.

    ``lax.cond`` maps what all worlds share too, in equal rows; where rows differ, observations and
    rewards are NaN.
    """
    call = custom_vmap(run)

    @call.def_vmap
    def _(
        size: int, mapped: tuple[Sequence[bool], Sequence[bool]], own: Arrays, shared: Any
    ) -> tuple[Arrays, Sequence[bool]]:
        repeated = [x if has else x[None] for x, has in zip(shared, mapped[1], strict=True)]
        same = jnp.array([(x == x[:1]).all() for x in repeated]).all()
        spread = (
            x if has_axis else jnp.broadcast_to(x, (size, *x.shape))
            for x, has_axis in zip(own, mapped[0], strict=True)
        )
        results = call(
            tuple(x.reshape(-1, *x.shape[2:]) for x in spread), shared._make(x[0] for x in repeated)
        )
        if any(mapped[1]):
            results = [
                jnp.where(same, x, jnp.nan) if x.dtype == jnp.float32 else x for x in results
            ]
        return tuple(x.reshape(size, -1, *x.shape[1:]) for x in results), (True,) * len(results)

    return call


def _is_over(flags: jax.Array) -> jax.Array:
    return flags[FLAG.terminated] | flags[FLAG.truncated]


def _one_row(x: jax.Array) -> jax.Array:
    return x[None]


def _one(call: _Call, own: Arrays, shared: Shared | LawParams) -> Arrays:
    """Return the results of one world."""
    return [x[0] for x in call(tuple(x[None] for x in own), shared)]


def _called(
    name: str, own: Arrays, shared: Shared, *further: jax.ShapeDtypeStruct, **options: Any
) -> Arrays:
    """Return worlds, episodes and observations after a call of the kernel, and further results."""
    entries = (shared.config.size - 2 * CONFIG_WIDTH) // 2
    state = [jax.ShapeDtypeStruct(x.shape, x.dtype) for x in own[:2]]
    obs = jax.ShapeDtypeStruct((len(own[0]), entries), jnp.float32)
    results = *state, obs, *(further and (obs, *further))
    return tuple(jax.ffi.ffi_call(name, results, **options)(*own, *shared))


@_many
def _reset(own: Arrays, shared: Shared) -> Arrays:
    return _called(RESET, own, shared)


@cache
def _stepping(name: str) -> _Call:
    """Return what steps worlds by the call of a name."""

    @_many
    def step(own: Arrays, shared: Shared) -> Arrays:
        rewards = jax.ShapeDtypeStruct((len(own[0]),), jnp.float32)
        flags = jax.ShapeDtypeStruct((len(own[0]), FLAGS), jnp.bool_)
        return _called(name, own, shared, rewards, flags, input_output_aliases={0: 0, 1: 1})

    return step


@cache
def _following(name: str) -> _Call:
    """Return what lets the law of a name act in worlds."""

    @_many
    def follow(own: Arrays, shared: LawParams) -> Arrays:
        obs, memory, rows, acts = own
        return call_law(name, obs, *shared, memory, rows, acts)

    return follow
