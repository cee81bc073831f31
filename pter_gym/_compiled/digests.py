# pyright: standard
"""What compiled code depends on, as a digest: equal digests mean equal code, in any process.

It covers the bytecode of a function and of every function that it reaches, and the values that
these read; of libraries, names alone. Comments, docstrings and layout leave it as it is.
"""

import builtins
import dis
import hashlib
import sys
from collections import ChainMap
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import Any, cast

import numpy as np
from numba.core import types
from numba.core.dispatcher import Dispatcher
from numba.core.extending import _Intrinsic  # pyright: ignore[reportPrivateUsage]
from numba.core.typing.templates import Signature

_COMPILER = ("compiler.py", "pipeline.py", "records.py", "shortcuts.py", "source.py")
"""What makes code of functions beside their bytecode: all of it counts for each of them."""

_LIBRARIES = ("builtins", "math", "cmath", "_operator", "operator", "typing", "numpy", "numba")
"""Libraries whose parts count by their names."""

_CONSTANTS = (bool, int, float, complex, str, bytes, type(None), type(...))

_CALLED = 0xFF
"""Those flags of code that say how it is called; the others are of its module and its docstring."""


def digest_of(function: Callable[..., Any]) -> str | None:
    """Return a hash of a function, compiled or not, and of all that it reads.

    It is None where it reads an object, a list, or a module that is no library's.
    """
    try:
        texts = [_compiler_text(), *texts_of(function)]
    except _UnknownError:
        return None
    return hashlib.sha256("\n".join(texts).encode()).hexdigest()


@cache
def _compiler_text() -> str:
    """Return the text of the modules that make code, without docstrings."""
    codes = [
        compile((Path(__file__).with_name(name)).read_text("utf-8"), name, "exec", optimize=2)
        for name in _COMPILER
    ]
    return "\n".join(_text(code, {}) for code in codes)


class _UnknownError(Exception):
    """The content of something that a function reads cannot be determined."""


def texts_of(function: Any) -> list[str]:
    """Return texts of a function and of all that it reads, which differ where these do.

    Functions are known by their numbers in the order in which they are reached, since they may
    call each other.
    """
    reached: dict[FunctionType, int] = {}
    texts = [_text(function, reached)]
    done = 0
    while done < len(reached):  # which grows on the way
        each = [*reached][done]
        done += 1
        texts.append(_text(each.__code__, reached))
        texts.extend(f"{name}={_text(value, reached)}" for name, value in _reads(each))
    return texts


def _text(value: Any, reached: dict[FunctionType, int]) -> str:  # noqa: C901  (one case for each kind of value)
    def of(*values: Any) -> str:
        return f"({','.join(_text(each, reached) for each in values)},)"

    if type(value) in _CONSTANTS:
        return repr(value)
    if (type(value) is np.ndarray or isinstance(value, np.generic)) and not value.dtype.hasobject:
        content = hashlib.sha256(value.tobytes()).hexdigest()
        return f"{type(cast(Any, value)).__name__} {value.dtype!r}{value.shape}{content}"
    if isinstance(value, types.Type):
        return f"numba.{value.name}"
    if name := _library_name(value):
        return name
    match value:
        case Signature():
            return str(value)
        case _Intrinsic():
            return of(cast(Any, value)._defn)
        case Dispatcher():
            return of(value.py_func, *sorted(value.targetoptions.items()))
        case FunctionType():
            return f"#{reached.setdefault(value, len(reached))}"
        case CodeType():
            return _code_text(value)
        case frozenset():  # in code
            return f"{{{','.join(sorted(map(of, cast(Any, value))))}}}"
        case slice():  # in code from Python 3.14 on
            return f"slice{of(value.start, value.stop, value.step)}"
        case tuple():
            kind = cast(Any, value).__class__
            return of(*cast(Any, value)) if kind is tuple else of(kind, *cast(Any, value))
        case type() if hasattr(value, "_fields"):
            record = cast(Any, value)
            return f"{record.__qualname__}{of(record._fields, *record._field_defaults.items())}"
        case _:  # pyright: ignore[reportUnknownVariableType]
            raise _UnknownError


def _library_name(value: Any) -> str:
    """Return the name of what a library keeps under it, or nothing."""
    if isinstance(value, ModuleType):
        name = value.__name__
        return name if _is_library(name) and sys.modules.get(name) is value else ""
    module = "numpy" if isinstance(value, np.ufunc) else getattr(value, "__module__", None)
    name = getattr(value, "__qualname__", None) or getattr(value, "__name__", None)
    if not isinstance(module, str) or not isinstance(name, str) or not _is_library(module):
        return ""
    return f"{module}.{name}" if getattr(sys.modules.get(module), name, None) is value else ""


def _is_library(module: str) -> bool:
    return module.partition(".")[0] in _LIBRARIES


@cache
def _code_text(code: CodeType) -> str:
    """Return the text of what code does; its docstring, on which it does nothing, is not in it."""
    names = (code.co_varnames, code.co_freevars, code.co_cellvars, code.co_exceptiontable)
    counts = (code.co_argcount, code.co_kwonlyargcount, code.co_flags & _CALLED)
    lines = [repr((names, counts))]
    for each in _instructions(code):
        constant = each.arg if each.opcode in dis.hasconst else None
        value = each.argval if constant is None else _text(code.co_consts[constant], {})
        lines.append(f"{each.opname} {value}")
    return "\n".join(lines)


@cache
def _instructions(code: CodeType) -> tuple[dis.Instruction, ...]:
    return tuple(dis.get_instructions(code))


def _reads(function: FunctionType) -> Iterator[tuple[str, Any]]:
    """Yield what a function reads outside itself, by name, and its defaults."""
    scope = ChainMap(function.__globals__, builtins.__dict__)
    cells = zip(function.__code__.co_freevars, function.__closure__ or (), strict=True)
    try:
        yield from [(name, cell.cell_contents) for name, cell in cells]
        yield from [(name, scope[name]) for name in _globals(function.__code__)]
    except (ValueError, KeyError):  # it is not there yet
        raise _UnknownError from None
    yield "defaults", (function.__defaults__, *(function.__kwdefaults__ or {}).items())


@cache
def _globals(code: CodeType) -> tuple[str, ...]:
    """Return the global names that code and the functions within it read, in order."""
    instructions = _instructions(code)
    # after these it is unknown what it reads
    if any(each.opname in ("IMPORT_NAME", "LOAD_BUILD_CLASS") for each in instructions):
        raise _UnknownError
    own = {each.argval for each in instructions if each.opname == "LOAD_GLOBAL"}
    inner = (_globals(each) for each in code.co_consts if isinstance(each, CodeType))
    return tuple(sorted(own.union(*inner)))
