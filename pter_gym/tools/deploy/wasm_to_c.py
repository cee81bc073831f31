"""The WebAssembly module of `pter play` as C99 without libraries other than the C one.

A function of the module becomes a function of C whose first argument is a module's memory. It has
the same bits, since both have the arithmetic of IEEE 754. What that module does not contain, such
as imports, tables of functions and SIMD, is refused.
"""

import math
import re
import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

from pter_gym.errors import DataError

KINDS = {0x7F: "i32", 0x7E: "i64", 0x7D: "f32", 0x7C: "f64"}
TYPES = {"i32": "uint32_t", "i64": "uint64_t", "f32": "float", "f64": "double"}
SIGNED = {"i32": "int32_t", "i64": "int64_t"}
BITS = {"i32": 32, "i64": 64}

NO_RESULT = 0x40
UNREACHABLE, NOP, BLOCK, LOOP, IF, ELSE, END = 0x00, 0x01, 0x02, 0x03, 0x04, 0x05, 0x0B
BR, BR_IF, BR_TABLE, RETURN, CALL, DROP, SELECT = 0x0C, 0x0D, 0x0E, 0x0F, 0x10, 0x1A, 0x1B
LOCAL_GET, LOCAL_SET, LOCAL_TEE, GLOBAL_GET, GLOBAL_SET = 0x20, 0x21, 0x22, 0x23, 0x24
MORE, MEMORY_COPY, MEMORY_FILL = 0xFC, 0x0A, 0x0B
SOURCES = ("int32_t", "uint32_t", "int64_t", "uint64_t")
"""Types that are converted to floating-point numbers, in the order of the instructions."""

NARROWING = 0xFC00
"""What the numbers of the saturating conversions begin with here."""

LONGEST = 90
"""Characters of an expression that is not worth a variable yet."""


class Kind(NamedTuple):
    """Types of a function: those of its parameters and its result, "" for none."""

    parameters: tuple[str, ...]
    result: str


class Value(NamedTuple):
    """An expression of C without effects: its type, its text, and the locals that it reads."""

    kind: str
    text: str
    reads: frozenset[str] = frozenset()


@dataclass
class Block:
    """What a branch may lead to: its label, the variable of its value, and the stack's height."""

    label: str
    result: Value | None
    height: int
    is_loop: bool = False
    otherwise: str = ""


class Operator(NamedTuple):
    """An instruction of one or two operands: the type of its result, and its C."""

    result: str
    text: str


def numbered(first: int, result: str, *texts: str) -> dict[int, Operator]:
    """Return operators with successive numbers."""
    return {first + k: Operator(result, text) for k, text in enumerate(texts)}


def whole_operators(kind: str, compare: int, compute: int) -> dict[int, Operator]:
    """Return the operators on whole numbers; signed and unsigned ones alternate."""
    own, signed, bits = TYPES[kind], SIGNED[kind], BITS[kind]
    by = f"(({{1}}) & {bits - 1})"
    tests = [
        f"(uint32_t)(({of})({{0}}) {order} ({of})({{1}}))"
        for order in ("<", ">", "<=", ">=")
        for of in (signed, own)
    ]
    divisions = [
        f"({own})(({of})({{0}}) {operator} ({of})({{1}}))"
        for operator in "/%"
        for of in (signed, own)
    ]
    return {
        compare: Operator("i32", "(uint32_t)(({0}) == 0)"),
        **numbered(compare + 1, "i32", *(f"(uint32_t)(({{0}}) {o} ({{1}}))" for o in ("==", "!="))),
        **numbered(compare + 3, "i32", *tests),
        **numbered(compute, kind, f"clz{bits}({{0}})", f"ctz{bits}({{0}})"),
        **numbered(compute + 3, kind, *(f"(({{0}}) {o} ({{1}}))" for o in "+-*")),
        **numbered(compute + 6, kind, *divisions),
        **numbered(compute + 10, kind, *(f"(({{0}}) {o} ({{1}}))" for o in "&|^")),
        compute + 13: Operator(kind, f"(({{0}}) << {by})"),
        compute + 14: Operator(kind, f"({own})(({signed})({{0}}) >> {by})"),
        compute + 15: Operator(kind, f"(({{0}}) >> {by})"),
    }


