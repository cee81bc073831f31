# pyright: standard
"""Functions of the simulator without branches, for the numbers of a trace or of JAX.

The functions of a substep are straight-line code but for conditional expressions. ``branchless``
makes the same function with calls in place of those.
"""

import ast
import inspect
import textwrap
from collections.abc import Callable, Mapping
from types import FunctionType
from typing import Any, Protocol

from pter_gym._compiled.records import entrywise
from pter_gym._compiled.source import compile_source

Stage = Callable[..., Any]
"""A function of the simulator on columns, or one that is made from it."""

_REWRITTEN = tuple(
    f"pter_gym.{room}"
    for room in ("_physics", "gradients", "params._machine", "hands", "paths", "tasks", "_engine")
)
"""Where functions are rewritten; others are called as they are."""


class _Branchless(ast.NodeTransformer):
    """Replace ``a if c else b``, ``not c``, ``a / b`` and ``if c: return a`` with calls."""

    def visit_IfExp(self, node: ast.IfExp) -> ast.AST:
        self.generic_visit(node)
        return _call("_where", node.test, node.body, node.orelse)

    def visit_UnaryOp(self, node: ast.UnaryOp) -> ast.AST:
        self.generic_visit(node)
        return _call("_not", node.operand) if isinstance(node.op, ast.Not) else node

    def visit_BinOp(self, node: ast.BinOp) -> ast.AST:
        self.generic_visit(node)
        return _call("_divide", node.left, node.right) if isinstance(node.op, ast.Div) else node

    def visit_FunctionDef(self, node: ast.FunctionDef) -> ast.AST:
        self.generic_visit(node)
        node.decorator_list, node.returns = [], None
        *before, last = node.body
        for k, part in enumerate(before):
            match part, last:
                case ast.If(test, [ast.Return(ast.expr() as x)], []), ast.Return(ast.expr() as y):
                    if part is before[-1] or _compares(test):
                        choice = _call(
                            "_choose", test, ast.Lambda(_NOTHING, x), ast.Lambda(_NOTHING, y)
                        )
                        node.body = [*before[:k], *before[k + 1 :], ast.Return(choice)]
                        break
                case _:
                    pass
        for argument in node.args.args:
            argument.annotation = None
        return node


def _compares(test: ast.expr) -> bool:
    """Return whether a condition compares numbers, rather than asks what there is."""
    return isinstance(test, ast.Compare) and not isinstance(test.ops[0], ast.Is | ast.IsNot)


_NOTHING = ast.arguments([], [], None, [], [], None, [])
"""Arguments of a function that has none."""


def _call(name: str, *arguments: ast.expr) -> ast.Call:
    return ast.Call(ast.Name(name, ast.Load()), list(arguments), [])


def branchless(function: Stage, meaning: Mapping[str, Any], cache: dict[Any, Stage]) -> Stage:
    """Return a function of the simulator, and all that it calls, for any kind of number.

    Parameters
    ----------
    function
        Compiled or not.
    meaning
        What ``_where(c, a, b)``, ``_not(c)`` and ``_divide(a, b)`` are, and built-in names that the
        numbers need.
    cache
        Functions by what they replace, by Python function; gains those that it makes.
    """

    def choose(condition: Any, x: Callable[[], Any], y: Callable[[], Any]) -> Any:
        if isinstance(condition, bool):
            return x() if condition else y()
        return meaning["_where"](condition, x(), y())

    plain = getattr(function, "py_func", function)
    if not isinstance(plain, FunctionType):
        return function
    if scalar := getattr(plain, "__wrapped__", None):  # it is entrywise
        cache[plain] = cache.get(plain) or entrywise(branchless(scalar, meaning, cache))
        return cache[plain]
    module: str | None = plain.__module__
    if module and not module.startswith(_REWRITTEN):  # generated functions have none
        return cache.get(plain, function)
    if plain not in cache:
        tree = _Branchless().visit(_parsed(plain))
        tree.body[0].args.defaults = []  # they may name what the new function does not know
        cells = zip(plain.__code__.co_freevars, plain.__closure__ or (), strict=True)
        names = {**plain.__globals__, **{name: cell.cell_contents for name, cell in cells}}
        space: dict[str, Any] = {**meaning, "_choose": choose}
        cache[plain] = compile_source(
            ast.unparse(ast.fix_missing_locations(tree)), tree.body[0].name, space
        )
        cache[plain].__defaults__ = plain.__defaults__
        cache[plain].__annotations__ = plain.__annotations__
        reads = {*plain.__code__.co_names, *plain.__code__.co_freevars}  # perhaps its own name, too
        space |= {
            name: branchless(names[name], meaning, cache)
            for name in reads & names.keys() - meaning.keys()
        }
    return cache[plain]


def _parsed(function: FunctionType) -> ast.Module:
    """Return the definition of a function, which may be a lambda on a line of its own."""
    tree = ast.parse(textwrap.dedent(inspect.getsource(function)))
    for node in ast.walk(tree):
        if isinstance(node, ast.Lambda) and function.__name__ == "<lambda>":
            return ast.Module(
                [ast.FunctionDef("given", node.args, [ast.Return(node.body)], [])], []
            )
    return tree


class Columns(Protocol):
    """Numbers by row and column, as a stage reads and writes them: an array, or a ``Column``."""

    @property
    def shape(self) -> tuple[int, ...]: ...

    def __getitem__(self, place: tuple[Any, Any], /) -> Any: ...

    def __setitem__(self, place: tuple[Any, Any], value: Any, /) -> None: ...


class Column:
    """A column of an array, as a stage reads and writes it, of any kind of number.

    Attributes
    ----------
    rows
        The numbers by row.
    given
        Called with a row that is read before it is known.
    """

    def __init__(self, rows: dict[int, Any], given: Callable[[int], Any] | None = None) -> None:
        self.rows = rows
        self.given = given

    def __getitem__(self, place: tuple[Any, Any]) -> Any:
        if place[0] not in self.rows and self.given:
            self.rows[place[0]] = self.given(place[0])
        return self.rows[place[0]]

    def __setitem__(self, place: tuple[Any, Any], value: Any) -> None:
        self.rows[place[0]] = value
