"""From compiled Python functions to readable C99: the device functions of laws, networks and paths, not a copy of them.

The functions are written in a small part of Python: numbers, named tuples, arrays that they get, ``for`` over a range.
``Program.call`` follows one from its syntax tree. What is known, such as gains, sizes and places of entries, is computed
at once; what is left becomes C, one C function for each Python function and each set of known arguments, with the same
names and the same operations in the same order, so its bits are those of Python. LLVM code made by numba was the
alternative: it can be turned into C, but only into C that nobody can read, and only for doubles.

A value is known (a Python object), an ``Expression`` of C, an ``Array`` of C, or a ``Table`` of known numbers that C may
look up. Anything else in a function is refused.
"""

import ast
import inspect
import math
import re
import textwrap
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import FunctionType
from typing import Any, NamedTuple

import numpy as np
from numba.core.registry import CPUDispatcher
from numpy.typing import NDArray

from pter_gym._compiled import records
from pter_gym.errors import ParameterError

UNROLLED = 8
"""Most turns of a loop that is written out."""

ATOM, UNARY, PRODUCT, SUM, COMPARISON, AND, OR, CHOICE = 8, 7, 6, 5, 4, 3, 2, 1
"""How tightly operators bind."""

OPERATORS: dict[type[ast.AST], tuple[str, int]] = {
    ast.Add: ("+", SUM),
    ast.Sub: ("-", SUM),
    ast.Mult: ("*", PRODUCT),
    ast.Div: ("/", PRODUCT),
    ast.FloorDiv: ("/", PRODUCT),
    ast.Mod: ("%", PRODUCT),
    ast.BitAnd: ("&&", AND),
    ast.BitOr: ("||", OR),
    ast.Lt: ("<", COMPARISON),
    ast.LtE: ("<=", COMPARISON),
    ast.Gt: (">", COMPARISON),
    ast.GtE: (">=", COMPARISON),
    ast.Eq: ("==", COMPARISON),
    ast.NotEq: ("!=", COMPARISON),
    ast.And: ("&&", AND),
    ast.Or: ("||", OR),
}

TAKEN = {"tanh", "short", "long", "double", "float", "int", "real", "register", "default", "switch", "signed", "char"}
"""Names that a function or variable of C cannot have here."""


class Unsupported(ParameterError):
    """A function is written in a part of Python that is not translated."""


@dataclass(frozen=True)
class Expression:
    """A value that only the running program knows.

    ``kind`` is "real", "single", "int", "bool", a named tuple or a tuple of kinds. To the value of ``text``, which binds
    as ``level`` says, ``shift`` is added; of a whole number, that value is at least ``least``.
    """

    kind: Any
    text: str
    level: int = ATOM
    shift: int = 0
    least: int = 0


@dataclass(frozen=True)
class Array:
    """Numbers in memory, from ``offset`` on: stored as ``element``, read as ``reads``.

    If they count steps, ``step`` is what one is.
    """

    element: str
    base: str
    reads: str = "real"
    offset: Any = 0
    count: Any = 0
    step: float | None = None
    const: bool = True


class Region(NamedTuple):
    """A named part of a table, which C keeps as an array of its own: ``first`` … ``last`` − 1, as ``element``."""

    name: str
    first: int
    last: int
    element: str = "real"
    step: float | None = None


@dataclass(frozen=True, eq=False)
class Table:
    """Known numbers; those in regions may be looked up by the running program."""

    values: NDArray[np.float64]
    regions: tuple[Region, ...] = ()

    def part(self, first: int, last: int) -> "Table":
        """Return a part of the table."""
        inside = (each for each in self.regions if first <= each.first and each.last <= last)
        moved = tuple(each._replace(first=each.first - first, last=each.last - first) for each in inside)
        return Table(self.values[first:last], moved)


@dataclass
class Translated:
    """A function of C: its name, the kind of its value or the value itself if known, and what it needs."""

    name: str
    value: Any = None
    returns: Any = None
    writes: bool = False
    read: list[str] = field(default_factory=list[str])
    counted: list[str] = field(default_factory=list[str])
    text: str = ""


@dataclass(frozen=True)
class Observed:
    """The kind of a record with entries that come from an observation: they are float32 in compiled Python, too."""

    record: Any
    kinds: tuple[Any, ...]


def is_known(value: Any) -> bool:
    """Return whether a value is known: no part of it is of the running program."""
    if isinstance(value, tuple):
        return all(is_known(each) for each in value)
    return not isinstance(value, Expression | Array | Table)


