"""Records: numbers with names, which lie in the rows of an array.

A record is a ``NamedTuple`` of floats and of other records. Its declaration is its layout: ``rows`` numbers its entries
in their order and returns a record of the same class that holds row numbers instead of values. So compiled code reads
and writes by name::

    ROW = rows(World)
    w[ROW.step, i] += 1.0
    store(w, ROW.motion, i, advance_position(load(w, ROW.motion, i), omega_a, omega_b, h))

``Annotated[float, Entry(unit, meaning, scale)]`` says what an entry is; ``layout_of`` makes a ``Layout`` of it.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Annotated, Any, TypeVar, cast, get_args, get_origin, get_type_hints

from numba import types
from numba.extending import overload

from pter_gym._compiled.compiler import WITHOUT_ARRAYS
from pter_gym._compiled.generated import compile_source
from pter_gym._compiled.layout import Field, Layout
from pter_gym._compiled.pipeline import Part

R = TypeVar("R")
"""A record, or a number."""


@dataclass(frozen=True)
class Entry:
    """What an entry of a record is, or what all entries of a record within it are.

    Attributes
    ----------
    unit, meaning
        Its unit, and what it says in a few words. Within a record, ``{}`` is what the record's own entry says:
        ``"clutch 1's {}"``.
    scale
        The value that is stored as 1, or a function that finds it for a machine.
    name
        Its name, where that is not the name of the field.
    """

    unit: str = ""
    meaning: str = ""
    scale: float | Callable[[Any], float] = 1.0
    name: str = ""


NO_ENTRY = Entry()


@dataclass(frozen=True)
class Leaf:
    """One number of a record: its name, and the entries that say what it is, the outermost first."""

    name: str
    entries: tuple[Entry, ...]

    def field(self, machine: Any = None) -> Field:
        """Return name, unit, meaning and scale."""
        told = self.entries[0] if self.entries else NO_ENTRY
        unit = next((entry.unit for entry in self.entries if entry.unit), "")
        meaning = ""
        for entry in self.entries:
            meaning = entry.meaning.replace("{}", meaning) or meaning
        scale = told.scale if isinstance(told.scale, (int, float)) else told.scale(machine)
        return Field(self.name, unit, meaning, scale)


def parts(kind: type[Any]) -> Iterator[tuple[str, Entry | None, type[Any]]]:
    """Yield name, entry and kind of each field of a record."""
    hints = get_type_hints(kind, include_extras=True)
    for name in kind._fields:
        hint = hints[name]
        entry = None
        if get_origin(hint) is Annotated:
            hint, *told = get_args(hint)
            entry = next((each for each in told if isinstance(each, Entry)), None)
        yield name, entry, hint


def is_record(kind: Any) -> bool:
    """Return whether a kind is that of a record, not of a number."""
    return isinstance(kind, type) and issubclass(kind, tuple)


def _holds_many(value: Any) -> bool:
    """Return whether a value is a record, not a number."""
    return isinstance(value, tuple)


def width(kind: type[Any]) -> int:
    """Return how many numbers a record holds."""
    return sum(width(inner) if is_record(inner) else 1 for _, _, inner in parts(kind))


def rows(kind: type[R], first: int = 0) -> R:
    """Return a record whose entries are their row numbers, counted from ``first`` on."""
    found: list[Any] = []
    for _, _, inner in parts(kind):
        found.append(rows(inner, first) if is_record(inner) else first)
        first += width(inner) if is_record(inner) else 1
    return kind(*found)


def leaves(kind: type[Any]) -> tuple[Leaf, ...]:
    """Return the numbers of a record in their order.

    The entries of a record whose field has an ``Entry`` are called after that field: ``volts_1``.
    """
    found: list[Leaf] = []
    for name, entry, inner in parts(kind):
        called = (entry.name if entry else "") or name
        entries = (entry,) if entry else ()
        if not is_record(inner):
            found.append(Leaf(called, entries))
        elif entry is None:
            found.extend(leaves(inner))
        else:
            found.extend(Leaf(f"{called}_{leaf.name}", (entry, *leaf.entries)) for leaf in leaves(inner))
    return tuple(found)


def layout_of(kind: type[Any], machine: Any = None) -> Layout:
    """Return names, units, meanings and scales of a record's numbers; some scales are those of a machine."""
    return Layout(tuple(leaf.field(machine) for leaf in leaves(kind)))


def flat(record: tuple[Any, ...]) -> tuple[float, ...]:
    """Return the numbers of a record in their order."""
    return tuple(number for part in record for number in _numbers(part))


