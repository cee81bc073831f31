"""The compiled simulator as the model of a log: many short windows, each begun where the log is.

The log is cut into windows of equal length. Within each the simulator gets the recorded voltages
and forces and predicts the angles. The clutches' lag runs on through the whole log, as it depends
on no motion; the motion begins again in each window.
"""

from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pter_gym._compiled.compiler import compile_kernel, device
from pter_gym._compiled.records import store
from pter_gym._physics.arm import Load, Motion
from pter_gym._physics.open_loop import BODY, BODY_WIDTH, body_of, initial_state, scratch
from pter_gym._physics.step import arrangement_from
from pter_gym._physics.step import paper_clutches as no_arrangement
from pter_gym.gradients._tangent import substep_tangents
from pter_gym.params import Machine
from pter_gym.tools.identification import parameters as at
from pter_gym.tools.identification.log import interpolated
from pter_gym.tools.identification.parameters import Shape

Array = NDArray[np.float64]

MAX_SUBSTEP = 0.5e-3
"""Longest substep of the simulator in a window [s]."""

ORDER = (
    *at.SLOPES,
    at.EXTRA,
    at.KNEE,
    at.RATIO,
    at.TIME_CONSTANT,
    at.DELAY,
    at.OFF_STATE,
    at.STRIBECK,
    at.FALL_RATIO,
    *range(at.SLOPES[0]),
    *at.DRY,
    *at.VISCOUS,
)
"""Coordinates in the order of the kernel's lanes; those of the clutches come first, those of a window's start last."""

DELAY_LANE = ORDER.index(at.DELAY)
START_LANE = len(ORDER)
LANES = START_LANE + 4
TORQUE_LANES = 12
"""Lanes in which clutches have tangents: those of the clutches' coordinates, in whole vectors."""

SMALL = 1e-4
"""Steps of differences where formulas are smooth, over the usual ones: they are right to about 10⁻⁹."""

advance: Any = None
lanes = 0
"""What the kernel below calls, and how many tangents it has; ``compile_kernel`` binds these names."""


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
        """Return the mean voltage of each substep [V], delayed by a time [s], and its derivative by
        the delay.

        Both have the shape (substeps, 4).
        """
        interval = self.step * self.substeps
        held = np.diff(self.charge, axis=0) / interval
        ends = self.step * np.arange(len(self.force) + 1, dtype=np.float64) - delay
        row = np.floor(ends / interval).astype(int).clip(0, len(held) - 1)
        rate = held[row]
        passed = self.charge[row] + rate * (ends - interval * row)[:, None]
        return np.maximum(np.diff(passed, axis=0) / self.step, 0.0), -np.diff(
            rate, axis=0
        ) / self.step


def make_inputs(
    interval: float, volts: Array, force: Array, longest: float = MAX_SUBSTEP
) -> LogInputs:
    """Return the model's inputs from rows of voltages [V], each held until the next, and of forces [N]."""
    substeps = int(np.ceil(interval / longest - 1e-9))
    step = interval / substeps
    charge = np.concatenate([np.zeros((1, 4)), np.cumsum(interval * volts[:-1], axis=0)])
    times = interval * np.arange(len(force), dtype=np.float64)
    middles = step * (np.arange(substeps * (len(force) - 1), dtype=np.float64) + 0.5)
    return LogInputs(
        step=step,
        substeps=substeps,
        charge=charge,
        force=interpolated(middles, times, force),
    )