def kind_of(value: Any) -> Any:
    """Return the kind of a value in C."""
    if isinstance(value, Expression):
        return value.kind
    if isinstance(value, tuple):
        return type(value) if hasattr(value, "_fields") else tuple(map(kind_of, value))
    if isinstance(value, Array | Table) or value is None:
        raise Unsupported(f"policies: C has no {value!r:.100}")
    return "bool" if isinstance(value, bool | np.bool_) else "int" if isinstance(value, int) else "real"


def fields_of(kind: Any) -> list[tuple[str, Any]]:
    """Return names and kinds of the entries of a record or a tuple."""
    if isinstance(kind, tuple):
        return [(f"e{k}", each) for k, each in enumerate(kind)]
    if isinstance(kind, Observed):
        return list(zip(kind.record._fields, kind.kinds, strict=True))
    return [(name, {float: "real", int: "int", bool: "bool"}.get(each, each)) for name, _, each in records.parts(kind)]


def name_of(kind: Any) -> str:
    """Return the name of a kind in C."""
    if isinstance(kind, tuple):
        return f"Real{len(kind)}" if set(kind) == {"real"} else "_".join(("Tuple", *map(name_of, kind)))
    if isinstance(kind, Observed):
        return f"Observed{kind.record.__name__}"
    return {"single": "float", "bool": "int"}.get(kind, kind) if isinstance(kind, str) else kind.__name__


def bound(value: Any, level: int) -> str:
    """Return an expression as text that binds at least as tightly as ``level``."""
    text = value.text
    at = value.level
    if value.shift:
        left = text if at >= SUM else f"({text})"
        text, at = f"{left} {'+' if value.shift > 0 else '-'} {abs(value.shift)}", SUM
    return text if at >= level else f"({text})"


