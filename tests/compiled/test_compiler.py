"""Device functions: compiled for kernels, and plain Python for Python."""

from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple

import numba
import numpy as np
import pytest

from pter_gym.compiled.compiler import device


class Point(NamedTuple):
    x: float
    y: float


def make_device() -> Any:
    """Return a device function that nothing has compiled yet."""

    @device
    def scaled(point: Point, factor: float, shift: float = 1.0) -> Point:
        return Point(point.x * factor + shift, point.y * factor + shift)

    return scaled


def compile_into_kernel(function: Any) -> Point:
    """Compile a device function into a kernel and return what the kernel finds."""

    @numba.njit
    def kernel(x: float, y: float) -> Any:
        return function(Point(x, y), 3.0, 0.5)

    return kernel(1.0, 2.0)


def check_calls(function: Any) -> None:
    """Check calls with each kind of argument."""
    assert function(Point(1.0, 2.0), 3.0, 0.5) == Point(3.5, 6.5)
    assert function(Point(1.0, 2.0), shift=0.5, factor=3.0) == Point(3.5, 6.5)
    assert function(factor=3.0, point=Point(1.0, 2.0), shift=0.5) == Point(3.5, 6.5)
    assert function(Point(1.0, 2.0), 3.0) == Point(4.0, 7.0)
    assert function(Point(1.0, 2.0), factor=3.0) == Point(4.0, 7.0)
    assert function(Point(1, 2), 3) == Point(4, 7)
    assert type(function(Point(1, 2), 3, 1).x) is int  # Python's arithmetic, not that of compiled code
    assert function(Point(np.ones(2), np.zeros(2)), 3.0).x.tolist() == [4.0, 4.0]


def test_python_gets_the_python_function_before_and_after_it_was_compiled() -> None:
    function = make_device()
    check_calls(function)
    assert compile_into_kernel(function) == Point(3.5, 6.5)
    check_calls(function)
    assert compile_into_kernel(function) == Point(3.5, 6.5)


def test_python_gets_the_python_function_if_it_was_compiled_first() -> None:
    function = make_device()
    assert compile_into_kernel(function) == Point(3.5, 6.5)
    check_calls(function)


def test_errors_of_a_call_are_those_of_python() -> None:
    function = make_device()
    for _ in range(2):
        with pytest.raises(TypeError):
            function(Point(1.0, 2.0))
        with pytest.raises(TypeError):
            function(Point(1.0, 2.0), 3.0, wrong=1.0)
        with pytest.raises(AttributeError):
            function(1.0, 3.0)
        compile_into_kernel(function)


def test_threads_may_call_it_while_it_compiles() -> None:
    function = make_device()
    with ThreadPoolExecutor(2) as threads:
        compiled = threads.submit(compile_into_kernel, function)
        called = threads.submit(lambda: [function(Point(1.0, float(k)), 2.0).y for k in range(2000)])
        assert compiled.result() == Point(3.5, 6.5)
        assert called.result() == [2.0 * k + 1.0 for k in range(2000)]


def test_it_keeps_name_and_docstring() -> None:
    assert make_device().__name__ == "scaled"
