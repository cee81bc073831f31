# pyright: standard
"""Numba's pipeline for kernels and their functions, and the message while they compile.

These are the steps of ``shortcuts.py``, which rely on numba's internals; or numba's own, with a
warning, where a numba newer than those tested does not compile a small kernel right by them.

``announce`` takes ``_compiler.compile`` and ``stats.cache_path`` of a kernel, ``compiler.py``
``Dispatcher.add_overload`` and ``_cache``, ``stored.py`` of ``FunctionCache`` ``_cache_path``,
``_index_key``, ``_impl`` (``check_cachable``, ``reduce``, ``rebuild``, ``locator``) and, of its
``_cache_file``, ``_dump`` and ``_open_for_write``.
"""

import functools
import logging
import multiprocessing
from threading import Timer
from typing import Any, NamedTuple

import numba
import numpy as np
from numba.core.compiler import Compiler
from numba.core.registry import CPUDispatcher

TESTED = (0, 68)
"""The newest numba whose internals are known to be those of ``shortcuts.py``."""

PATIENCE = 1.0
"""Seconds of compiling after which the user gets a message."""

CACHED = "compiling, once: about 20 s"
NOT_CACHED = "compiling for this process alone, as it cannot be stored: about 20 s"
NOT_STORED = "compiled code cannot be stored: other processes will compile again"

INLINED: Any = {"forceinline": True, "error_model": "numpy"}

WITHOUT_ARRAYS: Any = {
    **INLINED,
    "no_cpython_wrapper": True,
    "no_cfunc_wrapper": True,
    "_nrt": False,
}
"""Options of code that kernels inline, that makes no arrays and that Python does not call."""

_log = logging.getLogger(__name__.partition(".")[0])
_numba: Any = numba


class KernelFunction(CPUDispatcher):
    """A function that is compiled for compiled callers; from Python, calls the original function.

    Without the wrappers by which Python calls compiled code, kernels compile in three quarters of
    the time.
    """

    def add_overload(self, cres: Any) -> None:
        """Keep what was compiled for compiled callers."""
        self.overloads[tuple(cres.signature.args)] = cres

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        """Call the Python function."""
        return self.py_func(*args, **kwargs)


def for_compiled_callers(function: Any, steps: Any, options: dict[str, Any]) -> Any:
    """Return a function that kernels call, compiled by numba's steps or those of ``shortcuts``."""
    return KernelFunction(function, {}, {"nopython": True, "boundscheck": None, **options}, steps)


def kernel_of(function: Any, steps: Any) -> Any:
    """Return a kernel that is compiled by these steps, without the interpreter's lock."""
    return _numba.njit(nogil=True, error_model="numpy", pipeline_class=steps)(function)


def announce(kernel: Any) -> None:
    """Let a kernel log a message when it has been compiling for longer than ``PATIENCE``."""
    compiler = kernel._compiler
    compile_now = compiler.compile

    def compile_announced(*signature: Any) -> Any:
        timer = Timer(PATIENCE, warn, (CACHED if kernel.stats.cache_path else NOT_CACHED,))
        timer.daemon = True
        timer.start()
        try:
            return compile_now(*signature)
        finally:
            timer.cancel()

    compiler.compile = compile_announced


@functools.cache
def warn(text: str) -> None:
    """Log a warning once, and in no worker process."""
    if multiprocessing.parent_process() is None:
        _log.warning("%s: %s", _log.name, text)


class _Pair(NamedTuple):
    low: Any
    high: Any


_FACTORS = _Pair(_Pair(0.1, -0.0), _Pair(3, 1e300))


def _works(kernel_steps: Any, function_steps: Any) -> bool:
    """Return whether a small kernel compiled by these steps computes what Python does."""

    def scaled(x: Any, i: Any) -> Any:
        return x[i] * _FACTORS.low.low + _FACTORS.high.high * _FACTORS.low.high

    def chosen(flag: Any) -> Any:
        pair = _FACTORS.low
        if flag:
            pair = _FACTORS.low
        return pair.low / _FACTORS.high.low

    def kernel(x: Any, flag: Any) -> Any:
        for i in range(len(x)):
            x[i] = scaled(x, i)
        return chosen(flag)

    numbers = np.array([0.3, -1e-300, np.inf, 7.0])
    expected, computed = numbers.copy(), numbers.copy()
    value = kernel(expected, True)
    scaled = for_compiled_callers(scaled, function_steps, WITHOUT_ARRAYS)
    chosen = for_compiled_callers(chosen, function_steps, WITHOUT_ARRAYS | {"forceinline": False})
    compiled = kernel_of(kernel, kernel_steps)
    same_value = compiled(computed, True) == value
    _ = compiled._compiler.compile, compiled.stats.cache_path  # what ``announce`` takes
    return same_value and computed.tobytes() == expected.tobytes()


def _choose() -> tuple[Any, Any]:
    """Return numba's steps for kernels and for their functions."""
    try:
        from pter_gym._compiled.shortcuts import FunctionCompiler, KernelCompiler

        version = tuple(map(int, _numba.__version__.split(".")[:2]))
        if version <= TESTED or _works(KernelCompiler, FunctionCompiler):
            return KernelCompiler, FunctionCompiler
    except Exception:  # noqa: BLE001  (whatever has changed in numba)
        pass
    warn(
        f"numba {_numba.__version__} has other internals than numba "
        f"{'.'.join(map(str, TESTED))}: kernels compile more slowly and are slower"
    )
    return Compiler, Compiler


KernelCompiler, FunctionCompiler = _choose()
