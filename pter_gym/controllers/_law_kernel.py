"""The kernel that runs a control law in many worlds; users' laws have their bounds checked."""

import math
from functools import cache
from types import CellType, FunctionType
from typing import Any

import numba
import numpy as np
from numba.core import config, types
from numba.core.dispatcher import Dispatcher
from numba.core.errors import NumbaError

from pter_gym._compiled.compiler import compile_kernel, compiled, inlined
from pter_gym._compiled.digests import digest_of
from pter_gym._compiled.pipeline import KernelFunction
from pter_gym._compiled.records import entrywise, read, write
from pter_gym._physics.clutch import CLUTCHES, PerClutch
from pter_gym._physics.scalars import clamp
from pter_gym.controllers._gains import RELEASED
from pter_gym.controllers._laws import Law, is_ours
from pter_gym.controllers._network import (
    CORRECTED,
    FEWEST,
    HEADER,
    LANES,
    run_layers,
    take_inputs,
    voltage,
)
from pter_gym.errors import LawIndexError, ParameterError, PterError
from pter_gym.params import SLOTS

law: Any = None
"""The law that the kernels below inline; ``compile_kernel`` binds this name."""

corrected: Any = None
"""The law that a network corrects."""

LARGEST = float(np.finfo(np.float32).max)

origin = ""
"""Module of the law: what is cached names it, so the same text in another file is another law."""

_CHECKED: Any = {"forceinline": True, "error_model": "numpy", "boundscheck": True}

_numba: Any = numba
_config: Any = config


@entrywise
@inlined
def applied(volts: float, released: float, voltage_max: float) -> float:
    """Return a voltage [V] as a clutch gets it: a float32 within its range; NaN if not finite.

    A clutch that the law releases gets ``released``.
    """
    single = float(np.float32(clamp(volts, -LARGEST, LARGEST)))
    within = clamp(single, 0.0, voltage_max) if volts > RELEASED else released
    return within if math.isfinite(volts) else math.nan


def _build_act(digest: str) -> Any:
    def act(
        obs: Any, scales: Any, gains: Any, memory: Any, released: float, top: float, volts: Any
    ) -> None:
        _ = digest, origin
        for world in range(obs.shape[0]):
            decided = law(obs[world], scales, gains, memory[world])
            write(volts[world], CLUTCHES, applied(decided, released, top))

    return act


