"""Rollouts for ``jax.grad``: the compiled kernels as XLA calls with a custom gradient."""

import math
from collections.abc import Callable
from functools import cache, partial, reduce
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

from pter_gym.errors import ParameterError, needs_extra

try:
    import jax
    from jax import lax
    from jax import numpy as _numpy
    from jax.custom_batching import custom_vmap as _custom_vmap

    from pter_gym._engine import xla as _xla
    from pter_gym._engine.xla import rounded, words_of
    from pter_gym.envs import jax as _door
except ImportError as error:
    raise ImportError(str(needs_extra("pter_gym.gradients.jax", "jax"))) from error

from pter_gym._compiled.compiler import compile_kernel
from pter_gym._compiled.records import flat
from pter_gym._physics.model import arrangement_of, model_of
from pter_gym._physics.open_loop import BODY, BODY_WIDTH, State
from pter_gym.gradients._adjoint import FIRST, LAST, kernels
from pter_gym.gradients._branchless import branchless
from pter_gym.gradients._machine import copied, divided, numbers_of
from pter_gym.gradients._rollout import STATE, UNITS
from pter_gym.params import Machine

jnp: Any = _numpy
custom_vmap: Any = _custom_vmap
_XLA: Any = _xla
_many: Any = _door._many  # pyright: ignore[reportPrivateUsage]
_double_rows, _opened = _XLA._double_rows, _XLA._opened

forward: Any = None
backward: Any = None
version = 0
"""What the calls below call, and the version of XLA's interface; ``compile_kernel`` binds these names."""


def _divide(x: Any, y: Any) -> Any:
    """Return x/y; what a branch that is not taken divides by zero is finite, so that its derivative is."""
    return x / jnp.where(y == 0.0, 1.0, y)


def _chosen(condition: Any, x: Any, y: Any) -> Any:
    """Return one of two numbers or records."""
    if isinstance(condition, bool):
        return x if condition else y
    return jax.tree.map(partial(jnp.where, condition), x, y)


def _whole(x: Any) -> Any:
    return jnp.asarray(x).astype(jnp.int32)


def _root(x: Any) -> Any:
    """Return √x, at 0 with the derivative 0."""
    return jnp.where(x == 0.0, 0.0, jnp.sqrt(jnp.where(x == 0.0, 1.0, x)))


def _least(*given: Any) -> Any:
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


def first_order(function: Any) -> Any:
    """Return a function that raises a ParameterError where it is differentiated itself."""
    custom: Any = jax.custom_jvp
    once = custom(function)

    def refuse(*_: Any) -> None:
        raise ParameterError("derivatives must be first ones in reverse mode (jax.grad, jax.vjp, jax.jacrev)")

    once.defjvp(refuse)
    return once


class Motion(NamedTuple):
    """The attributes of ``Rollout``, at N + 1 control instants, as JAX arrays."""

    theta: jax.Array
    omega: jax.Array
    torque_breakaway: jax.Array
    torque_dynamic: jax.Array
    lagged_volts: jax.Array
    tip_position: jax.Array
    tip_velocity: jax.Array


