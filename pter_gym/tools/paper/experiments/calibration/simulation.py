"""The standard test of many candidates at once, each with a machine, a task and gains of its own."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pter_gym._compiled.compiler import device
from pter_gym._engine.batch import Batch
from pter_gym._engine.law import MEMORY
from pter_gym._physics.clutch import PerClutch
from pter_gym.benchmark._measures import column, low_pass, vector
from pter_gym.benchmark._recorded import START_UP
from pter_gym.controllers._laws import IMPEDANCE, guide
from pter_gym.params import Machine
from pter_gym.tasks.path_following import COLUMN
from pter_gym.tools.paper.experiments.setup import Setup
from pter_gym.units import INCH

Array = NDArray[np.float64]

STEPS = 250
"""Control steps within which a run must be complete."""


@dataclass(frozen=True)
class Case:
    """One run to be made: a machine, its task, and the controller's gain of the torque loop [V/(N·m)]."""

    machine: Machine
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
    integrator: Array


def run_cases(cases: Sequence[Case]) -> RunScores:
    """Run the standard test in many worlds at once."""
    batch = Batch([case.machine for case in cases], [case.setup.task for case in cases])
    gains = np.array(
        [case.setup.with_gain(case.feedback).bind(case.setup.baseline, batch.layout).gains for case in cases]
    )
    obs, first = batch.reset([0] * len(cases))
    flat = np.concatenate([[IMPEDANCE, gains.shape[1]], gains.ravel()])
    rows: Any
    _, rows = batch.rollout(obs, own_impedance, flat, STEPS)
    alive = np.isfinite(rows[..., COLUMN.time])
    steps = np.maximum(alive.sum(axis=0), 1)
    rows = np.where(alive[..., None], rows, 0.0)
    period = cases[0].setup.task.control_period
    skipped = round(START_UP / period)
    filtered = np.linalg.norm(low_pass(vector(rows, "acceleration"), period), axis=-1) * alive
    tips = np.concatenate([vector(first, "tip")[None], vector(rows, "tip")])
    ways = np.linalg.norm(np.diff(tips, axis=0), axis=-1) * alive
    top = cases[0].machine.clutch.voltage_max * (1.0 - 1e-6)
    work = np.maximum(column(rows, "hand_work").sum(axis=0), 1e-9)
    return RunScores(
        error=np.abs(column(rows, "normal_error")).sum(axis=0) / steps / INCH,
        speed=np.linalg.norm(vector(rows, "tip_velocity"), axis=-1).sum(axis=0) / steps / INCH,
        acceleration=filtered[skipped:].sum(axis=0) / np.maximum(steps - skipped, 1) / INCH,
        peak=filtered[skipped:].max(axis=0) / INCH,
        path_length=ways.sum(axis=0) / INCH,
        saturated=(rows[..., [*COLUMN.volts]] >= top).mean(axis=-1).sum(axis=0) / steps,
        completed=rows[..., COLUMN.is_success].max(axis=0) > 0.0,
        integrator=np.abs((column(rows, "numerical_loss") - column(rows, "residual")).sum(axis=0)) / work,
    )


@device
def own_impedance(obs: Any, scales: Any, gains: Any, memory: Any) -> PerClutch:
    """Return the voltages of the impedance law with gains of each world's own, (kind, count, gains of world 0, …)."""
    count = int(gains[1])
    first = 2 + int(memory[MEMORY.world]) * count
    return guide(obs, scales, gains[first : first + count], memory)


def at(machine: Machine, time_constant: float) -> Machine:
    """Return a machine with another time constant [s]."""
    return replace(machine, clutch=replace(machine.clutch, time_constant=time_constant))
