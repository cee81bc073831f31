"""Device functions: compiled for kernels, and plain Python for Python."""

from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple

import numba
import numpy as np
import pytest

from pter_gym.compiled.compiler import compile_kernel, device, digest_of


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


# --- the cache of kernels ---

TABLE = np.array([1.0, 2.0])
law: Any = None


@device
def one(x: float) -> float:
    return x + 1.0


@device
def two(x: float) -> float:
    return x + 2.0


def adding(amount: float) -> Any:
    @device
    def law(x: float) -> float:
        return x + amount

    return law


@device
def from_a_table(x: float) -> float:
    return x + TABLE[1]


def build_kernel(digest: str) -> Any:
    def kernel(x: float) -> Any:
        _ = digest
        return law(x)

    return kernel


def test_laws_of_one_file_that_differ_have_kernels_of_their_own() -> None:
    laws = {1.0: one, 2.0: two, 3.0: adding(3.0), 4.0: adding(4.0)}
    assert len({digest_of(each) for each in laws.values()}) == 4
    assert digest_of(adding(3.0)) == digest_of(adding(3.0))
    for amount, each in laws.items():
        assert compile_kernel(build_kernel, law=each)(0.0) == amount


def test_an_array_that_a_law_names_is_part_of_it(monkeypatch: pytest.MonkeyPatch) -> None:
    before = digest_of(from_a_table)
    monkeypatch.setitem(globals(), "TABLE", np.array([1.0, 3.0]))
    assert digest_of(from_a_table) != before