def make_rollout(machine: Machine | str | None = None, period: float = 0.01) -> Callable[..., Motion]:
    """Return ``pter_gym.gradients.rollout`` of a machine as a JAX function, for ``grad``, ``jit`` and ``vmap``.

    Parameters
    ----------
    machine
        The machine or its name, None for PTER as it is.
    period
        Length of a control step [s].

    Returns
    -------
    Callable
        ``rollout(state, volts, hand_force, hand_target=(0.0, 0.0), numbers=None)`` takes a ``State`` or a dict of its
        fields, and what ``rollout`` takes; voltages out of range are clipped. ``numbers`` replaces numbers of the
        machine by their places, such as ``{"clutch.time_constant": 0.1}``. It returns a ``Motion``.

    Raises
    ------
    ParameterError
        If JAX would run this on anything but a CPU, an argument is out of range, or in the call a shape is
        wrong or an array is not of numbers.
    """
    if jax.default_backend() != "cpu":
        raise ParameterError(f"JAX's platform must be cpu, got {jax.default_backend()}: set JAX_PLATFORMS=cpu")
    held, substeps = divided(machine, period)
    known = {place: value for place, value in numbers_of(held).items() if place != "substep"}
    fixed = jnp.asarray(flat(arrangement_of(held)))
    to_model = branchless(model_of, MEANING, {})
    roll = rolling(held.has_paper_clutches, held.substep)

    def rollout(
        state: State | dict[str, Any],
        volts: Any,
        hand_force: Any,
        hand_target: Any = (0.0, 0.0),
        numbers: dict[str, Any] | None = None,
    ) -> Motion:
        given = vars(state) if isinstance(state, State) else state
        at = {name: _floats(f"state.{name}", given[name], (end - begin,)) for name, (begin, end) in STATE.items()}
        volts = jnp.clip(_floats("volts", volts, (len(volts), 4)), 0.0, held.clutch.voltage_max)
        shape = len(volts), substeps, 2
        force, target = _spread("hand_force", hand_force, shape), _spread("hand_target", hand_target, shape)
        unknown = set(numbers or {}) - set(known)
        if unknown:
            raise ParameterError(f"numbers must be among {', '.join(known)}, got {', '.join(sorted(unknown))}")
        values = known | {place: _floats(place, each, ()) for place, each in (numbers or {}).items()}
        model = to_model(copied(held, "", values.get))
        a, b = at["theta"]
        units = jnp.stack([jnp.cos(a), jnp.sin(a), jnp.cos(b), jnp.sin(b)])
        motion = jnp.concatenate([at["theta"], at["omega"], units])
        limits = [at[name] for name in ("torque_breakaway", "torque_dynamic", "lagged_volts")]
        body = jnp.zeros(BODY_WIDTH).at[FIRST:LAST].set(jnp.concatenate([motion, *limits]))
        body = body.at[:FIRST].set(jnp.stack([*map(jnp.asarray, flat(model))])).at[BODY.drift].set(1.0)
        states = roll(body.at[BODY.arrangement.a.x1 :].set(fixed), volts, force, target)
        return _motion(states, jnp.stack([model.arm.length_a, model.arm.length_b]))

    return rollout


def _motion(states: jax.Array, lengths: jax.Array) -> Motion:
    reach = lengths[:, None] * states[:, UNITS].reshape(-1, 2, 2)
    across = jnp.stack([-reach[..., 1], reach[..., 0]], axis=-1)
    return Motion(
        **{name: states[:, begin:end] for name, (begin, end) in STATE.items()},
        tip_position=reach.sum(axis=1),
        tip_velocity=jnp.sum(states[:, 2:4, None] * across, axis=1),
    )


def _floats(name: str, values: Any, shape: tuple[int, ...]) -> jax.Array:
    array = jnp.asarray(values)
    if array.dtype.kind not in "fiu":
        raise ParameterError(f"{name} must be an array of numbers, got {array.dtype}")
    if array.shape != shape:
        raise ParameterError(f"{name} must have the shape {shape}, got {array.shape}")
    return array.astype(jnp.result_type(float))


def _spread(name: str, values: Any, shape: tuple[int, int, int]) -> jax.Array:
    found = np.shape(values)
    accepted = (shape[-1:], shape[::2], shape)
    if found not in accepted:
        raise ParameterError(f"{name} must have a shape among {accepted}, got {found}")
    array = _floats(name, values, found)
    return jnp.broadcast_to(array[:, None] if array.ndim == 2 else array, shape)


def rolling(papers: bool, substep: float) -> Any:
    """Return the states at the control instants as a function of a body, voltages, forces and targets."""
    names = {name: _registered(name, papers) for name in ("forward", "backward")}
    h = words_of(np.array([substep]))

    def call(name: str, results: tuple[tuple[int, ...], ...], given: tuple[Any, ...]) -> tuple[Any, ...]:
        many = _calling(names[name], tuple(2 * math.prod(shape) for shape in results))
        found = many(tuple(words[None] for words in (h, *map(_words, given))), ())
        return tuple(floats_of(words[0]).reshape(shape) for words, shape in zip(found, results, strict=True))

    @first_order
    def run(body: Any, volts: Any, force: Any, target: Any) -> Any:
        return call("forward", ((len(volts) + 1, LAST - FIRST),), (body, volts, force, target))[0]

    @first_order
    def back(*given: Any) -> Any:
        return call("backward", tuple(each.shape for each in given[:4]), given)

    custom: Any = jax.custom_vjp
    roll = custom(run)

    def keep(*given: Any) -> Any:
        states = run(*given)
        return states, (*given, states)

    def pull(kept: Any, by_states: Any) -> Any:
        return back(*kept, by_states)

    roll.defvjp(keep, pull)
    return roll


