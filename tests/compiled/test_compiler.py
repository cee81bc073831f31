"""Compiled code computes what Python does, and its cache notices changes."""

import os
import subprocess
import sys
from enum import Enum
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any, NamedTuple

import numba
import numpy as np
import pytest

from pter_gym._compiled import pipeline
from pter_gym._compiled.compiler import compile_kernel, inlined, outlined
from pter_gym._compiled.digests import digest_of
from pter_gym._compiled.records import load, rows, store
from pter_gym._engine import sensors
from pter_gym._engine.kernels import _build_advance, _build_reset
from pter_gym._physics import open_loop
from pter_gym.controllers._law_kernel import _build_act

needs_jit = pytest.mark.skipif(numba.config.DISABLE_JIT, reason="nothing is compiled")


class Pair(NamedTuple):
    a: float
    b: float


class Example(NamedTuple):
    first: Pair
    second: Pair
    alone: float


ROW = rows(Example)
FACTOR = Example(Pair(0.1, 0.2), Pair(-0.0, 1e300), 3.0)


@inlined
def swapped(w: Any, i: int, shift: float = 0.0) -> Pair:
    pair = load(w, ROW.first, i)
    return Pair(pair.b * FACTOR.first.a + shift, pair.a)


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


inlined_steps = inlined(steps)


def build_steps(digest: str) -> Any:
    def kernel(w: Any, flag: bool) -> Any:
        _ = digest
        return inlined_steps(w, flag)

    return kernel


@pytest.mark.parametrize("flag", [False, True])
def test_compiled_is_as_python_bit_for_bit(flag: bool) -> None:
    given = np.random.default_rng(0).normal(size=(5, 7))
    found, expected = given.copy(), given.copy()
    assert compile_kernel(build_steps)(found, flag) == steps(expected, flag) == ROW.second.a == 2
    assert found.tobytes() == expected.tobytes()


def test_python_calls_the_original_function() -> None:
    compile_kernel(build_steps)(np.ones((5, 1)), True)
    w = np.arange(5)[:, None]
    assert swapped(w, 0) == (0.1, 0)
    assert type(swapped(w, i=0, shift=1.0).b) is np.int64  # not the arithmetic of compiled code
    assert swapped.__name__ == "swapped"
    with pytest.raises(TypeError):
        swapped(w)


@needs_jit
def test_parts_have_no_machine_code() -> None:
    compile_kernel(build_steps)(np.ones((5, 2)), True)
    for part in vars(swapped)["overloads"].values():
        assert part.library.get_pointer_to_function(part.fndesc.llvm_func_name) == 0


CHANGES = {
    "nothing": "",
    "a class is gone": "del codegen.JITCodeLibrary",
    "a method is gone": "del compiler_machinery.PassManager.add_pass_after",
    "a class means another thing": (
        "from pter_gym._compiled import shortcuts; "
        "shortcuts.ir = SimpleNamespace(**{**vars(ir), 'Const': lambda x, at: ir.Const(2 * x, at)})"
    ),
}

WITH_ANOTHER_NUMBA = """
import os, sys
from types import SimpleNamespace
import gymnasium, hypothesis, numba, numpy as np, pytest
from numba.core import codegen, compiler_machinery, ir

numba.__version__ = "1.0.0"
for change in sys.argv[1:]:
    if child := os.fork():
        assert os.waitpid(child, 0)[1] == 0
        continue
    exec(change)
    from compiled.test_compiler import build_steps, compile_kernel, pipeline

    w = np.random.default_rng(0).normal(size=(5, 7))
    compile_kernel(build_steps)(w, True)
    print(pipeline.KernelCompiler.__name__, w.tobytes().hex())
    break
"""


@needs_jit
@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system has no fork")
def test_numba_of_other_internals_compiles_by_its_own_steps(tmp_path: Path) -> None:
    """With one warning, and the same bits."""
    given = np.random.default_rng(0).normal(size=(5, 7))
    compile_kernel(build_steps)(given, True)
    tests = str(Path(__file__).parents[1])
    ran = subprocess.run(
        [sys.executable, "-c", WITH_ANOTHER_NUMBA, *CHANGES.values()],
        env=os.environ
        | {
            "NUMBA_CACHE_DIR": str(tmp_path),
            "PYTHONPATH": os.pathsep.join([tests, os.environ.get("PYTHONPATH", "")]),
        },
        capture_output=True,
        text=True,
        check=True,
    )
    bits, expected = given.tobytes().hex(), ["KernelCompiler", *["Compiler"] * (len(CHANGES) - 1)]
    assert ran.stdout.splitlines() == [f"{steps_of} {bits}" for steps_of in expected]
    assert ran.stderr.count("numba 1.0.0 has other internals") == len(CHANGES) - 1


law: Any = None


def build_kernel(digest: str) -> Any:
    def kernel(x: float) -> Any:
        _ = digest
        return law(x)

    return kernel


@inlined
def one(x: float) -> float:
    return x + 1.0


