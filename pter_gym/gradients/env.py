# pyright: standard
"""The environment for ``jax.grad``: ``pter_gym.envs.jax`` with a rule for the derivative of a step.

A step has the same bits as ``JaxEnv``. Its derivative repeats the step: the arm by the compiled
kernels of ``pter_gym.gradients.jax``; the hand, the projection onto the path, reward and
observation as functions of JAX made from their source.
"""

from collections.abc import Sequence
from dataclasses import fields
from functools import partial
from typing import Any, Literal, NamedTuple, get_args

import numpy as np

from pter_gym._compiled.records import flat, leaves, load, store
from pter_gym._engine.command import clipped, given_volts, take_command
from pter_gym._engine.hand import move_hand, push_tip
from pter_gym._engine.judgement import judge_step, locate
from pter_gym._engine.motion import set_clutches
from pter_gym._engine.sensors import observe_world, scale_entries
from pter_gym._engine.world import BASIC_ROWS, CONFIG, CONSTANTS, EXTRAS, FLAG, KEPT, ROW, World
from pter_gym._physics.clutch import PerClutch
from pter_gym._physics.open_loop import BODY, BODY_WIDTH
from pter_gym._physics.order import is_kick, is_whole, stage_count
from pter_gym.envs import jax as jax_env
from pter_gym.errors import ParameterError, unknown_name
from pter_gym.gradients._branchless import Column, Stage, branchless
from pter_gym.gradients._machine import require_derivatives
from pter_gym.gradients.jax import MEANING, first_order, floats_of, jax, jnp, lax, rolling
from pter_gym.paths._projection import foot_on, neighbour, project, segment_at

__all__ = ["DifferentiableEnv", "DifferentiableEnvState", "make"]


class DifferentiableEnvState(NamedTuple):
    """A world, and the numbers that carry its derivatives from step to step.

    Attributes
    ----------
    world, episode
        Those of ``pter_gym.envs.jax.EnvState``.
    numbers
        ``world`` as floating-point numbers (52,): angles, velocities, torques and so on,
        in the order of ``pter_gym._engine.world.World``. A step does not read them.
    """

    world: jax.Array
    episode: jax.Array
    numbers: jax.Array


CARRIED = "frame_skip", "action_unit"
"""Fields of a view that a step to be differentiated follows."""

EpisodeEnd = Literal["raise", "constant"]
"""What to do with a derivative that would pass through the end of an episode, a jump."""


class DifferentiableEnv(jax_env.JaxEnv):
    """A ``JaxEnv`` whose ``step`` has a derivative; make one with ``make``.

    Observation, reward and next state are differentiable with respect to the action and the state.
    ``params`` is constant, and ``step`` uses only its ``constants``.
    """

    def __init__(self, env: Any, episode_end: EpisodeEnd) -> None:
        if episode_end not in get_args(EpisodeEnd):
            raise unknown_name("episode_end", episode_end, get_args(EpisodeEnd))
        if others := [
            field.name
            for field in fields(env.view)
            if field.name not in CARRIED and getattr(env.view, field.name) != field.default
        ]:
            raise ParameterError(
                f"{', '.join(others)} must not be given for a step to be differentiated"
            )
        if not env.batch.machine.has_paper_clutches:
            raise ParameterError(
                "machine must have the paper's clutches for a step to be differentiated"
            )
        require_derivatives(*(machine for machine, _ in env.batch.pairs))
        if env.batch.kernel_arrays()["worlds"].shape[1] != BASIC_ROWS:
            raise ParameterError(
                "hand must be a push and sines, and sensing ideal, for a step to be "
                "differentiated: not a recorded hand, one with an intent, or noise and delay"
            )
        if env.observation_layout.names[-1].startswith(("torque", "force")):
            raise ParameterError('sensors must be "encoders" for a step to be differentiated')
        super().__init__(env)
        config: Any = np.asarray(self.default_params.config).view(np.float64)
        follow = _following(config, self.frame_skip)
        _, state = self.reset_to_seed(0)
        words = _Words(self.default_params.constants)
        jax.eval_shape(partial(follow, constants=words), state.numbers, jnp.zeros(4))
        self._advance_one = _advancing(
            super()._advance, follow, int(config[CONFIG.entries]), episode_end
        )

    def reset_to_seed(self, seed: Any, params: Any = None) -> tuple[jax.Array, Any]:
        """Return what ``JaxEnv.reset_to_seed`` does, and the world's numbers."""
        obs, state = super().reset_to_seed(seed, params)
        world, episode = state[:2]
        return obs, DifferentiableEnvState(world, episode, floats_of(world))

    def step(self, key: Any, state: Any, action: Any, params: Any = None) -> Any:
        """Advance a world as ``JaxEnv.step`` does.

        Raises
        ------
        ParameterError
            If the action is not of floating-point numbers, or the state is not a
            ``DifferentiableEnvState``.
        """
        kind = jnp.result_type(action)
        if not jnp.issubdtype(kind, jnp.floating):
            raise ParameterError(
                f"action must be floating-point numbers, which have derivatives, got {kind}"
            )
        if not isinstance(state, DifferentiableEnvState):
            raise ParameterError(
                f"state must be from reset or step of this environment, got {type(state).__name__}"
            )
        door_state: Any = state
        return super().step(key, door_state, action, params)

    def _advance(self, state: Any, given: jax.Array, shared: Any) -> Any:
        shared = jax_env.Shared(self.default_params.config, shared.constants)
        state, obs, final, reward, flags = self._advance_one(
            state.numbers, given, state[:2], shared
        )
        over = flags[FLAG.terminated] | flags[FLAG.truncated]
        return state, obs, jnp.where(over, final, obs), reward, flags


