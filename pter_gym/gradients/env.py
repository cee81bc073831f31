# pyright: standard
"""The environment for ``jax.grad``: ``pter_gym.envs.jax`` with a rule for the derivative of a step.

A step has the same bits as ``JaxEnv``. Its derivative repeats the step: the arm by the compiled
kernels of ``pter_gym.gradients.jax``; the hand, the projection onto the path, reward and
observation as functions of JAX made from their source.
"""

from functools import partial
from typing import Any, Literal, NamedTuple, get_args

import numpy as np

from pter_gym._compiled.records import flat, load, store
from pter_gym._engine.command import clipped, given_volts, take_command
from pter_gym._engine.hand import move_hand, push_tip
from pter_gym._engine.judgement import judge_step, locate
from pter_gym._engine.motion import set_strengths
from pter_gym._engine.sensors import observe_world
from pter_gym._engine.world import BASIC_ROWS, CONFIG, CONSTANTS, FLAG, ROW, Config
from pter_gym._physics.clutch import PerClutch
from pter_gym._physics.open_loop import BODY, BODY_WIDTH
from pter_gym._physics.order import is_kick, is_whole, stage_count
from pter_gym.envs import jax as jax_env
from pter_gym.errors import ParameterError, unknown_name
from pter_gym.gradients._branchless import Column, Stage, branchless
from pter_gym.gradients._machine import kind_of
from pter_gym.gradients.jax import MEANING, first_order, floats_of, jax, jnp, lax, rolling
from pter_gym.paths._projection import foot_on, neighbour, project, segment_at
from pter_gym.tasks.path_following._observation import BOUND

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


EpisodeEnd = Literal["raise", "constant"]
"""What to do with a derivative that would pass through the end of an episode, a jump."""


class DifferentiableEnv(jax_env.JaxEnv):
    """A ``JaxEnv`` whose ``step`` has a derivative; make one with ``make``.

    Observation, reward and next state are differentiated by the action and the state. ``params``
    counts as constant; ``step`` takes its constants alone.
    """

    def __init__(self, env: Any, episode_end: EpisodeEnd) -> None:
        if episode_end not in get_args(EpisodeEnd):
            raise unknown_name("episode_end", episode_end, get_args(EpisodeEnd))
        if env.base is not None:
            raise ParameterError("base must be None for a step to be differentiated")
        if env.history:
            raise ParameterError("history must be () for a step to be differentiated")
        if not env.batch.machine.has_paper_clutches:
            raise ParameterError(
                "machine must have the paper's clutches for a step to be differentiated"
            )
        if env.batch.kernel_arrays()["worlds"].shape[1] != BASIC_ROWS:
            raise ParameterError(
                "hand must be a push and sines, and sensing ideal, for a step to be "
                "differentiated: not a recorded hand, one with an intent, or noise and delay"
            )
        if env.observation_layout.names[-1].startswith(("torque", "force")):
            raise ParameterError('sensors must be "encoders" for a step to be differentiated')
        super().__init__(env)
        config = np.asarray(self.default_params.config).view(np.float64)
        loaded = load(config[:, None], CONFIG, 0)
        roll = rolling(loaded.substep, **kind_of(*(machine for machine, _ in env.batch.pairs)))
        follow = _following(loaded, self.frame_skip, roll)
        self._advance_one = _advancing(super()._advance, follow, loaded, episode_end)

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
        shared = jax_env.EnvParams(self.default_params.config, shared.constants)
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
        it. With ``"constant"``, state, observations and reward after such a step count as constant.

    Raises
    ------
    ParameterError
        As there, and if machine, hand or sensors are such that a step has no derivative here.
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


def _following(config: Config, frame_skip: int, roll: Stage) -> Stage:
    """Return the function of JAX whose derivative is that of a step.

    From a world's numbers, an action and the constants, it returns the numbers, the observation and
    the reward that a step leads to where the episode goes on.
    """
    count = int(config.substeps)
    period = config.substep * count

    def move(w: Column) -> None:
        """Move the arm by a control step."""
        force = []
        for stage in range(stage_count(count)):
            if is_kick(stage):
                force.append(jnp.stack(load(w, ROW.force, 0)))
            else:
                _twin(move_hand)(w, 0, config.substep, is_whole(stage, count), False)
                _twin(push_tip)(w, 0, False)
        body = Column({})
        for name in ("machine", "motion", "torques", "lagged_volts", "strength"):
            store(body, getattr(BODY, name), 0, load(w, getattr(ROW, name), 0))
        column = jnp.stack(
            [jnp.asarray(body.rows.get(row, 0.0), float) for row in range(BODY_WIDTH)]
        )
        volts, push = jnp.stack(load(w, ROW.command, 0)), jnp.stack(force)
        states = roll(column, volts[None], push[None], jnp.zeros_like(push)[None])
        state = jnp.unstack(states[1])
        after = Column(dict(enumerate(state, int(BODY.motion.theta_a))))
        for name in ("motion", "torques", "lagged_volts"):
            store(w, getattr(ROW, name), 0, load(after, getattr(BODY, name), 0))

    def follow(
        numbers: jax.Array, action: jax.Array, constants: _Words
    ) -> tuple[jax.Array, jax.Array, jax.Array]:
        context = jnp.unstack(
            constants.part(_whole(numbers[ROW.context_at]), CONSTANTS.end - CONSTANTS.first)
        )

        def world(numbers: jax.Array) -> Column:
            w = Column({}, given=lambda _: 0.0)
            w.rows |= enumerate(jnp.unstack(numbers))
            w.rows |= enumerate(context, CONSTANTS.first)
            return w

        def hold(numbers: jax.Array, _: None) -> tuple[jax.Array, jax.Array]:
            w = world(numbers)
            most = w[ROW.machine.voltage_max, 0]
            _twin(take_command)(
                w, 0, _twin(given_volts)(action[None], 0, config.low, config.high, most)
            )
            _twin(set_strengths)(w, 0, period)
            move(w)
            _twin(locate)(w, 0, constants)
            _twin(judge_step)(w, 0, period, config.max_steps)
            return jnp.stack(
                [jnp.asarray(w[row, 0], numbers.dtype) for row in range(BASIC_ROWS)]
            ), w[ROW.reward, 0]

        numbers, earned = lax.scan(hold, numbers, length=frame_skip)
        w = world(numbers)
        _twin(observe_world)(w, 0)
        obs = jnp.stack(flat(load(w, ROW.seen, 0))) * jnp.stack(flat(config.inverse_scale))
        obs = jnp.clip(obs, -BOUND, BOUND)[: int(config.entries)]
        return numbers, obs.astype(jnp.float32), earned.sum().astype(jnp.float32)

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


def _advancing(advance: Stage, follow: Stage, config: Config, episode_end: EpisodeEnd) -> Stage:
    """Return a step as a function of a world's numbers, an action, its state and shared data."""

    @first_order
    def run(numbers: jax.Array, action: jax.Array, state: Any, shared: jax_env.EnvParams) -> Any:
        del numbers
        (world, episode), *rest = advance(state, action, shared)
        return DifferentiableEnvState(world, episode, floats_of(world)), *rest

    def keep(numbers: jax.Array, action: jax.Array, state: Any, shared: jax_env.EnvParams) -> Any:
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
        by_found = by_state.numbers, by_obs[: int(config.entries)], by_reward
        return *map(unless_over, back(tuple(map(unless_over, by_found)))), None, None

    step = jax.custom_vjp(run)
    step.defvjp(keep, pull)
    return step
