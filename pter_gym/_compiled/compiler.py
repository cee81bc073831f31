# pyright: standard
"""The one wrapper around numba.

``inlined`` marks a scalar function on one world. ``compile_kernel`` turns a function that loops
over worlds into machine code. Arithmetic is strict (no fast-math, no contraction), so a world in a
vectorised loop has the bits of a world alone.
"""

import inspect
from collections.abc import Callable
from contextlib import suppress
from types import FunctionType
from typing import Any, TypeVar, cast

import numba
from numba.core import config
from numba.core.compiler import Compiler

from pter_gym._compiled import pipeline
from pter_gym._compiled.digests import digest_of
from pter_gym._compiled.pipeline import INLINED, WITHOUT_ARRAYS
from pter_gym._compiled.stored import StoredKernel

Function = TypeVar("Function", bound=Callable[..., Any])

_NUMBA: Any = config
# numba would read settings, such as where to cache code, from a file in the working directory
_NUMBA._config_fname = ""
_NUMBA.reload_config()

COMPILES = not _NUMBA.DISABLE_JIT
"""Whether code is compiled; with ``NUMBA_DISABLE_JIT=1``, all of it is called as Python."""


def _for_compiled_callers(function: Function, **options: Any) -> Function:
    if not COMPILES:
        return function
    compiler = pipeline.FunctionCompiler
    return cast(Function, pipeline.for_compiled_callers(function, compiler, options))


def inlined(function: Function) -> Function:
    """Compile a scalar function so that it is always inlined into the kernel that calls it.

    It may read and write its array arguments but must not create arrays: numba then counts no
    references, which would cost more than the arithmetic and keep loops from being vectorised.
    """
    return _for_compiled_callers(function, **WITHOUT_ARRAYS)


def outlined(function: Function) -> Function:
    """Compile a function like ``inlined``, but once for all its calls: what is long but rare."""
    return _for_compiled_callers(function, **{**WITHOUT_ARRAYS, "forceinline": False})


def compiled(function: Function) -> Function:
    """Compile a user's scalar function as ``inlined`` does, but let it make arrays."""
    return cast(Function, numba.njit(**INLINED)(function))


def compile_kernel(build: Callable[[str], Function], **names: object) -> Function:
    """Compile a kernel with a cache that notices a change in any function that it inlines.

    Numba's cache looks at the file of the kernel alone (numba issue 1833). So ``build`` gets a
    digest of all that the kernel reaches and returns the kernel with that digest in its closure,
    which is part of the key in numba's cache. Each process compiles a kernel without a digest
    again.

    Parameters
    ----------
    build
        A factory: ``build(digest)`` returns a function whose body names ``digest``.
    **names
        Global names of the kernel to bind to other values: a control law, for example. In a
        closure, a compiled function would give the kernel another key in each process.
    """
    plain = cast(FunctionType, build(""))
    digest = digest_of(_bind(plain, names))
    function = _bind(cast(FunctionType, build(digest or "")), names)
    kernel: Any = pipeline.kernel_of(function, pipeline.KernelCompiler)
    if COMPILES:
        # a cache could not load functions that are in no module, as after exec
        if digest and all(inspect.getmodule(value) for value in names.values() if callable(value)):
            with suppress(RuntimeError):  # there is no folder to write to
                if pipeline.KernelCompiler is Compiler:
                    kernel.enable_caching()
                else:
                    stamp = digest_of(plain) if names else digest
                    kernel._cache = StoredKernel(function, stamp or "")
        if pipeline.KernelCompiler is not Compiler:
            pipeline.announce(kernel)
    return cast(Function, kernel)


def entry_of(kernel: Any, signature: Any) -> Any:
    """Return the machine code of a kernel for a signature, which looks at no argument's type."""
    return kernel.compile(tuple(signature.args)) if COMPILES else kernel


def _bind(function: FunctionType, names: dict[str, object]) -> FunctionType:
    bound = FunctionType(
        function.__code__,
        {**function.__globals__, **names},
        function.__name__,
        function.__defaults__,
        function.__closure__,
    )
    bound.__qualname__ = function.__qualname__
    return bound
