"""The bound of a control step's operations: no episode exceeds it, and every loop has one."""

import shutil
from pathlib import Path

import deploy as bench  # in benchmarks
import numpy as np
import operations  # in benchmarks
import pytest

from pter_gym.benchmark import find_policy
from pter_gym.benchmark.episodes import find_episodes
from pter_gym.tools.deploy import source_of

LOOPS = """
typedef float real;
static real inner(const real *x, int n) {{
    real sum = 0;
    for (int k = 0; k < n - 1; k += 2) {{
        sum += x[k] * 2.0f;
    }}
    return n > 4 ? sum / x[0] : -sum;
}}
real outer(const real *x, int m) {{
    int n = 5;
    {change}
    if (x[0] > 0) {{
        return inner(x, 3);
    }}
    return inner(x, n);
}}
"""


def test_the_dearer_branch_of_known_loops() -> None:
    program = operations.Program(LOOPS.format(change=""), 1)
    assert program.bound("outer") == (1 + 2 * 2 + 1, 1)
    assert program.bound("inner", None, 3) == (1 * 2 + 1, 1)
    assert program.bound("inner", None, 9).all == 4 * 2 + 1


def test_a_loop_that_depends_on_data_has_no_bound() -> None:
    program = operations.Program(LOOPS.format(change="n = m;"), 1)
    with pytest.raises(ValueError, match="no bound for the loop"):
        program.bound("outer")


@pytest.mark.slow
@pytest.mark.skipif(
    not (shutil.which("cc") and shutil.which("c++")), reason="needs compilers of C and C++"
)
@pytest.mark.parametrize("name", ["single-dof-tuned", "ppo-standard"])
def test_no_step_takes_more(name: str, tmp_path: Path) -> None:
    episodes = find_episodes("standard", "medium").first(1)
    policy = find_policy(name)
    source = source_of(policy, name=name)
    found = bench.recorded(policy, episodes.machines[0], episodes.tasks[0], episodes.seeds[0])
    source.write(tmp_path)
    counted = np.array(operations.counted(tmp_path, bench.rows_of(source, *found[:2])))
    bound = np.array(operations.bound(tmp_path, 1))
    assert (counted <= bound).all()
    assert counted.all()
    assert operations.bound(tmp_path, 2) > operations.bound(tmp_path, 1)
