"""The one wrapper around numba.

``device`` marks a scalar function on one world. ``compile_kernel`` turns a function that loops over worlds into machine
code. Arithmetic is strict (no fast-math, no contraction), so a world in a vectorised loop has the bits of a world
alone.
"""

import hashlib
import inspect
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import Any, TypeVar, cast

import numba
import numpy as np
from numba.core import config
from numba.core.dispatcher import Dispatcher
from numba.core.registry import CPUDispatcher

Function = TypeVar("Function", bound=Callable[..., Any])

_INLINED: Any = {"forceinline": True, "error_model": "numpy"}
_WITHOUT_WRAPPERS: Any = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}

WITHOUT_ARRAYS: Any = {**_INLINED, **_WITHOUT_WRAPPERS, "_nrt": False}
"""Options of code that is inlined into kernels, makes no arrays and is called by no Python code when compiled."""

_NUMBA: Any = config

PACKAGE = __name__.partition(".")[0]
"""Name of the package, whose records have to be looked at."""

_CONSTANTS = (bool, int, float, str, tuple, np.generic)


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
    return cast(Function, Device(function, targetoptions={"nopython": True, "boundscheck": None, **options}))


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
    function = _bind(cast(FunctionType, build(digest)), inlined)
    try:
        kernel = numba.njit(nogil=True, error_model="numpy", cache=all(map(_has_module, inlined.values())))(function)
    except RuntimeError:  # numba found no folder that it may write to
        kernel = numba.njit(nogil=True, error_model="numpy")(function)
    if hasattr(kernel, "compile"):  # not with NUMBA_DISABLE_JIT=1
        _compile_apart(kernel)
    return cast(Function, kernel)


def digest_of(function: Callable[..., Any]) -> str:
    """Return a hash of all sources and constants that a function reaches, compiled or not."""
    return _digest(getattr(function, "py_func", function))


def _has_module(value: object) -> bool:
    """Tell whether a function is in a module: what is not, as after ``exec``, could not be loaded from a cache."""
    function = getattr(value, "py_func", value)
    return not isinstance(function, FunctionType) or inspect.getmodule(function) is not None


def _compile_apart(kernel: Any) -> None:
    """Let a kernel compile in a thread of its own: an interrupt (Ctrl-C) within LLVM would break the process."""
    compile_here = kernel.compile

    def compile_there(signature: Any) -> Any:
        thread = ThreadPoolExecutor(1, thread_name_prefix="pter-compiler")
        try:
            return thread.submit(compile_here, signature).result()
        finally:
            thread.shutdown(wait=False)

    kernel.compile = compile_there


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


def _digest(kernel: FunctionType) -> str:
    """Hash this file, the functions that the kernel reaches, with their sources, and the constants that they name."""
    sources = {Path(__file__).read_bytes()}
    constants: set[str] = set()
    seen: set[int] = set()
    pending: list[Any] = [kernel]
    while pending:
        function = pending.pop()
        if id(function) in seen:
            continue
        seen.add(id(function))
        code = function.__code__
        sources.add(_source(code))
        constants.add(f"{function.__module__}.{function.__qualname__}:{code.co_firstlineno}")
        for name, named in _named(function):
            value: Any = cast(Any, named).py_func if isinstance(named, Dispatcher) else named
            if isinstance(value, FunctionType):
                pending.append(value)
            elif isinstance(value, type) and value.__module__.startswith(PACKAGE):
                constants.add(f"{name}={getattr(value, '_fields', value)!r}")
            elif isinstance(value, np.ndarray):
                constants.add(f"{name}={value.dtype.str}{value.shape}{hashlib.sha256(value.tobytes()).hexdigest()}")
            elif isinstance(value, _CONSTANTS):
                constants.add(f"{name}={value!r}")
    content = hashlib.sha256()
    for source in sorted(sources):
        content.update(source)
    content.update("\n".join(sorted(constants)).encode())
    return content.hexdigest()


def _named(function: FunctionType) -> Iterator[tuple[str, Any]]:
    """Yield what a function names outside itself: globals, attributes of modules, its closure and its defaults."""
    names = _names(function.__code__)
    known = [(name, function.__globals__[name]) for name in names if name in function.__globals__]
    yield from known
    for prefix, module in known:
        if isinstance(module, ModuleType):
            yield from ((f"{prefix}.{name}", vars(module)[name]) for name in names if name in vars(module))
    cells = zip(function.__code__.co_freevars, function.__closure__ or (), strict=True)
    yield from ((name, cell.cell_contents) for name, cell in cells)
    yield from ((f"default {k}", value) for k, value in enumerate(function.__defaults__ or ()))


def _names(code: CodeType) -> set[str]:
    """Return the names in a function's code and in that of the functions within it."""
    return set(code.co_names).union(*(_names(inner) for inner in code.co_consts if isinstance(inner, CodeType)))


def _source(code: CodeType) -> bytes:
    """Return the file that holds a function, or its bytecode where there is no file, as in a notebook."""
    try:
        return Path(code.co_filename).read_bytes()
    except OSError:
        return code.co_code + repr((code.co_consts, code.co_names)).encode()
