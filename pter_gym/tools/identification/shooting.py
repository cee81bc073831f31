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
from pter_gym._physics.step import arrangement_from
from pter_gym._physics.step import paper_clutches as no_arrangement
from pter_gym.gradients._tangent import substep_tangents
from pter_gym.tools.identification import parameters as at
from pter_gym.tools.identification.log import interpolated
from pter_gym.tools.identification.parameters import Shape

Array = NDArray[np.float64]

MAX_SUBSTEP = 0.5e-3
"""Longest substep of the simulator in a window [s]."""

ORDER = (
    *(*at.SLOPES, at.EXTRA, at.KNEE, at.RATIO, at.TIME_CONSTANT, at.DELAY),
    *(at.OFF_STATE, at.STRIBECK, at.FALL_RATIO),
    *(*range(at.SLOPES[0]), *at.DRY, *at.VISCOUS, *at.OFFSET),
)
"""Coordinates in the order of the kernel's lanes: those of the clutches come first."""

DELAY_LANE = ORDER.index(at.DELAY)
TORQUE_LANES = 12
"""Lanes in which clutches have tangents: those of the clutches' coordinates, in whole vectors."""

LANES = len(ORDER) + 4
"""All lanes: the last four are the derivatives by a window's start."""

SMALL = 1e-4
"""Steps of differences of smooth formulas, over the usual ones: right to about 10⁻⁹."""

advance: Any = None
"""What the kernel below calls; ``compile_kernel`` binds this name."""


@dataclass(frozen=True)
class LogInputs:
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

    def volts(self, delay: float) -> tuple[Array, Array]:
        """Return the delayed mean voltage of each substep [V], and its derivative by the delay.

        Both have the shape (substeps, 4).
        """
        interval = self.step * self.substeps
        held = np.diff(self.charge, axis=0) / interval
        ends = self.step * np.arange(len(self.force) + 1, dtype=np.float64) - delay
        row = np.floor(ends / interval).astype(int).clip(0, len(held) - 1)
        passed = self.charge[row] + held[row] * (ends - interval * row)[:, None]
        volts = np.maximum(np.diff(passed, axis=0) / self.step, 0.0)
        return volts, -np.diff(held[row], axis=0) / self.step


def make_inputs(
    interval: float, volts: Array, force: Array, longest: float = MAX_SUBSTEP
) -> LogInputs:
    """Return the model's inputs from rows of voltages [V], which are held, and forces [N]."""
    substeps = int(np.ceil(interval / longest - 1e-9))
    step = interval / substeps
    charge = np.concatenate([np.zeros((1, 4)), np.cumsum(interval * volts[:-1], axis=0)])
    times = interval * np.arange(len(force), dtype=np.float64)
    middles = step * (np.arange(substeps * (len(force) - 1), dtype=np.float64) + 0.5)
    return LogInputs(step, substeps, charge, interpolated(middles, times, force))


def predict(shape: Shape, p: Array, inputs: LogInputs, starts: Array, length: int) -> Array:
    """Return the angles [rad] that the simulator predicts, shape (windows, length, 2).

    Parameters
    ----------
    shape, p
        Coordinates and what they mean, shape (21,).
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

    Shapes (windows, length, 2), (windows, length, 2, 21) and (windows, length, 2, 4).
    """
    tangents, volts = np.zeros((BODY_WIDTH, LANES)), inputs.volts(float(p[at.DELAY]))[0][0]
    for lane, i in enumerate(ORDER):
        change = SMALL * at.STEPS[i] * np.eye(at.COUNT)[i]
        high, low = ((p + e * change).clip(at.LOWEST, shape.highest) for e in (1.0, -1.0))
        bodies = [_body(shape, near, inputs, volts)[:, 0] for near in (high, low)]
        tangents[:, lane] = (bodies[0] - bodies[1]) / (high[i] - low[i])
    angles, by = _run(shape, p, tangents, inputs, starts, length)
    return angles, by[..., np.argsort(ORDER)], by[..., len(ORDER) :]


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
    volts, by_delay = inputs.volts(float(p[at.DELAY]))
    record = np.empty((len(starts), length, 2))
    by = np.empty((*record.shape, tangents.shape[1]))
    _kernel(paper_clutches=shape.start.has_paper_clutches)(
        *(_body(shape, p, inputs, volts[0]), tangents, volts, by_delay, inputs.force, starts),
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
def _command(body: Any, dot: Any, volts: Any, by_delay: Any, k: int) -> bool:
    """Give a substep its voltages; return whether they, or their derivatives, have changed."""
    changed = k == 0
    for x in range(4):
        changed |= (volts[k, x] != volts[k - 1, x]) | (by_delay[k, x] != by_delay[k - 1, x])
        body[BODY.command.x1 + x, 0] = volts[k, x]
        if dot.shape[1] > 0:
            dot[BODY.command.x1 + x, DELAY_LANE] = by_delay[k, x]
    return changed


def _build(digest: str) -> Any:
    def kernel(
        machine: Any,
        tangents: Any,
        volts: Any,
        by_delay: Any,
        force: Any,
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
        dot[:] = tangents
        k = 0
        for window in range(record.shape[0]):
            start = starts[window]
            _begin(body, dot, start[0], start[1], start[2], start[3])
            for row in range(record.shape[1]):
                for _substep in range(substeps):
                    changed = _command(body, dot, volts, by_delay, k)
                    body[BODY.load.force_x, 0], body[BODY.load.force_y, 0] = (
                        force[k, 0],
                        force[k, 1],
                    )
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