def real_operators(kind: str, compare: int, compute: int) -> dict[int, Operator]:
    """Return the operators on floating-point numbers; their functions in C are exact."""
    end = "f" if kind == "f32" else ""
    orders = ("==", "!=", "<", ">", "<=", ">=")
    functions = ("ceil", "floor", "trunc", "nearbyint", "sqrt")
    return {
        **numbered(compare, "i32", *(f"(uint32_t)(({{0}}) {order} ({{1}}))" for order in orders)),
        **numbered(compute, kind, f"fabs{end}({{0}})", "(-({0}))"),
        **numbered(compute + 2, kind, *(f"{name}{end}({{0}})" for name in functions)),
        **numbered(compute + 7, kind, *(f"(({{0}}) {operator} ({{1}}))" for operator in "+-*/")),
        compute + 13: Operator(kind, f"copysign{end}({{0}}, {{1}})"),
    }


OPERATORS = {
    **whole_operators("i32", 0x45, 0x67),
    **whole_operators("i64", 0x50, 0x79),
    **real_operators("f32", 0x5B, 0x8B),
    **real_operators("f64", 0x61, 0x99),
    0xA7: Operator("i32", "(uint32_t)({0})"),
    **numbered(0xAC, "i64", "(uint64_t)(int32_t)({0})", "(uint64_t)({0})"),
    **numbered(0xB2, "f32", *(f"(float)({of})({{0}})" for of in SOURCES)),
    0xB6: Operator("f32", "(float)({0})"),
    **numbered(0xB7, "f64", *(f"(double)({of})({{0}})" for of in SOURCES)),
    0xBB: Operator("f64", "(double)({0})"),
    0xBC: Operator("i32", "i32_of_f32({0})"),
    0xBD: Operator("i64", "i64_of_f64({0})"),
    0xBE: Operator("f32", "f32_of_i32({0})"),
    0xBF: Operator("f64", "f64_of_i64({0})"),
    **numbered(0xC0, "i32", *(f"(uint32_t)(int32_t)(int{n}_t)({{0}})" for n in (8, 16))),
    **numbered(0xC2, "i64", *(f"(uint64_t)(int64_t)(int{n}_t)({{0}})" for n in (8, 16, 32))),
    **numbered(NARROWING, "i32", *("narrowed_s32({0})", "narrowed_u32({0})") * 2),
    **numbered(NARROWING + 4, "i64", *("narrowed_s64({0})", "narrowed_u64({0})") * 2),
}
"""Instructions of one or two operands, by their numbers."""

LOADS = {
    0x28: ("i32", "uint32_t"),
    0x29: ("i64", "uint64_t"),
    0x2A: ("f32", "float"),
    0x2B: ("f64", "double"),
    0x2C: ("i32", "int8_t"),
    0x2D: ("i32", "uint8_t"),
    0x2E: ("i32", "int16_t"),
    0x2F: ("i32", "uint16_t"),
    0x30: ("i64", "int8_t"),
    0x31: ("i64", "uint8_t"),
    0x32: ("i64", "int16_t"),
    0x33: ("i64", "uint16_t"),
    0x34: ("i64", "int32_t"),
    0x35: ("i64", "uint32_t"),
}
STORES = ("uint32_t", "uint64_t", "float", "double") + ("uint8_t", "uint16_t") * 2 + ("uint32_t",)
FIRST_STORE = 0x36

MEMORY_TYPES = [
    f"{sign}int{bits}_t"
    for bits in (8, 16, 32, 64)
    for sign in ("", "u")
    if (bits, sign) != (64, "")
] + ["float", "double"]


