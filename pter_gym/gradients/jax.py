# pyright: standard
"""Rollouts for ``jax.grad``: the compiled kernels as XLA calls with a custom gradient."""

import math
from collections.abc import Callable
from functools import cache, partial, reduce
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from pter_gym.errors import ParameterError, needs_extra

try:
    import jax
    from jax import lax, numpy as jnp

    from pter_gym._engine import xla as _xla
    from pter_gym._engine.xla import cpu_device, on_cpu, rounded, words_of
except ImportError as error:
    raise ImportError(str(needs_extra("pter_gym.gradients.jax", "jax"))) from error

from pter_gym._compiled.addresses import caller, export
from pter_gym._compiled.compiler import compiled
from pter_gym._compiled.records import flat
from pter_gym._physics.model import arrangement_of, model_of
from pter_gym._physics.open_loop import BODY, BODY_WIDTH, Array, State
from pter_gym.gradients._adjoint import BACKWARD_TYPES, FIRST, FORWARD_TYPES, LAST, kernels
from pter_gym.gradients._branchless import Stage, branchless
from pter_gym.gradients._machine import divided, with_any_numbers
from pter_gym.gradients._rollout import STATE, tip_motion
from pter_gym.params import Machine
from pter_gym.params._spread import numbers_of

__all__ = ["JaxMotion", "make_rollout"]

_double_rows = _xla._double_rows

STRENGTH = slice(BODY.strength.x1, BODY.strength.x4 + 1)
"""Rows of what heat leaves of the torques."""


def _divide(x: jax.Array, y: jax.Array) -> jax.Array:
    """Return x/y, finite in a branch that is not taken, as its derivative has to be."""
    return x / jnp.where(y == 0.0, 1.0, y)


def _chosen(condition: Any, x: Any, y: Any) -> Any:
    """Return one of two numbers or records."""
    if isinstance(condition, bool):
        return x if condition else y
    return jax.tree.map(partial(jnp.where, condition), x, y)


def _whole(x: ArrayLike) -> jax.Array:
    return jnp.asarray(x).astype(jnp.int32)


def _root(x: jax.Array) -> jax.Array:
    """Return √x, at 0 with the derivative 0."""
    return jnp.where(x == 0.0, 0.0, jnp.sqrt(jnp.where(x == 0.0, 1.0, x)))


def _least(*given: jax.Array) -> jax.Array:
    """Return the least number, with the derivative of the first of equal ones."""
    return reduce(lambda least, each: jnp.where(each < least, each, least), given)


MEANING: dict[str, Any] = {
    "_where": _chosen,
    "_not": jnp.logical_not,
    "_divide": _divide,
    "abs": jnp.abs,
    "min": _least,
    "int": _whole,
    "math": SimpleNamespace(exp=jnp.exp, hypot=jnp.hypot, sqrt=_root, atan2=jnp.arctan2),
}
"""What functions of the simulator need to be functions of JAX; see ``branchless``."""


def first_order(function: Stage) -> Stage:
    """Return a function that raises a ParameterError where it is differentiated itself."""
    once = jax.custom_jvp(function)

    def refuse(*_: Any) -> Any:
        raise ParameterError(
            "derivatives must be of first order, in reverse mode (jax.grad, jax.vjp, jax.jacrev)"
        )

    once.defjvp(refuse)
    return once


class JaxMotion(NamedTuple):
    """The attributes of ``Rollout``, at N + 1 control instants, as JAX arrays."""

    theta: jax.Array
    omega: jax.Array
    torque_breakaway: jax.Array
    torque_dynamic: jax.Array
    lagged_volts: jax.Array
    tip_position: jax.Array
    tip_velocity: jax.Array


