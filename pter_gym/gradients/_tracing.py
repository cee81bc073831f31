# pyright: standard
"""Derivatives from the simulator's own source: adjoints and tangents from a trace.

``adjoint_of`` and ``tangent_of`` run a stage of a substep once, without branches, on values that
note each operation, and write out the vector–Jacobian product, or the Jacobian–vector products, as
a function that numba compiles.
"""

import math
from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

from pter_gym._compiled.compiler import inlined
from pter_gym._compiled.records import flat
from pter_gym._compiled.source import compile_source
from pter_gym._physics.arrangement import Arrangement
from pter_gym._physics.clutch import PerClutch
from pter_gym._physics.friction import resolve
from pter_gym._physics.open_loop import BODY
from pter_gym.gradients._branchless import Column, Stage, branchless
from pter_gym.gradients._friction import resolve_adjoint, resolve_tangent


@dataclass
class _Trace:
    """Operations in their order: what each one makes, its kind, and of what."""

    steps: list[tuple[tuple["_Value", ...], str, tuple[object, ...]]] = field(
        default_factory=list[tuple[tuple["_Value", ...], str, tuple[object, ...]]]
    )
    count: int = 0

    def new(self) -> "_Value":
        self.count += 1
        return _Value(self, f"x{self.count}")

    def note(self, kind: str, *of: object, results: int = 1) -> Any:
        made = tuple(self.new() for _ in range(results))
        self.steps.append((made, kind, of))
        return made if results > 1 else made[0]


def _operator(kind: str, *, swapped: bool = False) -> Stage:
    def operate(x: "_Value", y: "Number") -> "Number":
        return x.trace.note(kind, y, x) if swapped else x.trace.note(kind, x, y)

    return operate


class _Value:
    """A number or a truth of a trace, by the name that it has in the code."""

    def __init__(self, trace: _Trace, name: str) -> None:
        self.trace = trace
        self.name = name

    def __repr__(self) -> str:
        return self.name

    def __neg__(self) -> "_Value":
        return self.trace.note("neg", self)

    def __abs__(self) -> "_Value":
        return self.trace.note("abs", self)

    def __pow__(self, power: float) -> "_Value":
        assert power == 2
        return self.trace.note("*", self, self)

    def __bool__(self) -> bool:
        raise TypeError("a value of a trace has no truth: the function is not straight-line code")

    __hash__ = None  # pyright: ignore[reportAssignmentType]
    __add__, __radd__ = _operator("+"), _operator("+", swapped=True)
    __sub__, __rsub__ = _operator("-"), _operator("-", swapped=True)
    __mul__, __rmul__ = _operator("*"), _operator("*", swapped=True)
    __truediv__, __rtruediv__ = _operator("/"), _operator("/", swapped=True)
    __lt__, __le__, __gt__, __ge__ = (
        _operator("<"),
        _operator("<="),
        _operator(">"),
        _operator(">="),
    )
    __eq__, __ne__ = _operator("=="), _operator("!=")  # pyright: ignore[reportAssignmentType]
    __and__, __or__ = _operator("&"), _operator("|")


Number = _Value | float
"""A value of a trace, or one that does not vary."""


def _where(condition: "_Value | bool", x: "Number", y: "Number") -> "Number":
    if not isinstance(condition, _Value):
        return x if condition else y
    return condition.trace.note("where", condition, x, y)


def _not(condition: "_Value | bool") -> "_Value | bool":
    return (
        condition.trace.note("not", condition) if isinstance(condition, _Value) else not condition
    )


def _min(*values: "Number") -> "Number":
    least = values[0]
    for value in values[1:]:
        least = _where(value < least, value, least)
    return least


def _divide(x: "Number", y: "Number") -> "Number":
    return x / y


def _noted(kind: str) -> Stage:
    def function(*values: "_Value") -> "_Value":
        return values[0].trace.note(kind, *values)

    return function


_MEANING: dict[str, object] = {
    "_where": _where,
    "_not": _not,
    "_divide": _divide,
    "min": _min,
    "math": SimpleNamespace(exp=_noted("exp"), hypot=_noted("hypot")),
}

_CODE = {
    "neg": "-{0}",
    "abs": "abs({0})",
    "exp": "math.exp({0})",
    "hypot": "math.hypot({0}, {1})",
    "not": "not {0}",
    "where": "({1} if {0} else {2})",
}
"""How an operation is written, where not between its operands."""