class Bytes:
    """Reads a module's numbers one after the other."""

    def __init__(self, data: bytes) -> None:
        self.data, self.at = data, 0

    def __bool__(self) -> bool:
        return self.at < len(self.data)

    def byte(self) -> int:
        """Return the next byte."""
        self.at += 1
        return self.data[self.at - 1]

    def take(self, count: int) -> bytes:
        """Return the next bytes."""
        self.at += count
        return self.data[self.at - count : self.at]

    def whole(self) -> int:
        """Return the next whole number from 0 on."""
        value = shift = 0
        while True:
            byte = self.byte()
            value |= (byte & 0x7F) << shift
            shift += 7
            if byte < 0x80:
                return value

    def signed(self) -> int:
        """Return the next signed whole number."""
        begin = self.at
        value, bits = self.whole(), 7 * (self.at - begin)
        return value - (1 << bits) if value >> (bits - 1) else value

    def each(self, read: Callable[[], Any]) -> list[Any]:
        """Return the entries of a list."""
        return [read() for _ in range(self.whole())]

    def kinds(self) -> list[str]:
        """Return a list of types."""
        return [KINDS[kind] for kind in self.take(self.whole())]


class Module:
    """A module: its types and functions, globals, exports and initial data."""

    def __init__(self, data: bytes) -> None:
        source = Bytes(data)
        if source.take(8) != b"\0asm\1\0\0\0":
            raise DataError("this is not a WebAssembly module")
        self.types: list[Kind] = []
        self.kinds: list[int] = []
        self.globals: list[tuple[bool, int]] = []
        self.exports: dict[str, tuple[int, int]] = {}
        self.codes: list[bytes] = []
        self.data: list[tuple[int, bytes]] = []
        readers: dict[int, Callable[[Bytes], None]] = {
            1: self._read_type,
            3: self._read_kind,
            6: self._read_global,
            7: self._read_export,
            10: self._read_code,
            11: self._read_data,
        }
        while source:
            number, section = source.byte(), Bytes(source.take(source.whole()))
            if number in (2, 8, 9):
                raise DataError("a module with imports, a start or a table is not translated")
            if number in readers:
                section.each(lambda number=number, section=section: readers[number](section))

    def _read_type(self, source: Bytes) -> None:
        source.byte()
        parameters, results = source.kinds(), source.kinds()
        self.types.append(Kind(tuple(parameters), results[0] if results else ""))

    def _read_kind(self, source: Bytes) -> None:
        self.kinds.append(source.whole())

    def _read_code(self, source: Bytes) -> None:
        self.codes.append(source.take(source.whole()))

    def _read_global(self, source: Bytes) -> None:
        _, changes = source.byte(), source.byte()
        self.globals.append((changes == 1, self._constant(source)))

    def _read_export(self, source: Bytes) -> None:
        name = source.take(source.whole()).decode()
        self.exports[name] = source.byte(), source.whole()

    def _read_data(self, source: Bytes) -> None:
        if source.whole():
            raise DataError("passive data is not translated")
        begin = self._constant(source)
        self.data.append((begin, source.take(source.whole())))

    def _constant(self, source: Bytes) -> int:
        source.byte()
        value = source.signed()
        source.byte()
        return value

    @property
    def heap(self) -> int:
        """Where memory begins that the module does not use itself."""
        return self.globals[self.exports["__heap_base"][1]][1]


