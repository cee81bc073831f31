"""The standard test of many candidates at once, each with its own machine, task and gains."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pter_gym._compiled.compiler import device
from pter_gym._engine.batch import Batch
from pter_gym._engine.law import MEMORY
from pter_gym._engine.world import ROW
from pter_gym._physics.clutch import PerClutch, lag_left
from pter_gym.benchmark._measures import START_UP, column, low_pass, vector
from pter_gym.controllers._laws import IMPEDANCE, guide
from pter_gym.params import Machine
from pter_gym.tasks.path_following import COLUMN
from pter_gym.tasks.path_following._context import CONTEXT, CONTEXT_WIDTH
from pter_gym.tools.paper.experiments.setup import Setup
from pter_gym.units import INCH

Array = NDArray[np.float64]

STEPS = 250
"""Control steps within which a run must be complete."""


@dataclass(frozen=True)
class Case:
    """A run to make: a machine, its clutches' time constant [s], its task, and Kp [V/(N·m)]."""

    machine: Machine
    time_constant: float
    setup: Setup
    feedback: float = 0.0


@dataclass(frozen=True)
class RunScores:
    """Scores of N runs, arrays of shape (N,), in the paper's units."""

    error: Array
    speed: Array
    acceleration: Array
    peak: Array
    path_length: Array
    saturated: Array
    completed: NDArray[np.bool_]


class _Runs(Batch):
    """Worlds of cases: machines that differ only in the time constant are checked and prepared once."""

    def __init__(self, cases: Sequence[Case]) -> None:
        super().__init__([case.machine for case in cases], [case.setup.task for case in cases])
        entry, count = CONTEXT.machine, len(cases)
        places: Any = self._worlds[:, ROW.context_at].ravel()[:count].astype(int)
        contexts = self._constants[places[:, None] + np.arange(CONTEXT_WIDTH)]
        for context, case in zip(contexts, cases, strict=True):
            lags = entry.voltage_decay if case.machine.clutch.lag == "voltage" else entry.torque_decay
            context[lags] = lag_left(0.5 * case.machine.substep, case.time_constant)
        begins = len(self._constants) + CONTEXT_WIDTH * np.arange(count)
        self._constants = np.concatenate([self._constants, contexts.ravel()])
        at = self._worlds[:, ROW.context_at]
        at[:] = np.append(begins, np.repeat(begins[-1:], at.size - count)).reshape(at.shape)
        self._worlds[:, ROW.draws_from] = at


def run_cases(cases: Sequence[Case]) -> RunScores:
    """Run the standard test in many worlds at once."""
    batch = _Runs(cases)
    bound: dict[tuple[int, float], Any] = {}
    for case in cases:
        key = id(case.setup), case.feedback
        if key not in bound:
            bound[key] = case.setup.with_gain(case.feedback).bind(case.setup.baseline, batch.layout).gains
    gains = np.array([bound[id(case.setup), case.feedback] for case in cases])
    obs, first = batch.reset([0] * len(cases))
    flat = np.concatenate([[IMPEDANCE, gains.shape[1]], gains.ravel()])
    rows: Any
    _, rows = batch.rollout(obs, own_impedance, flat, STEPS)
    alive = np.isfinite(rows[..., COLUMN.time])
    rows, alive = rows[: alive.any(axis=1).sum()], alive[: alive.any(axis=1).sum()]
    rows[~alive] = 0.0
    steps = np.maximum(alive.sum(axis=0), 1)
    period = cases[0].setup.task.control_period
    skipped = round(START_UP / period)
    filtered = (np.linalg.norm(low_pass(vector(rows, "acceleration"), period), axis=-1) * alive)[skipped:]
    tips = np.concatenate([vector(first, "tip")[None], vector(rows, "tip")])
    ways = np.linalg.norm(np.diff(tips, axis=0), axis=-1) * alive
    top = cases[0].machine.clutch.voltage_max * (1.0 - 1e-6)
    return RunScores(
        error=np.abs(column(rows, "normal_error")).sum(axis=0) / steps / INCH,
        speed=np.linalg.norm(vector(rows, "tip_velocity"), axis=-1).sum(axis=0) / steps / INCH,
        acceleration=filtered.sum(axis=0) / np.maximum(steps - skipped, 1) / INCH,
        peak=filtered.max(axis=0, initial=0.0) / INCH,
        path_length=ways.sum(axis=0) / INCH,
        saturated=(rows[..., [*COLUMN.volts]] >= top).mean(axis=-1).sum(axis=0) / steps,
        completed=column(rows, "is_success").max(axis=0) > 0.0,
    )


@device
def own_impedance(obs: Any, scales: Any, gains: Any, memory: Any) -> PerClutch:
    """Return the voltages of the impedance law with each world's own gains, (kind, count, gains of world 0, …)."""
    count = int(gains[1])
    first = 2 + int(memory[MEMORY.world]) * count
    return guide(obs, scales, gains[first : first + count], memory)