def make(
    env_id: str = "PTER/PathFollowing-v0", *, episode_end: EpisodeEnd = "raise", **keywords: Any
) -> tuple[DifferentiableEnv, Any]:
    """Return a differentiable environment of an id, and what its worlds share.

    Parameters
    ----------
    env_id, **keywords
        As ``pter_gym.envs.jax.make`` takes them; ``sensors`` is ``"encoders"`` by default.
    episode_end
        A derivative that would pass through a step in which an episode ends raises an error: a
        ``ParameterError``, or within ``jit``, ``vmap`` and ``scan`` the error of JAX that quotes
        it. With ``"constant"``, state, observations and reward after such a step are treated as
        constant.

    Raises
    ------
    ParameterError
        As there, and if a step has no derivative with this machine, hand or sensors.
    """
    keywords = {"sensors": "encoders", **keywords}
    env = DifferentiableEnv.from_id(env_id, keywords, episode_end=episode_end)
    return env, env.default_params


_whole = MEANING["int"]


def _project(constants: Any, first: Any, count: Any, segment: Any, x: Any, y: Any) -> Any:
    """Return a point's projection onto a chain of arcs; the walk to its arc has no derivative."""

    def turn(segment: Any, direction: jax.Array | int) -> jax.Array:
        arc = segment_at(constants, first, segment)
        s = _twin(foot_on)(arc, segment, *lax.stop_gradient((x, y))).arc_length
        return _twin(neighbour)(arc, segment, count, s, direction)

    def walk(at: tuple[jax.Array, jax.Array]) -> tuple[jax.Array, jax.Array]:
        return at[0] + at[1], turn(at[0] + at[1], at[1])

    segment, _ = lax.while_loop(lambda at: at[1] != 0, walk, (segment, turn(segment, 0)))
    return _twin(foot_on)(segment_at(constants, first, segment), segment, x, y)


def _clipped(volts: PerClutch, most: jax.Array) -> PerClutch:
    return volts._make(jnp.clip(each, 0.0, most) for each in volts)


_MADE: dict[Any, Stage] = {clipped: _clipped, getattr(project, "py_func", project): _project}
_twin = partial(branchless, meaning=MEANING, cache=_MADE)
"""Returns the twin of a function of the simulator, made once."""