class Function:
    """Translates the code of one function."""

    def __init__(self, module: Module, number: int, names: list[str]) -> None:
        self.module, self.names = module, names
        self.kind = module.types[module.kinds[number]]
        self.source = Bytes(module.codes[number])
        self.lines: list[str] = []
        self.stack: list[Value] = []
        self.blocks: list[Block] = []
        self.used: set[str] = set()
        self.count = 0
        declared = self.source.each(lambda: (self.source.whole(), KINDS[self.source.byte()]))
        more = [kind for count, kind in declared for _ in range(count)]
        self.locals = [*self.kind.parameters, *more]
        first = len(self.kind.parameters)
        for kind, of in TYPES.items():
            own = [f"v{k} = 0" for k in range(first, len(self.locals)) if self.locals[k] == kind]
            self.lines += [f"{of} {', '.join(own)};"] if own else []

    def body(self) -> list[str]:
        """Return its statements."""
        self.enter(self.kind.result)
        while self.blocks:
            self.instruction(self.source.byte())
        if self.kind.result:
            self.lines.append(f"return {self.pop()};")
        return [line for line in self.lines if not line.endswith(":;") or line[:-2] in self.used]

    # --- the stack ---

    def fresh(self, letter: str) -> str:
        """Return a new name."""
        self.count += 1
        return f"{letter}{self.count}"

    def push(self, kind: str, text: str, reads: frozenset[str] = frozenset()) -> None:
        """Push an expression without effects, in a variable if it is long."""
        if len(text) > LONGEST:
            text, reads = self.variable(kind, text), frozenset()
        self.stack.append(Value(kind, text, reads))

    def variable(self, kind: str, text: str) -> str:
        """Return a new variable with the value of an expression."""
        name = self.fresh("t")
        self.lines.append(f"{TYPES[kind]} {name} = {text};")
        return name

    def pop(self) -> str:
        """Pop an expression."""
        return self.stack.pop().text

    def keep(self, local: str | None = None) -> None:
        """Put into variables what reads a local that is about to change, or any."""
        for k, value in enumerate(self.stack):
            if value.reads and (local is None or local in value.reads):
                self.stack[k] = Value(value.kind, self.variable(value.kind, value.text))

    # --- blocks ---

    def enter(self, result: str, *, is_loop: bool = False, otherwise: str = "") -> None:
        """Begin a block."""
        self.keep()
        value = None
        if result:
            value = Value(result, self.fresh("r"))
            self.lines.append(f"{TYPES[result]} {value.text} = 0;")
        label = self.fresh("L")
        if is_loop:
            self.lines.append(f"{label}:;")
        self.blocks.append(Block(label, value, len(self.stack), is_loop, otherwise))

    def leave(self, block: Block) -> None:
        """End a block, or its part before an ``else``, where its code comes to its end."""
        if block.result is not None:
            self.lines.append(f"{block.result.text} = {self.pop()};")
        del self.stack[block.height :]

    def end(self) -> None:
        """End the innermost block."""
        block = self.blocks.pop()
        if block.otherwise:
            self.lines.append(f"{block.otherwise}:;")
        if not block.is_loop:
            self.lines.append(f"{block.label}:;")
        if block.result is not None:
            self.stack.append(block.result)

    def goto(self, depth: int) -> str:
        """Return the statements that leave so many blocks and go on with the next one."""
        block = self.blocks[-1 - depth]
        self.used.add(block.label)
        if block.result is None or block.is_loop:
            return f"goto {block.label};"
        return f"{{ {block.result.text} = {self.stack[-1].text}; goto {block.label}; }}"

    def dead(self) -> None:
        """Skip what comes after a jump, up to the end of the block or to its ``else``."""
        depth = 0
        del self.stack[self.blocks[-1].height :]
        while True:
            code = self.source.byte()
            if depth == 0 and code in (ELSE, END):
                self.otherwise() if code == ELSE else self.end()
                return
            depth += (code in (BLOCK, LOOP, IF)) - (code == END)
            self.skip(code)

    def skip(self, code: int) -> None:
        """Read the operands of an instruction that is never run."""
        source = self.source
        if code in (BLOCK, LOOP, IF):
            source.byte()
        elif code in (BR, BR_IF, CALL) or LOCAL_GET <= code <= GLOBAL_SET:
            source.whole()
        elif code in LOADS or FIRST_STORE <= code < FIRST_STORE + len(STORES):
            source.whole()
            source.whole()
        elif code in (0x41, 0x42):
            source.signed()
        elif code in (0x43, 0x44):
            source.take(4 if code == 0x43 else 8)
        elif code == BR_TABLE:
            source.each(source.whole)
            source.whole()
        elif code == MORE:
            more = source.whole()
            source.take({MEMORY_COPY: 2, MEMORY_FILL: 1}.get(more, 0))

    def otherwise(self) -> None:
        """Begin the ``else`` of the innermost block."""
        block = self.blocks[-1]
        self.lines += [f"{block.otherwise}:;"]
        block.otherwise = ""

    # --- instructions ---

    def instruction(self, code: int) -> None:
        """Translate an instruction."""
        if code == MORE:
            code = NARROWING + self.source.whole()
        if code in OPERATORS:
            self.operate(code)
        elif code in LOADS:
            self.load(code)
        elif FIRST_STORE <= code < FIRST_STORE + len(STORES):
            self.store(STORES[code - FIRST_STORE])
        elif LOCAL_GET <= code <= LOCAL_TEE:
            self.local(code)
        elif 0x41 <= code <= 0x44:
            self.constant(code)
        elif code in (BLOCK, LOOP, IF, ELSE, END):
            self.structure(code)
        elif code in (BR, BR_IF, BR_TABLE, RETURN, UNREACHABLE):
            self.jump(code)
        else:
            self.other(code)

    def operate(self, code: int) -> None:
        """Translate arithmetic, a comparison or a conversion."""
        result, text = OPERATORS[code]
        operands = [self.stack.pop() for _ in range(2 if "{1}" in text else 1)][::-1]
        reads = frozenset[str]().union(*(each.reads for each in operands))
        self.push(result, text.format(*(each.text for each in operands)), reads)

    def load(self, code: int) -> None:
        """Translate a read of memory."""
        kind, of = LOADS[code]
        self.source.whole()
        place = self.place(self.source.whole(), self.pop())
        cast = "" if TYPES[kind] == of else f"({TYPES[kind]})"
        signed = f"({SIGNED[kind]})" if of.startswith("int") else ""
        self.stack.append(Value(kind, self.variable(kind, f"{cast}{signed}get_{of}({place})")))

    def store(self, of: str) -> None:
        """Translate a write to memory."""
        self.source.whole()
        offset, value = self.source.whole(), self.stack.pop()
        cast = "" if TYPES[value.kind] == of else f"({of})"
        self.lines.append(f"put_{of}({self.place(offset, self.pop())}, {cast}({value.text}));")

    def place(self, offset: int, address: str) -> str:
        """Return a place in memory."""
        return f"memory + {offset} + (size_t)({address})" if offset else f"memory + ({address})"

    def local(self, code: int) -> None:
        """Translate what reads or sets a local variable."""
        number = self.source.whole()
        name, kind = f"v{number}", self.locals[number]
        if code != LOCAL_GET:
            value = self.pop()
            self.keep(name)
            self.lines.append(f"{name} = {value};")
        if code != LOCAL_SET:
            self.stack.append(Value(kind, name, frozenset((name,))))

    def constant(self, code: int) -> None:
        """Translate a number."""
        source = self.source
        if code in (0x41, 0x42):
            kind, bits = ("i32", 32) if code == 0x41 else ("i64", 64)
            end = "u" if kind == "i32" else "ull"
            self.push(kind, f"{source.signed() % (1 << bits)}{end}")
            return
        kind, form, of = ("f32", "<fI", "i32") if code == 0x43 else ("f64", "<dQ", "i64")
        data = source.take(4 if kind == "f32" else 8)
        (value,), (pattern,) = (struct.unpack(f"<{each}", data) for each in form[1:])
        end = "u" if kind == "f32" else "ull"
        exact = f"{value.hex()}{'f' if kind == 'f32' else ''}"
        self.push(kind, exact if math.isfinite(value) else f"{kind}_of_{of}({pattern}{end})")

    def structure(self, code: int) -> None:
        """Translate the beginning or the end of a block."""
        if code in (BLOCK, LOOP, IF):
            kind = self.source.byte()
            condition = self.pop() if code == IF else ""
            otherwise = self.fresh("L") if code == IF else ""
            result = "" if kind == NO_RESULT else KINDS[kind]
            self.enter(result, is_loop=code == LOOP, otherwise=otherwise)
            if otherwise:
                self.used.add(otherwise)
                self.lines.append(f"if (!({condition})) goto {otherwise};")
            return
        block = self.blocks[-1]
        self.leave(block)
        if code == ELSE:
            self.lines.append(self.goto(0) if block.result is None else f"goto {block.label};")
            self.used.add(block.label)
            self.otherwise()
        else:
            self.end()

    def jump(self, code: int) -> None:
        """Translate a jump."""
        source = self.source
        if code == BR_IF:
            condition = self.pop()
            self.lines.append(f"if ({condition}) {self.goto(source.whole())}")
            return
        if code == BR:
            self.lines.append(self.goto(source.whole()))
        elif code == BR_TABLE:
            chosen = self.pop()
            cases = [f"case {k}: {self.goto(to)}" for k, to in enumerate(source.each(source.whole))]
            last = f"default: {self.goto(source.whole())}"
            self.lines.append(f"switch ({chosen}) {{ {' '.join([*cases, last])} }}")
        elif code == RETURN:
            self.lines.append(f"return {self.pop()};" if self.kind.result else "return;")
        else:
            self.lines.append("abort();")
        self.dead()

    def other(self, code: int) -> None:
        """Translate a call, a choice, a global variable, or what copies or fills memory."""
        if code == CALL:
            number = self.source.whole()
            kind = self.module.types[self.module.kinds[number]]
            given = [self.pop() for _ in kind.parameters][::-1]
            call = f"{self.names[number]}({', '.join(['memory', *given])})"
            if kind.result:
                self.stack.append(Value(kind.result, self.variable(kind.result, call)))
            else:
                self.lines.append(f"{call};")
        elif code == SELECT:
            condition, second, first = (self.stack.pop() for _ in range(3))
            text = f"(({condition.text}) ? ({first.text}) : ({second.text}))"
            self.push(first.kind, text, condition.reads | first.reads | second.reads)
        elif code in (GLOBAL_GET, GLOBAL_SET):
            place = f"memory - {4 * (self.source.whole() + 1)}"
            if code == GLOBAL_GET:
                self.stack.append(Value("i32", self.variable("i32", f"get_uint32_t({place})")))
            else:
                self.lines.append(f"put_uint32_t({place}, {self.pop()});")
        elif code in (NARROWING + MEMORY_COPY, NARROWING + MEMORY_FILL):
            is_copy = code == NARROWING + MEMORY_COPY
            self.source.take(2 if is_copy else 1)
            count, value, to = (self.pop() for _ in range(3))
            what = f"memmove(memory + ({to}), memory + ({value}), " if is_copy else ""
            what = what or f"memset(memory + ({to}), (int)({value}), "
            self.lines.append(f"{what}{count});")
        elif code == DROP:
            self.stack.pop()
        elif code != NOP:
            raise DataError(f"the instruction {code:#x} is not translated")