_PULLS: dict[str, tuple[str, ...]] = {
    "+": ("{g}", "{g}"),
    "-": ("{g}", "-{g}"),
    "*": ("{g} * {1}", "{0} * {g}"),
    # a branch that is not taken may divide by zero; its adjoint is zero
    "/": (
        "({g} / {1} if {g} != 0.0 else 0.0)",
        "(-{g} * {0} / ({1} * {1}) if {g} != 0.0 else 0.0)",
    ),
    "neg": ("-{g}",),
    "abs": ("({g} if {0} >= 0.0 else -{g})",),
    "exp": ("{g} * math.exp({0})",),
    "hypot": ("{g} * {0} / math.hypot({0}, {1})", "{g} * {1} / math.hypot({0}, {1})"),
    "where": ("", "({g} if {0} else 0.0)", "(0.0 if {0} else {g})"),
}
"""What an operation adds to the adjoint of each of its operands, by its own adjoint g; truths have
none.

That is linear in g with the operand's derivative as its factor, so it is also what an operand's
tangent g adds to that of the operation. """


def _traced(*given: object) -> tuple[_Value, _Value]:
    """Note the friction problem; it has ``resolve_adjoint`` and ``resolve_tangent``."""
    trace: _Trace = next(each.trace for each in flat(given) if isinstance(each, _Value))
    return trace.note("resolve", *given, results=2)


_RULES: dict[Any, Stage] = {getattr(resolve, "py_func", resolve): _traced}
"""Functions that a trace notes as one operation."""

_NUMBERS = 9
"""How many numbers ``resolve`` takes that have derivatives, the first."""

_NAMES: dict[str, object] = {
    each.__name__: each
    for each in (math, resolve, resolve_adjoint, resolve_tangent, PerClutch, Arrangement)
}
"""What generated code may name."""


_ENERGIES = flat(BODY.energy)
"""Rows in which a stage's results do not count."""


class _Stage:
    """A stage of a substep as a trace: what it reads, computes, writes and returns."""

    def __init__(self, stage: Stage, scalars: tuple[str, ...], constants: tuple[bool, ...]) -> None:
        self.trace = trace = _Trace()
        self.read: dict[int, _Value] = {}
        self.scalars = tuple(_Value(trace, name) for name in scalars)
        column = Column({}, lambda row: self.read.setdefault(row, trace.new()))
        self.returned = branchless(stage, _MEANING, dict(_RULES))(
            column, 0, *self.scalars, *constants
        )
        self.written = {
            row: value for row, value in column.rows.items() if value is not self.read.get(row)
        }

    @property
    def lines(self) -> list[str]:
        """The lines that read and compute."""
        return [
            *(f"{value} = w[{row}, i]" for row, value in self.read.items()),
            *(_forward(*s) for s in self.trace.steps),
        ]


def adjoint_of(stage: Stage, *scalars: str, constants: tuple[bool, ...] = ()) -> Stage:
    """Return the vector–Jacobian product of a stage of a substep, compiled.

    Parameters
    ----------
    stage
        ``stage(w, i, *scalars, *constants)`` reads and writes rows of column ``i`` of an array
        ``w``. It may return a number.
    scalars, constants
        Names of its further arguments that are numbers; values of those that do not vary.

    Returns
    -------
    Callable
        ``adjoint(w, i, bar, *scalars, seed)``: takes the column as it was before the stage, and
        turns ``bar`` (entries, 1), the adjoints of its entries after it but the energies, into
        those before it. ``seed`` is the adjoint of the returned number, if there is one. Returns
        the adjoint of the only scalar, 0 if there is none.
    """
    recording = _Stage(stage, scalars, constants)
    adjoints = _Adjoints()
    lines = recording.lines
    for row, value in recording.written.items():
        if row not in _ENERGIES:
            lines += [f"b{row} = bar[{row}, 0]", f"bar[{row}, 0] = 0.0"]
            adjoints.add(value, f"b{row}")
    seeds = () if recording.returned is None else ("seed",)
    for seed in seeds:
        adjoints.add(recording.returned, seed)
    for step in reversed(recording.trace.steps):
        lines += adjoints.through(*step)
    for row, value in recording.read.items():
        lines += [f"bar[{row}, 0] += {pull}" for pull in adjoints.of(value)]
    by_scalars = [pull for name in recording.scalars for pull in adjoints.of(name)]
    lines.append(f"return {' + '.join(by_scalars) or '0.0'}")
    return _compiled("adjoint", ("bar", *scalars, *seeds), lines)


