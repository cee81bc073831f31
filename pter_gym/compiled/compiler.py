"""The one wrapper around numba.

``device`` marks a scalar function on one world. ``compile_kernel`` turns a function that loops over worlds into machine
code. Arithmetic is strict (no fast-math, no contraction), so a world in a vectorised loop has the bits of a world
alone.
"""

import builtins
import dis
import hashlib
import inspect
import sys
from collections import ChainMap
from collections.abc import Callable, Iterable, Iterator
from enum import Enum, EnumType
from pathlib import Path
from types import CellType, CodeType, FunctionType, ModuleType
from typing import Any, TypeVar, cast

import numba
import numpy as np
from numba.core import config, types
from numba.core.dispatcher import Dispatcher
from numba.core.registry import CPUDispatcher
from numpy.typing import NDArray

from pter_gym.compiled import pipeline
from pter_gym.compiled.stored import StoredKernels

Function = TypeVar("Function", bound=Callable[..., Any])

_INLINED: Any = {"forceinline": True, "error_model": "numpy"}
_WITHOUT_WRAPPERS: Any = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}

WITHOUT_ARRAYS: Any = {**_INLINED, **_WITHOUT_WRAPPERS, "_nrt": False}
"""Options of code that is inlined into kernels, makes no arrays and is called by no Python code when compiled."""

_KERNEL: Any = {"nogil": True, "error_model": "numpy", "pipeline_class": pipeline.Kernel}

_NUMBA: Any = config

PACKAGE = __name__.partition(".")[0]
"""Name of the package, whose records have to be looked at."""

_CONSTANTS = (bool, int, float, complex, str, bytes, type(None), type(...))

_LIBRARIES = ("builtins", "math", "cmath", "_operator", "operator", "typing", "numpy", "numba")
"""Packages whose parts are told by their names."""

_CELL = "cell "

_ROOTS = {"LOAD_GLOBAL": "", "LOAD_DEREF": _CELL}
"""Instructions with which a dotted name begins, and how its text begins."""

_UNREADABLE = ("IMPORT_NAME", "LOAD_BUILD_CLASS")
"""Instructions after which nobody can tell what is read."""


class Device(CPUDispatcher):
    """A function that is compiled for compiled callers alone; for others it is the Python function that it was.

    Without the wrappers by which Python calls compiled code, kernels compile in three quarters of the time.
    """

    def add_overload(self, cres: Any) -> None:
        """Keep what was compiled for compiled callers."""
        self.overloads[tuple(cres.signature.args)] = cres

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        """Call the Python function."""
        return self.py_func(*args, **kwargs)


def _for_compiled_callers(function: Function, **options: Any) -> Function:
    if _NUMBA.DISABLE_JIT:
        return function
    return cast(Function, Device(function, {}, {"nopython": True, "boundscheck": None, **options}, pipeline.Part))


def device(function: Function) -> Function:
    """Compile a scalar function so that it is always inlined into the kernel that calls it.

    It may read and write the arrays that it gets and makes none of its own: numba then counts no references to arrays,
    which would cost more than the arithmetic and keep loops from being vectorised.
    """
    return _for_compiled_callers(function, **WITHOUT_ARRAYS)


def outlined(function: Function) -> Function:
    """Compile a scalar function of the kind of ``device`` once, however often it is called: what is rare but long."""
    return _for_compiled_callers(function, **{**WITHOUT_ARRAYS, "forceinline": False})


def inlined(function: Function) -> Function:
    """Compile a user's scalar function as ``device`` does, but let it make arrays."""
    return cast(Function, numba.njit(**_INLINED)(function))


def compile_kernel(build: Callable[[str], Function], **inlined: object) -> Function:
    """Compile a kernel with a cache that notices a change in any function that it inlines.

    Numba's cache sees only the file of the kernel itself (numba issue 1833). So ``build`` gets a digest of every source
    that the kernel reaches and returns the kernel with that digest in its closure, which is part of numba's cache key.
    A kernel that reads what has no digest is compiled in memory, each time.

    Parameters
    ----------
    build
        A factory: ``build(digest)`` returns a function whose body names ``digest``.
    **inlined
        Global names of the kernel to bind to other values: a control law, for example. A closure over a compiled
        function would give a new cache key in each process; a global name does not.
    """
    template = cast(FunctionType, build(""))
    digest = _digest(_bind(template, inlined))
    function = _bind(cast(FunctionType, build(digest or "")), inlined)
    stored = digest is not None and all(map(_has_module, inlined.values()))
    kernel: Any = numba.njit(**_KERNEL)(function)
    if hasattr(kernel, "compile"):  # not with NUMBA_DISABLE_JIT=1
        pipeline.compile_apart(kernel, stored=stored and _is_stored(kernel))
    return cast(Function, kernel)