def make_rollout(
    machine: Machine | str | None = None, period: float = 0.01
) -> Callable[..., JaxMotion]:
    """Return ``rollout`` of a machine as a JAX function, for ``grad``, ``jit`` and ``vmap``.

    Parameters
    ----------
    machine
        The machine or its name, None for the default PTER.
    period
        Length of a control step [s].

    Returns
    -------
    Callable
        ``rollout(state, volts, hand_force, hand_target=(0.0, 0.0), numbers=None)`` takes a
        ``State`` or a dict of its fields, and what ``rollout`` takes; voltages out of range are
        clipped. ``numbers`` replaces parameters of the machine by name, such as
        ``{"clutch.time_constant": 0.1}``. It returns a ``JaxMotion``.

    Raises
    ------
    ParameterError
        If JAX has no CPU device, an argument is out of range, or in the call a
        shape is wrong or an array is not of numbers.
    """
    cpu_device()
    machine, substeps = divided(machine, period)
    defaults = {place: number.value for place, number in numbers_of(machine).items()}
    del defaults["substep"]
    fixed = jnp.asarray(on_cpu(np.array(flat(arrangement_of(machine)))))
    to_model = branchless(model_of, MEANING, {})
    roll = rolling(machine.has_paper_clutches, machine.substep)

    def rollout(
        state: State | dict[str, Any],
        volts: Any,
        hand_force: ArrayLike,
        hand_target: ArrayLike = (0.0, 0.0),
        numbers: dict[str, ArrayLike] | None = None,
    ) -> JaxMotion:
        fields = vars(state) if isinstance(state, State) else state
        at = {
            name: _floats(f"state.{name}", fields[name], (end - begin,))
            for name, (begin, end) in STATE.items()
        }
        volts = jnp.clip(_floats("volts", volts, (len(volts), 4)), 0.0, machine.clutch.voltage_max)
        shape = len(volts), substeps, 2
        force, target = (
            _spread("hand_force", hand_force, shape),
            _spread("hand_target", hand_target, shape),
        )
        unknown = set(numbers or {}) - set(defaults)
        if unknown:
            raise ParameterError(
                f"numbers must be among {', '.join(defaults)}, got {', '.join(sorted(unknown))}"
            )
        values = defaults | {
            place: _floats(place, each, ()) for place, each in (numbers or {}).items()
        }
        model = to_model(with_any_numbers(machine, values.get))
        a, b = at["theta"]
        units = jnp.stack([jnp.cos(a), jnp.sin(a), jnp.cos(b), jnp.sin(b)])
        motion = jnp.concatenate([at["theta"], at["omega"], units])
        limits = [at[name] for name in ("torque_breakaway", "torque_dynamic", "lagged_volts")]
        body = jnp.zeros(BODY_WIDTH).at[FIRST:LAST].set(jnp.concatenate([motion, *limits]))
        body = (
            body.at[:FIRST].set(jnp.stack([*map(jnp.asarray, flat(model))])).at[STRENGTH].set(1.0)
        )
        states = roll(body.at[BODY.arrangement.a.x1 :].set(fixed), volts, force, target)
        return _motion(states, model.arm)

    return rollout


def _motion(states: jax.Array, arm: Any) -> JaxMotion:
    position, velocity = tip_motion(states, arm, jnp)
    return JaxMotion(
        **{name: states[:, begin:end] for name, (begin, end) in STATE.items()},
        tip_position=position,
        tip_velocity=velocity,
    )


def _floats(name: str, values: ArrayLike, shape: tuple[int, ...]) -> jax.Array:
    array = jnp.asarray(values)
    if array.dtype.kind not in "fiu":
        raise ParameterError(f"{name} must be an array of numbers, got {array.dtype}")
    if array.shape != shape:
        raise ParameterError(f"{name} must have the shape {shape}, got {array.shape}")
    return array.astype(jnp.result_type(float))


def _spread(name: str, values: ArrayLike, shape: tuple[int, int, int]) -> jax.Array:
    found = np.shape(values)
    accepted = (shape[-1:], shape[::2], shape)
    if found not in accepted:
        raise ParameterError(f"{name} must have a shape among {accepted}, got {found}")
    array = _floats(name, values, found)
    return jnp.broadcast_to(array[:, None] if array.ndim == 2 else array, shape)


def rolling(has_paper_clutches: bool, substep: float) -> Stage:
    """Return a function of body, voltages, forces and targets: states at control instants."""
    names = {name: _registered(name, has_paper_clutches) for name in ("forward", "backward")}
    h = words_of(np.array([substep]))

    def call(
        name: str, shapes: tuple[tuple[int, ...], ...], arguments: tuple[jax.Array, ...]
    ) -> tuple[jax.Array, ...]:
        results = tuple(
            jax.ShapeDtypeStruct((2 * math.prod(shape),), jnp.uint32) for shape in shapes
        )
        buffers = jax.ffi.ffi_call(names[name], results, vmap_method="broadcast_all")(
            h, *map(_words, arguments)
        )
        return tuple(
            floats_of(words).reshape(shape) for words, shape in zip(buffers, shapes, strict=True)
        )

    @first_order
    def run(body: jax.Array, volts: jax.Array, force: jax.Array, target: jax.Array) -> jax.Array:
        return call("forward", ((len(volts) + 1, LAST - FIRST),), (body, volts, force, target))[0]

    @first_order
    def back(*arguments: jax.Array) -> tuple[jax.Array, ...]:
        return call("backward", tuple(each.shape for each in arguments[:4]), arguments)

    roll = jax.custom_vjp(run)

    def keep(*arguments: jax.Array) -> tuple[jax.Array, tuple[jax.Array, ...]]:
        states = run(*arguments)
        return states, (*arguments, states)

    def pull(residuals: tuple[jax.Array, ...], by_states: jax.Array) -> tuple[jax.Array, ...]:
        return back(*residuals, by_states)

    roll.defvjp(keep, pull)
    return roll


