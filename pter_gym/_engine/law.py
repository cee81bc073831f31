"""The interface between the engine and a compiled control law: a function that is inlined, and its
memory per world.

A law is ``law(obs, scales, gains, memory) -> PerClutch``: ``obs`` is one float32 observation,
``obs·scales`` is in physical units, ``gains`` belongs to the law and ``memory`` to one world. What
the memory holds is a record: ``Memory`` for the built-in laws, any other for a law that needs one
(``pter_gym.controllers.Policy`` takes it).
"""

from collections.abc import Generator
from contextlib import contextmanager
from numbers import Real
from types import CellType, FunctionType
from typing import Annotated, Any, NamedTuple

import numpy as np
from numba.core.dispatcher import Dispatcher
from numba.core.errors import NumbaError
from numpy.typing import NDArray

from pter_gym._compiled.compiler import Device, device
from pter_gym._compiled.records import Entry, rows, width
from pter_gym._physics.clutch import PerClutch
from pter_gym.errors import LawIndexError, ParameterError


class Memory(NamedTuple):
    """What the built-in laws keep of one world."""

    kept: Annotated[float, Entry("1", "the clutch engaged last, or a counter")]
    brake: Annotated[float, Entry("N", "force along the path that the pace's integral has come to")]
    steps: Annotated[float, Entry("1", "control steps of the episode that went before")]
    progress: Annotated[float, Entry("1", "part of the path at the last of them")]
    world: Annotated[float, Entry("1", "number of the world")]


MEMORY = rows(Memory)
CLUTCHES = rows(PerClutch)
"""Places of the voltages in an array (4,)."""


def empty_memory(worlds: int, kind: type[Any] = Memory) -> NDArray[np.float64]:
    """Return what a law keeps at the start of an episode, a row for each world: (N, numbers of the
    record).

    Parameters
    ----------
    worlds
        N.
    kind
        Record of what is kept. All of it is zero; an entry ``world`` is the number of the world.
    """
    memory: Any = np.zeros((worlds, width(kind)))
    if "world" in kind._fields:
        memory[:, rows(kind).world] = np.arange(worlds)
    return memory


@device
def no_law(obs: Any, scales: Any, gains: Any, memory: Any) -> PerClutch:  # noqa: ARG001
    """Return no voltages: the law of a kernel whose voltages are given."""
    return PerClutch(0.0, 0.0, 0.0, 0.0)


CHECKS = 64
"""Calls of a user's law as Python before it is compiled: enough to enter branches and to count memory up."""

_CHECKED: set[tuple[Any, ...]] = set()


def check_law(
    law: Any, scales: NDArray[np.float64], gains: NDArray[np.float64], memory: NDArray[np.float64]
) -> None:
    """Call a user's law as Python on rows of the lengths that it will get: compiled code checks no
    index.

    The observations are random within [−1, 1], and the memory is kept from call to call.

    Raises
    ------
    LawIndexError
        If the law reads or writes beyond its observation, gains or memory.
    ParameterError
        If it cannot be called so, names what is not there, or does not return a ``PerClutch`` of
        numbers.
    """
    key = (law, len(scales), len(gains), len(memory))
    if key in _CHECKED or str(getattr(law, "__module__", "")).startswith("pter_gym."):
        return
    name, plain, memory = getattr(law, "__name__", repr(law)), as_python(law, {}), memory.copy()
    for obs in (
        np.random.default_rng(0).uniform(-1.0, 1.0, (CHECKS, len(scales))).astype(np.float32)
    ):
        try:
            with np.errstate(all="ignore"):
                found = plain(obs, scales.copy(), gains.copy(), memory)
        except IndexError as error:
            lengths = f"obs and scales have {len(scales)} entries, gains {len(gains)}, memory {len(memory)}"
            raise LawIndexError(f"law {name}: {error}; {lengths}") from None
        except (AttributeError, NameError, TypeError) as error:
            raise ParameterError(f"law {name}: {error}") from None
        except (ArithmeticError, ValueError, NotImplementedError):  # which compiled code may allow
            continue
        if not all(isinstance(getattr(found, clutch, None), Real) for clutch in PerClutch._fields):
            got = " ".join(repr(found).split())
            raise ParameterError(f"law {name} must return a PerClutch of numbers, got {got:.100}")
    _CHECKED.add(key)


def as_python(function: Any, made: dict[Any, Any]) -> Any:
    """Return a law as a Python function that calls other compiled functions as Python, too."""
    plain = getattr(function, "py_func", function)
    if not isinstance(plain, FunctionType):
        return plain
    if plain not in made:

        def of(value: Any) -> Any:
            return (
                as_python(value, made)
                if isinstance(value, Dispatcher) and not isinstance(value, Device)
                else value
            )

        names = dict(plain.__globals__)
        cells = tuple(CellType(of(cell.cell_contents)) for cell in plain.__closure__ or ())
        made[plain] = FunctionType(plain.__code__, names, plain.__name__, plain.__defaults__, cells)
        names |= {name: of(value) for name, value in plain.__globals__.items()}
    return made[plain]


@contextmanager
def compiling(law: Any) -> Generator[None]:
    """Turn what numba says of a law that it cannot compile into a ParameterError of one line."""
    try:
        yield
    except NumbaError as error:
        lines = [line.strip() for line in str(error).splitlines() if line.strip()]
        told = next(
            (line for line in lines if not line.startswith(("Failed", "Compilation", "- "))),
            lines[0],
        )
        raise ParameterError(
            f"law {getattr(law, '__name__', law)!s} cannot be compiled: {told:.300}"
        ) from error