HEAD = """\
/* The functions of the WebAssembly module of `pter play`, made by pter_gym from it. Their first
   argument is a memory, which NAME_prepare must have prepared; each thread has its own. */

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "module.h"

#if defined(__clang__)
#pragma STDC FP_CONTRACT OFF
#elif defined(_MSC_VER)
#pragma fp_contract(off)
#endif
"""

_ONE_OF = """
static inline {type} get_{type}(const unsigned char *from)
{{
    {type} value;
    memcpy(&value, from, sizeof value);
    return value;
}}
"""

_PUT = """
static inline void put_{type}(unsigned char *to, {type} value)
{{
    memcpy(to, &value, sizeof value);
}}
"""

HELPERS = {
    **{
        f"{to}_of_{of}": f"""
static inline {TYPES[to]} {to}_of_{of}({TYPES[of]} x)
{{
    {TYPES[to]} y;
    memcpy(&y, &x, sizeof y);
    return y;
}}
"""
        for to, of in (("f32", "i32"), ("i32", "f32"), ("f64", "i64"), ("i64", "f64"))
    },
    **{
        f"{name}{bits}": f"""
static inline uint{bits}_t {name}{bits}(uint{bits}_t x)
{{
    uint{bits}_t n = 0;
    while (n < {bits} && !(x >> {place} & 1))
        n++;
    return n;
}}
"""
        for bits in (32, 64)
        for name, place in (("clz", f"({bits - 1} - n)"), ("ctz", "n"))
    },
    **{
        f"narrowed_{sign}{bits}": f"""
static inline uint{bits}_t narrowed_{sign}{bits}(double x)
{{
    if (!(x > {low}))
        return x <= {low} ? (uint{bits}_t){least} : 0;
    return x >= {high} ? (uint{bits}_t){most} : (uint{bits}_t)({of})x;
}}
"""
        for bits in (32, 64)
        for sign, of, low, high, least, most in (
            (
                "s",
                f"int{bits}_t",
                f"-0x1p{bits - 1}",
                f"0x1p{bits - 1}",
                f"INT{bits}_MIN",
                f"INT{bits}_MAX",
            ),
            ("u", f"uint{bits}_t", "0.0", f"0x1p{bits}", "0", f"UINT{bits}_MAX"),
        )
    },
}
"""Functions of C for instructions that it does not have."""


