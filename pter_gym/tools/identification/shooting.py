"""The compiled simulator as the model of a log: many short windows, each begun where the log is.

The log is cut into windows of equal length. Within each the simulator gets the recorded voltages and forces and
predicts the angles. The clutches' lag runs on through the whole log, as it depends on no motion; the motion begins
again in each window.
"""

from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pter_gym._compiled.compiler import compile_kernel
from pter_gym._compiled.records import store
from pter_gym._physics.arm import Load, Motion
from pter_gym._physics.clutch import PerClutch
from pter_gym._physics.open_loop import BODY, advance, advance_declared, body_of, initial_state, scratch
from pter_gym.params import Machine
from pter_gym.tools.identification.log import interpolated

Array = NDArray[np.float64]

LONGEST_SUBSTEP = 0.5e-3
"""Longest substep of the simulator in a window [s]."""


@dataclass(frozen=True)
class Inputs:
    """What drives the model, for each substep.

    Attributes
    ----------
    step
        Substep [s]; a row of the log takes ``substeps`` of them.
    substeps
        Substeps between two rows of the log.
    charge
        Integral of the recorded voltages from the beginning on [V·s], shape (rows, 4).
    force
        Force on the tip in the middle of each substep [N], shape (substeps in all, 2).
    """

    step: float
    substeps: int
    charge: Array
    force: Array

    def volts(self, delay: float) -> Array:
        """Return the mean voltage of each substep [V], shape (substeps in all, 4), a time [s] after it was recorded."""
        rows = len(self.charge)
        ends = self.step * np.arange(len(self.force) + 1, dtype=np.float64) - delay
        times = self.step * self.substeps * np.arange(rows, dtype=np.float64)
        first = (self.charge[1] - self.charge[0]) / times[1]
        last = (self.charge[-1] - self.charge[-2]) / times[1]
        passed = interpolated(ends, times, self.charge)
        passed += np.minimum(ends, 0.0)[:, None] * first + np.maximum(ends - times[-1], 0.0)[:, None] * last
        return np.maximum(np.diff(passed, axis=0) / self.step, 0.0)


def make_inputs(interval: float, volts: Array, force: Array, longest: float = LONGEST_SUBSTEP) -> Inputs:
    """Return the model's inputs from rows of voltages [V], each held until the next, and of forces [N]."""
    substeps = int(np.ceil(interval / longest - 1e-9))
    step = interval / substeps
    charge = np.concatenate([np.zeros((1, 4)), np.cumsum(interval * volts[:-1], axis=0)])
    times = interval * np.arange(len(force), dtype=np.float64)
    middles = step * (np.arange(substeps * (len(force) - 1), dtype=np.float64) + 0.5)
    return Inputs(
        step=step,
        substeps=substeps,
        charge=charge,
        force=interpolated(middles, times, force),
    )


def predict(machine: Machine, inputs: Inputs, delay: float, starts: Array, length: int) -> Array:
    """Return the angles [rad] that the simulator predicts, shape (windows, length, 2).

    Parameters
    ----------
    machine
        Whose model is run; its hand has to be none.
    inputs
        Voltages and forces.
    delay
        Time from a recorded voltage to the motion that it makes [s].
    starts
        Angles [rad] and angular velocities [rad/s] with which each window begins, shape (windows, 4).
    length
        Rows of a window after the one with which it begins.
    """
    volts = inputs.volts(delay)
    settled = initial_state(machine, (0.0, 0.0), volts=np.minimum(volts[0], machine.clutch.voltage_max))
    body = body_of(replace(machine, substep=inputs.step), settled)
    record = np.empty((len(starts), length, 2))
    _kernel(papers=machine.has_paper_clutches)(body, volts, inputs.force, starts, inputs.step, inputs.substeps, record)
    return record


def _build(digest: str) -> Any:
    def kernel(given: Any, volts: Any, force: Any, starts: Any, h: float, substeps: int, record: Any) -> None:
        _ = digest
        body = scratch(given)
        k = 0
        for window in range(record.shape[0]):
            a, b = starts[window, 0], starts[window, 1]
            motion = Motion(a, b, starts[window, 2], starts[window, 3], np.cos(a), np.sin(a), np.cos(b), np.sin(b))
            store(body, BODY.motion, 0, motion)
            for row in range(record.shape[1]):
                for _substep in range(substeps):
                    command = PerClutch(volts[k, 0], volts[k, 1], volts[k, 2], volts[k, 3])
                    advance(body, command, Load(force[k, 0], force[k, 1], 0.0, 0.0, 0.0, 0.0), h)
                    k += 1
                record[window, row, 0] = body[BODY.motion.theta_a, 0]
                record[window, row, 1] = body[BODY.motion.theta_b, 0]

    return kernel


@cache
def _kernel(*, papers: bool) -> Any:
    return compile_kernel(_build) if papers else compile_kernel(_build, advance=advance_declared)