class Program:
    """A file of C in the making: functions, the records and constants that they need, in order."""

    def __init__(self, elementary: Mapping[Any, Any], *, single: bool) -> None:
        self.elementary = elementary
        self.single = single
        self.kinds: list[Any] = []
        self.constants: dict[str, str] = {}
        self.functions: dict[Any, Translated] = {}

    def literal(self, value: Any, kind: Any) -> str:
        """Return a known value as C."""
        if isinstance(kind, str):
            if kind in ("int", "bool"):
                return str(int(value))
            if math.isnan(value):
                return "NOT_A_NUMBER"
            if self.single and 0.0 < abs(value) < 1e-9:
                value *= 2.0**29
            with np.errstate(over="ignore"):
                number = np.float32(value) if self.single or kind == "single" else np.float64(value)
            if np.isinf(number):
                return "INFINITE" if number > 0 else "-INFINITE"
            return str(number) + ("f" if self.single or kind == "single" else "")
        parts = zip(value, fields_of(kind), strict=True)
        return self.made(kind, [self.text(each, inner) for each, (_, inner) in parts])

    def made(self, kind: Any, parts: Sequence[str]) -> str:
        """Return a record of C from its entries."""
        return f"({self.declared(kind)}){{{', '.join(parts)}}}"

    def text(self, value: Any, kind: Any = None, level: int = 0) -> str:
        """Return any value as C of a kind."""
        if isinstance(value, Expression):
            return bound(value, level)
        kind = kind_of(value) if kind is None else kind
        if isinstance(value, tuple) and not is_known(value):
            return self.literal(value, kind)
        text = self.literal(value, kind)
        return f"({text})" if text.startswith("-") and level > SUM else text

    def declared(self, kind: Any) -> str:
        """Return the name of a kind, which the file will declare."""
        if not isinstance(kind, str) and kind not in self.kinds:
            for _, inner in fields_of(kind):
                self.declared(inner)
            if name_of(kind) in map(name_of, self.kinds):
                raise Unsupported(f"policies: C would have two records called {name_of(kind)}")
            self.kinds.append(kind)
        return name_of(kind)

    def looked_up(self, table: Table, at: Expression) -> Expression:
        """Return a number of a table at a place that only the running program knows."""
        first = at.shift + at.least
        region = next((each for each in table.regions if each.first <= first < each.last), None)
        if region is None:
            raise Unsupported(f"policies: no part of the gains is looked up at {first}")
        self.keep(table, region)
        text = f"{region.name}[{bound(replace(at, shift=at.shift - region.first), 0)}]"
        return self.counted(text, region.step)

    def counted(self, text: str, step: float | None) -> Expression:
        """Return a stored number, which may count steps."""
        if step is None:
            return Expression("real", text)
        return Expression("real", f"{self.literal(step, 'real')} * {text}", PRODUCT)

    def keep(self, table: Table, region: Region) -> None:
        """Keep a region of a table as an array of C."""
        if region.name in self.constants:
            return
        values = table.values[region.first : region.last]
        if region.step is not None:
            words = [str(round(value / region.step)) for value in values]
        else:
            words = [self.literal(value, "single" if region.element == "float" else "real") for value in values]
        lines = textwrap.wrap(", ".join(words), 116)
        body = "\n    ".join(lines)
        self.constants[region.name] = f"static const {region.element} {region.name}[{len(values)}] = {{\n    {body}\n}};"

    def call(self, function: Any, *arguments: Any, whole: bool = False) -> tuple[Any, str]:
        """Return the value of a Python function, and a statement of C that calls it if the value does not.

        What is known is computed at once; for the rest, the function is translated. Arguments that it does not read are
        left out, unless the file calls it with the ``whole`` of them.
        """
        python = getattr(function, "py_func", function)
        if all(is_known(each) for each in arguments):
            return python(*arguments), ""
        given = inspect.signature(python).bind(*arguments)
        given.apply_defaults()
        known: dict[str, Any] = {}
        passed: dict[str, Any] = {}
        for name, value in given.arguments.items():
            varies = isinstance(value, int | float | Expression | Array) or not (is_known(value) or isinstance(value, Table))
            (passed if varies else known)[name] = value
        key = python, tuple(known.items()), tuple((name, self.signature(value)) for name, value in passed.items())
        if key not in self.functions:
            names = [each.name for each in self.functions.values()]
            made = Translated(next(each for each in numbered(python.__name__) if each not in names))
            self.functions[key] = made
            Body(self, made, python, known, passed).translate(whole=whole)
            self.functions[key] = self.functions.pop(key)  # after those that it calls
        made = self.functions[key]
        texts = (self.argument(passed[name]) for name in made.read)
        counts = (self.text(passed[name].count, "int") for name in made.counted)
        text = f"{made.name}({', '.join((*texts, *counts))})"
        if made.returns is not None:
            return Expression(made.returns, text), ""
        return made.value, f"{text};" if made.writes else ""

    def signature(self, value: Any) -> Any:
        """Return what of an argument decides which translation is called."""
        return (value.element, value.step, value.const) if isinstance(value, Array) else kind_of(value)

    def argument(self, value: Any) -> str:
        """Return an argument as C."""
        if isinstance(value, Array):
            return value.base if value.offset == 0 else f"{value.base} + {self.text(value.offset, 'int', PRODUCT)}"
        return self.text(value)

    def source(self) -> str:
        """Return the records, constants and functions that are needed, in an order in which C can read them."""
        texts = [each for each in self.functions.values() if each.text]
        declarations: list[str] = []
        for kind in self.kinds:
            entries = "".join(f"    {name_of(inner)} {name};\n" for name, inner in fields_of(kind))
            declarations.append(f"typedef struct {{\n{entries}}} {name_of(kind)};")
        return "\n\n".join((*declarations, *self.constants.values(), *(each.text for each in texts)))


def numbered(name: str) -> Any:
    """Yield a name and others that differ by a number."""
    yield safe(name)
    yield from (f"{name}_{k}" for k in range(2, 1000))


def safe(name: str) -> str:
    """Return a name that C allows."""
    return f"{name}_" if name in TAKEN else name


@dataclass
class Line:
    """A statement of C: its text, the local variable that it declares, and whether it writes to an array."""

    text: str
    declares: str = ""
    writes: bool = False