@needs_jit
def test_a_long_compilation_is_announced_once(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(pipeline, "PATIENCE", 0.001)
    pipeline.warn.cache_clear()
    kernels: list[Any] = [compile_kernel(build_kernel, law=one) for _ in range(2)]
    assert (kernels[0](1.0), kernels[0](1)) == (2.0, 2.0)
    assert [record.name for record in caplog.records] == ["pter_gym"]
    pipeline.warn.cache_clear()
    assert kernels[1](1.0) == 2.0
    assert sum(kernels[1].stats.cache_hits.values()) == 1
    assert len(caplog.records) == 1


def adding(amount: float) -> Any:
    @inlined
    def law(x: float) -> float:
        return x + amount

    return law


def test_laws_of_one_file_that_differ_have_kernels_of_their_own() -> None:
    for amount, each in {1.0: one, 3.0: adding(3.0), 4.0: adding(4.0)}.items():
        assert compile_kernel(build_kernel, law=each)(0.0) == amount


TABLE = np.array([1.0, 2.0])


@inlined
def from_a_table(x: float) -> float:
    return x + TABLE[1]


def test_arrays_used_by_a_law_are_in_its_digest(monkeypatch: pytest.MonkeyPatch) -> None:
    before = digest_of(from_a_table)
    monkeypatch.setitem(globals(), "TABLE", np.array([1.0, 3.0]))
    assert digest_of(from_a_table) != before


def reading(value: Any) -> Any:
    @inlined
    def law(x: float) -> Any:
        return x + value[0]

    return law


def calling(*functions: Any) -> Any:
    def law(x: float) -> Any:
        return functions[0](x)

    return law


@pytest.mark.parametrize(
    "read",
    [
        lambda x: (np.array([0.0, x]),),
        lambda x: Pair(np.array([x]), 0.0),
        lambda x: ((x,),),
        adding,
    ],
)
def test_values_read_by_a_law_are_in_its_digest(read: Any) -> None:
    assert digest_of(reading(read(12.0))) == digest_of(reading(read(12.0))) is not None
    assert digest_of(reading(read(1.0))) != digest_of(reading(read(12.0)))


LIKE: dict[str, Any] = {
    "middle of an array": (reading((np.zeros(2000),)), reading((np.eye(1, 2000, 1000)[0],))),
    "last bit": (adding(0.1), adding(0.1 + 1e-16)),
    "sign of zero": (adding(0.0), adding(-0.0)),
    "type": (adding(1.0), adding(np.float64(1.0))),
    "order": (calling(adding(1.0), adding(2.0)), calling(adding(2.0), adding(1.0))),
    "line": ((lambda x: x + 1.0), (lambda x: x + 2.0)),
    "options": (numba.njit(one.py_func), numba.njit(fastmath=True)(one.py_func)),
    "names": (reading(np.zeros(1, [("a", "f8")])), reading(np.zeros(1, [("b", "f8")]))),
}


@pytest.mark.parametrize("pair", LIKE)
def test_laws_that_look_alike_differ(pair: str) -> None:
    found = [digest_of(each) for each in LIKE[pair]]
    assert None not in found
    assert found[0] != found[1]


def importing() -> Any:
    def law(x: float) -> float:
        from math import pi

        return x + pi

    return law


@numba.vectorize
def raised(x: float) -> float:
    return x + 3.0


UNKNOWN: dict[str, Any] = {
    "an object": reading(SimpleNamespace(value=1.0)),
    "a list": reading(([1.0],)),
    "a member of an enum": reading(Enum("Volts", {"VOLTS": 1.0}).VOLTS),
    "addresses": reading(np.array([object()])),
    "another kind of array": reading(np.ma.zeros(3)),
    "a module": reading(ModuleType("settings")),
    "an import": importing(),
    "a function of arrays": calling(raised),
    "no function": SimpleNamespace(),
}


@pytest.mark.parametrize("kind", UNKNOWN)
def test_undeterminable_values_have_no_digest(kind: str) -> None:
    assert digest_of(UNKNOWN[kind]) is None


def test_a_law_without_a_digest_is_compiled_in_memory() -> None:
    cached, not_cached = (compile_kernel(build_kernel, law=each) for each in (one, calling(raised)))
    assert cached(0.0) == 1.0
    assert cached.stats.cache_path is not None
    assert not_cached.stats.cache_path is None


BUILDS: Any = [_build_advance, _build_reset, _build_act, open_loop._build]


@pytest.mark.parametrize("build", BUILDS, ids=lambda build: build.__module__)
def test_kernels_of_the_package_have_a_digest(build: Any) -> None:
    assert digest_of(build("")) == digest_of(build("")) is not None


def test_the_code_that_compiles_is_in_each_digest(monkeypatch: pytest.MonkeyPatch) -> None:
    before = digest_of(one)
    monkeypatch.setattr("pter_gym._compiled.digests._compiler_text", lambda: "another compiler")
    assert digest_of(one) not in (None, before)


def test_a_constant_that_a_function_within_a_kernel_reads_is_in_its_digest(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    before = digest_of(_build_advance(""))
    monkeypatch.setattr(sensors, "BOUND", sensors.BOUND + 1.0)
    assert digest_of(_build_advance("")) != before
