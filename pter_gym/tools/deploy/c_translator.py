"""From compiled Python functions to readable C99: inlined functions of laws, networks and paths.

These are written in a small part of Python: numbers, named tuples, arrays that they get, ``for``
over a range. ``Program.call`` follows one from its syntax tree. What is known, such as gains, sizes
and places of entries, is computed at once. The rest becomes C: a C function for each Python
function and each set of known arguments, with the same names and the same operations in the same
order, so it has the bits of compiled Python. (C from numba's LLVM code would be unreadable, and
float64 alone.) Anything else is refused.
"""

import ast
import inspect
import itertools
import math
import operator
import re
import textwrap
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import FunctionType
from typing import Any

import numpy as np
from numba.core.registry import CPUDispatcher

from pter_gym._compiled import records
from pter_gym.tools.deploy.values import (
    AND,
    ATOM,
    CHOICE,
    COMPARISON,
    OR,
    PRODUCT,
    SUM,
    UNARY,
    Array,
    ConstantTable,
    Expression,
    Observed,
    Region,
    Unsupported,
    bound,
    fields_of,
    is_known,
    is_number,
    is_record,
    kind_of,
    name_of,
)

UNROLLED = 8
"""Most turns of a loop that is written out."""

TOLERANCE, SINGLE_FACTOR = 1e-9, 2.0**29
"""Smaller constants are tolerances for rounding, so many times as large in float32."""

OPERATORS: dict[type[ast.AST], tuple[str, int, Callable[[Any, Any], Any]]] = {
    ast.Add: ("+", SUM, operator.add),
    ast.Sub: ("-", SUM, operator.sub),
    ast.Mult: ("*", PRODUCT, operator.mul),
    ast.Div: ("/", PRODUCT, operator.truediv),
    ast.FloorDiv: ("", PRODUCT, operator.floordiv),
    ast.Mod: ("%", PRODUCT, operator.mod),
    ast.BitAnd: ("&&", AND, operator.and_),
    ast.And: ("&&", AND, operator.and_),
    ast.BitOr: ("||", OR, operator.or_),
    ast.Or: ("||", OR, operator.or_),
    ast.Lt: ("<", COMPARISON, operator.lt),
    ast.LtE: ("<=", COMPARISON, operator.le),
    ast.Gt: (">", COMPARISON, operator.gt),
    ast.GtE: (">=", COMPARISON, operator.ge),
    ast.Eq: ("==", COMPARISON, operator.eq),
    ast.NotEq: ("!=", COMPARISON, operator.ne),
    ast.Is: ("", COMPARISON, operator.is_),
    ast.IsNot: ("", COMPARISON, operator.is_not),
}
"""Operators in C, how tightly they bind there, and what they do.

Whole numbers that are divided are not negative.
"""

PLAIN: dict[Any, str] = {
    int: "(int32_t)",
    float: "",
    np.float32: "(float)",
    abs: "magnitude",
    math.sqrt: "square_root",
    max: "larger",
    min: "smaller",
}
"""Functions that every file has, or casts; numba's ``float``, too, leaves a float32 as it is."""

CHOSEN = "chosen"
"""What a function of C calls the number of the table that it reads, of several."""

TAKEN = {
    "char",
    "default",
    "double",
    "float",
    "int",
    "long",
    "real",
    "register",
    "short",
    "signed",
    "switch",
    "tanh",
}
"""Names of C."""


@dataclass
class Translated:
    """A function of C: ``returns`` is the kind of its value, or None if that is the ``value``."""

    name: str
    value: Any = None
    returns: Any = None
    writes: bool = False
    reads: list[str] = field(default_factory=list[str])
    counted: list[str] = field(default_factory=list[str])
    text: str = ""