class _Words:
    """Words as an array of numbers, of which few are looked at."""

    def __init__(self, words: jax.Array) -> None:
        self.words = words

    def __getitem__(self, first: jax.Array) -> jax.Array:
        return self.part(first, 1)[0]

    def part(self, first: jax.Array, count: int) -> jax.Array:
        return floats_of(lax.dynamic_slice_in_dim(self.words, 2 * first, 2 * count))


NAMES = [leaf.name for leaf in leaves(World)]
"""Names of the rows of a world."""

UNKNOWN = flat(ROW.torque)
"""Rows of what a step finds beside the motion, which this room does not compute."""


class _Unknown:
    """A number that has no derivative here: it may be read and stored, but not used."""

    def __init__(self, row: int) -> None:
        self.row = row

    def __jax_array__(self, *_: object) -> jax.Array:
        raise ParameterError(
            f"{NAMES[self.row]} must not be used by a step to be differentiated: "
            "pter_gym.gradients.env does not compute it"
        )

    __add__ = __radd__ = __sub__ = __rsub__ = __mul__ = __rmul__ = __jax_array__
    __lt__ = __le__ = __gt__ = __ge__ = __neg__ = __abs__ = __jax_array__


class _World(Column):
    """A world of which every number has a derivative, is 0, or is unknown."""

    def __init__(self, numbers: jax.Array, context: Sequence[jax.Array]) -> None:
        super().__init__({}, lambda row: 0.0 if EXTRAS.first <= row < EXTRAS.end else _Unknown(row))
        self.rows |= enumerate(jnp.unstack(numbers))
        self.rows |= enumerate(context, CONSTANTS.first)
        for row in UNKNOWN:
            del self.rows[row]
        self.read, self.written = set[int](), set[int]()

    def __getitem__(self, place: tuple[Any, Any]) -> Any:
        self.read.add(place[0])
        return super().__getitem__(place)

    def __setitem__(self, place: tuple[Any, Any], value: Any) -> None:
        self.written.add(place[0])
        super().__setitem__(place, value)

    def kept(self, numbers: jax.Array) -> jax.Array:
        """Return the numbers that it keeps from the step, or raise if it kept old ones."""
        for row in (self.read - self.written).intersection(range(*KEPT)).difference(UNKNOWN):
            _Unknown(row).__jax_array__()
        rows = (numbers[k] if k in UNKNOWN else self.rows[k] for k in range(BASIC_ROWS))
        return jnp.stack([jnp.asarray(each, numbers.dtype) for each in rows])


def _following(config: Any, frame_skip: int) -> Stage:
    """Return the function of JAX whose derivative is that of a step.

    From a world's numbers, an action and the constants, it returns the numbers, the observation and
    the reward that a step leads to where the episode goes on. What a stage uses and this room does
    not compute raises a ParameterError.
    """
    shared = load(config[:, None], CONFIG, 0)
    count, entries = int(shared.substeps), int(shared.entries)
    period = shared.substep * count
    roll = rolling(True, shared.substep)

    def move(w: Column) -> None:
        """Move the arm by a control step."""
        force = []
        for stage in range(stage_count(count)):
            if is_kick(stage):
                force.append(jnp.stack(load(w, ROW.force, 0)))
            else:
                _twin(move_hand)(w, 0, shared.substep, is_whole(stage, count), False)
                _twin(push_tip)(w, 0, False)
        body = Column({})
        for name in ("machine", "motion", "torques", "lagged_volts", "strength"):
            store(body, getattr(BODY, name), 0, load(w, getattr(ROW, name), 0))
        column = jnp.stack(
            [jnp.asarray(body.rows.get(row, 0.0), float) for row in range(BODY_WIDTH)]
        )
        volts, push = jnp.stack(load(w, ROW.volts, 0)), jnp.stack(force)
        states = roll(column, volts[None], push[None], jnp.zeros_like(push)[None])
        state = jnp.unstack(states[1])
        after = Column(dict(enumerate(state, int(BODY.motion.theta_a))))
        for name in ("motion", "torques", "lagged_volts"):
            store(w, getattr(ROW, name), 0, load(after, getattr(BODY, name), 0))

    def observe(w: Column) -> jax.Array:
        """Return the observation of encoders."""
        _twin(observe_world)(w, 0)
        seen = flat(ROW.seen)
        for row in seen[entries:]:  # of other sensors
            w[row, 0] = 0.0
        _twin(scale_entries)(w, 0, 1, config)
        return jnp.stack([w[row, 0] for row in seen[:entries]]).astype(jnp.float32)

    def follow(
        numbers: jax.Array, action: jax.Array, constants: _Words
    ) -> tuple[jax.Array, jax.Array, jax.Array]:
        first = _whole(numbers[ROW.context_at])
        context = jnp.unstack(constants.part(first, CONSTANTS.end - CONSTANTS.first))

        def hold(numbers: jax.Array, _: None) -> tuple[jax.Array, tuple[jax.Array, jax.Array]]:
            w = _World(numbers, context)
            most = w[ROW.machine.voltage_max, 0]
            given = _twin(given_volts)(action[None], 0, shared.low, shared.high, most)
            _twin(take_command)(w, 0, given)
            _twin(set_clutches)(w, 0, period)
            move(w)
            _twin(locate)(w, 0, constants)
            _twin(judge_step)(w, 0, period, shared.max_steps)
            obs, earned = observe(w), w[ROW.reward, 0]
            return w.kept(numbers), (obs, earned)

        numbers, (obs, earned) = lax.scan(hold, numbers, length=frame_skip)
        return numbers, obs[-1], earned.sum().astype(jnp.float32)

    return follow


