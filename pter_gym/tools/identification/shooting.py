# pyright: standard
"""The compiled simulator as the model of a log: many short windows, each begun where the log is.

Within each window the simulator gets the recorded voltages and forces and predicts the angles. The
clutches' lag runs on through the whole log, as it depends on no motion.
"""

from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pter_gym._compiled.compiler import compile_kernel, inlined
from pter_gym._compiled.records import store
from pter_gym._physics.arm import Motion
from pter_gym._physics.open_loop import BODY, BODY_WIDTH, body_of, initial_state, scratch
from pter_gym._physics.step import arrangement_from, paper_clutches as no_arrangement
from pter_gym.gradients._machine import refuse_creep
from pter_gym.gradients._tangent import substep_tangents
from pter_gym.tools.identification.parameters import AT, CLUTCH_NAMES, COUNT, NAMES, Shape

Array = NDArray[np.float64]

MAX_SUBSTEP = 0.5e-3
"""Longest substep of the simulator in a window [s]."""

DELAY_LANE, FORCE_LANE = AT["delay"], AT["force_delay"]
TORQUE_LANES = len(CLUTCH_NAMES)
"""Lanes in which clutches have tangents: the first ones, in whole vectors."""

LANES = COUNT + 4
"""A lane for each coordinate; the last four are the derivatives by a window's start."""

SMALL = 1e-4
"""Steps of differences of smooth formulas, over the usual ones: right to about 10⁻⁹."""

advance: Any = None
"""What the kernel below calls; ``compile_kernel`` binds this name."""


@dataclass(frozen=True)
class LogInputs:
    """What drives the model: voltages [V], which are held, (rows, 4), and forces [N], (rows, 2).

    A row takes ``substeps`` substeps of ``step`` seconds. All that is returned has a row for each
    substep, and comes with its derivative by the delay, per second.
    """

    step: float
    substeps: int
    volts: Array
    force: Array

    @property
    def _ends(self) -> Array:
        """Times at which substeps end, from the beginning [s]."""
        return self.step * np.arange(self.substeps * (len(self.force) - 1) + 1, dtype=np.float64)

    def delayed_volts(self, delay: float) -> tuple[Array, Array]:
        """Return the mean voltages [V] of substeps if they act later, shapes (substeps, 4)."""
        interval = self.step * self.substeps
        charge = np.concatenate([np.zeros((1, 4)), np.cumsum(interval * self.volts[:-1], axis=0)])
        ends = self._ends - delay
        row = np.floor(ends / interval).astype(int).clip(0, len(charge) - 2)
        passed = charge[row] + self.volts[row] * (ends - interval * row)[:, None]
        means = np.maximum(np.diff(passed, axis=0) / self.step, 0.0)
        return means, -np.diff(self.volts[row], axis=0) / self.step

    def early_force(self, delay: float) -> tuple[Array, Array]:
        """Return forces [N] amid substeps if they were recorded late, shapes (substeps, 2)."""
        place = (self._ends[:-1] + 0.5 * self.step + delay) / (self.step * self.substeps)
        row = np.floor(place).astype(int).clip(0, len(self.force) - 2)
        rise = np.diff(self.force, axis=0)[row]
        within = (place - row).clip(0.0, 1.0)[:, None]
        return self.force[row] + within * rise, rise / (self.step * self.substeps)


def make_inputs(
    interval: float, volts: Array, force: Array, longest: float = MAX_SUBSTEP
) -> LogInputs:
    """Return the model's inputs from rows of voltages [V] and forces [N]."""
    substeps = int(np.ceil(interval / longest - 1e-9))
    return LogInputs(interval / substeps, substeps, volts, force)


def predict(shape: Shape, p: Array, inputs: LogInputs, starts: Array, length: int) -> Array:
    """Return the angles [rad] that the simulator predicts, shape (windows, length, 2).

    Parameters
    ----------
    shape, p
        Coordinates and what they mean, shape (22,).
    inputs
        Voltages and forces.
    starts
        Angles [rad] and angular velocities [rad/s] with which each window begins, shape (windows,
        4).
    length
        Rows of a window after the one with which it begins.
    """
    return _run(shape, p, np.empty((BODY_WIDTH, 0)), inputs, starts, length)[0]


def differentiate(
    shape: Shape, p: Array, inputs: LogInputs, starts: Array, length: int
) -> tuple[Array, Array, Array]:
    """Return what ``predict`` does, and its exact derivatives by the coordinates and the starts.

    Shapes (windows, length, 2), (windows, length, 2, 22) and (windows, length, 2, 4).
    """
    tangents = np.zeros((BODY_WIDTH, LANES))
    volts = inputs.delayed_volts(float(p[AT["delay"]]))[0][0]
    for lane, name in enumerate(NAMES):
        high, low = shape.around(p, name, SMALL)
        bodies = [_body(shape, near, inputs, volts)[:, 0] for near in (high, low)]
        tangents[:, lane] = (bodies[0] - bodies[1]) / (high[lane] - low[lane])
    angles, by = _run(shape, p, tangents, inputs, starts, length)
    return angles, by[..., :COUNT], by[..., COUNT:]


