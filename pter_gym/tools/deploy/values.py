"""Values that a translation to C meets: known Python objects, and the running program's."""

from dataclasses import dataclass
from typing import Any, Literal, NamedTuple, cast, get_args

import numpy as np
from numpy.typing import NDArray

from pter_gym._compiled.records import record_fields
from pter_gym.errors import ParameterError

ATOM, UNARY, PRODUCT, SUM, COMPARISON, AND, OR, CHOICE = 8, 7, 6, 5, 4, 3, 2, 1
"""How tightly operators of C bind."""


Precision = Literal["double", "float"]
"""Type of the arithmetic: float64 with Python's bits, or float32, as small processors have it."""

Weights = Literal["float", "int8"]
"""Type of stored weights: float32, as in a policy's file, or 8 bits with a step per layer."""


def check_choice(field: str, value: object, accepted: Any) -> None:
    """Raise a ParameterError unless a value is one of a ``Literal``."""
    if value not in get_args(accepted):
        raise ParameterError(
            f"{field} must be one of {', '.join(get_args(accepted))}, got {value!r}"
        )


class Unsupported(ParameterError):
    """A function is written in a part of Python that is not translated."""


@dataclass(frozen=True)
class Expression:
    """A number or a record that only the running program knows.

    Attributes
    ----------
    kind
        "real", "single" (float32), "int", "bool", a named tuple's class, an ``Observed``, or a
        tuple of kinds.
    text, level
        The expression in C, and how tightly its outermost operator binds.
    shift
        A whole number that is added to it.
    least
        Of a whole number without ``shift``, the smallest value.
    """

    kind: Any
    text: str
    level: int = ATOM
    shift: int = 0
    least: int = 0


@dataclass(frozen=True)
class Observed:
    """The kind of a record with entries from an observation, which are float32 in Python, too."""

    record: Any
    kinds: tuple[Any, ...]


@dataclass(frozen=True)
class Array:
    """Numbers in memory from ``offset`` on, stored as ``element`` and read as ``reads``.

    With a ``step`` they are multiples of it.
    """

    element: str
    base: str
    reads: str = "real"
    offset: Any = 0
    count: Any = 0
    step: float | None = None
    const: bool = True


class Region(NamedTuple):
    """Entries ``first`` … ``last`` − 1 of a table, a separate array in C."""

    name: str
    first: int
    last: int
    element: str = "real"
    step: float | None = None


@dataclass(frozen=True, eq=False)
class ConstantTable:
    """Constants; the running program may index those in regions.

    Attributes
    ----------
    values
        The constants, (entries,), or several tables of which the running program chooses one,
        (tables, entries).
    regions
        Parts of each table.
    choices
        Where in the entries such tables lie behind each other: the first one, and their size.
    """

    values: NDArray[np.float64]
    regions: tuple[Region, ...] = ()
    choices: tuple[int, int] | None = None

    def __len__(self) -> int:
        """Return the number of entries."""
        return self.values.shape[-1]

    def part(self, first: int, last: int) -> "ConstantTable":
        """Return a part of the table."""
        return ConstantTable(self.values[..., first:last], self._regions(first, last))

    def tables(self) -> "ConstantTable":
        """Return the tables of which the running program chooses one."""
        assert self.choices is not None
        first, size = self.choices
        return ConstantTable(
            self.values[first:].reshape(-1, size), self._regions(first, first + size)
        )

    def _regions(self, first: int, last: int) -> tuple[Region, ...]:
        return tuple(
            region._replace(first=region.first - first, last=region.last - first)
            for region in self.regions
            if first <= region.first and region.last <= last
        )

    def differ(self, first: int, last: int) -> bool:
        """Return whether some entries depend on what the running program chooses."""
        return self.values.ndim > 1 and bool((self.values != self.values[0])[:, first:last].any())


def is_known(value: Any) -> bool:
    """Return whether no part of a value is of the running program."""
    if isinstance(value, tuple):
        return all(map(is_known, cast("tuple[Any, ...]", value)))
    return not isinstance(value, Expression | Array | ConstantTable)


def is_number(value: Any) -> bool:
    """Return whether this is a number, known or not."""
    return isinstance(value, int | float) or (
        isinstance(value, Expression) and isinstance(value.kind, str)
    )


def is_record(value: Any) -> bool:
    """Return whether this is a record or a tuple, known or not."""
    return isinstance(value, tuple) or (
        isinstance(value, Expression) and not isinstance(value.kind, str)
    )


def kind_of(value: Any) -> Any:
    """Return the kind of a value in C."""
    if isinstance(value, Expression):
        return value.kind
    if isinstance(value, tuple):
        whole = cast("tuple[Any, ...]", value)
        return type(whole) if hasattr(whole, "_fields") else tuple(map(kind_of, whole))
    if not isinstance(value, int | float):
        raise Unsupported(f"policies: C has no {value!r:.100}")
    return "bool" if isinstance(value, bool) else "int" if isinstance(value, int) else "real"


def fields_of(kind: Any) -> list[tuple[str, Any]]:
    """Return names and kinds of the entries of a record or a tuple."""
    if isinstance(kind, tuple):
        return [(f"e{k}", each) for k, each in enumerate(cast("tuple[Any, ...]", kind))]
    if isinstance(kind, Observed):
        return list(zip(kind.record._fields, kind.kinds, strict=True))
    return [
        (name, {float: "real", int: "int", bool: "bool"}.get(each, each))
        for name, _, each in record_fields(kind)
    ]


def name_of(kind: Any) -> str:
    """Return the name of a kind in C."""
    if isinstance(kind, str):
        return {"single": "float", "int": "int32_t", "bool": "int"}.get(kind, kind)
    if isinstance(kind, tuple):
        kinds = cast("tuple[Any, ...]", kind)
        are_real = set(kinds) == {"real"}
        return f"Real{len(kinds)}" if are_real else "_".join(("Tuple", *map(name_of, kinds)))
    return f"Observed{kind.record.__name__}" if isinstance(kind, Observed) else kind.__name__


def bound(value: Expression, level: int) -> str:
    """Return an expression as text that binds at least as tightly as ``level``."""
    text, at = value.text, value.level
    if value.shift:
        left = text if at >= SUM else f"({text})"
        text, at = f"{left} {'+' if value.shift > 0 else '-'} {abs(value.shift)}", SUM
    return text if at >= level else f"({text})"