def _words(numbers: jax.Array) -> jax.Array:
    """Return numbers of 32 or 64 bits as words of those of 64."""
    flat_numbers = numbers.reshape(-1)
    bits = lax.bitcast_convert_type(flat_numbers, jnp.uint32)
    if flat_numbers.dtype == jnp.float64:
        return bits.reshape(-1)
    exponent = (bits >> 23) & 0xFF
    wider = jnp.where(exponent == 0, 0, jnp.where(exponent == 0xFF, 0x7FF, exponent + (1023 - 127)))
    low, high = bits << 29, (bits >> 31) << 31 | wider << 20 | (bits & 0x7FFFFF) >> 3
    return jnp.where(exponent[:, None] == 0, 0, jnp.stack([low, high], axis=1)).reshape(-1)


def floats_of(words: jax.Array) -> jax.Array:
    """Return words as numbers of the width that JAX is set to."""
    if jnp.result_type(float) == jnp.float64:
        return lax.bitcast_convert_type(words.reshape(-1, 2), jnp.float64)
    return rounded(words)


@cache
def _registered(name: str, has_paper_clutches: bool) -> str:
    """Register the call ``forward`` or ``backward``, once; return its name in XLA."""
    forward, backward = kernels(has_paper_clutches=has_paper_clutches)
    called = f"pter_rollout_{name}_{'paper' if has_paper_clutches else 'declared'}"
    kernel, signature, handler = {
        "forward": (forward, FORWARD_TYPES, _forward_handler),
        "backward": (backward, BACKWARD_TYPES, _backward_handler),
    }[name]
    export(kernel, signature, symbol := f"{called}_kernel")
    _xla.register(called, handler(caller(signature, symbol)))
    return called


@compiled
def _rollout(buffers: int, first: int, i: int) -> tuple[Array, Array, Array, Array]:
    """Return body, voltages, forces and targets of rollout ``i``, in buffers from ``first`` on."""
    body, volts = _double_rows(buffers, first)[i], _double_rows(buffers, first + 1)[i]
    force, target = _double_rows(buffers, first + 2)[i], _double_rows(buffers, first + 3)[i]
    steps = len(volts) // 4
    acting = steps, len(force) // (2 * steps), 2
    return (
        body.reshape((BODY_WIDTH, 1)),
        volts.reshape((steps, 4)),
        force.reshape(acting),
        target.reshape(acting),
    )


@compiled
def _states(buffers: int, number: int, i: int) -> Array:
    """Return the states of rollout ``i`` at the control instants."""
    states = _double_rows(buffers, number)[i]
    return states.reshape((len(states) // (LAST - FIRST), LAST - FIRST))


def _forward_handler(forward: Stage) -> Stage:
    """Return what simulates.

    Its arguments are the substep, bodies, voltages, forces and targets; its result states.
    """

    @compiled
    def handler(arguments: int, results: int) -> None:
        h = _double_rows(arguments, 0)[0, 0]
        for i in range(len(_double_rows(arguments, 1))):
            forward((*_rollout(arguments, 1, i), h, _states(results, 0, i)))

    return handler


def _backward_handler(backward: Stage) -> Stage:
    """Return what pulls adjoints back.

    Its arguments are those of the other call, the states, and their adjoints; its results are the
    adjoints of all of them but the substep.
    """

    @compiled
    def handler(arguments: int, results: int) -> None:
        h = _double_rows(arguments, 0)[0, 0]
        for i in range(len(_double_rows(arguments, 1))):
            by_body, by_volts, by_force, by_target = _rollout(results, 0, i)
            states, by_states = _states(arguments, 5, i), _states(arguments, 6, i)
            outputs = by_volts, by_force, by_target, by_body
            backward((*_rollout(arguments, 1, i), h, states, by_states, *outputs))

    return handler