def _is_stored(kernel: Any) -> bool:
    """Let a kernel be stored on the disk; tell whether there is a folder for it."""
    try:
        kernel._cache = StoredKernels(kernel.py_func)
    except RuntimeError:
        return False
    return True


def digest_of(function: Callable[..., Any]) -> str | None:
    """Return a hash of all that a function reaches, compiled or not, or None if that cannot be told."""
    return _digest(function)


def files_of(function: Callable[..., Any]) -> set[str]:
    """Return the files of all functions that a function of this package reaches, compiled or not, and this file."""
    content = _Content()
    content.all_of(function)
    return content.files


def _has_module(value: object) -> bool:
    """Tell whether a function is in a module: what is not, as after ``exec``, could not be loaded from a cache."""
    function = getattr(value, "py_func", value)
    return not isinstance(function, FunctionType) or inspect.getmodule(function) is not None


def _bind(function: FunctionType, names: dict[str, object]) -> FunctionType:
    bound = FunctionType(
        function.__code__,
        {**function.__globals__, **names},
        function.__name__,
        function.__defaults__,
        function.__closure__,
    )
    bound.__qualname__ = function.__qualname__
    bound.__module__ = function.__module__
    return bound


def _digest(function: object) -> str | None:
    """Hash this file, the functions that a function reaches, with their files, and all that they read.

    None where they read anything whose content cannot be told.
    """
    try:
        parts = _Content().all_of(function)
    except _UnknownError:
        return None
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()


class _UnknownError(Exception):
    """The content of something that a function reads cannot be told."""


class _Content:
    """Texts that differ where values differ.

    The text of a function is its number, in the order in which functions are reached: so a function may call itself,
    and two that exchange what they read do not look alike.
    """

    def __init__(self) -> None:
        self._reached: list[FunctionType] = []
        self._numbers: dict[int, int] = {}
        self._known: dict[int, tuple[object, str]] = {}

    def all_of(self, function: object) -> list[str]:
        """Return the texts of a function, of all that it reaches, and the hashes of their files."""
        parts = [self._of(function)]
        for reached in self._reached:  # grows on the way
            code = reached.__code__
            parts.append(f"{reached.__module__}.{reached.__qualname__}:{code.co_firstlineno}{self._of(code)}")
            parts.extend(f"{name}={self._of(value)}" for name, value in _reads(reached))
        return parts + sorted(map(_file_hash, self.files))

    @property
    def files(self) -> set[str]:
        """The files of the functions that were reached, and those that compile."""
        return {
            str(Path(__file__)),
            str(Path(pipeline.__file__)),
            *(reached.__code__.co_filename for reached in self._reached),
        }

    def _of(self, value: Any) -> str:
        if id(value) not in self._known:
            texts = (each(value) for each in (_plain, self._several, self._code, self._kind, _library))
            self._known[id(value)] = value, next(filter(None, texts))
        return self._known[id(value)][1]

    def _several(self, value: Any) -> str:
        """Return the text of a tuple, also one with names, or of a set among the constants of code."""
        kind = cast(Any, type(value))
        if kind is frozenset:
            return f"{{{','.join(sorted(map(self._of, value)))}}}"
        if kind is tuple:
            return f"({','.join(map(self._of, value))},)"
        return f"{self._of(kind)}{self._of(tuple(value))}" if _has_fields(kind) else ""

    def _code(self, value: Any) -> str:
        """Return the text of a function, compiled or not, or of its code."""
        if isinstance(value, Dispatcher):
            options = tuple(sorted(cast(Any, value).targetoptions.items()))
            return f"{self._of(cast(Any, value).py_func)}{self._of(options)}"
        if isinstance(value, FunctionType) and not _in_library(value):
            return f"#{self._number(value)}"
        if isinstance(value, CodeType):
            names = (value.co_names, value.co_varnames, value.co_freevars, value.co_cellvars)
            counts = (value.co_argcount, value.co_kwonlyargcount, value.co_flags)
            return self._of((value.co_code, value.co_exceptiontable, *names, *counts, value.co_consts))
        return ""

    def _number(self, function: FunctionType) -> int:
        number = self._numbers.setdefault(id(function), len(self._reached))
        if number == len(self._reached):
            self._reached.append(function)
        return number

    def _kind(self, value: Any) -> str:
        """Return the text of an enum, of one of its members, or of a class of named tuples."""
        if isinstance(value, Enum):
            return f"{self._of(type(value))}.{value.name}={self._of(value.value)}"
        if isinstance(value, EnumType):
            return f"{_full_name(value)}{self._of(tuple((key, each.value) for key, each in _members(value)))}"
        if _has_fields(value):
            return f"{_full_name(value)}{self._of((value._fields, tuple(value._field_defaults.items())))}"
        return ""