class Program:
    """A file of C in the making: functions, and the records and constants that they need.

    Parameters
    ----------
    elementary
        Python functions that take the place of others, such as those of ``math``.
    single
        Whether numbers are float32.
    """

    def __init__(self, elementary: Mapping[Any, Any], *, single: bool) -> None:
        self.elementary = elementary
        self.single = single
        self.kinds: list[Any] = []
        self.constants: dict[str, str] = {}
        self.functions: dict[Any, Translated] = {}

    def call(
        self, function: Any, *arguments: Any, whole: bool = False, chosen: Any = None
    ) -> tuple[Any, str, bool]:
        """Return a function's value, a statement that calls it if the value does not, if it writes.

        What is known is computed at once; for the rest, the function is translated. Arguments that
        it does not read are left out, unless the file calls it with the ``whole`` of them. It reads
        the ``chosen`` one of several tables.
        """
        python = getattr(function, "py_func", function)
        if all(is_known(each) for each in arguments):
            return python(*arguments), "", False
        by_name = inspect.signature(python).bind(*arguments)
        by_name.apply_defaults()
        known: dict[str, Any] = {}
        passed: dict[str, Any] = {}
        for name, value in by_name.arguments.items():
            varies = is_number(value) or not (is_known(value) or isinstance(value, ConstantTable))
            (passed if varies else known)[name] = value
        tables = (each for each in known.values() if isinstance(each, ConstantTable))
        if any(each.values.ndim > 1 for each in tables):
            passed[CHOSEN] = chosen
        key = (
            python,
            tuple(known.items()),
            tuple((name, self._signature(value)) for name, value in passed.items()),
        )
        if key not in self.functions:
            names = [each.name for each in self.functions.values()]
            translation = Translated(
                next(each for each in numbered(python.__name__) if each not in names)
            )
            self.functions[key] = translation
            _Body(self, translation, python, known, passed).translate(whole=whole)
            self.functions[key] = self.functions.pop(key)  # after those that it calls
        translation = self.functions[key]
        texts = (
            self.pointer(each) if isinstance(each, Array) else self.text(each)
            for each in map(passed.get, translation.reads)
        )
        counts = (self.text(passed[name].count, "int") for name in translation.counted)
        call = f"{translation.name}({', '.join((*texts, *counts))})"
        if translation.returns is not None:
            return Expression(translation.returns, call), "", translation.writes
        return translation.value, f"{call};" if translation.writes else "", translation.writes

    def _signature(self, value: Any) -> Any:
        return (
            (value.element, value.step, value.const) if isinstance(value, Array) else kind_of(value)
        )

    def pointer(self, array: Array) -> str:
        """Return where an array begins."""
        return (
            array.base
            if array.offset == 0
            else f"{array.base} + {self.text(array.offset, 'int', PRODUCT)}"
        )

    def literal(self, value: Any, kind: Any) -> str:
        """Return a number, or a record or tuple of any values, as C."""
        if not isinstance(kind, str):
            parts = zip(value, fields_of(kind), strict=True)
            texts = ", ".join(self.text(part, inner) for part, (_, inner) in parts)
            return f"({self.declared(kind)}){{{texts}}}"
        if kind in ("int", "bool"):
            return str(int(value))
        if math.isnan(value):
            return "NOT_A_NUMBER"
        single = self.single or kind == "single"
        with np.errstate(over="ignore"):
            number = np.float32(value) if single else np.float64(value)
        text = str(number) + ("f" if single else "")
        return text if np.isfinite(number) else "INFINITE" if number > 0 else "-INFINITE"

    def text(self, value: Any, kind: Any = None, level: int = 0) -> str:
        """Return a value, a known one as a ``kind``, as C that binds as tightly as ``level``."""
        if isinstance(value, Expression):
            whole = value.kind in ("int", "bool") and kind in ("real", "single")
            return f"({name_of(kind)}){bound(value, ATOM)}" if whole else bound(value, level)
        text = self.literal(value, kind_of(value) if kind is None else kind)
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

    def stored(self, text: str, step: float | None, kind: str = "real") -> Expression:
        """Return a stored number, which may count steps."""
        return (
            Expression(kind, text)
            if step is None
            else Expression("real", f"{self.literal(step, 'real')} * {text}", PRODUCT)
        )

    def keep(self, table: ConstantTable, region: Region) -> None:
        """Keep a region of a table as an array of C."""
        kind = "single" if region.element == "float" else "real"
        tables = np.atleast_2d(table.values)[:, region.first : region.last]
        differ = table.differ(region.first, region.last)
        values = (tables if differ else tables[0]).ravel().tolist()
        words = (
            str(round(each / region.step)) if region.step else self.literal(each, kind)
            for each in values
        )
        body = textwrap.fill(", ".join(words), 116, initial_indent="    ", subsequent_indent="    ")
        self.constants[region.name] = (
            f"static const {region.element} {region.name}[{len(values)}] = {{\n{body}\n}};"
        )

    def source(self) -> str:
        """Return the records, constants and functions, in an order in which C can read them."""
        declarations: list[str] = []
        for kind in self.kinds:
            entries = "".join(f"    {name_of(inner)} {name};\n" for name, inner in fields_of(kind))
            declarations.append(f"typedef struct {{\n{entries}}} {name_of(kind)};")
        texts = (each.text for each in self.functions.values() if each.text)
        return "\n\n".join((*declarations, *self.constants.values(), *texts))