def load(w: Any, at: R, i: Any) -> R:
    """Read a record from column ``i`` of an array (rows, worlds); ``at`` holds its row numbers."""
    places: Any = at
    return type(places)(*(load(w, row, i) for row in places)) if _holds_many(at) else w[at, i]


def store(w: Any, at: R, i: Any, value: R) -> None:
    """Write a record to column ``i`` of an array (rows, worlds); ``at`` holds its row numbers."""
    for row, part in zip(_numbers(at), _numbers(value), strict=True):
        w[row, i] = part


def read(array: Any, at: R, first: Any) -> R:
    """Read a record from an array (numbers,) in which it begins at ``first``; ``at`` holds its places from there."""
    places: Any = at
    return type(places)(*(read(array, place, first) for place in places)) if _holds_many(at) else array[first + at]


def write(array: Any, at: R, value: R) -> None:
    """Write a record to an array (numbers,); ``at`` holds its places."""
    for place, part in zip(_numbers(at), _numbers(value), strict=True):
        array[place] = part


def blend(low: R, high: R, part: Any) -> R:
    """Return the record that lies a part of the way from one record to another of its kind."""
    a: Any = low
    b: Any = high
    if _holds_many(low):
        return type(a)(*(blend(x, y, part) for x, y in zip(a, b, strict=True)))
    return a + part * (b - a)


def _numbers(value: Any) -> tuple[Any, ...]:
    return flat(value) if _holds_many(value) else (value,)


def _paths(kind: Any, before: str = "") -> Iterator[str]:
    """Yield how each number of a compiled record is reached: ``.motion.theta_a``."""
    if not isinstance(kind, types.BaseNamedTuple):
        yield before
        return
    for name, inner in zip(cast(Any, kind).fields, cast(Any, kind).types, strict=True):
        yield from _paths(inner, f"{before}.{name}")


def _made(kind: Any, number: str, names: dict[str, Any], before: str = "") -> str:
    """Return the source that makes a compiled record from ``number``, that of an entry; ``names`` gets the classes."""
    if not isinstance(kind, types.BaseNamedTuple):
        return number.replace("AT", before)
    record: Any = kind
    names[record.instance_class.__name__] = record.instance_class
    inner = (
        _made(each, number, names, f"{before}.{name}") for name, each in zip(record.fields, record.types, strict=True)
    )
    return f"{record.instance_class.__name__}({', '.join(inner)})"


def written(arguments: str, lines: Iterable[str], names: dict[str, Any]) -> Any:
    """Return a function with a body that knows some names: what is made for a record's class is written out."""
    return compile_source(f"def written({arguments}):\n    " + "\n    ".join(lines), "written", names)


def _returning(kind: Any, arguments: str, number: str) -> Any:
    names: dict[str, Any] = {}
    return written(arguments, [f"return {_made(kind, number, names)}"], names)


def _doing(kind: Any, arguments: str, number: str) -> Any:
    return written(arguments, [number.replace("AT", path) for path in _paths(kind)], {})


def _compiled(function: Any) -> Any:
    """Say what builds the compiled form of a function: the same for every device, for a CPU in less time."""
    for_cpu: Any = {**WITHOUT_ARRAYS, "pipeline_class": Part}

    def register(build: Any) -> Any:
        overload(function, jit_options=for_cpu, target="cpu")(build)
        return overload(function, jit_options=WITHOUT_ARRAYS)(build)

    return register


@_compiled(load)
def _load(w, at, i):  # pyright: ignore[reportUnknownParameterType, reportMissingParameterType]  # noqa: ARG001
    return _returning(at, "w, at, i", "w[atAT, i]")


@_compiled(store)
def _store(w, at, i, value):  # pyright: ignore[reportUnknownParameterType, reportMissingParameterType]  # noqa: ARG001
    return _doing(at, "w, at, i, value", "w[atAT, i] = valueAT")


@_compiled(read)
def _read(array, at, first):  # pyright: ignore[reportUnknownParameterType, reportMissingParameterType]  # noqa: ARG001
    return _returning(at, "array, at, first", "array[first + atAT]")


@_compiled(write)
def _write(array, at, value):  # pyright: ignore[reportUnknownParameterType, reportMissingParameterType]  # noqa: ARG001
    return _doing(at, "array, at, value", "array[atAT] = valueAT")


@_compiled(blend)
def _blend(low, high, part):  # pyright: ignore[reportUnknownParameterType, reportMissingParameterType]  # noqa: ARG001
    return _returning(low, "low, high, part", "lowAT + part * (highAT - lowAT)")