def predict(machine: Machine, inputs: LogInputs, delay: float, starts: Array, length: int) -> Array:
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
        Angles [rad] and angular velocities [rad/s] with which each window begins, shape (windows,
        4).
    length
        Rows of a window after the one with which it begins.
    """
    volts, by_delay = inputs.volts(delay)
    body = _body(machine, inputs, volts[0])
    return _run(machine, inputs, body, np.empty((BODY_WIDTH, 0)), volts, by_delay, starts, length)[
        0
    ]


def differentiate(
    shape: Shape, p: Array, inputs: LogInputs, starts: Array, length: int
) -> tuple[Array, Array, Array]:
    """Return what ``predict`` does at coordinates, and its exact derivatives by them and by the
    starts.

    Parameters
    ----------
    shape, p
        Coordinates and what they mean, shape (19,).
    inputs, starts, length
        As ``predict`` takes them.

    Returns
    -------
    angles, by_coordinates, by_start
        Shapes (windows, length, 2), (windows, length, 2, 19) and (windows, length, 2, 4).
    """
    machine = shape.machine(p)
    volts, by_delay = inputs.volts(float(p[at.DELAY]))
    tangents, highest = np.zeros((BODY_WIDTH, LANES)), shape.highest
    for lane, i in enumerate(ORDER):
        ends: list[Array] = []
        for sign in (1.0, -1.0):
            near = p.copy()
            near[i] = np.clip(p[i] + sign * SMALL * at.STEPS[i], at.LOWEST[i], highest[i])
            ends.append(near)
        bodies = [_body(shape.machine(near), inputs, volts[0])[:, 0] for near in ends]
        tangents[:, lane] = (bodies[0] - bodies[1]) / (ends[0][i] - ends[1][i])
    body = _body(machine, inputs, volts[0])
    angles, by = _run(machine, inputs, body, tangents, volts, by_delay, starts, length)
    return angles, by[..., np.argsort(ORDER)], by[..., START_LANE:]


def _body(machine: Machine, inputs: LogInputs, volts: Array) -> Array:
    """Return a machine whose clutches have settled at voltages, as kernels take it."""
    settled = initial_state(
        machine, (0.0, 0.0), volts=np.minimum(volts, machine.clutch.voltage_max)
    )
    return body_of(replace(machine, substep=inputs.step), settled)


def _run(
    machine: Machine,
    inputs: LogInputs,
    body: Array,
    tangents: Array,
    volts: Array,
    by_delay: Array,
    starts: Array,
    length: int,
) -> tuple[Array, Array]:
    record = np.empty((len(starts), length, 2))
    by = np.empty((*record.shape, tangents.shape[1]))
    kernel = _kernel(paper_clutches=machine.has_paper_clutches, lanes=tangents.shape[1])
    kernel(
        body,
        tangents,
        volts,
        by_delay,
        inputs.force,
        starts,
        inputs.step,
        inputs.substeps,
        record,
        by,
    )
    return record, by


@device
def _begin(
    body: Any, dot: Any, lanes: int, a: float, b: float, omega_a: float, omega_b: float
) -> None:
    """Begin a window with the angles a and b [rad]; the last four lanes are the derivatives by its start."""
    motion = Motion(a, b, omega_a, omega_b, np.cos(a), np.sin(a), np.cos(b), np.sin(b))
    store(body, BODY.motion, 0, motion)
    for j in range(lanes):
        store(dot, BODY.motion, j, Motion(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    if lanes > 0:
        store(
            dot,
            BODY.motion,
            lanes - 4,
            Motion(1.0, 0.0, 0.0, 0.0, -motion.sin_a, motion.cos_a, 0.0, 0.0),
        )
        store(
            dot,
            BODY.motion,
            lanes - 3,
            Motion(0.0, 1.0, 0.0, 0.0, 0.0, 0.0, -motion.sin_b, motion.cos_b),
        )
        dot[BODY.motion.omega_a, lanes - 2] = dot[BODY.motion.omega_b, lanes - 1] = 1.0


@device
def _command(body: Any, dot: Any, lanes: int, volts: Any, by_delay: Any, k: int) -> bool:
    """Give a substep its voltages; return whether they, or their derivatives, have changed."""
    changed = k == 0
    for x in range(4):
        changed |= (volts[k, x] != volts[k - 1, x]) | (by_delay[k, x] != by_delay[k - 1, x])
        body[BODY.command.x1 + x, 0] = volts[k, x]
        if lanes > 0:
            dot[BODY.command.x1 + x, DELAY_LANE] = by_delay[k, x]
    return changed


def _build(digest: str) -> Any:
    def kernel(
        given: Any,
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
        """Fill the angles of each row of each window, and their tangents."""
        _ = digest
        body = scratch(given)
        dot: Any = np.empty((BODY_WIDTH, lanes))
        dot[:] = tangents
        k = 0
        for window in range(record.shape[0]):
            _begin(
                body,
                dot,
                lanes,
                starts[window, 0],
                starts[window, 1],
                starts[window, 2],
                starts[window, 3],
            )
            for row in range(record.shape[1]):
                for _substep in range(substeps):
                    changed = _command(body, dot, lanes, volts, by_delay, k)
                    store(body, BODY.load, 0, Load(force[k, 0], force[k, 1], 0.0, 0.0, 0.0, 0.0))
                    advance(body, dot, h, changed)
                    k += 1
                for link in range(2):
                    record[window, row, link] = body[BODY.motion.theta_a + link, 0]
                    for j in range(lanes):
                        by[window, row, link, j] = dot[BODY.motion.theta_a + link, j]

    return kernel


@cache
def _kernel(*, paper_clutches: bool, lanes: int) -> Any:
    arrangement_at = no_arrangement if paper_clutches else arrangement_from(BODY)
    substep = substep_tangents(arrangement_at, lanes, min(lanes, TORQUE_LANES))
    return compile_kernel(_build, advance=substep, lanes=lanes)
