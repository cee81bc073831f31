"""Small faults in a source text, one at a time: the operators of the mutation campaign.

A fault swaps an operator, moves a comparison by its border or turns it round, changes a number, takes a negation, a
function such as ``abs`` or a statement away. What says nothing about results stays as it is: docstrings, texts,
annotations, the arguments of exceptions.
"""

import ast
import copy
import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

SWAPPED: tuple[tuple[type[ast.AST], type[ast.AST]], ...] = (
    (ast.Add, ast.Sub),
    (ast.Mult, ast.Div),
    (ast.LShift, ast.RShift),
    (ast.BitAnd, ast.BitOr),
    (ast.Eq, ast.NotEq),
    (ast.Is, ast.IsNot),
    (ast.In, ast.NotIn),
    (ast.And, ast.Or),
)
OPERATORS: dict[type[ast.AST], tuple[type[ast.AST], ...]] = {
    **{one: (other,) for pair in SWAPPED for one, other in (pair, pair[::-1])},
    **dict.fromkeys((ast.FloorDiv, ast.Mod, ast.Pow), (ast.Mult,)),
    ast.BitXor: (ast.BitOr,),
    ast.Lt: (ast.LtE, ast.GtE),
    ast.LtE: (ast.Lt, ast.Gt),
    ast.Gt: (ast.GtE, ast.LtE),
    ast.GtE: (ast.Gt, ast.Lt),
}
"""What stands in for each operator."""

_PAIRS = (("min", "max"), ("minimum", "maximum"), ("any", "all"), ("sin", "cos"), ("floor", "ceil"))
NAMES = {name: other for pair in _PAIRS for name, other in (pair, pair[::-1])}
"""What stands in for the name of a function."""

TAKEN_AWAY = ("abs", "fabs", "sqrt", "sorted", "tuple")
"""Functions of one argument that a fault may leave out."""

SILENT = ("warning", "info", "debug", "print", "warn")
"""Calls whose loss changes no result."""


@dataclass(frozen=True)
class Mutant:
    """One fault: where it is, how the line reads, what changes, and the source text with it.

    ``lines`` are those of its statement, which runs when the module is imported if ``at_import`` is true.
    """

    file: str
    scope: str
    line: str
    change: str
    number: int
    lines: range
    at_import: bool
    source: str

    @property
    def name(self) -> str:
        """What tells this fault from all others, whatever the number of its line."""
        count = f" (occurrence {self.number})" if self.number > 1 else ""
        return f"{self.file} | {self.scope} | {self.line} | {self.change}{count}"


def mutants_of(file: str, source: str) -> list[Mutant]:
    """All faults of a file, in the order of the text."""
    lines = source.encode().splitlines(keepends=True)
    starts = [0]
    for line in lines:
        starts.append(starts[-1] + len(line))
    data = source.encode()
    found: list[Mutant] = []
    for place, old, new in _faults(ast.parse(source)):
        begin = starts[old.lineno - 1] + old.col_offset
        end = starts[old.end_lineno - 1] + old.end_col_offset
        text = ast.unparse(new)
        inside = f"({text})" if isinstance(new, ast.expr) and not isinstance(new, ast.Constant | ast.Name) else text
        mutated = (data[:begin] + inside.encode() + data[end:]).decode()
        change = f"{_short(ast.unparse(old))} → {_short(text)}"
        line = re.sub(r"\s+", " ", lines[old.lineno - 1].decode()).strip()
        found.append(Mutant(file, place.scope, line, change, 1, _lines(place.statement), place.at_import, mutated))
    seen: Counter[str] = Counter()
    numbered = []
    for mutant in found:
        seen[mutant.name] += 1
        numbered.append(replace(mutant, number=seen[mutant.name]))
    return numbered


def _short(text: str) -> str:
    flat = re.sub(r"\s+", " ", text)
    return flat if len(flat) <= 60 else f"{flat[:57]}…"


def _lines(statement: ast.stmt) -> range:
    """Lines of a simple statement, or of the head of another."""
    body = getattr(statement, "body", None)
    return range(statement.lineno, body[0].lineno if body else (statement.end_lineno or statement.lineno) + 1)


@dataclass(frozen=True)
class _Place:
    """Where a node is: names around it, its statement, and whether that runs when the module is imported."""

    scope: str
    statement: Any
    at_import: bool


