"""Count the floating-point operations of the control step, by running its Python source on numbers that count.

One addition, subtraction, multiplication, division or square root counts one, also a division, which takes much longer.
Comparisons, absolute values, changes of sign, choices between two values, conversions, loads and stores count nothing.
Code without branches computes both values of a choice in every lane; the source computes one, so a count is a lower
bound where they differ. In the substep loop they do not: every world there costs the same, ``Count.varies`` says so.

Sine and cosine, with which an episode starts, count one. In the substep loop are the functions that run in every
substep: not the crossing rule, which runs in few blocks, nor the steady torques, found once in a control step.

Compiled functions cannot count, so this runs in a process of its own with ``NUMBA_DISABLE_JIT=1``.
"""

import json
import math
import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import wraps
from types import FunctionType
from typing import Any, cast

import numpy as np

_COUNTED = ("add", "radd", "sub", "rsub", "mul", "rmul", "truediv", "rtruediv")
_FREE = ("neg", "abs")
_FUNCTIONS = ("sqrt", "sin", "cos")
_WORLDS = 64
_STEPS = 5


@dataclass(frozen=True)
class Count:
    """Operations of one function: of a mean call, its calls in a control step of one world, whether calls differ."""

    operations: float
    calls_per_step: float
    varies: bool


@dataclass(frozen=True)
class Counts:
    """Operations of one world: one substep in the loop, one whole control step, and each function by itself."""

    substep: float
    step: float
    functions: dict[str, Count]


class Counter:
    """How many operations there were so far."""

    total = 0


class Counted(float):
    """A number whose arithmetic counts."""

    __slots__ = ()


def count_operations() -> Counts:
    """Return the counts, from a process of its own; equal each time."""
    found = subprocess.run(
        [sys.executable, "-c", f"from {__name__} import print_counts; print_counts()"],
        env={**os.environ, "NUMBA_DISABLE_JIT": "1"},
        capture_output=True,
        text=True,
        check=True,
    )
    content = json.loads(found.stdout)
    functions = {name: Count(**count) for name, count in content["functions"].items()}
    return Counts(content["substep"], content["step"], functions)


def count_here() -> Counts:
    """Return the counts of some random control steps; with ``NUMBA_DISABLE_JIT=1`` only."""
    from pter_gym.engine import kernels
    from pter_gym.speed.ours import substeps_per_step

    teach_to_count()
    calls: dict[str, list[int]] = {}
    for name, function in vars(kernels).copy().items():
        if isinstance(function, FunctionType) and function.__module__ == "pter_gym.engine.world":
            setattr(kernels, name, observed(function, calls.setdefault(name, [])))
    _take_steps(calls)
    functions = {
        name: Count(sum(each) / len(each), len(each) / (_WORLDS * _STEPS), min(each) != max(each))
        for name, each in calls.items()
        if each
    }
    return Counts(
        substep=sum(count.operations for count in functions.values() if count.calls_per_step == substeps_per_step()),
        step=sum(count.operations * count.calls_per_step for count in functions.values()),
        functions=functions,
    )


def print_counts() -> None:
    """Print what ``count_here`` returns, as JSON."""
    sys.stdout.write(json.dumps(asdict(count_here())))


def _take_steps(calls: dict[str, list[int]]) -> None:
    """Take control steps from the midst of episodes, without what the reset before them counted."""
    from pter_gym.speed.ours import make_vec, random_actions

    env = make_vec(_WORLDS, 1)
    env.reset(seed=0)
    for each in calls.values():
        each.clear()
    actions = random_actions(env)
    for k in range(_STEPS):
        env.step(actions[k % len(actions)])
    env.close()


def teach_to_count() -> None:
    """Give the numbers their counting arithmetic, and the square root, sine and cosine of ``math`` too."""
    for name in _COUNTED:
        setattr(Counted, f"__{name}__", _arithmetic(getattr(float, f"__{name}__"), 1))
    for name in _FREE:
        setattr(Counted, f"__{name}__", _arithmetic(getattr(float, f"__{name}__"), 0))
    for name in _FUNCTIONS:
        setattr(math, name, _arithmetic(getattr(math, name), 1))


def _arithmetic(operation: Callable[..., Any], cost: int) -> Callable[..., Any]:
    def counting(*numbers: Any) -> Any:
        found = operation(*map(float, numbers))
        Counter.total += cost
        return Counted(found)

    return counting


class View:
    """An array whose numbers count. Whole numbers and flags do not."""

    def __init__(self, array: Any) -> None:
        self.array = array
        self.shape = array.shape

    def __getitem__(self, key: Any) -> Any:
        """Return a number, or a view of a part."""
        return counted(self.array[key])

    def __setitem__(self, key: Any, value: Any) -> None:
        """Write a number."""
        self.array[key] = value


def counted(value: Any) -> Any:
    """Return a number or array that counts, in place of one that does not."""
    if isinstance(value, np.ndarray):
        return View(value)
    if isinstance(value, Counted) or not isinstance(value, (float, np.floating)):
        return value
    return Counted(cast(float, value))


def observed(function: Callable[..., Any], calls: list[int]) -> Callable[..., Any]:
    """Return a function that counts in its arguments and notes what each call cost."""

    @wraps(function)
    def counting(*arguments: Any) -> Any:
        before = Counter.total
        found = function(*map(counted, arguments))
        calls.append(Counter.total - before)
        return found

    return counting