def signature(kind: Kind, name: str) -> str:
    """Return the head of a function."""
    given = [f"{TYPES[each]} v{k}" for k, each in enumerate(kind.parameters)]
    return (
        f"{TYPES.get(kind.result, 'void')} {name}({', '.join(['unsigned char *memory', *given])})"
    )


def translated(data: bytes, name: str) -> dict[str, str]:
    """Return ``module.c`` and ``module.h`` of a module, whose functions begin with ``name``."""
    module = Module(data)
    exported = {at: each for each, (kind, at) in module.exports.items() if kind == 0}
    names = [
        f"{name}_{exported[k]}" if k in exported else f"function_{k}"
        for k in range(len(module.codes))
    ]
    heads = [signature(module.types[kind], names[k]) for k, kind in enumerate(module.kinds)]
    static = [f"static {head}" if k not in exported else head for k, head in enumerate(heads)]
    functions = [
        "\n".join([head, "{", *(f"    {line}" for line in Function(module, k, names).body()), "}"])
        for k, head in enumerate(static)
    ]
    body = "\n\n".join(functions)
    helpers = [text for helper, text in HELPERS.items() if f"{helper}(" in body]
    accesses = [
        form.format(type=each)
        for each in MEMORY_TYPES
        for form, word in ((_ONE_OF, "get"), (_PUT, "put"))
        if f"{word}_{each}(" in body or (each, word) == ("uint32_t", "put")
    ]
    forward = [f"{head};" for k, head in enumerate(static) if k not in exported]
    parts = [
        HEAD.replace("NAME", name),
        *accesses,
        *helpers,
        "\n".join(forward),
        *_data(module),
        _prepare(module, name),
        body,
    ]
    header = [f"{heads[k]};" for k in sorted(exported)]
    return {"module.c": "\n".join(parts) + "\n", "module.h": _header(module, name, header)}