class Body:
    """The body of one function in the making."""

    def __init__(
        self, program: Program, made: Translated, function: Any, known: dict[str, Any], passed: dict[str, Any]
    ) -> None:
        self.program, self.made, self.function = program, made, function
        (self.tree,) = ast.parse(textwrap.dedent(inspect.getsource(function))).body
        closure = inspect.getclosurevars(function)
        self.outer = {**closure.builtins, **closure.globals, **closure.nonlocals}
        self.names: dict[str, Any] = dict(known)
        self.stored = [node.id for node in ast.walk(self.tree) if isinstance(node, ast.Name) and type(node.ctx) is ast.Store]
        self.parameters: dict[str, str] = {}
        self.lines: list[Line] = []
        self.used: set[str] = set()
        self.depth, self.nested, self.touched = 1, 0, False
        for name, value in passed.items():
            self.used.add(safe(name))
            if isinstance(value, Array):
                self.names[name] = replace(value, base=safe(name), offset=0, count=Expression("int", f"{name}_count"))
                const = "const " if value.const else ""
                self.parameters[name] = f"{const}{value.element} *{safe(name)}"
            else:
                self.names[name] = Expression(kind_of(value), safe(name))
                self.parameters[name] = f"{program.declared(kind_of(value))} {safe(name)}"

    def translate(self, *, whole: bool) -> None:
        """Write the function, unless its value is known and it writes nothing."""
        made = self.made
        self.block(self.tree.body)
        if made.returns is None and not made.writes:
            return
        words = self.prune()
        made.read = [name for name in self.parameters if whole or safe(name) in words]
        given = [*(self.parameters[name] for name in made.read), *(f"int {name}_count" for name in made.counted)]
        head = f"static {self.program.declared(made.returns) if made.returns else 'void'} {made.name}"
        told = textwrap.wrap((inspect.getdoc(self.function) or "").partition("\n")[0], 116)
        comment = "/* " + "\n   ".join(told) + " */\n" if told else ""
        lines = "\n".join(line.text for line in self.lines)
        arguments = "\n    ".join(textwrap.wrap(", ".join(given), 112)) or "void"
        made.text = f"{comment}{head}({arguments})\n{{\n{lines}\n}}"

    def prune(self) -> list[str]:
        """Leave out variables that nothing reads, and return the words of what is left."""
        while True:
            words = [word for line in self.lines for word in re.findall(r"[A-Za-z_]\w*", line.text)]
            unread = [line for line in self.lines if line.declares and not line.writes and words.count(line.declares) == 1]
            if not unread:
                return words
            self.lines = [line for line in self.lines if line not in unread]

    def emit(self, text: str, declares: str = "") -> None:
        indent = "    " * self.depth
        lines = textwrap.wrap(text, 116, initial_indent=indent, subsequent_indent=indent + "    ", break_on_hyphens=False)
        self.lines.append(Line("\n".join(lines), declares, self.touched))
        self.made.writes |= self.touched
        self.touched = False

    def refuse(self, node: ast.AST) -> Unsupported:
        return Unsupported(f"policies: {self.function.__name__} cannot be translated to C: {ast.unparse(node):.100}")

    # --- statements ---

    def block(self, statements: Sequence[ast.stmt]) -> bool:
        """Translate statements; return whether what follows them is never reached."""
        return any(self.statement(each) for each in statements)

    def statement(self, node: ast.stmt) -> bool:
        match node:
            case ast.Expr(value=ast.Constant()) | ast.Pass():
                return False
            case ast.Expr(value=value):
                found = self.value(value)
                if isinstance(found, Expression):
                    self.emit(f"{found.text};")
            case ast.Return():
                self.give_back(None if node.value is None else self.value(node.value))
                return True
            case ast.Assign(targets=[target], value=value):
                self.assign(target, self.value(value))
            case ast.AugAssign(target=target, op=op, value=value):
                read = ast.parse(ast.unparse(target), mode="eval").body
                self.assign(target, self.operation(op, self.value(read), self.value(value), node))
            case ast.If():
                return self.branch(node)
            case ast.For(target=ast.Name(id=name), iter=ast.Call(func=ast.Name(id="range"), args=args)):
                self.loop(name, [self.value(each) for each in args], node)
            case ast.Break():
                self.emit("break;")
                return True
            case _:
                raise self.refuse(node)
        return False

    def give_back(self, value: Any) -> None:
        """Return a value; one that is known is told to the caller and not returned by C."""
        made, program = self.made, self.program
        if value is None or (is_known(value) and not self.nested and made.returns is None):
            made.value = value
            return
        made.returns = made.returns or kind_of(value)
        self.emit(f"return {program.text(value, made.returns)};")

    def assign(self, target: ast.expr, value: Any) -> None:
        match target:
            case ast.Name(id=name):
                self.name(name, value)
            case ast.Subscript(value=array, slice=index):
                place, at = self.value(array), self.value(index)
                if not isinstance(place, Array) or place.const:
                    raise self.refuse(target)
                self.touched = True
                self.emit(f"{self.entry(place, at)} = {self.program.text(value, 'real')};")
            case ast.Tuple(elts=targets):
                if isinstance(value, Expression):
                    whole = self.variable("pair", value)
                    parts = [Expression(kind, f"{whole.text}.{name}") for name, kind in fields_of(value.kind)]
                else:
                    parts = [self.variable("new", each) if self.changes(each, targets) else each for each in value]
                for each, part in zip(targets, parts, strict=True):
                    self.assign(each, part)
            case _:
                raise self.refuse(target)

    def changes(self, value: Any, targets: list[ast.expr]) -> bool:
        """Return whether a value might be read after one of several targets has been assigned to."""
        text = value.text if isinstance(value, Expression) else ""
        words = set(re.findall(r"(?<!\.)\b[A-Za-z_]\w*", text))
        names = {node.id for each in targets for node in ast.walk(each) if isinstance(node, ast.Name)}
        return bool(words & {safe(name) for name in names})

    def name(self, name: str, value: Any) -> None:
        """Give a name a value: a variable of C where only the running program knows it."""
        before = self.names.get(name)
        if isinstance(value, tuple) and not is_known(value) and not hasattr(value, "_fields"):
            value = Expression(kind_of(value), self.program.text(value))
        if isinstance(before, Expression) and (self.is_number(value) or isinstance(value, Expression)):
            if before.kind == kind_of(value) or self.is_number(value):
                self.emit(f"{before.text} = {self.program.text(value, before.kind)};")
                return
        if isinstance(value, Expression):
            value = self.variable(name, value)
        elif isinstance(value, Array) and value.base in self.used | set(self.program.constants) and value.offset != 0:
            const = "const " if value.const else ""
            fresh = self.fresh(name)
            self.emit(f"{const}{value.element} *{fresh} = {self.program.argument(value)};", fresh)
            value = replace(value, base=fresh, offset=0)
        self.names[name] = value

    def is_number(self, value: Any) -> bool:
        return isinstance(value, int | float)

    def fresh(self, name: str) -> str:
        found = next(each for each in numbered(name) if each not in self.used)
        self.used.add(found)
        return found

    def variable(self, name: str, value: Any) -> Expression:
        """Declare a variable of C with a value."""
        kind, fresh, shift = kind_of(value), self.fresh(name), 0
        if kind == "int" and isinstance(value, Expression) and self.stored.count(name) == 1:
            value, shift = replace(value, shift=0), value.shift
        self.emit(f"{self.program.declared(kind)} {fresh} = {self.program.text(value, kind)};", fresh)
        return Expression(kind, fresh, shift=shift)

    def unknown(self, statements: Sequence[ast.stmt]) -> None:
        """Make variables of C of the numbers that statements may change."""
        for node in (inner for each in statements for inner in ast.walk(each)):
            if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store) and node.id in self.names:
                value = self.names[node.id]
                if self.is_number(value) or (isinstance(value, tuple) and is_known(value)):
                    self.names[node.id] = self.variable(node.id, value)

    def inside(self, statements: Sequence[ast.stmt]) -> bool:
        """Translate statements that may not run, or run several times."""
        before, used = set(self.names), set(self.used)
        self.depth += 1
        self.nested += 1
        ended = self.block(statements)
        self.depth -= 1
        self.nested -= 1
        self.names = {name: value for name, value in self.names.items() if name in before}
        self.used = used
        return ended

    def branch(self, node: ast.If) -> bool:
        condition = self.value(node.test)
        if is_known(condition):
            return self.block(node.body if condition else node.orelse)
        self.unknown([*node.body, *node.orelse])
        self.emit(f"if ({condition.text}) {{")
        ended = self.inside(node.body)
        if node.orelse:
            self.emit("} else {")
            ended &= self.inside(node.orelse)
        self.emit("}")
        return ended and bool(node.orelse)

    def loop(self, name: str, given: list[Any], node: ast.For) -> None:
        start, stop, step = [0, *given, 1] if len(given) == 1 else [*given, 1] if len(given) == 2 else given
        turns = range(start, stop, step) if is_known((start, stop, step)) else None
        breaks = any(isinstance(each, ast.Break) for each in ast.walk(node))
        if turns is not None and len(turns) <= UNROLLED and not breaks:
            for turn in turns:
                self.names[name] = turn
                self.block(node.body)
            return
        self.unknown(node.body)
        used, fresh = set(self.used), self.fresh("turn" if name == "_" else name)
        self.names[name] = Expression("int", fresh, least=min(turns) if turns else 0)
        change = {1: f"{fresh}++", -1: f"{fresh}--"}.get(step, f"{fresh} += {step}")
        texts = self.program.text(start, "int"), self.program.text(stop, "int", SUM)
        self.emit(f"for (int {fresh} = {texts[0]}; {fresh} {'<' if step > 0 else '>'} {texts[1]}; {change}) {{")
        self.inside(node.body)
        self.emit("}")
        del self.names[name]
        self.used = used

    # --- expressions ---

    def value(self, node: ast.expr) -> Any:
        """Return the value of an expression."""
        match node:
            case ast.Constant(value=value):
                return value
            case ast.Name(id=name):
                if name not in self.names and name not in self.outer:
                    raise self.refuse(node)
                return self.names[name] if name in self.names else self.outer[name]
            case ast.Tuple(elts=parts):
                return tuple(self.value(each) for each in parts)
            case ast.Attribute(value=owner, attr=name):
                return self.attribute(self.value(owner), name, node)
            case ast.UnaryOp(op=op, operand=operand):
                return self.turned(op, self.value(operand), node)
            case ast.BinOp(op=op, left=left, right=right):
                return self.operation(op, self.value(left), self.value(right), node)
            case ast.Compare(left=left, ops=[op], comparators=[right]):
                return self.operation(op, self.value(left), self.value(right), node)
            case ast.BoolOp(op=op, values=values):
                found = self.value(values[0])
                for each in values[1:]:
                    found = self.operation(op, found, self.value(each), node)
                return found
            case ast.IfExp(test=test, body=body, orelse=orelse):
                return self.chosen(self.value(test), lambda: self.value(body), lambda: self.value(orelse))
            case ast.Subscript(value=owner, slice=ast.Slice(lower=lower, upper=upper)):
                ends = (0 if each is None else self.value(each) for each in (lower, upper))
                return self.sliced(self.value(owner), *ends, node)
            case ast.Subscript(value=owner, slice=index):
                return self.indexed(self.value(owner), self.value(index), node)
            case ast.Call(func=function, args=arguments, keywords=keywords):
                named = {each.arg: self.value(each.value) for each in keywords}
                return self.called(self.value(function), [self.value(each) for each in arguments], named, node)
            case _:
                raise self.refuse(node)

    def attribute(self, owner: Any, name: str, node: ast.expr) -> Any:
        match owner:
            case Expression(kind=kind):
                return Expression(dict(fields_of(kind))[name], f"{bound(owner, ATOM)}.{name}")
            case Array() | Table() if name == "shape":
                return (self.length(owner),)
            case Array() | Table():
                raise self.refuse(node)
            case _:
                return getattr(owner, name)

    def length(self, owner: Any) -> Any:
        if isinstance(owner, Table):
            return len(owner.values)
        if isinstance(owner, Array):
            name = owner.base
            if isinstance(owner.count, Expression) and owner.count.text == f"{name}_count":
                self.made.counted += [] if name in self.made.counted else [name]
            return owner.count
        return len(owner)

    def turned(self, op: ast.unaryop, value: Any, node: ast.expr) -> Any:
        if is_known(value):
            return -value if isinstance(op, ast.USub) else not value
        match op:
            case ast.USub():
                return Expression(value.kind, f"-{bound(value, UNARY)}", UNARY)
            case ast.Not():
                return Expression("bool", f"!{bound(value, UNARY)}", UNARY)
            case _:
                raise self.refuse(node)

    def operation(self, op: ast.AST, left: Any, right: Any, node: ast.AST) -> Any:
        """Return what an operator makes of two values."""
        if is_known(left) and is_known(right):
            plain = {"left": left, "right": right}
            if isinstance(op, ast.operator):
                tree: Any = ast.BinOp(ast.Name("left", ast.Load()), op, ast.Name("right", ast.Load()))
            elif isinstance(op, ast.boolop):
                tree = ast.BoolOp(op, [ast.Name("left", ast.Load()), ast.Name("right", ast.Load())])
            else:
                tree = ast.Compare(ast.Name("left", ast.Load()), [op], [ast.Name("right", ast.Load())])
            return eval(compile(ast.fix_missing_locations(ast.Expression(tree)), "", "eval"), plain)
        if type(op) in (ast.Is, ast.IsNot):
            return isinstance(op, ast.IsNot)
        if type(op) not in OPERATORS:
            raise self.refuse(node)
        sign, level = OPERATORS[type(op)]
        kinds = {kind_of(left), kind_of(right)}
        if level in (AND, OR):
            return self.logic(sign, level, left, right)
        kind = "real" if "real" in kinds else "single" if "single" in kinds else "int"
        if kind == "int" and isinstance(op, ast.Add | ast.Sub) and is_known(right):
            return replace(left, shift=left.shift + (right if isinstance(op, ast.Add) else -right))
        if kind == "int" and isinstance(op, ast.Add) and is_known(left):
            return replace(right, shift=right.shift + left)
        if level == COMPARISON:
            return Expression("bool", f"{self.side(left, kind, SUM)} {sign} {self.side(right, kind, SUM)}", COMPARISON)
        cast = "(real)" if isinstance(op, ast.Div) and kind == "int" else ""
        kind = "real" if cast else kind
        return Expression(kind, f"{cast}{self.side(left, kind, level)} {sign} {self.side(right, kind, level + 1)}", level)

    def side(self, value: Any, kind: str, level: int) -> str:
        """Return one side of an operator; a known number gets the kind of the result."""
        return self.program.text(value, kind if is_known(value) else None, level)

    def logic(self, sign: str, level: int, left: Any, right: Any) -> Any:
        for known, other in ((left, right), (right, left)):
            if is_known(known):
                return other if bool(known) == (level == AND) else known
        texts = (bound(each, level if each.level == level else COMPARISON) for each in (left, right))
        return Expression("bool", f" {sign} ".join(texts), level)

    def chosen(self, condition: Any, first: Callable[[], Any], second: Callable[[], Any]) -> Any:
        """Return one value or another."""
        if is_known(condition):
            return first() if condition else second()
        return self.choice(condition, first(), second())

    def choice(self, condition: Any, a: Any, b: Any) -> Any:
        if isinstance(a, tuple) and isinstance(b, tuple):
            pairs = tuple(self.choice(condition, x, y) for x, y in zip(a, b, strict=True))
            return type(a)(*pairs) if hasattr(a, "_fields") else pairs
        kinds = [kind_of(a), kind_of(b)]
        kind = "real" if "real" in kinds else kinds[0]
        test, texts = bound(condition, OR), [self.program.text(each, kind, CHOICE + 1) for each in (a, b)]
        return Expression(kind, f"{test} ? {texts[0]} : {texts[1]}", CHOICE)

    def entry(self, array: Array, at: Any) -> str:
        place = self.operation(ast.Add(), array.offset, at, ast.Pass())
        return f"{array.base}[{self.program.text(place, 'int')}]"

    def indexed(self, owner: Any, at: Any, node: ast.expr) -> Any:
        """Return an entry of an array, a table, a record or a tuple."""
        if isinstance(owner, Array):
            text = self.entry(owner, at)
            return self.program.counted(text, owner.step) if owner.step else Expression(owner.reads, text)
        if isinstance(owner, Table):
            return float(owner.values[at]) if is_known(at) else self.program.looked_up(owner, at)
        parts = self.entries(owner)
        if is_known(at):
            return parts[at]
        found = parts[-1]
        for k in range(len(parts) - 2, -1, -1):
            found = self.choice(self.operation(ast.Eq(), at, k, node), parts[k], found)
        return found

    def entries(self, owner: Any) -> tuple[Any, ...]:
        if isinstance(owner, tuple):
            return owner
        return tuple(Expression(kind, f"{bound(owner, ATOM)}.{name}") for name, kind in fields_of(owner.kind))

    def sliced(self, owner: Any, first: Any, last: Any, node: ast.expr) -> Any:
        if isinstance(owner, Table) and is_known((first, last)):
            for each in owner.regions:
                if each.element != "real" and each.first <= first and last <= each.last:
                    self.program.keep(owner, each)
                    return Array(each.element, each.name, "real", first - each.first, last - first, each.step)
            return owner.part(first, last)
        if not isinstance(owner, Array):
            raise self.refuse(node)
        offset = self.operation(ast.Add(), owner.offset, first, node)
        return replace(owner, offset=offset, count=self.operation(ast.Sub(), last, first, node))

    def called(self, function: Any, arguments: list[Any], named: dict[str, Any], node: ast.expr) -> Any:
        """Return the value of a call."""
        if isinstance(function, type) and hasattr(function, "_fields"):
            return self.record(function, arguments, named)
        if function in (records.read, records.write):
            return getattr(self, function.__name__)(*arguments)
        if getattr(function, "__name__", "") == "each" and function.__module__ == records.__name__:
            return self.entrywise(function, arguments)
        if function in PLAIN:
            if all(map(is_known, arguments)):
                return function(*arguments)
            return self.plain(function, arguments)
        if function is len:
            return self.length(*arguments)
        function = self.program.elementary.get(function, function)
        if not isinstance(function, FunctionType | CPUDispatcher):
            raise self.refuse(node)
        value, statement = self.program.call(function, *arguments)
        made = next((each for each in self.program.functions.values() if each.name == self.callee(value, statement)), None)
        self.touched |= made is not None and made.writes
        if statement:
            self.emit(statement)
        return value

    def callee(self, value: Any, statement: str) -> str:
        text = value.text if isinstance(value, Expression) else statement
        return text.partition("(")[0]

    def record(self, kind: Any, arguments: list[Any], named: dict[str, Any]) -> Any:
        made = kind(*arguments, **named)
        if is_known(made):
            return made
        usual = [each for _, each in fields_of(kind)]
        kinds = tuple(k if k == "single" or isinstance(k, Observed) else u for k, u in zip(map(kind_of, made), usual, strict=True))
        seen = Observed(kind, kinds) if kinds != tuple(usual) else kind
        return Expression(seen, self.program.literal(tuple(made), seen))

    def read(self, array: Any, at: Any, first: Any) -> Any:
        """Return a record from an array; see ``pter_gym._compiled.records``."""
        if not isinstance(at, tuple):
            return self.indexed(array, self.operation(ast.Add(), first, at, ast.Pass()), ast.Constant(at))
        return self.record(type(at), [self.read(array, each, first) for each in at], {})

    def write(self, array: Any, at: Any, value: Any) -> None:
        """Write a record to an array; see ``pter_gym._compiled.records``."""
        if isinstance(value, Expression) and not value.text.isidentifier():
            value = self.variable("record", value)
        for place, part in zip(at, self.entries(value), strict=True):
            if isinstance(place, tuple):
                self.write(array, place, part)
            else:
                self.touched = True
                self.emit(f"{self.entry(array, place)} = {self.program.text(part, 'real')};")

    def entrywise(self, function: Any, arguments: list[Any]) -> Any:
        """Return what a scalar function makes of each entry of records."""
        told = inspect.getclosurevars(function).nonlocals
        is_record = [
            varies and (isinstance(value, tuple) or (isinstance(value, Expression) and not isinstance(value.kind, str)))
            for value, varies in zip(arguments, told["varies"], strict=True)
        ]
        if not any(is_record):
            return self.called(told["scalar"], arguments, {}, ast.Pass())
        held = [
            self.variable("record", value)
            if whole and isinstance(value, Expression) and not re.fullmatch(r"[\w.]+", value.text)
            else value
            for value, whole in zip(arguments, is_record, strict=True)
        ]
        kind = kind_of(held[is_record.index(True)])
        kind = kind.record if isinstance(kind, Observed) else kind
        columns = [self.entries(value) if whole else (value,) * len(kind._fields) for value, whole in zip(held, is_record, strict=True)]
        return self.record(kind, [self.entrywise(function, list(row)) for row in zip(*columns, strict=True)], {})

    def plain(self, function: Any, arguments: list[Any]) -> Any:
        """Return the value of a function that C has as an expression."""
        first = arguments[0]
        if function is int:
            return first if kind_of(first) == "int" else Expression("int", f"(int){bound(first, UNARY)}", UNARY)
        if function is float:
            is_real = kind_of(first) in ("real", "single")  # numba, too, leaves a float32 as it is
            return first if is_real else Expression("real", f"(real){bound(first, UNARY)}", UNARY)
        if function is np.float32:
            return Expression("single", f"(float){bound(first, UNARY)}", UNARY)
        if function in (abs, math.sqrt):
            name = "magnitude" if function is abs else "square_root"
            return Expression("real", f"{name}({self.program.text(first, 'real')})")
        name = "larger" if function is max else "smaller"
        found = first
        for each in arguments[1:]:
            found = Expression("real", f"{name}({self.program.text(found, 'real')}, {self.program.text(each, 'real')})")
        return found


PLAIN: tuple[Any, ...] = (int, float, bool, abs, max, min, np.float32, math.sqrt)
"""Functions that are expressions of C, or small functions of every file."""