def numbered(name: str) -> Iterator[str]:
    """Yield a name that C allows, and others that differ by a number."""
    yield f"{name}_" if name in TAKEN else name
    yield from (f"{name}_{k}" for k in itertools.count(2))


@dataclass
class _Line:
    """A statement of C, the local variable that it declares, and whether it writes to an array."""

    text: str
    declares: str = ""
    writes: bool = False


class _Body:
    """The body of one function in the making."""

    def __init__(
        self,
        program: Program,
        made: Translated,
        function: Any,
        known: dict[str, Any],
        passed: dict[str, Any],
    ) -> None:
        self.program, self.made, self.function = program, made, function
        self.tree: Any = ast.parse(textwrap.dedent(inspect.getsource(function))).body[0]
        names = (node for node in ast.walk(self.tree) if isinstance(node, ast.Name))
        self.stored = [node.id for node in names if isinstance(node.ctx, ast.Store)]
        closure = inspect.getclosurevars(function)
        self.names: dict[str, Any] = {
            **closure.builtins,
            **closure.globals,
            **closure.nonlocals,
            **known,
        }
        self.parameters: dict[str, str] = {}
        self.lines: list[_Line] = []
        self.used: set[str] = set()
        self.depth, self.touched = 1, False
        for name, value in passed.items():
            called = self._fresh(name)
            if isinstance(value, Array):
                self.names[name] = replace(
                    value, base=called, offset=0, count=Expression("int", f"{name}_count")
                )
                self.parameters[name] = (
                    f"{'const ' if value.const else ''}{value.element} *{called}"
                )
            else:
                self.names[name] = Expression(kind_of(value), called)
                self.parameters[name] = f"{program.declared(kind_of(value))} {called}"
        self.chosen: Any = self.names[CHOSEN] if CHOSEN in passed else None

    def translate(self, *, whole: bool) -> None:
        """Write the function, unless its value is known and it writes nothing."""
        made = self.made
        self._block(self.tree.body)
        if made.returns is None and not made.writes:
            return
        words = self._prune()
        made.reads = [name for name in self.parameters if whole or next(numbered(name)) in words]
        parameters = [
            *(self.parameters[name] for name in made.reads),
            *(f"int32_t {name}_count" for name in made.counted),
        ]
        returns = self.program.declared(made.returns) if made.returns else "void"
        head = f"static {returns} {made.name}"
        summary = (inspect.getdoc(self.function) or "").partition("\n")[0]
        comment = textwrap.fill(summary, 116, subsequent_indent="   ")
        arguments = textwrap.fill(", ".join(parameters) or "void", 112, subsequent_indent="    ")
        lines = "\n".join(line.text for line in self.lines)
        made.text = f"/* {comment} */\n{head}({arguments})\n{{\n{lines}\n}}"

    def _prune(self) -> list[str]:
        """Leave out variables that nothing reads, and return the words of what is left."""
        while True:
            words = [word for line in self.lines for word in re.findall(r"[A-Za-z_]\w*", line.text)]
            unread = [
                each
                for each in self.lines
                if each.declares and not each.writes and words.count(each.declares) == 1
            ]
            if not unread:
                return words
            self.lines = [line for line in self.lines if line not in unread]

    def _emit(self, text: str, declares: str = "") -> None:
        indent = "    " * self.depth
        text = textwrap.fill(
            text,
            116,
            initial_indent=indent,
            subsequent_indent=indent + "    ",
            break_on_hyphens=False,
        )
        self.lines.append(_Line(text, declares, self.touched))
        self.made.writes |= self.touched
        self.touched = False

    def _refuse(self, construct: ast.AST | str) -> Unsupported:
        text = construct if isinstance(construct, str) else ast.unparse(construct)
        return Unsupported(
            f"policies: {self.function.__name__} cannot be translated to C: {text:.100}"
        )

    # --- statements ---

    def _block(self, statements: Sequence[ast.stmt]) -> bool:
        """Translate statements; return whether what follows them is never reached."""
        return any(self._statement(each) for each in statements)

    def _statement(self, node: ast.stmt) -> bool:
        match node:
            case ast.Expr(value=ast.Constant()):
                return False
            case ast.Expr(value=value):
                result = self._value(value)
                if isinstance(result, Expression):
                    self._emit(f"{result.text};")
            case ast.Return(value=value):
                self._give_back(None if value is None else self._value(value))
                return True
            case ast.Assign(targets=[target], value=value):
                self._assign(target, self._value(value))
            case ast.AugAssign(target=target, op=op, value=value):
                before = self._value(ast.parse(ast.unparse(target), mode="eval").body)
                self._assign(target, self._operation(op, before, self._value(value)))
            case ast.If():
                return self._branch(node)
            case ast.For(
                target=ast.Name(id=name), iter=ast.Call(func=ast.Name(id="range"), args=args)
            ):
                self._loop(name, [self._value(each) for each in args], node)
            case ast.Break():
                self._emit("break;")
                return True
            case _:
                raise self._refuse(node)
        return False

    def _give_back(self, value: Any) -> None:
        """Return a value; a known one goes to the caller of the translator, not through C."""
        made = self.made
        if value is None or (is_known(value) and self.depth == 1 and made.returns is None):
            made.value = value
            return
        made.returns = made.returns or kind_of(value)
        self._check(kind_of(value), made.returns, "return")
        self._emit(f"return {self.program.text(value, made.returns)};")

    def _check(self, kind: Any, wanted: Any, place: str) -> None:
        """Refuse a value that C would convert to another kind, except numbers to real ones."""
        if kind != wanted and not (wanted == "real" and isinstance(kind, str)):
            raise self._refuse(place)

    def _assign(self, target: ast.expr, value: Any) -> None:
        match target:
            case ast.Name(id=name):
                self._name(name, value)
            case ast.Subscript(value=array, slice=index):
                self._store(self._value(array), self._value(index), value)
            case ast.Tuple(elts=targets):
                if isinstance(value, Expression):
                    whole = self._variable("pair", value)
                    parts = [
                        Expression(kind, f"{whole.text}.{name}")
                        for name, kind in fields_of(value.kind)
                    ]
                else:
                    parts = [
                        self._variable("new", each) if self._changes(each, targets) else each
                        for each in value
                    ]
                for each, part in zip(targets, parts, strict=True):
                    self._assign(each, part)
            case _:
                raise self._refuse(target)

    def _store(self, array: Any, at: Any, value: Any) -> None:
        self.touched = True
        self._emit(f"{self._entry(array, at)} = {self.program.text(value, 'real')};")

    def _changes(self, value: Any, targets: list[ast.expr]) -> bool:
        """Return whether a value might be read after one of several targets is assigned."""
        text = value.text if isinstance(value, Expression) else ""
        words = set(re.findall(r"(?<!\.)\b[A-Za-z_]\w*", text))
        names = (
            node.id for each in targets for node in ast.walk(each) if isinstance(node, ast.Name)
        )
        return bool(words & {next(numbered(name)) for name in names})

    def _name(self, name: str, value: Any) -> None:
        """Give a name a value: a variable of C where only the running program knows it."""
        before = self.names.get(name)
        if not is_known(value) and isinstance(value, tuple):
            value = Expression(kind_of(value), self.program.text(value))
        varies = isinstance(value, Expression)
        if (
            isinstance(before, Expression)
            and (is_number(value) or varies)
            and before.kind in ("real", kind_of(value))
        ):
            self._emit(f"{before.text} = {self.program.text(value, before.kind)};")
            return
        if varies:
            value = self._variable(name, value)
        elif isinstance(value, Array) and value.offset != 0:
            called = self._fresh(name)
            const = "const " if value.const else ""
            self._emit(f"{const}{value.element} *{called} = {self.program.pointer(value)};", called)
            value = replace(value, base=called, offset=0)
        self.names[name] = value

    def _fresh(self, name: str) -> str:
        found = next(each for each in numbered(name) if each not in self.used)
        self.used.add(found)
        return found

    def _variable(self, name: str, value: Any) -> Expression:
        """Declare a variable of C with a value; where in a table a place lies stays known."""
        self.used |= self.program.constants.keys()
        kind, called, shift = kind_of(value), self._fresh(name), 0
        if kind == "int" and isinstance(value, Expression) and self.stored.count(name) == 1:
            value, shift = replace(value, shift=0), value.shift
        self._emit(
            f"{self.program.declared(kind)} {called} = {self.program.text(value, kind)};", called
        )
        return Expression(kind, called, shift=shift)

    def _unknown(self, statements: Sequence[ast.stmt]) -> None:
        """Spill constants that the statements may assign to C variables."""
        for node in (inner for each in statements for inner in ast.walk(each)):
            if (
                isinstance(node, ast.Name)
                and isinstance(node.ctx, ast.Store)
                and node.id in self.names
            ):
                value = self.names[node.id]
                if is_known(value) and (is_number(value) or is_record(value)):
                    self.names[node.id] = self._variable(node.id, value)

    def _inside(self, statements: Sequence[ast.stmt]) -> bool:
        """Translate statements that may not run, or run several times."""
        before, used = dict(self.names), set(self.used)
        self.depth += 1
        ended = self._block(statements)
        self.depth -= 1
        for name, value in before.items():
            if self.names.get(name) is not value:  # C has no one variable for it
                raise self._refuse(name)
        self.names, self.used = before, used
        return ended

    def _branch(self, node: ast.If) -> bool:
        condition = self._value(node.test)
        if is_known(condition):
            return self._block(node.body if condition else node.orelse)
        self._unknown([*node.body, *node.orelse])
        self._emit(f"if ({condition.text}) {{")
        returns = self._inside(node.body)
        if node.orelse:
            self._emit("} else {")
            returns &= self._inside(node.orelse)
        self._emit("}")
        return returns and bool(node.orelse)

    def _loop(self, name: str, arguments: list[Any], node: ast.For) -> None:
        start, stop, step = (0, *arguments, 1) if len(arguments) == 1 else (*arguments, 1)[:3]
        turns = range(start, stop, step) if is_known((start, stop, step)) else None
        breaks = any(isinstance(each, ast.Break) for each in ast.walk(node))
        if turns is not None and len(turns) <= UNROLLED and not breaks:
            for turn in turns:
                self.names[name] = turn
                self._block(node.body)
            self.names.pop(name, None)
            return
        self._unknown(node.body)
        called = self._fresh("turn" if name == "_" else name)
        self.names[name] = Expression("int", called, least=min(turns) if turns else 0)
        texts = self.program.text(start, "int"), self.program.text(stop, "int", SUM)
        sign, change = "<" if step > 0 else ">", f"{called} += {step}"
        self._emit(f"for (int32_t {called} = {texts[0]}; {called} {sign} {texts[1]}; {change}) {{")
        self._inside(node.body)
        self._emit("}")
        del self.names[name]
        self.used.discard(called)

    # --- expressions ---

    def _value(self, node: ast.expr) -> Any:  # noqa: C901  (one case for each kind of expression)
        match node:
            case ast.Constant(value=float(value)) if (
                self.program.single and 0.0 < value < TOLERANCE
            ):
                return value * SINGLE_FACTOR
            case ast.Constant(value=value):
                return value
            case ast.Name(id=name) if name in self.names:
                return self.names[name]
            case ast.Tuple(elts=parts):
                return tuple(self._value(each) for each in parts)
            case ast.Attribute(value=owner, attr=name):
                return self._attribute(self._value(owner), name)
            case ast.UnaryOp(op=op, operand=operand):
                return self._signed(op, self._value(operand))
            case (
                ast.BinOp(op=op, left=left, right=right)
                | ast.Compare(ops=[op], left=left, comparators=[right])
            ):
                return self._operation(op, self._value(left), self._value(right))
            case ast.BoolOp(op=op, values=[first, *others]):
                result = self._value(first)
                for each in others:
                    result = self._operation(op, result, self._value(each))
                return result
            case ast.IfExp(test=test, body=body, orelse=orelse):
                condition = self._value(test)
                if is_known(condition):
                    return self._value(body if condition else orelse)
                return self._choice(condition, self._value(body), self._value(orelse))
            case ast.Subscript(value=owner, slice=ast.Slice(lower=lower, upper=upper)):
                first, last = (0 if each is None else self._value(each) for each in (lower, upper))
                return self._sliced(self._value(owner), first, last)
            case ast.Subscript(value=owner, slice=index):
                return self._indexed(self._value(owner), self._value(index))
            case ast.Call(func=function, args=arguments, keywords=keywords):
                named = {str(each.arg): self._value(each.value) for each in keywords}
                return self._called(
                    self._value(function), [self._value(each) for each in arguments], named, node
                )
            case _:
                raise self._refuse(node)

    def _attribute(self, owner: Any, name: str) -> Any:
        if isinstance(owner, Expression):
            return Expression(dict(fields_of(owner.kind))[name], f"{bound(owner, ATOM)}.{name}")
        return (self._length(owner),) if name == "shape" else getattr(owner, name)

    def _length(self, owner: Any) -> Any:
        if isinstance(owner, ConstantTable):
            return len(owner)
        if not isinstance(owner, Array):
            return len(owner)
        if (
            owner.count == Expression("int", f"{owner.base}_count")
            and owner.base not in self.made.counted
        ):
            self.made.counted.append(owner.base)
        return owner.count

    def _signed(self, op: ast.unaryop, value: Any) -> Any:
        negates = isinstance(op, ast.USub)
        if is_known(value):
            return -value if negates else not value
        return Expression(
            value.kind if negates else "bool",
            f"{'-' if negates else '!'}{bound(value, UNARY)}",
            UNARY,
        )

    def _operation(self, op: ast.AST, left: Any, right: Any) -> Any:
        """Apply an operator to two values."""
        sign, level, function = OPERATORS.get(type(op), ("", 0, operator.is_))
        if level and is_known((left, right)):
            return function(left, right)
        kinds = {kind_of(left), kind_of(right)}
        if (
            not sign
            or (level in (AND, OR) and kinds != {"bool"})
            or (sign == "%" and kinds != {"int"})
        ):
            raise self._refuse(type(op).__name__)
        if level in (AND, OR):
            return self._logic(sign, level, left, right)
        kind = next(each for each in ("real", "single", "int", "bool") if each in kinds)
        if kind == "int" and level == SUM and (sign == "+" or is_known(right)):
            constant, other = (right, left) if is_known(right) else (left, right)
            if is_known(constant):
                return replace(other, shift=other.shift + (constant if sign == "+" else -constant))
        kind = "real" if isinstance(op, ast.Div) and kind == "int" else kind
        sides = [
            self.program.text(value, kind, at)
            for value, at in (
                (left, SUM if level == COMPARISON else level),
                (right, SUM if level == COMPARISON else level + 1),
            )
        ]
        return Expression(
            "bool" if level == COMPARISON else kind, f"{sides[0]} {sign} {sides[1]}", level
        )

    def _logic(self, sign: str, level: int, left: Any, right: Any) -> Any:
        for known, other in ((left, right), (right, left)):
            if is_known(known):
                return other if bool(known) == (level == AND) else known
        texts = (
            bound(each, level if each.level == level else COMPARISON) for each in (left, right)
        )
        return Expression("bool", f" {sign} ".join(texts), level)

    def _choice(self, condition: Any, a: Any, b: Any) -> Any:
        """Return a value that the C program selects by a condition."""
        if type(a) is type(b) is tuple:
            return tuple(self._choice(condition, *pair) for pair in zip(a, b, strict=True))
        kind = "real" if kind_of(b) == "real" else kind_of(a)
        texts = (self.program.text(each, kind, CHOICE + 1) for each in (a, b))
        return Expression(kind, f"{bound(condition, OR)} ? {' : '.join(texts)}", CHOICE)

    def _looked_up(self, table: ConstantTable, at: Any) -> Any:
        """Return a number of a table: a known one if its place is and all tables have the same."""
        if is_known(at) and not table.differ(at, at + 1):
            return float(table.values[..., at].flat[0])
        first = at if is_known(at) else at.shift + at.least
        region = next((each for each in table.regions if each.first <= first < each.last), None)
        if region is None:
            raise Unsupported(f"policies: no part of the gains is looked up at {first}")
        place = self._operation(ast.Sub(), at, region.first)
        return self.program.stored(self._entry(self._kept(table, region), place), region.step)

    def _kept(self, table: ConstantTable, region: Region) -> Array:
        """Return a region of a table, or of the chosen one, as an array of C."""
        self.program.keep(table, region)
        count, offset = region.last - region.first, 0
        if table.differ(region.first, region.last):
            offset = self._operation(ast.Mult(), self.chosen, count)
        return Array(region.element, region.name, "real", offset, count, region.step)

    def _entry(self, array: Array, at: Any) -> str:
        place = self._operation(ast.Add(), array.offset, at)
        return f"{array.base}[{self.program.text(place, 'int')}]"

    def _indexed(self, owner: Any, at: Any) -> Any:
        """Return an entry of an array, a table, a record or a tuple."""
        if isinstance(owner, Array):
            return self.program.stored(self._entry(owner, at), owner.step, owner.reads)
        if isinstance(owner, ConstantTable):
            return self._looked_up(owner, at)
        parts = self._entries(owner)
        if is_known(at):
            return parts[at]
        result = parts[-1]
        for k in range(len(parts) - 2, -1, -1):
            result = self._choice(self._operation(ast.Eq(), at, k), parts[k], result)
        return result

    def _entries(self, owner: Any) -> tuple[Any, ...]:
        if not isinstance(owner, Expression):
            return owner
        return tuple(
            Expression(kind, f"{bound(owner, ATOM)}.{name}") for name, kind in fields_of(owner.kind)
        )

    def _sliced(self, owner: Any, first: Any, last: Any) -> Any:
        if isinstance(owner, ConstantTable):
            if isinstance(first, Expression):
                return self._one_of(owner, first, last)
            for each in owner.regions:
                if each.element != "real" and each.first <= first and last <= each.last:
                    array = self._kept(owner, each)
                    offset = self._operation(ast.Add(), array.offset, first - each.first)
                    return replace(array, offset=offset, count=last - first)
            return owner.part(first, last)
        offset = self._operation(ast.Add(), owner.offset, first)
        return replace(owner, offset=offset, count=self._operation(ast.Sub(), last, first))

    def _one_of(self, table: ConstantTable, first: Expression, last: Expression) -> ConstantTable:
        """Return the tables of which one begins at ``first``, and remember which is chosen."""
        size = last.shift - first.shift
        if table.choices != (first.shift, size) or first.text != last.text:
            raise self._refuse("a part of the gains that only the running program knows")
        place = bound(replace(first, shift=0), PRODUCT)
        number = Expression("int", f"{place} / {size}", PRODUCT)
        self.chosen = self._variable(CHOSEN, number)
        return table.tables()

    def _called(
        self, function: Any, arguments: list[Any], named: dict[str, Any], node: ast.AST
    ) -> Any:
        """Return the value of a call."""
        if function in PLAIN:
            return (
                function(*arguments)
                if is_known(tuple(arguments))
                else self._plain(function, arguments)
            )
        if function is len:
            return self._length(*arguments)
        if isinstance(function, type) and hasattr(function, "_fields"):
            return self._record(function, arguments, named)
        if function in (records.read, records.write):
            return (self._read if function is records.read else self._write)(*arguments)
        if getattr(function, "__qualname__", "") == "entrywise.<locals>.each":
            return self._entrywise(function, arguments)
        function = self.program.elementary.get(function, function)
        if named or not isinstance(function, FunctionType | CPUDispatcher):
            raise self._refuse(node)
        value, statement, writes = self.program.call(function, *arguments, chosen=self.chosen)
        self.touched |= writes
        if statement:
            self._emit(statement)
        return value

    def _plain(self, function: Any, arguments: list[Any]) -> Any:
        """Return the value of a function that is a cast, or that every file has."""
        first, *others = arguments
        if function in (int, float, np.float32):
            kind = {int: "int", float: "real", np.float32: "single"}[function]
            as_it_is = kind_of(first) == kind or (function is float and kind_of(first) == "single")
            cast = PLAIN[function] or "(real)"
            return first if as_it_is else Expression(kind, f"{cast}{bound(first, UNARY)}", UNARY)
        result = self.program.text(first, "real")
        for operand in others:
            result = f"{PLAIN[function]}({result}, {self.program.text(operand, 'real')})"
        return Expression("real", result if others else f"{PLAIN[function]}({result})")

    def _record(self, kind: Any, arguments: Sequence[Any], named: Mapping[str, Any]) -> Any:
        record = kind(*arguments, **named)
        if is_known(record):
            return record
        usual = [each for _, each in fields_of(kind)]
        kinds = (
            each if each == "single" or isinstance(each, Observed) else None
            for each in map(kind_of, record)
        )
        types = tuple(each or use for each, use in zip(kinds, usual, strict=True))
        kind = kind if types == tuple(usual) else Observed(kind, types)
        return Expression(kind, self.program.literal(tuple(record), kind))

    def _read(self, array: Any, at: Any, first: Any) -> Any:
        """Return a record from an array; see ``pter_gym._compiled.records``."""
        if not is_record(at):
            return self._indexed(array, self._operation(ast.Add(), first, at))
        return self._record(type(at), [self._read(array, each, first) for each in at], {})

    def _write(self, array: Any, at: Any, value: Any) -> None:
        """Write a record to an array; see ``pter_gym._compiled.records``."""
        for place, part in zip(records.flat(at), self._flat(self._named(value)), strict=True):
            self._store(array, place, part)

    def _flat(self, value: Any) -> Iterator[Any]:
        for each in self._entries(value):
            yield from self._flat(each) if is_record(each) else (each,)

    def _named(self, value: Any) -> Any:
        """Return a record whose entries can be read one by one."""
        computed = isinstance(value, Expression) and not re.fullmatch(r"[\w.]+", value.text)
        return self._variable("record", value) if computed else value

    def _entrywise(self, function: Any, arguments: list[Any]) -> Any:
        """Apply a scalar function to each entry of records."""
        closure = inspect.getclosurevars(function).nonlocals
        wholes = [
            varies and is_record(each)
            for each, varies in zip(arguments, closure["varies"], strict=True)
        ]
        if not any(wholes):
            return self._called(closure["scalar"], arguments, {}, ast.Pass())
        held = [
            self._named(each) if whole else each
            for each, whole in zip(arguments, wholes, strict=True)
        ]
        kind = kind_of(held[wholes.index(True)])
        kind = kind.record if isinstance(kind, Observed) else kind
        columns = (
            self._entries(each) if whole else itertools.repeat(each, len(kind._fields))
            for each, whole in zip(held, wholes, strict=True)
        )
        return self._record(
            kind, [self._entrywise(function, list(row)) for row in zip(*columns, strict=True)], {}
        )