def _body(shape: Shape, p: Array, inputs: LogInputs, volts: Array) -> Array:
    """Return a machine whose clutches have settled at voltages, as kernels take it."""
    machine = shape.machine(p)
    volts = np.minimum(volts, machine.clutch.voltage_max)
    settled = initial_state(machine, (0.0, 0.0), volts=volts)
    body = body_of(replace(machine, substep=inputs.step), settled)
    at_load: Any = [BODY.load.torque_a, BODY.load.torque_b]
    body[at_load, 0] = shape.offsets(p)
    return body


def _run(
    shape: Shape, p: Array, tangents: Array, inputs: LogInputs, starts: Array, length: int
) -> tuple[Array, Array]:
    volts = inputs.delayed_volts(float(p[AT["delay"]]))
    force = inputs.early_force(float(p[AT["force_delay"]]))
    record = np.empty((len(starts), length, 2))
    by = np.empty((*record.shape, tangents.shape[1]))
    refuse_creep(shape.start)
    _kernel(paper_clutches=shape.start.has_paper_clutches)(
        *(_body(shape, p, inputs, volts[0][0]), tangents, *volts, *force, starts),
        *(inputs.step, inputs.substeps, record, by),
    )
    return record, by


@inlined
def _begin(body: Any, dot: Any, a: float, b: float, omega_a: float, omega_b: float) -> None:
    """Begin a window with the angles a and b [rad]."""
    motion = Motion(a, b, omega_a, omega_b, np.cos(a), np.sin(a), np.cos(b), np.sin(b))
    store(body, BODY.motion, 0, motion)
    lanes = dot.shape[1]
    for j in range(lanes):
        store(dot, BODY.motion, j, Motion(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    if lanes > 0:
        dot[BODY.motion.theta_a, lanes - 4] = dot[BODY.motion.theta_b, lanes - 3] = 1.0
        dot[BODY.motion.cos_a, lanes - 4], dot[BODY.motion.sin_a, lanes - 4] = -np.sin(a), np.cos(a)
        dot[BODY.motion.cos_b, lanes - 3], dot[BODY.motion.sin_b, lanes - 3] = -np.sin(b), np.cos(b)
        dot[BODY.motion.omega_a, lanes - 2] = dot[BODY.motion.omega_b, lanes - 1] = 1.0


@inlined
def _drive(
    body: Any, dot: Any, volts: Any, volts_by: Any, force: Any, force_by: Any, k: int
) -> bool:
    """Give a substep its inputs; return whether voltages, or their derivatives, have changed."""
    changed, lanes = k == 0, dot.shape[1]
    for x in range(4):
        changed |= (volts[k, x] != volts[k - 1, x]) | (volts_by[k, x] != volts_by[k - 1, x])
        body[BODY.command.x1 + x, 0] = volts[k, x]
        if lanes > 0:
            dot[BODY.command.x1 + x, DELAY_LANE] = volts_by[k, x]
    for i in range(2):
        body[BODY.load.force_x + i, 0] = force[k, i]
        if lanes > 0:
            dot[BODY.load.force_x + i, FORCE_LANE] = force_by[k, i]
    return changed


def _build(digest: str) -> Any:
    def kernel(
        machine: Any,
        tangents: Any,
        volts: Any,
        volts_by: Any,
        force: Any,
        force_by: Any,
        starts: Any,
        h: float,
        substeps: int,
        record: Any,
        by: Any,
    ) -> None:
        """Fill the angles of each row of each window and as many of their tangents as there are."""
        _ = digest
        body = scratch(machine)
        # rows of a width that the compiler knows: lanes of two rows are known to be apart
        dot: Any = np.empty((BODY_WIDTH, LANES))[:, : tangents.shape[1]]
        for entry in range(BODY_WIDTH):
            for j in range(tangents.shape[1]):
                dot[entry, j] = tangents[entry, j]
        k = 0
        for window in range(record.shape[0]):
            start = starts[window]
            _begin(body, dot, start[0], start[1], start[2], start[3])
            for row in range(record.shape[1]):
                for _substep in range(substeps):
                    changed = _drive(body, dot, volts, volts_by, force, force_by, k)
                    advance(body, dot, h, changed)
                    k += 1
                for link in range(2):
                    record[window, row, link] = body[BODY.motion.theta_a + link, 0]
                    for j in range(tangents.shape[1]):
                        by[window, row, link, j] = dot[BODY.motion.theta_a + link, j]

    return kernel


@cache
def _kernel(*, paper_clutches: bool) -> Any:
    arrangement_at = no_arrangement if paper_clutches else arrangement_from(BODY)
    return compile_kernel(_build, advance=substep_tangents(arrangement_at, TORQUE_LANES))