def _members(enum: Any) -> Iterable[tuple[str, Any]]:
    return enum.__members__.items()


def _has_fields(kind: Any) -> bool:
    """Tell whether something is a class of named tuples."""
    return isinstance(kind, type) and issubclass(kind, tuple) and hasattr(cast(Any, kind), "_fields")


def _full_name(kind: type) -> str:
    return f"{kind.__module__}.{kind.__qualname__}"


def _plain(value: Any) -> str:
    """Return the text of a constant or an array."""
    if type(value) in _CONSTANTS:
        return repr(value)
    if type(value) is np.ndarray or isinstance(value, np.generic):
        return _array(cast(Any, value))
    if isinstance(value, types.Number | types.Boolean):
        return f"numba.{value.name}"
    return ""


def _array(array: NDArray[Any]) -> str:
    """Return the text of an array or of a scalar of NumPy, if it holds no addresses."""
    if array.dtype.hasobject:
        return ""
    return f"{type(array).__name__} {array.dtype!r}{array.shape}{hashlib.sha256(array.tobytes()).hexdigest()}"


def _library(value: Any) -> str:
    """Return the name of what is part of a library that numba knows, or a class of this package."""
    if (
        isinstance(value, ModuleType)
        and sys.modules.get(value.__name__) is value
        and _is_of(value.__name__, _LIBRARIES)
    ):
        return f"module {value.__name__}"
    name = _in_library(value)
    if not name:
        raise _UnknownError
    return name


def _in_library(value: Any) -> str:
    """Return the name under which a library keeps a value, if one does."""
    module = "numpy" if isinstance(value, np.ufunc) else getattr(value, "__module__", None)
    name = getattr(value, "__qualname__", None) or getattr(value, "__name__", None)
    packages = (*_LIBRARIES, PACKAGE) if isinstance(value, type) else _LIBRARIES
    if not isinstance(module, str) or not isinstance(name, str) or not _is_of(module, packages):
        return ""
    return f"{module}.{name}" if getattr(sys.modules.get(module), name, None) is value else ""


def _is_of(module: str, packages: tuple[str, ...]) -> bool:
    return module.partition(".")[0] in packages


def _reads(function: FunctionType) -> Iterator[tuple[str, Any]]:
    """Yield what a function reads outside itself, by its dotted names, and its defaults."""
    cells = zip(function.__code__.co_freevars, function.__closure__ or (), strict=True)
    scope: ChainMap[str, Any] = ChainMap(
        {f"{_CELL}{name}": cell for name, cell in cells}, function.__globals__, builtins.__dict__
    )
    for path in dict.fromkeys(_paths(function.__code__)):
        if path[0] in scope:
            yield ".".join(path), _follow(scope[path[0]], path[1:])
        elif not path[0].startswith(_CELL):  # else a name that the function itself shares with one within it
            raise _UnknownError
    yield "defaults", function.__defaults__
    yield "defaults by name", tuple((function.__kwdefaults__ or {}).items())


def _follow(value: Any, attributes: tuple[str, ...]) -> Any:
    """Return what a dotted name leads to, as far as it leads through modules."""
    try:
        value = value.cell_contents if isinstance(value, CellType) else value
        for attribute in attributes:
            if not isinstance(value, ModuleType):
                break
            value = getattr(value, attribute)
    except (AttributeError, ValueError) as error:
        raise _UnknownError from error
    return value


def _paths(code: CodeType) -> Iterator[tuple[str, ...]]:
    """Yield the dotted names that code and the functions within it read, where they begin outside of it."""
    path: tuple[str, ...] = ()
    for each in dis.get_instructions(code):
        if each.opname in _UNREADABLE:
            raise _UnknownError
        if path and each.opname in ("LOAD_ATTR", "LOAD_METHOD"):
            path += (str(each.argval),)
        elif each.opname != "EXTENDED_ARG":
            if path:
                yield path
            path = (_ROOTS[each.opname] + each.argval,) if each.opname in _ROOTS else ()
    for inner in code.co_consts:
        if isinstance(inner, CodeType):
            yield from _paths(inner)


def _file_hash(name: str) -> str:
    """Hash the file that holds a function, if there is one: none in a notebook."""
    try:
        return hashlib.sha256(Path(name).read_bytes()).hexdigest()
    except OSError:
        return ""
