"""Kernels are compiled once, and again after a change of code; there may be no cache."""

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numba
import numpy as np
import pytest

from pter_gym._physics import open_loop
from pter_gym.controllers import Policy
from pter_gym.params import BASELINE
from pter_gym.tasks.path_following import observation_layout

needs_jit = pytest.mark.skipif(numba.config.DISABLE_JIT, reason="nothing is compiled")

CALLEE = '''
from pter_gym._compiled.compiler import inlined
{constant}
@inlined
def value():
    """Return a number.{comment}"""
    return {result}
'''

CALLER = """
from pter_gym._compiled.compiler import compile_kernel
from callee import value

def build(digest):
    def kernel():
        digest
        return value()
    return kernel

kernel = compile_kernel(build)
print(kernel(), sum(kernel.stats.cache_hits.values()))
"""


def start(folder: Path, script: str = "import caller", **environment: str) -> Any:
    """Start a fresh interpreter."""
    return subprocess.Popen(
        [sys.executable, "-c", script],
        cwd=folder,
        env={**os.environ, "NUMBA_CACHE_DIR": str(folder / "cache"), **environment},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def run(folder: Path, script: str = "import caller", **environment: str) -> str:
    """Run the caller in a fresh interpreter; return its value and the hits in the cache."""
    process = start(folder, script, **environment)
    printed, errors = process.communicate()
    assert process.returncode == 0, errors
    return printed.strip()


def write(folder: Path, result: str, constant: str = "", comment: str = "") -> None:
    """Write the two modules."""
    callee = CALLEE.format(result=result, constant=constant, comment=comment)
    (folder / "callee.py").write_text(callee)
    (folder / "caller.py").write_text(comment + CALLER)


def test_a_change_of_code_is_noticed_and_one_of_a_comment_is_none(tmp_path: Path) -> None:
    write(tmp_path, "1.0")
    assert run(tmp_path) == "1.0 0"
    write(tmp_path, "(1.0)  # one", comment="# a comment\n\n")
    assert run(tmp_path) == "1.0 1"
    before = (tmp_path / "caller.py").stat()
    write(tmp_path, "2.0")
    os.utime(tmp_path / "caller.py", ns=(before.st_atime_ns, before.st_mtime_ns))
    assert run(tmp_path) == "2.0 0"


@pytest.mark.long
def test_a_changed_constant_of_a_third_file_is_noticed(tmp_path: Path) -> None:
    (tmp_path / "third.py").write_text("LIMIT = 3.0\n")
    write(tmp_path, "LIMIT", "from third import LIMIT")
    assert run(tmp_path) == "3.0 0"
    (tmp_path / "third.py").write_text("LIMIT = 4.0\n")
    assert run(tmp_path) == "4.0 0"


@pytest.mark.long
def test_no_folder_to_write_to_compiles_without_a_cache(tmp_path: Path) -> None:
    write(tmp_path, "5.0")
    blocked = tmp_path / "blocked"
    blocked.write_text("a file where the cache's folder should be")
    assert run(tmp_path, NUMBA_CACHE_DIR=str(blocked)) == "5.0 0"


VARIANTS = """
import os, sys, time
from pter_gym._compiled.compiler import compile_kernel

def build(digest):
    def kernel(x):
        digest
        return x / 2
    return kernel

kernel = compile_kernel(build)
replace = os.replace

def replace_together(source, target):
    open(f"at {os.getpid()}", "w").close()
    while sum(name.startswith("at ") for name in os.listdir()) < 2:
        time.sleep(0.01)
    replace(source, target)

if "together" in sys.argv:
    os.replace = replace_together
for x in map(eval, sys.argv[-1].split()):
    print(kernel(x), sum(kernel.stats.cache_hits.values()))
"""


@pytest.mark.long
@needs_jit
def test_two_processes_store_variants_at_the_same_time(tmp_path: Path) -> None:
    (tmp_path / "caller.py").write_text(VARIANTS)
    together = "import sys; sys.argv += ['together', '{}']; import caller"
    writers = [start(tmp_path, together.format(x)) for x in ("3", "3.0")]
    assert [writer.communicate()[0] for writer in writers] == ["1.5 0\n", "1.5 0\n"]
    assert run(tmp_path, "import sys; sys.argv += ['3 3.0']; import caller") == "1.5 1\n1.5 2"


@pytest.mark.long
@needs_jit
def test_a_kernel_compiled_for_a_signature_is_that_of_a_call(tmp_path: Path) -> None:
    (tmp_path / "caller.py").write_text(VARIANTS)
    compiled = "import sys; sys.argv += [''] ; import caller; caller.kernel.compile('f8(i8)')"
    assert run(tmp_path, compiled) == ""
    assert run(tmp_path, "import sys; sys.argv += ['3']; import caller") == "1.5 1"


KILLED = """
import os
replace, left = os.replace, [{}]

def replace_or_die(source, target):
    if not left[0]:
        os._exit(9)
    left[0] -= 1
    replace(source, target)

os.replace = replace_or_die
import caller
"""


@pytest.mark.long
@needs_jit
@pytest.mark.parametrize("replaced", [0, 1])
def test_a_writer_is_killed_after_the_sources_changed(tmp_path: Path, replaced: int) -> None:
    write(tmp_path, "1.0")
    assert run(tmp_path) == "1.0 0"
    write(tmp_path, "2.0")
    start(tmp_path, KILLED.format(replaced)).communicate()
    assert run(tmp_path).startswith("2.0")
    assert run(tmp_path) == "2.0 1"


@pytest.mark.long
@needs_jit
def test_files_that_cannot_be_read_cost_only_time(tmp_path: Path) -> None:
    def garbled(content: bytes) -> bytes:
        middle = len(content) // 2
        return content[:middle] + bytes(64) + content[middle + 64 :]

    write(tmp_path, "1.0")
    assert run(tmp_path) == "1.0 0"
    for damaged in (lambda _: b"no pickle", lambda content: content[:-9], garbled):
        for path in (tmp_path / "cache").rglob("*.nb*"):
            path.write_bytes(damaged(path.read_bytes()))
        assert run(tmp_path) == "1.0 0"


@pytest.mark.long
@needs_jit
def test_what_cannot_be_stored_is_used_and_told_once(tmp_path: Path) -> None:
    write(tmp_path, "1.0")
    script = """
import errno, os

def full(*_):
    raise OSError(errno.ENOSPC, "No space left on device")

os.replace = full
import caller

caller.compile_kernel(caller.build)()
"""
    assert run(tmp_path, script) == "1.0 0"
    assert [path for path in (tmp_path / "cache").rglob("*") if path.is_file()] == []
    process = start(tmp_path, script)
    assert process.communicate()[1].count("No space left on device") == 1


@pytest.mark.long
@needs_jit
def test_files_of_other_sources_do_not_pile_up(tmp_path: Path) -> None:
    counts = set()
    for number in range(3):
        write(tmp_path, f"{number}.0")
        assert run(tmp_path) == f"{number}.0 0"
        counts.add(sum(path.is_file() for path in (tmp_path / "cache").rglob("*")))
    assert len(counts) == 1


LAW = """
from pter_gym.controllers import PerClutch, compiled

@compiled
def law(obs, scales, gains, memory):
    return PerClutch(gains[0], {second}, 0.0, 0.0)
"""


def test_a_law_may_be_in_no_file() -> None:
    layout = observation_layout(BASELINE, "torque")
    for second, volts in (("2.0 * gains[0]", [3.0, 6.0, 0.0, 0.0]), ("5.0", [3.0, 5.0, 0.0, 0.0])):
        names = {}
        exec(compile(LAW.format(second=second), "<cell of a notebook>", "exec"), names)
        policy = Policy.from_law(names["law"], [3.0], BASELINE, layout)
        (row,) = policy.act(np.zeros((1, len(layout)), np.float32), policy.start(1))
        assert row.tolist() == volts


@needs_jit
def test_input_shapes_cause_no_recompilation() -> None:
    state, steps = open_loop.initial_state(BASELINE, (0.5, 2.0)), 5
    open_loop.simulate(BASELINE, state, np.zeros(4), np.zeros(2), duration=steps * BASELINE.substep)
    open_loop.simulate(BASELINE, state, np.zeros((steps, 4)), np.zeros(2))
    open_loop.simulate(BASELINE, state, np.zeros(4), np.zeros((steps, 2)), np.zeros((steps, 2)))
    assert len(open_loop._kernel(paper_clutches=True).signatures) == 1
