"""Kernels are compiled once, and again after a change of code; there may be no cache."""

import os
import subprocess
import sys
from pathlib import Path

import numba
import numpy as np
import pytest

from pter_gym._physics import open_loop
from pter_gym.controllers import Policy
from pter_gym.params import BASELINE
from pter_gym.tasks.path_following import observation_layout

CALLEE = '''
from pter_gym._compiled.compiler import device
{constant}
@device
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


def run(folder: Path, **environment: str) -> str:
    """Run the caller in a fresh interpreter; return its value and the hits in the cache."""
    settings = {**os.environ, "NUMBA_CACHE_DIR": str(folder / "cache"), **environment}
    found = subprocess.run(
        [sys.executable, "caller.py"],
        cwd=folder,
        env=settings,
        capture_output=True,
        text=True,
        check=True,
    )
    return found.stdout.strip()


def write(folder: Path, result: str, constant: str = "", comment: str = "") -> None:
    """Write the two modules."""
    callee = CALLEE.format(result=result, constant=constant, comment=comment)
    (folder / "callee.py").write_text(callee)
    (folder / "caller.py").write_text(comment + CALLER)


def test_a_change_of_code_is_noticed_and_one_of_a_comment_is_none(tmp_path: Path) -> None:
    write(tmp_path, "1.0")
    assert run(tmp_path) == "1.0 0"
    assert run(tmp_path) == "1.0 1"
    write(tmp_path, "(1.0)  # one", comment="# a comment\n\n")
    assert run(tmp_path) == "1.0 1"
    before = (tmp_path / "caller.py").stat()
    write(tmp_path, "2.0")
    os.utime(tmp_path / "caller.py", ns=(before.st_atime_ns, before.st_mtime_ns))
    assert run(tmp_path) == "2.0 0"


def test_a_changed_constant_of_a_third_file_is_noticed(tmp_path: Path) -> None:
    (tmp_path / "third.py").write_text("LIMIT = 3.0\n")
    write(tmp_path, "LIMIT", "from third import LIMIT")
    assert run(tmp_path) == "3.0 0"
    (tmp_path / "third.py").write_text("LIMIT = 4.0\n")
    assert run(tmp_path) == "4.0 0"


def test_no_folder_to_write_to_compiles_without_a_cache(tmp_path: Path) -> None:
    write(tmp_path, "5.0")
    blocked = tmp_path / "blocked"
    blocked.write_text("a file where the cache's folder should be")
    assert run(tmp_path, NUMBA_CACHE_DIR=str(blocked)) == "5.0 0"


LAW = """
from pter_gym.controllers import PerClutch, device

@device
def law(obs, scales, gains, memory):
    return PerClutch(gains[0], {second}, 0.0, 0.0)
"""


def test_a_law_may_be_in_no_file() -> None:
    layout = observation_layout(BASELINE, "torque")
    for second, volts in (("2.0 * gains[0]", [3.0, 6.0, 0.0, 0.0]), ("5.0", [3.0, 5.0, 0.0, 0.0])):
        names = {}
        exec(compile(LAW.format(second=second), "<cell of a notebook>", "exec"), names)
        policy = Policy.of_law(names["law"], [3.0], BASELINE, layout)
        (row,) = policy.act(np.zeros((1, len(layout)), np.float32), policy.start(1))
        assert row.tolist() == volts


@pytest.mark.skipif(numba.config.DISABLE_JIT, reason="nothing is compiled")
def test_input_shapes_cause_no_recompilation() -> None:
    state, steps = open_loop.initial_state(BASELINE, (0.5, 2.0)), 5
    open_loop.simulate(BASELINE, state, np.zeros(4), np.zeros(2), duration=steps * BASELINE.substep)
    open_loop.simulate(BASELINE, state, np.zeros((steps, 4)), np.zeros(2))
    open_loop.simulate(BASELINE, state, np.zeros(4), np.zeros((steps, 2)), np.zeros((steps, 2)))
    assert len(open_loop._kernel(paper_clutches=True).signatures) == 1
