"""Device functions: compiled for kernels, and plain Python for Python."""

from concurrent.futures import ThreadPoolExecutor
from enum import Enum
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any, NamedTuple

import numba
import numpy as np
import pytest

from pter_gym._compiled import digests, prefetch
from pter_gym._compiled.compiler import compile_kernel, device
from pter_gym._compiled.digests import SOURCES, digest_of, files_of
from pter_gym._engine.kernels import _build_advance, _build_reset
from pter_gym.controllers._base import _build_act


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


def long(volts: float) -> Any:
    """Return an array whose ``repr`` leaves out what is in its middle."""
    array = np.zeros(2000)
    array[1000] = volts
    return array


class Pair(NamedTuple):
    weights: Any
    other: float = 0.0


def of_tuple(read: Any) -> Any:
    @device
    def law(x: float) -> float:
        return x + read[0][1000]

    return law


def of_deep_tuple(read: Any) -> Any:
    @device
    def law(x: float) -> float:
        return x + read[0][0][1000]

    return law


def of_member(read: Any) -> Any:
    @device
    def law(x: float) -> float:
        return x + read.value

    return law


def of_function(read: Any) -> Any:
    @device
    def law(x: float) -> float:
        return x + read(0.0)

    return law


READ: dict[str, Any] = {
    "tuple": (of_tuple, lambda volts: (long(volts),)),
    "named tuple": (of_tuple, lambda volts: Pair(long(volts))),
    "deep tuple": (of_deep_tuple, lambda volts: ((long(volts),),)),
    "function": (of_function, adding),
}


@pytest.mark.parametrize("kind", READ)
def test_what_a_law_reads_is_part_of_it(kind: str) -> None:
    make, read = READ[kind]
    assert digest_of(make(read(12.0))) == digest_of(make(read(12.0))) is not None
    assert digest_of(make(read(1.0))) != digest_of(make(read(12.0)))


def of_two(one: Any, two: Any) -> Any:
    def law(x: float) -> float:
        return one(x) - two(x)

    return law


LIKE: dict[str, Any] = {
    "last bit": (adding(0.1), adding(0.1 + 1e-16)),
    "last bit in an array": (of_tuple((np.array([0.1]),)), of_tuple((np.array([0.1 + 1e-16]),))),
    "sign of zero": (adding(0.0), adding(-0.0)),
    "type": (adding(1.0), adding(np.float64(1.0))),
    "order": (of_two(adding(1.0), adding(2.0)), of_two(adding(2.0), adding(1.0))),
    "line": ((lambda x: x + 1.0), (lambda x: x + 2.0)),
    "options": (numba.njit(one.py_func), numba.njit(fastmath=True)(one.py_func)),
    "names": (of_tuple(np.zeros(1, [("a", "f8")])), of_tuple(np.zeros(1, [("b", "f8")]))),
}


@pytest.mark.parametrize("pair", LIKE)
def test_laws_that_look_alike_differ(pair: str) -> None:
    found = [digest_of(each) for each in LIKE[pair]]
    assert None not in found
    assert found[0] != found[1]


def of_import() -> Any:
    def law(x: float) -> float:
        from math import pi

        return x + pi

    return law


@numba.vectorize
def raised(x: float) -> float:
    return x + 3.0


UNKNOWN: dict[str, Any] = {
    "an object": of_member(SimpleNamespace(value=1.0)),
    "an object in a tuple": of_tuple((SimpleNamespace(),)),
    "a list": of_tuple([1.0]),
    "a member of an enum": of_member(Enum("Volts", {"VOLTS": 1.0}).VOLTS),
    "addresses": of_tuple(np.array([object()])),
    "another kind of array": of_tuple(np.ma.zeros(3)),
    "a module": of_member(ModuleType("settings")),
    "an import": of_import(),
    "a function of arrays": of_function(raised),
    "no function": SimpleNamespace(),
}


@pytest.mark.parametrize("kind", UNKNOWN)
def test_what_cannot_be_told_has_no_digest(kind: str) -> None:
    assert digest_of(UNKNOWN[kind]) is None


def test_a_law_without_a_digest_is_compiled_in_memory() -> None:
    stored, not_stored = (compile_kernel(build_kernel, law=each) for each in (one, of_function(raised)))
    assert (stored(0.0), not_stored(0.0)) == (1.0, 3.0)
    assert stored.stats.cache_path is not None
    assert not_stored.stats.cache_path is None


def test_kernels_reach_no_file_beside_those_that_count_as_a_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    """A kernel that reached another file would be found in the cache after that file has changed."""
    monkeypatch.setattr(digests, "ROOMS", ())  # so every function is looked at, but what emits instructions by itself
    known = digests._counts_by_name
    monkeypatch.setattr(digests, "_counts_by_name", lambda module: module == prefetch.__name__ or known(module))
    reached = {build.__module__: files_of(build("")) for build in (_build_act, _build_advance, _build_reset)}
    names = {Path(file) for files in reached.values() for file in files if Path(file).is_file()}
    assert len(names) > 20
    assert names <= set(SOURCES)