def _refuse() -> None:
    raise ParameterError(
        "gradient must not pass through the end of an episode, where there is a jump: take fewer "
        "steps, apply jax.lax.stop_gradient where an episode ends, or make the environment with "
        'episode_end="constant"'
    )


@jax.custom_batching.custom_vmap
def _zero_unless(passes: jax.Array) -> jax.Array:
    """Return zero, or raise an error if a derivative passes through the end of an episode."""
    zero = np.float32(0.0)
    return lax.cond(passes, lambda: jax.pure_callback(_refuse, zero), lambda: zero)


@_zero_unless.def_vmap
def _(size: int, _: list[bool], passes: jax.Array) -> tuple[jax.Array, bool]:
    zero = _zero_unless(passes.any())
    return jnp.broadcast_to(zero, size), True


def _advancing(advance: Stage, follow: Stage, entries: int, episode_end: EpisodeEnd) -> Stage:
    """Return a step as a function of a world's numbers, an action, its state and shared data."""

    @first_order
    def run(numbers: jax.Array, action: jax.Array, state: Any, shared: jax_env.Shared) -> Any:
        del numbers
        (world, episode), *rest = advance(state, action, shared)
        return DifferentiableEnvState(world, episode, floats_of(world)), *rest

    def keep(numbers: jax.Array, action: jax.Array, state: Any, shared: jax_env.Shared) -> Any:
        result = run(numbers, action, state, shared)
        flags = result[-1]
        return result, (
            numbers,
            action,
            shared.constants,
            flags[FLAG.terminated] | flags[FLAG.truncated],
        )

    def pull(residuals: Any, by: Any) -> Any:
        *inputs, constants, over = residuals
        by_state, by_obs, by_final, by_reward, _ = by
        zero = np.float32(0.0)
        if episode_end == "raise":
            ends = by_state.numbers, by_obs, by_final, by_reward
            passes = over & jnp.any(jnp.concatenate([jnp.ravel(entry) != 0.0 for entry in ends]))
            if isinstance(passes, jax_env.Tracer):
                zero = _zero_unless(passes)
            elif passes:
                _refuse()

        def unless_over(entry: jax.Array) -> jax.Array:
            return jnp.where(over, zero, entry)

        def near(numbers: jax.Array, action: jax.Array) -> tuple[jax.Array, jax.Array, jax.Array]:
            return follow(numbers, action, _Words(constants))

        back = jax.vjp(near, *inputs)[1]
        by_found = by_state.numbers, by_obs[:entries], by_reward
        return *map(unless_over, back(tuple(map(unless_over, by_found)))), None, None

    step = jax.custom_vjp(run)
    step.defvjp(keep, pull)
    return step
