"""The substep loop against what this machine's arithmetic can do at most, on one thread.

The peak is that of a compiled loop of independent multiplications and additions, as many of each, without loads and
stores. It does not contract a product and a sum into one operation (FMA), since the simulator may not: its results
would no longer be the same bits alone and in a batch.

The time of the substep loop is the difference between two control steps from the same states, one with more substeps
than the other, so what else a control step does is not in it.
"""

import os
import re
import statistics
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from functools import cache, partial
from typing import Any, NamedTuple

import numba
import numpy as np

from pter_gym.speed.counting import count_operations
from pter_gym.speed.ours import make_vec, random_actions, substeps_per_step
from pter_gym.speed.timing import seconds_of
from pter_gym.tasks.path_following import PathFollowing

_WORLDS = 1_024
_STEPS_BEFORE = 12
_MORE = 5
_CHAINS = 6
_UNROLLED = 16
_LANES = 64
_CALLS = 20_000


@dataclass(frozen=True)
class Roofline:
    """The substep loop on one thread.

    Attributes
    ----------
    operations_per_substep, operations_per_step
        Counted floating-point operations of one world; ``pter_gym.speed.counting`` says what counts.
    peak
        Measured largest rate of multiplications and additions that are not contracted [1/s].
    peak_width
        Numbers in a vector of the loop that measured the peak; 1 if it was not vectorised.
    nanoseconds_per_substep
        Of one world.
    share, share_of_step
        Of the peak, in the substep loop and in the whole control step: median of alternating blocks.
    widths
        Width of each loop that LLVM vectorised in the block kernel, by its own report; empty if it was not asked.
    """

    operations_per_substep: float
    operations_per_step: float
    peak: float
    peak_width: int
    nanoseconds_per_substep: float
    share: float
    share_of_step: float
    widths: tuple[int, ...]


def measure_roofline(rounds: int, *, recompile: bool = True) -> Roofline:
    """Count, and measure peak and substep loop in turn.

    Parameters
    ----------
    rounds
        Each takes control steps of 1,024 worlds, some five times as long, and the peak.
    recompile
        Whether to ask LLVM about the block kernel, which has to compile again for that.
    """
    counts = count_operations()
    found = _rounds(rounds)
    return Roofline(
        operations_per_substep=counts.substep,
        operations_per_step=counts.step,
        peak=statistics.median(each.peak for each in found),
        peak_width=min(vectorised_loops("peak_kernel"), default=1),  # loops over bytes are wider
        nanoseconds_per_substep=1e9 * statistics.median(each.substep for each in found),
        share=statistics.median(counts.substep / (each.substep * each.peak) for each in found),
        share_of_step=statistics.median(counts.step / (each.step * each.peak) for each in found),
        widths=tuple(sorted(vectorised_loops("one_step"))) if recompile else (),
    )


class _Round(NamedTuple):
    """Peak [1/s], and the time of a substep and of a whole control step of one world [s], measured in turn."""

    peak: float
    substep: float
    step: float


def _rounds(count: int) -> list[_Round]:
    numbers = np.ones((2 * _CHAINS, _LANES))
    kernel = peak_kernel()
    short, long = _stepper(1), _stepper(_MORE)
    substeps = _WORLDS * (_MORE - 1) * substeps_per_step()
    operations = _CALLS * _LANES * 2 * _CHAINS * _UNROLLED
    found: list[_Round] = []
    for _ in range(count):
        peak = operations / min(seconds_of(partial(kernel, numbers, 1.0, 0.0, _CALLS)) for _ in range(3))
        one, more = min(short() for _ in range(5)), min(long() for _ in range(5))
        found.append(_Round(peak, (more - one) / substeps, one / _WORLDS))
    return found


def _stepper(times: int) -> Any:
    """Return a function that tells the time [s] of a control step with ``times`` as many substeps as usual.

    It begins from the same states each time, a little after the start of the episodes.
    """
    task = PathFollowing()
    env = make_vec(_WORLDS, 1, task=PathFollowing(control_period=times * task.control_period))
    before = make_vec(_WORLDS, 1)
    before.reset(seed=0)
    actions = random_actions(before)
    for _ in range(_STEPS_BEFORE):
        before.step(actions[0])
    state = before.get_state()
    env.reset(seed=0)

    def step() -> float:
        env.set_state(state)
        return seconds_of(partial(env.step, actions[0]))

    step()
    return step


@cache
def peak_kernel() -> Any:
    """Return the compiled ``peak(x (12, 64), factor, term, calls)``; every column multiplies and adds."""

    def peak(x: Any, factor: float, term: float, calls: int) -> None:
        w = np.empty((2 * _CHAINS, _LANES))
        w[:] = x
        for _ in range(calls):
            for i in range(_LANES):
                a0, a1, a2, a3, a4, a5 = w[0, i], w[1, i], w[2, i], w[3, i], w[4, i], w[5, i]
                b0, b1, b2, b3, b4, b5 = w[6, i], w[7, i], w[8, i], w[9, i], w[10, i], w[11, i]
                for _ in range(_UNROLLED):
                    a0, a1, a2, a3, a4, a5 = (
                        a0 * factor,
                        a1 * factor,
                        a2 * factor,
                        a3 * factor,
                        a4 * factor,
                        a5 * factor,
                    )
                    b0, b1, b2, b3, b4, b5 = b0 + term, b1 + term, b2 + term, b3 + term, b4 + term, b5 + term
                w[0, i], w[1, i], w[2, i], w[3, i], w[4, i], w[5, i] = a0, a1, a2, a3, a4, a5
                w[6, i], w[7, i], w[8, i], w[9, i], w[10, i], w[11, i] = b0, b1, b2, b3, b4, b5
        x[:] = w

    kernel: Any = numba.njit(error_model="numpy", nogil=True)(peak)
    kernel(np.ones((2 * _CHAINS, _LANES)), 1.0, 0.0, 1)
    return kernel


def one_step() -> None:
    """Compile the block kernel, and take a control step."""
    env = make_vec(64, 1)
    env.reset(seed=0)
    env.step(random_actions(env)[0])


def vectorised_loops(function: str) -> list[int]:
    """Return the width of each loop that LLVM vectorised as a function of this module compiled again."""
    code = (
        "import llvmlite.binding as llvm; llvm.set_option('', '-pass-remarks=loop-vectorize');"
        f"from {__name__} import {function}; {function}()"
    )
    with tempfile.TemporaryDirectory() as cached:
        found = subprocess.run(
            [sys.executable, "-c", code],
            env={**os.environ, "NUMBA_CACHE_DIR": cached},
            capture_output=True,
            text=True,
            check=True,
        )
    return [int(width) for width in re.findall(r"vectorized loop \(vectorization width: (\d+)", found.stderr)]
