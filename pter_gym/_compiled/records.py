# pyright: standard
"""Records: numbers with names, which lie in the rows of an array.

A record is a ``NamedTuple`` of floats and of other records. Its declaration is its layout: ``rows``
numbers its entries in their order and returns a record of the same class that holds row numbers
instead of values. So compiled code reads and writes by name::

    ROW = rows(World)
    w[ROW.step, i] += 1.0
    store(w, ROW.motion, i, advance_position(load(w, ROW.motion, i), omega_a, omega_b, h))

``Annotated[float, Entry(unit, meaning, scale)]`` says what an entry is; ``layout_of`` makes a
``Layout`` of it.
"""

import inspect
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import update_wrapper
from typing import (
    Annotated,
    Any,
    NamedTuple,
    Protocol,
    TypeVar,
    get_args,
    get_origin,
    get_type_hints,
)

from numba import types
from numba.extending import overload

from pter_gym._compiled.compiler import inlined
from pter_gym._compiled.layout import Field, Layout
from pter_gym._compiled.pipeline import WITHOUT_ARRAYS, FunctionCompiler
from pter_gym._compiled.source import compile_source

R = TypeVar("R")
"""A record, or a number."""


@dataclass(frozen=True)
class Entry:
    """What an entry of a record is, or what all entries of a record within it are.

    Attributes
    ----------
    unit, meaning
        Its unit, and what it says in a few words. Within a record, ``{}`` is what the record's own
        entry says: ``"clutch 1's {}"``.
    scale
        The value that is stored as 1, or a function that finds it for a machine.
    name
        Its name, where that is not the name of the field.
    """

    unit: str = ""
    meaning: str = ""
    scale: float | Callable[[Any], float] = 1.0
    name: str = ""


def record_fields(kind: type[Any]) -> Iterator[tuple[str, Entry | None, type[Any]]]:
    """Yield name, entry and kind of each field of a record."""
    for name, hint in get_type_hints(kind, include_extras=True).items():
        inner, *told = get_args(hint) if get_origin(hint) is Annotated else (hint,)
        yield name, next((each for each in told if isinstance(each, Entry)), None), inner


def _is_record(kind: Any) -> bool:
    """Return whether a type is a record."""
    return isinstance(kind, type) and issubclass(kind, tuple)


def width(kind: type[Any]) -> int:
    """Return how many numbers a record holds."""
    return len(leaves(kind))


def rows(kind: type[R], first: int = 0) -> R:
    """Return a record whose entries are their row numbers, counted from ``first`` on."""
    found: list[Any] = []
    for _, _, inner in record_fields(kind):
        found.append(rows(inner, first) if _is_record(inner) else first)
        first += width(inner) if _is_record(inner) else 1
    return kind(*found)


def joined(name: str, *kinds: type[Any]) -> Any:
    """Return a record of a name that has the fields of several, in the order of these."""
    fields = [
        field for kind in kinds for field in get_type_hints(kind, include_extras=True).items()
    ]
    record: Any = NamedTuple(name, fields)
    record.__module__ = kinds[0].__module__
    return record


class Records(Protocol):
    """An array as compiled code reads and writes it: by places that a record holds."""

    @property
    def shape(self) -> tuple[int, ...]: ...
    def __getitem__(self, at: Any, /) -> float: ...
    def __setitem__(self, at: Any, value: float, /) -> None: ...


class Leaf(NamedTuple):
    """One number of a record: its name, and what says what it is, the outermost entry first."""

    name: str
    entries: tuple[Entry, ...] = ()


def leaves(kind: type[Any]) -> list[Leaf]:
    """Return the numbers of a record in their order.

    The entries of a record whose field has an ``Entry`` are called after that field: ``volts_1``.
    """
    numbers: list[Leaf] = []
    for name, entry, inner in record_fields(kind):
        called, entries = ((entry.name or name), (entry,)) if entry else (name, ())
        if not _is_record(inner):
            numbers.append(Leaf(called, entries))
        else:
            before = f"{called}_" if entry else ""
            numbers.extend(
                Leaf(before + leaf.name, (*entries, *leaf.entries)) for leaf in leaves(inner)
            )
    return numbers


def layout_of(kind: type[Any], machine: Any = None) -> Layout:
    """Return the layout of a record's numbers; some scales depend on the machine."""
    return Layout(tuple(_field(name, entries, machine) for name, entries in leaves(kind)))


def _field(name: str, entries: tuple[Entry, ...], machine: Any) -> Field:
    meaning = ""
    for entry in entries:
        meaning = entry.meaning.replace("{}", meaning) or meaning
    unit = next((entry.unit for entry in entries if entry.unit), "")
    scale = entries[0].scale if entries else 1.0
    return Field(name, unit, meaning, scale if isinstance(scale, (int, float)) else scale(machine))


def flat(value: Any) -> tuple[Any, ...]:
    """Return the numbers of a record in their order; of a number, itself alone."""
    numbers: list[Any] = []

    def add(record: Any) -> None:
        for part in record:
            if isinstance(part, tuple):
                add(part)
            else:
                numbers.append(part)

    add((value,))
    return tuple(numbers)