def _build_act_in_lanes(digest: str) -> Any:
    def act(
        obs: Any, scales: Any, gains: Any, memory: Any, released: float, top: float, volts: Any
    ) -> None:
        _ = digest
        net, worlds = read(gains, HEADER, 0), obs.shape[0]
        alone = worlds if worlds < FEWEST else 0
        for world in range(alone):
            decided = law(obs[world], scales, gains, memory[world])
            write(volts[world], CLUTCHES, applied(decided, released, top))
        # equal blocks of whole vectors; their number of lanes is no constant, so LLVM vectorises
        # loops over lanes rather than writing them out
        eights = 8 * max(1, -(-worlds // LANES))
        room = np.zeros((2 * int(net.width), -(-worlds // eights) * 8))
        for first in range(alone, worlds, room.shape[1]):
            lanes = min(room.shape[1], worlds - first)
            for lane in range(lanes):
                seen, past = obs[first + lane], memory[first + lane]
                base = corrected(seen, scales, gains, past)
                write(volts[first + lane], CLUTCHES, base)
                take_inputs(net, seen, scales, gains, past, base, room[:, lane])
            outputs = run_layers(net, gains, room)
            for lane in range(lanes):
                output = read(room[outputs : outputs + SLOTS, lane], CLUTCHES, 0)
                decided = voltage(net, output, read(volts[first + lane], CLUTCHES, 0))
                write(volts[first + lane], CLUTCHES, applied(decided, released, top))

    return act


_NUMBERS, _ROWS = types.float64[::1], types.float64[:, ::1]

LAW_TYPES: Any = types.none(
    types.float32[:, ::1], _NUMBERS, _NUMBERS, _ROWS, types.float64, types.float64, _ROWS
)
"""Types of a law's kernel: observations, scales, gains, memory, released, top and volts."""


def kernel_of(law: Law) -> Any:
    """Return ``act(obs, scales, gains, memory, released, top, volts)``, a law in N worlds.

    The kernel of a user's law is recompiled when its code, or a value that it reads, has changed.
    """
    if is_ours(law):
        return _kernel(law)
    digest = digest_of(law)
    if digest is None:  # nobody can tell whether what it reads has changed
        return _compile(law)
    if digest not in _KERNELS:
        _KERNELS[digest] = _compile(law)
    return _KERNELS[digest]


_KERNELS: dict[str, Any] = {}


@cache
def guarded(law: Law) -> Law:
    """Return a law with the largest voltage as a fifth argument, for callers that cannot raise.

    Its voltages are within the range or ``RELEASED``, and NaN where a user's law reads or writes
    beyond an array.
    """
    if is_ours(law):

        @compiled
        def act(obs: Any, scales: Any, gains: Any, memory: Any, voltage_max: float) -> Any:
            return applied(law(obs, scales, gains, memory), RELEASED, voltage_max)

        return act
    checked = _checked(law, {})

    @compiled
    def act_checked(obs: Any, scales: Any, gains: Any, memory: Any, voltage_max: float) -> Any:
        try:
            return applied(checked(obs, scales, gains, memory), RELEASED, voltage_max)
        except Exception:  # noqa: BLE001  (numba knows no other)
            return PerClutch(math.nan, math.nan, math.nan, math.nan)

    return act_checked


FAULTS = (IndexError, NumbaError, AttributeError, NameError, TypeError, ValueError)
"""What a law raises that is wrong; all but the first two only where numba is disabled."""


def law_error(law: Law, error: Exception, observed: int, gains: int, remembered: int) -> PterError:
    """Return an error of one line for what went wrong in a law with arrays of these lengths."""
    name = getattr(law, "__name__", repr(law))
    if isinstance(error, IndexError):
        return LawIndexError(
            f"law {name}: {error}; obs and scales have {observed} entries, gains {gains}, "
            f"memory {remembered}"
        )
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    skipped = ("Failed", "Compilation", "- ")
    reason = next((line for line in lines if not line.startswith(skipped)), lines[0])
    return ParameterError(f"law {name} cannot be compiled: {reason:.300}")


@cache
def _kernel(law: Law) -> Any:
    if law in CORRECTED:
        return compile_kernel(_build_act_in_lanes, law=law, corrected=CORRECTED[law])
    return compile_kernel(_build_act, law=law)


def _compile(law: Law) -> Any:
    return compile_kernel(_build_act, law=_checked(law, {}), origin=law.__module__)


def _checked(function: Any, done: dict[Any, Any]) -> Any:
    """Return a user's function compiled afresh with bounds checks, with all that it calls."""
    plain = getattr(function, "py_func", function)
    if not isinstance(plain, FunctionType) or isinstance(function, KernelFunction):
        return function
    if plain not in done:
        names = dict(plain.__globals__)
        empty = tuple(CellType() for _ in plain.__closure__ or ())
        copy = FunctionType(plain.__code__, names, plain.__name__, plain.__defaults__, empty)
        copy.__qualname__ = plain.__qualname__
        done[plain] = copy if _config.DISABLE_JIT else _numba.njit(**_CHECKED)(copy)

        def replaced(value: Any) -> Any:
            return _checked(value, done) if isinstance(value, Dispatcher) else value

        for cell, original in zip(empty, plain.__closure__ or (), strict=True):
            cell.cell_contents = replaced(original.cell_contents)
        names |= {name: replaced(value) for name, value in names.items()}
    return done[plain]