def _faults(tree: ast.Module) -> Iterator[tuple[_Place, Any, ast.AST]]:
    """Where each fault is, the node that changes, and the node instead of it."""
    for place, node in _nodes(tree, _Place("", None, at_import=True)):
        for other in _replacements(node):
            yield place, node, other
        if isinstance(node, ast.If | ast.IfExp) and isinstance(node.test, ast.Name | ast.Attribute | ast.Call):
            yield place, node.test, ast.UnaryOp(ast.Not(), node.test)


def _nodes(node: ast.AST, place: _Place) -> Iterator[tuple[_Place, ast.AST]]:
    """What a fault may change, and where it is."""
    for field, value in ast.iter_fields(node):
        if field in _untouched(node):
            continue
        at_import = place.at_import and not (isinstance(node, ast.FunctionDef) and field == "body")
        for child in value if isinstance(value, list) else [value]:
            if not isinstance(child, ast.AST) or isinstance(child, ast.JoinedStr) or _says_nothing(child):
                continue
            statement = child if isinstance(child, ast.stmt) else place.statement
            scope = place.scope
            if isinstance(child, ast.FunctionDef | ast.ClassDef):
                scope = f"{scope}.{child.name}".lstrip(".")
            inner = _Place(scope, statement, at_import)
            yield inner, child
            yield from _nodes(child, inner)


def _untouched(node: ast.AST) -> tuple[str, ...]:
    """Fields of a node that say nothing about results, or whose change is that of the node."""
    if isinstance(node, ast.Raise):
        return ("exc", "cause")
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
        return ("op",)
    return ("annotation", "returns", "type_params", "decorator_list", "op", "ops", "ctx")


def _says_nothing(node: ast.AST) -> bool:
    """Tell whether a node is a docstring, an import, for the type checker, or what a developer sees."""
    match node:
        case ast.Expr(value=ast.Constant()) | ast.Import() | ast.ImportFrom() | ast.Assert():
            return True
        case ast.If(test=ast.Name(id="TYPE_CHECKING")) | ast.FunctionDef(name="__repr__" | "__str__"):
            return True
        case ast.Assign(targets=[ast.Name(id=name)], value=ast.BinOp() | ast.Subscript()):
            return name[:1].isupper() and not name.isupper()  # an alias of types
        case _:
            return False


def _replacements(node: ast.AST) -> Iterator[ast.AST]:
    """Nodes that may stand instead of a node."""
    match node:
        case ast.BinOp(op=op) | ast.BoolOp(op=op) | ast.AugAssign(op=op):
            for kind in OPERATORS.get(type(op), ()):
                yield _with(node, op=kind())
        case ast.Compare(ops=ops):
            for place, op in enumerate(ops):
                for kind in OPERATORS.get(type(op), ()):
                    yield _with(node, ops=[*ops[:place], kind(), *ops[place + 1 :]])
        case ast.UnaryOp(op=ast.Not() | ast.USub() | ast.Invert(), operand=operand):
            yield operand
        case ast.stmt():
            yield from _other_statements(node)
        case _:
            yield from _other_values(node)


def _other_values(node: ast.AST) -> Iterator[ast.AST]:
    match node:
        case ast.Constant(value=bool(value)):
            yield ast.Constant(not value)
        case ast.Constant(value=int(value) | float(value)):
            yield ast.Constant(value + 1)
        case ast.Name(id=name, ctx=ast.Load()) if name in NAMES:
            yield _with(node, id=NAMES[name])
        case ast.Attribute(attr=name, ctx=ast.Load()) if name in NAMES:
            yield _with(node, attr=NAMES[name])
        case ast.Call(func=ast.Name(id=name) | ast.Attribute(attr=name), args=[argument]) if name in TAKEN_AWAY:
            yield argument
        case _:
            pass


def _other_statements(node: ast.stmt) -> Iterator[ast.AST]:
    match node:
        case ast.Assign(targets=[ast.Attribute() | ast.Subscript()]) | ast.Raise():
            yield ast.Pass()
        case ast.Expr(value=ast.Call(func=ast.Name(id=name) | ast.Attribute(attr=name))) if name not in SILENT:
            yield ast.Pass()
        case ast.Continue():
            yield ast.Break()
        case ast.Break():
            yield ast.Continue()
        case _:
            pass


def _with(node: ast.AST, **fields: object) -> ast.AST:
    other = copy.copy(node)
    for name, value in fields.items():
        setattr(other, name, value)
    return other
