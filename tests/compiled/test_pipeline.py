"""How kernels are compiled: the same results as numba's own steps, a word to the user, and nothing left behind."""

import gc
import time
from pathlib import Path
from typing import Any, NamedTuple

import numba
import numpy as np
import pytest
from numba.core.errors import TypingError

from pter_gym._compiled import pipeline
from pter_gym._compiled.compiler import compile_kernel, device, outlined
from pter_gym._compiled.records import load, rows, store

pytestmark = pytest.mark.skipif(numba.config.DISABLE_JIT, reason="nothing is compiled")


class Pair(NamedTuple):
    a: float
    b: float


class World(NamedTuple):
    first: Pair
    second: Pair
    alone: float


ROW = rows(World)

FACTOR = World(Pair(0.1, 0.2), Pair(-0.0, 1e300), 3.0)


@device
def swapped(w: Any, i: int) -> Pair:
    pair = load(w, ROW.first, i)
    return Pair(pair.b * FACTOR.first.a, pair.a)


@outlined
def chosen(flag: bool) -> Any:
    row = ROW.first
    if flag:
        row = ROW.second
    return row.b


def steps(w: Any, flag: bool) -> Any:
    for i in range(w.shape[1]):
        store(w, ROW.second, i, swapped(w, i))
        w[ROW.alone, i] += w[chosen(flag), i] * FACTOR.second.b
        if ROW.alone > 3:
            w[ROW.first[0], i] = FACTOR.second.a
    return ROW.second.a


def build_steps(digest: str) -> Any:
    def kernel(w: Any, flag: bool) -> Any:
        _ = digest
        return steps_device(w, flag)

    return kernel


steps_device = device(steps)


def build_other(digest: str) -> Any:
    def kernel(x: float) -> float:
        _ = digest
        return x + 1.0

    return kernel


def build_wrong(digest: str) -> Any:
    def kernel(x: float) -> Any:
        _ = digest
        return x.no_such_attribute

    return kernel


@pytest.fixture
def patient(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Compiling takes longer than the user's patience, and has told nobody yet."""
    fold = pipeline._fold

    def slowly(blocks: Any) -> Any:
        time.sleep(0.6)
        return fold(blocks)

    monkeypatch.setattr(pipeline, "_fold", slowly)
    monkeypatch.setattr(pipeline, "PATIENCE", 0.3)
    monkeypatch.setattr(pipeline, "_told", set[str]())
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))


@pytest.mark.parametrize("flag", [False, True])
def test_compiled_is_as_python_bit_for_bit(flag: bool) -> None:
    given = np.random.default_rng(0).normal(size=(5, 7))
    found, expected = given.copy(), given.copy()
    assert compile_kernel(build_steps)(found, flag) == steps(expected, flag) == ROW.second.a == 2
    assert found.tobytes() == expected.tobytes()


@pytest.mark.usefixtures("patient")
def test_the_user_is_told_once_and_only_if_something_is_compiled(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert compile_kernel(build_other)(1.0) == 2.0
    assert [record.getMessage() for record in caplog.records] == ["pter_gym: compiling, once: about 20 s"]
    assert caplog.records[0].name == "pter_gym"
    assert compile_kernel(build_other)(1) == 2.0  # for another type
    assert len(caplog.records) == 1
    monkeypatch.setattr(pipeline, "_told", set[str]())
    monkeypatch.setattr(pipeline, "PATIENCE", 0.0)
    kernel: Any = compile_kernel(build_other)
    assert kernel(1.0) == 2.0
    assert sum(kernel.stats.cache_hits.values()) == 1
    assert len(caplog.records) == 1


@pytest.mark.parametrize("enabled", [True, False])
def test_the_collector_is_as_it_was(enabled: bool) -> None:
    was_enabled = gc.isenabled()
    (gc.enable if enabled else gc.disable)()
    try:
        with pytest.raises(TypingError):
            compile_kernel(build_wrong)(1.0)
        assert gc.isenabled() == enabled
        assert compile_kernel(build_other)(1.0) == 2.0
        assert gc.isenabled() == enabled
    finally:
        (gc.enable if was_enabled else gc.disable)()


def test_parts_have_no_machine_code(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))
    compile_kernel(build_steps)(np.ones((5, 1)), True)
    part = next(iter(vars(swapped)["overloads"].values()))
    assert part.library.get_pointer_to_function(part.fndesc.llvm_func_name) == 0