def load(w: Any, at: R, i: int) -> R:
    """Read a record from column ``i`` of an array (rows, worlds); ``at`` holds its row numbers."""
    places: Any = at
    return type(places)(*(load(w, row, i) for row in places)) if isinstance(at, tuple) else w[at, i]


def store(w: Any, at: R, i: int, value: R) -> None:
    """Write a record to column ``i`` of an array (rows, worlds); ``at`` holds its row numbers."""
    for row, part in zip(flat(at), flat(value), strict=True):
        w[row, i] = part


def read(array: Any, at: R, first: int) -> R:
    """Read a record that begins at ``first`` in an array; ``at`` holds its places from there."""
    places: Any = at
    return (
        type(places)(*(read(array, x, first) for x in places))
        if isinstance(at, tuple)
        else array[first + places]
    )


def write(array: Records, at: R, value: R) -> None:
    """Write a record to an array (numbers,); ``at`` holds its places."""
    for place, part in zip(flat(at), flat(value), strict=True):
        array[place] = part


def _paths(kind: Any, before: str = "") -> Iterator[str]:
    """Yield how each number of a compiled record is reached: ``.motion.theta_a``."""
    if not isinstance(kind, types.BaseNamedTuple):
        yield before
        return
    record: Any = kind
    for name, inner in zip(record.fields, record.types, strict=True):
        yield from _paths(inner, f"{before}.{name}")


def _made(kind: Any, number: str, names: dict[str, Any], before: str = "") -> str:
    """Return source that makes a compiled record from that of an entry; ``names`` gains classes."""
    if not isinstance(kind, types.BaseNamedTuple):
        return number.replace("AT", before)
    record: Any = kind
    called = record.instance_class.__name__
    names[called] = record.instance_class
    values = [
        _made(inner, number, names, f"{before}.{name}")
        for name, inner in zip(record.fields, record.types, strict=True)
    ]
    return f"{called}({', '.join(values)})"


def _compiled(
    function: Any, arguments: str, number: str, record: str = "at", *, returns: bool
) -> None:
    """Give a function its compiled form: the statement ``number`` for each entry of a record."""

    def source(**kinds: Any) -> Any:
        names: dict[str, Any] = {}
        if returns:
            lines = [f"return {_made(kinds[record], number, names)}"]
        else:
            lines = [number.replace("AT", path) for path in _paths(kinds[record])]
        return compile_source(
            "\n    ".join([f"def written({arguments}):", *lines]), "written", names
        )

    _overload(function, arguments, source)


def _overload(function: Any, arguments: str, source: Callable[..., Any]) -> None:
    """Give a function the compiled form that ``source`` returns for the types of its arguments."""
    # numba passes types by the names of the function's arguments
    given = ", ".join(f"{name}={name}" for name in arguments.split(", "))
    build = compile_source(
        f"def build({arguments}):\n    return source({given})", "build", {"source": source}
    )
    options: Any = {**WITHOUT_ARRAYS, "pipeline_class": FunctionCompiler}
    overload(function, jit_options=options)(build)


_compiled(load, "w, at, i", "w[atAT, i]", returns=True)
_compiled(store, "w, at, i, value", "w[atAT, i] = valueAT", returns=False)
_compiled(read, "array, at, first", "array[first + atAT]", returns=True)
_compiled(write, "array, at, value", "array[atAT] = valueAT", returns=False)


def entrywise(function: Callable[..., float]) -> Any:
    """Return a function that applies a scalar one to each entry of records of one class.

    Records may take the place of what is annotated as ``float``; all else is the same for each
    entry::

        @entrywise
        @inlined
        def limited(volts: float, most: float) -> float:
            return volts if volts < most else most

        limited(PerClutch(1.0, 30.0, 2.0, 3.0), 24.0)
    """
    scalar: Any = function
    names = tuple(inspect.signature(function).parameters)
    varies = tuple(
        each.annotation is float for each in inspect.signature(function).parameters.values()
    )

    def each(*arguments: Any) -> Any:
        columns = [
            varying and isinstance(value, tuple)
            for value, varying in zip(arguments, varies, strict=True)
        ]
        if not any(columns):
            return scalar(*arguments)
        record = arguments[columns.index(True)]
        rows = (
            value if is_column else (value,) * len(record)
            for value, is_column in zip(arguments, columns, strict=True)
        )
        return type(record)(*(each(*row) for row in zip(*rows, strict=True)))

    def source(**kinds: Any) -> Any:
        parameters = zip(names, varies, strict=True)
        records = [
            name
            for name, varying in parameters
            if varying and isinstance(kinds[name], types.BaseNamedTuple)
        ]
        entry = f"scalar({', '.join(f'{name}AT' if name in records else name for name in names)})"
        space: dict[str, Any] = {"scalar": scalar}
        expression = _made(kinds[records[0]], entry, space) if records else entry
        return compile_source(
            f"def written({', '.join(names)}):\n    return {expression}", "written", space
        )

    _overload(each, ", ".join(names), source)
    update_wrapper(each, function, ("__doc__",), ())
    return each


@entrywise
@inlined
def lerp(low: float, high: float, part: float) -> float:
    """Return the record that lies a part of the way from one record to another of its kind."""
    return low + part * (high - low)
