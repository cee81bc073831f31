"""What compiled code depends on, as a digest: equal digests mean equal code, in any process.

Within the package, it covers all source files of the rooms that kernels are made of. Of any other
function, such as a user's law, it covers the bytecode, the module and the values that it reads.
"""

import builtins
import dis
import hashlib
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import Any, cast

import numpy as np
from numba.core import types
from numba.core.dispatcher import Dispatcher

PACKAGE = Path(__file__).parents[1]

ROOMS = ("_compiled", "_engine", "_physics", "controllers", "hands", "params", "paths", "tasks")
"""Folders of the package that kernels are made of."""

SOURCES = (
    *sorted(PACKAGE.glob("*.py")),
    *(path for room in ROOMS for path in sorted((PACKAGE / room).rglob("*.py"))),
)
"""Their files, and those that set their constants."""

# read once, with the code itself: a file that changes later is not what this process compiles
_SOURCES_DIGEST = hashlib.sha256(b"".join(path.read_bytes() for path in SOURCES)).hexdigest()

_LIBRARIES = ("builtins", "math", "cmath", "_operator", "operator", "typing", "numpy", "numba")
"""Libraries whose parts count by their names."""

_CONSTANTS = (bool, int, float, complex, str, bytes, type(None), type(...))


def digest_of(function: Callable[..., Any]) -> str | None:
    """Return a hash of a function, compiled or not, of all that it reads and of the package's
    sources.

    It is None where it reads an object, a list, or a module that is neither a library's nor of
    ``ROOMS``. What is of a library or of ``ROOMS`` counts by its name alone.
    """
    try:
        return hashlib.sha256(
            "\n".join([_SOURCES_DIGEST, *texts_of(function)]).encode()
        ).hexdigest()
    except _UnknownError:
        return None


class _UnknownError(Exception):
    """The content of something that a function reads cannot be determined."""


def texts_of(function: Any, reached: list[FunctionType] | None = None) -> list[str]:
    """Return texts of a function and of all that it reads, which differ where these do.

    ``reached`` gains the functions: each is known by its number there, since functions may call
    each other.
    """
    found = [] if reached is None else reached
    texts = [_text(function, found)]
    for each in found:  # grows on the way
        texts.append(f"{each.__module__}{_text(each.__code__, found)}")
        texts.extend(f"{name}={_text(value, found)}" for name, value in _reads(each))
    return texts


def _text(value: Any, reached: list[FunctionType]) -> str:  # noqa: C901  (one case for each kind of value)
    def of(*values: Any) -> str:
        return f"({','.join(_text(each, reached) for each in values)},)"

    if type(value) in _CONSTANTS:
        return repr(value)
    if (type(value) is np.ndarray or isinstance(value, np.generic)) and not value.dtype.hasobject:
        content = hashlib.sha256(value.tobytes()).hexdigest()
        return f"{type(cast(Any, value)).__name__} {value.dtype!r}{value.shape}{content}"
    if isinstance(value, types.Number | types.Boolean):
        return f"numba.{value.name}"
    if name := _name(value):
        return name
    match value:
        case Dispatcher():
            return of(value.py_func, *sorted(value.targetoptions.items()))
        case FunctionType():
            if value not in reached:
                reached.append(value)
            return f"#{reached.index(value)}"
        case CodeType():
            names = (value.co_names, value.co_varnames, value.co_freevars, value.co_cellvars)
            counts = (value.co_argcount, value.co_kwonlyargcount, value.co_flags)
            return of(value.co_code, value.co_exceptiontable, *names, *counts, value.co_consts)
        case frozenset():  # in code
            return f"{{{','.join(sorted(map(of, cast(Any, value))))}}}"
        case tuple():
            kind = cast(Any, value).__class__
            return of(*cast(Any, value)) if kind is tuple else of(kind, *cast(Any, value))
        case type() if hasattr(value, "_fields"):
            record = cast(Any, value)
            return f"{record.__qualname__}{of(record._fields, *record._field_defaults.items())}"
        case _:  # pyright: ignore[reportUnknownVariableType]
            raise _UnknownError


def _name(value: Any) -> str:
    """Return the name of what a library or one of the rooms keeps under it, or nothing."""
    if isinstance(value, ModuleType):
        found = value.__name__
        return found if _counts_by_name(found) and sys.modules.get(found) is value else ""
    module = "numpy" if isinstance(value, np.ufunc) else getattr(value, "__module__", None)
    name = getattr(value, "__qualname__", None) or getattr(value, "__name__", None)
    if not isinstance(module, str) or not isinstance(name, str) or not _counts_by_name(module):
        return ""
    return f"{module}.{name}" if getattr(sys.modules.get(module), name, None) is value else ""


def _counts_by_name(module: str) -> bool:
    library, room, *_ = (*module.split("."), "")
    return library in _LIBRARIES or (library == PACKAGE.name and room in ROOMS)


def _reads(function: FunctionType) -> Iterator[tuple[str, Any]]:
    """Yield what a function reads outside itself, by name, and its defaults."""
    scope = {**vars(builtins), **function.__globals__}
    cells = zip(function.__code__.co_freevars, function.__closure__ or (), strict=True)
    try:
        yield from [(name, cell.cell_contents) for name, cell in cells]
        yield from [(name, scope[name]) for name in sorted({*_globals(function.__code__)})]
    except (ValueError, KeyError):  # it is not there yet
        raise _UnknownError from None
    yield "defaults", (function.__defaults__, *(function.__kwdefaults__ or {}).items())


def _globals(code: CodeType) -> Iterator[str]:
    """Yield the global names that code and the functions within it read."""
    for each in dis.get_instructions(code):
        if each.opname in (
            "IMPORT_NAME",
            "LOAD_BUILD_CLASS",
        ):  # after which it is unknown what it reads
            raise _UnknownError
        if each.opname == "LOAD_GLOBAL":
            yield each.argval
    for inner in code.co_consts:
        if isinstance(inner, CodeType):
            yield from _globals(inner)