def tangent_of(
    stage: Stage,
    *scalars: str,
    constants: tuple[bool, ...] = (),
    active: Collection[float],
    lanes: int | str,
) -> Stage:
    """Return a stage of a substep with its Jacobian–vector products, compiled.

    Parameters
    ----------
    stage, scalars, constants
        As ``adjoint_of`` takes them; what ``stage`` returns is not differentiated.
    active
        Rows whose entries vary and are written; all others, and the scalars, have no tangents.
    lanes
        Number of tangents.

    Returns
    -------
    Callable
        ``tangent(w, i, dot, *scalars)``: does to the active rows of column ``i`` of ``w`` what the
        stage does, and turns ``dot`` (entries, at least ``lanes``), the tangents of the entries
        before it, into those after it.
    """
    recording = _Stage(stage, scalars, constants)
    inner = [f"d{value} = dot[{row}, j]" for row, value in recording.read.items() if row in active]
    active_names = {value.name for row, value in recording.read.items() if row in active}

    def dot(value: object) -> str:
        return f"d{value}" if isinstance(value, _Value) and value.name in active_names else ""

    for results, kind, of in recording.trace.steps:
        numbers = flat(of)[:_NUMBERS] if kind == "resolve" else of
        if kind == "resolve":
            arguments = [
                *map(repr, of),
                *map(repr, results),
                *(dot(value) or "0.0" for value in numbers),
            ]
            line = f"resolve_tangent({', '.join(arguments)})"
        else:
            pulls = zip(of, _PULLS.get(kind, ("",) * len(of)), strict=True)
            line = " + ".join(
                pull.format(*of, g=dot(value)) for value, pull in pulls if pull and dot(value)
            )
        if line and any(map(dot, numbers)):
            inner.append(f"{', '.join(f'd{value}' for value in results)} = {line}")
            active_names |= {value.name for value in results}
    outputs = {row: value for row, value in recording.written.items() if row in active}
    inner += [f"dot[{row}, j] = {dot(value) or '0.0'}" for row, value in outputs.items()]
    writes = [f"w[{row}, i] = {value}" for row, value in outputs.items()]
    lines = [
        *recording.lines,
        *writes,
        f"for j in range({lanes}):",
        *(f"    {line}" for line in inner),
    ]
    return _compiled("tangent", ("dot", *scalars), lines)


def _compiled(name: str, arguments: tuple[str, ...], lines: list[str]) -> Stage:
    header = f"def {name}({', '.join(('w', 'i', *arguments))}):"
    return inlined(compile_source("\n    ".join([header, *lines]), name, dict(_NAMES)))


def _forward(made: tuple[_Value, ...], kind: str, of: tuple[object, ...]) -> str:
    left = ", ".join(map(repr, made))
    if kind == "resolve":
        return f"{left} = resolve({', '.join(map(repr, of))})"
    return f"{left} = {_CODE.get(kind, f'{{0}} {kind} {{1}}').format(*of)}"


class _Adjoints:
    """Contributions to the adjoint of each value, by its name."""

    def __init__(self) -> None:
        self.pulls: dict[str, list[str]] = {}

    def add(self, value: object, pull: str) -> None:
        if isinstance(value, _Value):
            self.pulls.setdefault(value.name, []).append(pull)

    def of(self, value: _Value) -> list[str]:
        return self.pulls.get(value.name, [])

    def through(
        self, results: tuple[_Value, ...], kind: str, of: tuple[object, ...]
    ) -> Iterator[str]:
        """Yield the lines that pull adjoints of results back through an operation."""
        if not any(map(self.of, results)) or not (kind in _PULLS or kind == "resolve"):
            return
        for value in results:
            yield f"g{value} = {' + '.join(self.of(value)) or '0.0'}"
        if kind == "resolve":
            everything = [*map(repr, of), *map(repr, results), *(f"g{value}" for value in results)]
            yield f"p{results[0]} = resolve_adjoint({', '.join(everything)})"
            for k, value in enumerate(flat(of)[:_NUMBERS]):
                self.add(value, f"p{results[0]}[{k}]")
            return
        for value, pull in zip(of, _PULLS[kind], strict=True):
            if pull:
                self.add(value, pull.format(*of, g=f"g{results[0]}"))
