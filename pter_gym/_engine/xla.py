# pyright: standard
"""The kernels as calls of XLA's foreign-function interface: a world is a row, without Python.

A handler gets XLA's call frame, a C structure whose fields are machine words: the version of the
interface's header is in ``jaxlib``. Everything it is given lies in memory that XLA keeps: it reads
blocks of rows, runs the kernels on them and writes them back. A row is opaque, pairs of 32-bit
words, so JAX needs no 64-bit types for it.
"""

import re
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import Any, TypeVar, cast

import jax
import jaxlib
import numba
import numpy as np
from jax import lax, numpy as jnp
from jax.core import Tracer
from jax.sharding import SingleDeviceSharding
from numba import types
from numpy.typing import NDArray

from pter_gym._compiled.addresses import caller, double, export, flag, single, unsigned, whole
from pter_gym._compiled.compiler import compile_kernel, compiled
from pter_gym._compiled.digests import digest_of
from pter_gym._compiled.records import write
from pter_gym._engine.kernels import RESET_TYPES, advance_caller, reset_kernel
from pter_gym._engine.world import CONFIG, FLAG, FLAGS, LANES, ROW, SAME_STEP
from pter_gym._physics.clutch import CLUTCHES
from pter_gym.errors import ParameterError
from pter_gym.tasks.path_following._context import CONTEXT, CONTEXT_WIDTH

TERMINATED, TRUNCATED = int(FLAG.terminated), int(FLAG.truncated)

CONTEXT_AT, DRAWS_FROM, DRAWS = int(ROW.context_at), int(ROW.draws_from), int(ROW.draws)
LOW, HIGH, SLACK = int(CONFIG.low), int(CONFIG.high), int(CONFIG.slack)
ALIVE, STEPS, SEGMENT_NUMBER = int(ROW.alive), int(ROW.step), int(ROW.foot.segment)
ARCS_AT, ARCS = int(CONTEXT.task.path.first), int(CONTEXT.task.path.arcs)

MAX_STEPS = 2.0**31
"""Steps that no world can reach."""

STEP, DECLARED_STEP, RESET = "pter_step", "pter_declared_step", "pter_reset"
"""Names of the calls."""

# words of XLA_FFI_CallFrame, XLA_FFI_Buffer and XLA_FFI_Metadata_Extension
_EXTENSION, _ARGUMENTS, _RESULTS = 1, 9, 14
_DATA, _RANK, _DIMENSIONS = 3, 4, 5
_TYPE, _METADATA = 1, 3
_METADATA_TYPE = 1
_VERSION, _TRAITS = 3, 4

Floats = NDArray[np.float64]
Singles = NDArray[np.float32]
Words = NDArray[np.uint64]
Flags = NDArray[np.bool_]
Tree = TypeVar("Tree")

Handler = Callable[[int, int], None]
"""What a call runs: a compiled function of the addresses of its arguments and results."""

_numba: Any = numba
_njit: Any = numba.njit(nogil=True, error_model="numpy")

handle: Any = None
version = 0
"""What a call runs, and the version of the interface; ``compile_kernel`` binds these names."""


@_njit
def _data(buffers: int, number: int) -> int:
    """Return the address of a buffer's data."""
    return whole(whole(buffers)[number])[_DATA]


@_njit
def _dimension(buffers: int, number: int, axis: int) -> int:
    """Return a dimension of a buffer; axes count from the end as in Python."""
    buffer = whole(whole(buffers)[number])
    return whole(buffer[_DIMENSIONS])[axis if axis >= 0 else buffer[_RANK] + axis]