@cache
def _calling(name: str, widths: tuple[int, ...]) -> Any:
    """Return a call for many rollouts: of arrays of words with a row for each, to such arrays of these widths."""

    def run(own: Any, _: Any) -> Any:
        ffi: Any = jax.ffi
        results = tuple(jax.ShapeDtypeStruct((len(own[0]), width), jnp.uint32) for width in widths)
        return tuple(ffi.ffi_call(name, results)(*own))

    return _many(run)


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
def _registered(name: str, papers: bool) -> str:
    """Compile a call and tell XLA its address, once; return its name."""
    there, back = kernels(papers=papers)
    bound: Any = {"version": _XLA._installed_version()}
    build, bound[name] = (_build_forward, there) if name == "forward" else (_build_backward, back)
    kernel = compile_kernel(build, **bound)
    called = f"pter_rollout_{name}_{'paper' if papers else 'declared'}"
    _XLA._register(called, kernel)
    _KEPT.append(kernel)
    return called


_KEPT: list[Any] = []
"""Kernels whose addresses XLA has."""


def _build_forward(digest: str) -> Any:
    """Return what simulates. Its arguments are the substep, bodies, voltages, forces and targets; its result states."""

    def call(address: int) -> int:
        _ = digest
        arguments, results = _opened(address, version)
        if results == 0:
            return 0
        h, bodies, volts = _double_rows(arguments, 0)[0, 0], _double_rows(arguments, 1), _double_rows(arguments, 2)
        force, target, states = _double_rows(arguments, 3), _double_rows(arguments, 4), _double_rows(results, 0)
        steps = volts.shape[1] // 4
        acting = steps, force.shape[1] // (2 * steps), 2
        for i in range(len(bodies)):
            forward(
                bodies[i].reshape((BODY_WIDTH, 1)),
                volts[i].reshape((steps, 4)),
                force[i].reshape(acting),
                target[i].reshape(acting),
                h,
                states[i].reshape((steps + 1, LAST - FIRST)),
            )
        return 0

    return call


def _build_backward(digest: str) -> Any:
    """Return what pulls adjoints back.

    Its arguments are those of the other call, the states, and their adjoints; its results are the adjoints of all of
    them but the substep.
    """

    def call(address: int) -> int:
        _ = digest
        arguments, results = _opened(address, version)
        if results == 0:
            return 0
        h, bodies, volts = _double_rows(arguments, 0)[0, 0], _double_rows(arguments, 1), _double_rows(arguments, 2)
        force, target = _double_rows(arguments, 3), _double_rows(arguments, 4)
        states, by_states = _double_rows(arguments, 5), _double_rows(arguments, 6)
        by_bodies, by_volts = _double_rows(results, 0), _double_rows(results, 1)
        by_force, by_target = _double_rows(results, 2), _double_rows(results, 3)
        steps = volts.shape[1] // 4
        acting = steps, force.shape[1] // (2 * steps), 2
        for i in range(len(bodies)):
            backward(
                bodies[i].reshape((BODY_WIDTH, 1)),
                volts[i].reshape((steps, 4)),
                force[i].reshape(acting),
                target[i].reshape(acting),
                h,
                states[i].reshape((steps + 1, LAST - FIRST)),
                by_states[i].reshape((steps + 1, LAST - FIRST)),
                by_volts[i].reshape((steps, 4)),
                by_force[i].reshape(acting),
                by_target[i].reshape(acting),
                by_bodies[i].reshape((BODY_WIDTH, 1)),
            )
        return 0

    return call