def _data(module: Module) -> Iterator[str]:
    """Yield the tables of a module's initial data."""
    for k, (_, data) in enumerate(module.data):
        rows = re.sub(r"((?:\d+, ){24})", r"\1\n    ", ", ".join(map(str, data)) + ", ")
        yield f"\nstatic const unsigned char data_{k}[] = {{\n    {rows.rstrip(', ')}\n}};"


def _prepare(module: Module, name: str) -> str:
    """Return the function that prepares a memory."""
    lines = [
        f"memcpy(memory + {begin}, data_{k}, sizeof data_{k});"
        for k, (begin, _) in enumerate(module.data)
    ]
    lines += [
        f"put_uint32_t(memory - {4 * (k + 1)}, {value}u);"
        for k, (_, value) in enumerate(module.globals)
    ]
    body = "".join(f"    {line}\n" for line in lines)
    return f"\nvoid {name}_prepare(unsigned char *memory)\n{{\n{body}}}\n"


def _header(module: Module, name: str, heads: list[str]) -> str:
    """Return the header of a module."""
    functions = "\n".join([f"void {name}_prepare(unsigned char *memory);", *heads])
    return f"""\
#ifndef {name.upper()}_MODULE_H
#define {name.upper()}_MODULE_H

#include <stddef.h>
#include <stdint.h>

/* Bytes before a memory that belong to it, and those within that the module itself uses. */
#define {name.upper()}_GLOBALS {4 * len(module.globals)}
#define {name.upper()}_HEAP {module.heap}

{functions}

#endif
"""
