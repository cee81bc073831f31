"""What compiled code depends on, as a digest: equal digests mean equal code, in any process.

The rooms of this package that kernels are made of count as a whole, by their source files. Of a user's law, and of any
other function, its bytecode counts, and so do its module and the values that it reads.
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
    PACKAGE / "presets" / "pter.toml",
)
"""Their files, and those that set their constants."""

# read once, with the code itself: a file that changes later is not what this process compiles
_SOURCES_DIGEST = hashlib.sha256(b"".join(path.read_bytes() for path in SOURCES)).hexdigest()

_LIBRARIES = ("builtins", "math", "cmath", "_operator", "operator", "typing", "numpy", "numba")
"""Libraries whose parts count by their names."""

_CONSTANTS = (bool, int, float, complex, str, bytes, type(None), type(...))


def digest_of(function: Callable[..., Any]) -> str | None:
    """Return a hash of a function, of all that it reads and of the package's sources; None as ``content_digest``."""
    content = content_digest(function)
    return content and hashlib.sha256(f"{_SOURCES_DIGEST}\n{content}".encode()).hexdigest()


def content_digest(function: Callable[..., Any]) -> str | None:
    """Return a hash of a function, compiled or not, and all that it reads, or None if that cannot be determined.

    That is so where it reads an object, a list, or a module that is neither a library's nor of ``ROOMS``. What is of a
    library or of ``ROOMS`` counts by its name alone.
    """
    try:
        texts = _Content().of_all(function)
    except _UnknownError:
        return None
    return hashlib.sha256("\n".join(texts).encode()).hexdigest()


def files_of(function: Callable[..., Any]) -> set[str]:
    """Return the source files of all that a function may reach, compiled or not."""
    content = _Content()
    content.of_all(function)
    return {*map(str, SOURCES), *(reached.__code__.co_filename for reached in content.reached)}


class _UnknownError(Exception):
    """The content of something that a function reads cannot be determined."""


class _Content:
    """Texts that differ where values differ.

    The text of a function is its number, in the order in which functions are reached, so functions may call each other.
    """

    def __init__(self) -> None:
        self.reached: list[FunctionType] = []

    def of_all(self, function: object) -> list[str]:
        """Return the texts of a function and of all that it reads."""
        texts = [self.of(function)]
        for reached in self.reached:  # grows on the way
            texts.append(f"{reached.__module__}{self.of(reached.__code__)}")
            texts.extend(f"{name}={self.of(value)}" for name, value in _reads(reached))
        return texts

    def of(self, value: Any) -> str:
        """Return the text of a value."""
        if type(value) in _CONSTANTS:
            return repr(value)
        if type(value) is np.ndarray or isinstance(value, np.generic):
            return _array(value)
        if isinstance(value, types.Number | types.Boolean):
            return f"numba.{value.name}"
        return _name(value) or self._function(value) or self._tuple(value)

    def _function(self, value: Any) -> str:
        """Return the text of a function, compiled or not, or of its code."""
        if isinstance(value, Dispatcher):
            compiled = cast(Any, value)
            return self.of((compiled.py_func, *sorted(compiled.targetoptions.items())))
        if isinstance(value, FunctionType):
            if value not in self.reached:
                self.reached.append(value)
            return f"#{self.reached.index(value)}"
        if isinstance(value, CodeType):
            names = (value.co_names, value.co_varnames, value.co_freevars, value.co_cellvars)
            counts = (value.co_argcount, value.co_kwonlyargcount, value.co_flags)
            return self.of((value.co_code, value.co_exceptiontable, *names, *counts, value.co_consts))
        return ""

    def _tuple(self, value: Any) -> str:
        """Return the text of a tuple, also a named one, of of a class of such, or of a set in code."""
        if isinstance(value, frozenset):
            return f"{{{','.join(sorted(map(self.of, cast(Any, value))))}}}"
        if isinstance(value, tuple):
            named = "" if type(cast(Any, value)) is tuple else self.of(type(cast(Any, value)))
            return f"{named}({','.join(map(self.of, cast(Any, value)))},)"
        if isinstance(value, type) and hasattr(value, "_fields"):
            record: Any = value
            return f"{record.__qualname__}{self.of((record._fields, *record._field_defaults.items()))}"
        raise _UnknownError


def _array(array: Any) -> str:
    """Return the text of an array or of a scalar of NumPy, unless it holds addresses."""
    if array.dtype.hasobject:
        raise _UnknownError
    return f"{type(array).__name__} {array.dtype!r}{array.shape}{hashlib.sha256(array.tobytes()).hexdigest()}"


def _name(value: Any) -> str:
    """Return the name of what a library or one of the rooms keeps under it, or nothing."""
    module = "numpy" if isinstance(value, np.ufunc) else getattr(value, "__module__", None)
    name = getattr(value, "__qualname__", None) or getattr(value, "__name__", None)
    if isinstance(value, ModuleType):
        found = value.__name__
        return found if _counts_by_name(found) and sys.modules.get(found) is value else ""
    if not isinstance(module, str) or not isinstance(name, str) or not _counts_by_name(module):
        return ""
    return f"{module}.{name}" if getattr(sys.modules.get(module), name, None) is value else ""


def _counts_by_name(module: str) -> bool:
    library, room, *_ = (*module.split("."), "")
    return library in _LIBRARIES or (library == PACKAGE.name and room in ROOMS)


def _reads(function: FunctionType) -> Iterator[tuple[str, Any]]:
    """Yield what a function reads outside itself, by name, and its defaults."""
    code = function.__code__
    scope = {**vars(builtins), **function.__globals__}
    try:
        yield from (
            (name, cell.cell_contents) for name, cell in zip(code.co_freevars, function.__closure__ or (), strict=True)
        )
        yield from ((name, scope[name]) for name in sorted(set(_globals(code))))
    except (ValueError, KeyError):  # it is not there yet
        raise _UnknownError from None
    yield "defaults", (function.__defaults__, *(function.__kwdefaults__ or {}).items())


def _globals(code: CodeType) -> Iterator[str]:
    """Yield the global names that code and the functions within it read."""
    for each in dis.get_instructions(code):
        if each.opname in ("IMPORT_NAME", "LOAD_BUILD_CLASS"):  # after which it is unknown what it reads
            raise _UnknownError
        if each.opname == "LOAD_GLOBAL":
            yield each.argval
    for inner in code.co_consts:
        if isinstance(inner, CodeType):
            yield from _globals(inner)