@_njit
def _doubles(buffers: int, number: int) -> Floats:
    """Return a buffer of 32-bit words as numbers of 64 bits."""
    return _numba.carray(double(_data(buffers, number)), (_dimension(buffers, number, 0) // 2,))


@_njit
def _double_rows(buffers: int, number: int) -> Floats:
    """Return a buffer of 32-bit words (…, 2 n) as rows of numbers of 64 bits, (rows, n)."""
    rows = 1
    for axis in range(whole(whole(buffers)[number])[_RANK] - 1):
        rows *= _dimension(buffers, number, axis)
    return _numba.carray(
        double(_data(buffers, number)), (rows, _dimension(buffers, number, -1) // 2)
    )


@_njit
def _singles(buffers: int, number: int, n: int, width: int) -> Singles:
    """Return a buffer as numbers of 32 bits, (n, width)."""
    return _numba.carray(single(_data(buffers, number)), (n, width))


@_njit
def _flags(buffers: int, number: int, n: int) -> Flags:
    """Return a buffer as flags, (n, FLAGS)."""
    return _numba.carray(flag(_data(buffers, number)), (n, FLAGS))


@_njit
def _bools(buffers: int, number: int, n: int) -> Flags:
    """Return a buffer as truth values, (n,)."""
    return _numba.carray(flag(_data(buffers, number)), (n,))


@_njit
def _gather(block: Floats, words: Words, rows: int, seeds: int, first: int) -> None:
    """Read the worlds from ``first`` on into a block: rows to lanes."""
    stored = _numba.carray(double(rows), ((first + len(words)) * block.shape[1],))
    counts = _numba.carray(unsigned(seeds), ((first + len(words)) * 2,))
    for i in range(len(words)):
        for row in range(block.shape[1]):
            block[0, row, i] = stored[(first + i) * block.shape[1] + row]
        words[i, 0] = counts[2 * (first + i)]
        words[i, 1] = counts[2 * (first + i) + 1]


@_njit
def _scatter(block: Floats, words: Words, rows: int, seeds: int, first: int) -> None:
    """Write a block back: lanes to rows."""
    stored = _numba.carray(double(rows), ((first + len(words)) * block.shape[1],))
    counts = _numba.carray(unsigned(seeds), ((first + len(words)) * 2,))
    for i in range(len(words)):
        for row in range(block.shape[1]):
            stored[(first + i) * block.shape[1] + row] = block[0, row, i]
        counts[2 * (first + i)] = words[i, 0]
        counts[2 * (first + i) + 1] = words[i, 1]


@_njit
def _copy(into: Any, row: Any) -> None:
    """Copy a row; an assignment of arrays compiles for seconds, for what it says of shapes."""
    for k in range(len(row)):
        into[k] = row[k]


@_njit
def _is_place(number: float, end: float) -> bool:
    """Return whether a context begins at a place in the constants."""
    return 0.0 <= number < end and number % CONTEXT_WIDTH == 0.0


@_njit
def _has_contexts(world: Floats, constants: Floats) -> bool:
    """Return whether the contexts that a world has and draws from are in the constants."""
    if len(constants) < CONTEXT_WIDTH:
        return False
    end = min(constants[ARCS_AT], 1.0 * len(constants))  # where the arcs of the first path begin
    at, begin, draws = world[CONTEXT_AT], world[DRAWS_FROM], world[DRAWS]
    last = begin + draws * CONTEXT_WIDTH
    return _is_place(at, end) and _is_place(begin, end) and begin <= at < last <= end


@_njit
def _goes_on(world: Floats, constants: Floats) -> bool:
    """Return whether a world can make a step: it has begun, and is somewhere on its path."""
    if not _has_contexts(world, constants) or world[ALIVE] != 1.0:
        return False
    arcs = constants[int(world[CONTEXT_AT]) + ARCS]
    return 0.0 <= world[STEPS] < MAX_STEPS and 0.0 <= world[SEGMENT_NUMBER] < arcs


@_njit
def _stand_in(world: Floats) -> None:
    """Put a world that goes on with any constants in place of one that does not."""
    world[:] = 0.0
    world[DRAWS], world[ALIVE] = 1.0, 1.0


@_njit
def _is_within(action: Floats, low: float, high: float) -> bool:
    """Return whether all entries of an action are within their bounds; NaN is not."""
    within = True
    for entry in action:
        within &= low <= entry <= high
    return within


@_njit
def _replace_unsound(
    block: Floats, actions: Floats, goes: Flags, lanes: int, config: Floats, constants: Floats
) -> None:
    """Say which worlds of a block go on, and put others in place of those that do not."""
    low, high = config[LOW] - config[SLACK], config[HIGH] + config[SLACK]
    for i in range(LANES):
        goes[i] = i < lanes and _goes_on(block[0, :, i], constants)
        goes[i] &= _is_within(actions[i], low, high)
        if not goes[i]:
            _stand_in(block[0, :, i])
            actions[i] = config[LOW]


@_njit
def _opened(address: int, version: int) -> tuple[int, int]:
    """Return the addresses of arguments and results; none where XLA only asks for the version."""
    frame = whole(address)
    if frame[_EXTENSION] != 0:
        extension = whole(frame[_EXTENSION])
        if (extension[_TYPE] & 0xFFFFFFFF) == _METADATA_TYPE:
            metadata = whole(extension[_METADATA])
            metadata[_VERSION] = version
            metadata[_TRAITS] = 0
            return 0, 0
    return frame[_ARGUMENTS], frame[_RESULTS]


def _build_call(digest: str) -> Callable[[int], int]:
    def call(address: int) -> int:
        _ = digest
        arguments, results = _opened(address, version)
        if results != 0:
            handle(arguments, results)
        return 0

    return call


_KEPT: list[Any] = []
"""Calls whose addresses XLA has."""


def register(name: str, handler: Handler) -> None:
    """Compile a call of ``handler(arguments, results)``, addresses of buffers, and tell XLA."""
    call: Any = compile_kernel(_build_call, handle=handler, version=_installed_version())
    signature = (types.int64,)
    call.compile(signature)
    variant = call.overloads[signature]
    address = variant.library.get_pointer_to_function(variant.fndesc.llvm_cfunc_wrapper_name)
    jax.ffi.register_ffi_target(name, jax.ffi.pycapsule(address), platform="cpu")
    _KEPT.append(call)


def _installed_version() -> int:
    """Return the version of the interface that the installed jaxlib speaks, as a word."""
    header = Path(jaxlib.__file__).parent / "include/xla/ffi/api/c_api.h"
    text = header.read_text("utf-8")
    major, minor = (
        int(re.findall(rf"#define XLA_FFI_API_{part} (\d+)", text)[0])
        for part in ("MAJOR", "MINOR")
    )
    return major | minor << 32


def _step_handler(advance: Callable[..., object]) -> Handler:
    """Return what advances worlds.

    Its arguments are worlds, seeds and episodes, actions, config and constants; its results worlds,
    seeds and episodes, observations, last observations, rewards and flags. A world that is damaged,
    was never reset, is of other constants or gets an action out of bounds stays as it is; its
    numbers are NaN.
    """

    @compiled
    def step(arguments: int, results: int) -> None:
        config, constants = _doubles(arguments, 3), _doubles(arguments, 4)
        n, rows = _dimension(arguments, 0, 0), _dimension(arguments, 0, -1) // 2
        entries = _dimension(results, 2, -1)
        actions = _singles(arguments, 2, n, 4)
        obs, last_obs = _singles(results, 2, n, entries), _singles(results, 3, n, entries)
        rewards = _singles(results, 4, n, 1)
        flags = _flags(results, 5, n)
        block = np.zeros((1, rows, LANES))
        words, given = np.empty((LANES, 2), np.uint64), np.zeros((LANES, 4))
        goes = np.ones(LANES, np.bool_)
        earned, flags_here, telemetry = (
            np.empty(LANES),
            np.empty((FLAGS, LANES), np.bool_),
            np.empty((0, LANES, 1)),
        )
        ended, first_block, last_block = np.int64(SAME_STEP), np.int64(0), np.int64(1)
        for first in range(0, n, LANES):
            lanes = min(LANES, n - first)
            mine, obs_here, last = (
                words[:lanes],
                obs[first : first + lanes],
                last_obs[first : first + lanes],
            )
            _gather(block, mine, _data(arguments, 0), _data(arguments, 1), first)
            for i in range(lanes):
                _copy(given[i], actions[first + i])
            _replace_unsound(block, given, goes, lanes, config, constants)
            outputs = obs_here, last, earned[:lanes], flags_here, telemetry, config, constants
            advance((block, mine, given[:lanes], *outputs, ended, first_block, last_block))
            for i in range(lanes):
                if not goes[i]:
                    one = slice(i, i + 1)
                    world, word, place = block[:, :, one], mine[one], first + i
                    _gather(world, word, _data(arguments, 0), _data(arguments, 1), place)
                    obs_here[i], last[i], earned[i], flags_here[:, i] = (
                        np.nan,
                        np.nan,
                        np.nan,
                        False,
                    )
            _scatter(block, mine, _data(results, 0), _data(results, 1), first)
            for i in range(lanes):
                rewards[first + i, 0] = earned[i]
                _copy(flags[first + i], flags_here[:, i])
                if not (flags_here[TERMINATED, i] or flags_here[TRUNCATED, i]):
                    _copy(last[i], obs_here[i])

    return step


def _reset_handler(start: Callable[..., object]) -> Handler:
    """Return what starts worlds.

    Its arguments are worlds that have not begun, seeds and episodes, config and constants; its
    results worlds, seeds and episodes, and observations, which are NaN for a world that draws from
    other constants.
    """

    @compiled
    def reset(arguments: int, results: int) -> None:
        config, constants = _doubles(arguments, 2), _doubles(arguments, 3)
        n, rows = _dimension(arguments, 0, 0), _dimension(arguments, 0, -1) // 2
        obs = _singles(results, 2, n, _dimension(results, 2, -1))
        block = np.zeros((1, rows, LANES))
        words, chosen = np.empty((LANES, 2), np.uint64), np.ones(LANES, np.bool_)
        telemetry = np.empty((0, LANES, 1))
        for first in range(0, n, LANES):
            lanes = min(LANES, n - first)
            _gather(block, words[:lanes], _data(arguments, 0), _data(arguments, 1), first)
            mine, obs_here = words[:lanes], obs[first : first + lanes]
            for i in range(lanes):
                chosen[i] = _has_contexts(block[0, :, i], constants)
                if not chosen[i]:
                    _stand_in(block[0, :, i])
            start((block, mine, chosen[:lanes], True, obs_here, telemetry, config, constants))
            for i in range(lanes):
                if not chosen[i]:
                    obs_here[i] = np.nan
            _scatter(block, words[:lanes], _data(results, 0), _data(results, 1), first)

    return reset


def _law_handler(law: Callable[..., Any]) -> Handler:
    """Return what follows a controller's law where it acts.

    Its arguments are observations, scales, rows of gains, the largest voltage, what the law keeps
    of each world, the row that is each world's, and whether it acts there; its results voltages
    [V], and what it keeps after that.
    """

    @compiled
    def follow(arguments: int, results: int) -> None:
        n = _dimension(arguments, 0, 0)
        obs, volts = (
            _singles(arguments, 0, n, _dimension(arguments, 0, -1)),
            _singles(results, 0, n, 4),
        )
        scales, gains = _doubles(arguments, 1), _double_rows(arguments, 2)
        top = _doubles(arguments, 3)[0]
        before, memory = _double_rows(arguments, 4), _double_rows(results, 1)
        rows, acts = _singles(arguments, 5, n, 1), _bools(arguments, 6, n)
        for world in range(n):
            _copy(memory[world], before[world])
            if acts[world]:
                own = gains[int(min(max(rows[world, 0], 0.0), len(gains) - 1.0))]
                write(volts[world], CLUTCHES, law(obs[world], scales, own, memory[world], top))
            else:
                volts[world] = 0.0

    return follow


def register_calls(step: str = STEP) -> None:
    """Register the call that resets, and one that steps: ``STEP`` or ``DECLARED_STEP``."""
    for name in (RESET, step):
        _register_call(name)


@cache
def _register_call(name: str) -> None:
    if name == RESET:
        export(reset_kernel(), RESET_TYPES, symbol := f"{name}_kernel")
        register(name, _reset_handler(caller(RESET_TYPES, symbol)))
    else:
        register(name, _step_handler(advance_caller(name == DECLARED_STEP)))


@cache
def register_law(law: Callable[..., Any], guarded: Callable[..., Any]) -> str:
    """Compile the call of a controller's law, once; return its name.

    ``guarded(obs, scales, gains, memory, voltage_max)`` is the law in a form that raises nothing.
    """
    name = f"pter_law_{digest_of(law)}"
    register(name, _law_handler(guarded))
    return name


def call_law(
    name: str,
    obs: jax.Array,
    scales: jax.Array,
    gains: jax.Array,
    voltage_max: jax.Array,
    memory: jax.Array,
    rows: jax.Array,
    acts: jax.Array,
) -> Sequence[jax.Array]:
    """Return the voltages [V] of a law, float32 (N, 4), and its memory after them.

    Parameters
    ----------
    name
        From ``register_law``.
    obs
        Observations, float32 (N, entries).
    scales, gains, voltage_max
        Of the observation's layout, the law and the machine, as ``words_of`` makes them; gains
        (rows, G).
    memory
        What the law keeps of each world, as words (N, M).
    rows
        Which gains are each world's, float32 (N,); the last ones for larger numbers.
    acts
        Where it acts, bool (N,); elsewhere voltages are 0, and its memory stays.
    """
    results = (
        jax.ShapeDtypeStruct((len(obs), 4), jnp.float32),
        jax.ShapeDtypeStruct(memory.shape, memory.dtype),
    )
    return jax.ffi.ffi_call(name, results)(obs, scales, gains, voltage_max, memory, rows, acts)


def words_of(numbers: NDArray[Any]) -> jax.Array:
    """Return numbers of 64 bits as words of 32, on the CPU."""
    return jnp.asarray(on_cpu(np.ascontiguousarray(numbers).view(np.uint32)))


def on_cpu(arrays: Tree) -> Tree:
    """Return arrays on JAX's CPU device, where kernels run.

    Where the CPU is JAX's default, they stay as they are, and where a mesh has devices of its own.
    Elsewhere they are committed to it, so what is computed with them is computed there; where they
    are traced, so is all of the ``jit``.

    Raises
    ------
    ParameterError
        If JAX has no CPU device.
    """
    if jax.default_backend() == "cpu" or not jax.sharding.get_abstract_mesh().empty:
        return arrays
    here, tracer = SingleDeviceSharding(cpu_device()), cast("type", Tracer)

    def placed(array: jax.Array) -> jax.Array:
        place = lax.with_sharding_constraint if isinstance(array, tracer) else jax.device_put
        return place(array, here)

    return jax.tree.map(placed, arrays)


def cpu_device() -> Any:
    """Return JAX's first CPU device, or raise a ParameterError if it has none."""
    try:
        return jax.local_devices(backend="cpu")[0]
    except RuntimeError as error:
        raise ParameterError(
            "JAX's platforms must include cpu, on which the worlds run, as "
            f"JAX_PLATFORMS=cuda,cpu has it: {error}"
        ) from None


def rounded(words: jax.Array) -> jax.Array:
    """Return words of float64 (…, 2 n) as float32 (…, n), rounded toward zero, to 0 if tiny."""
    low, high = words[..., ::2], words[..., 1::2]
    exponent = ((high >> 20) & 0x7FF).astype(jnp.int32) - (1023 - 127)
    size = jnp.clip(exponent, 0, 254).astype(jnp.uint32) << 23 | (high & 0xFFFFF) << 3 | low >> 29
    return lax.bitcast_convert_type(
        (high >> 31) << 31 | jnp.where(exponent > 0, size, 0), jnp.float32
    )
