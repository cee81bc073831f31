"""A first estimate: the balance of torques as a linear regression, on a grid of what is not linear.

Where all engaged clutches slip one way, the paper's Eqs. 3 and 4 are linear in inertias, slopes and curvature, once
time constant, delay and knee are chosen. It needs no start, and its noise on accelerations does not matter for one.
"""

from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pter_gym.tools.identification import parameters as at
from pter_gym.tools.identification.log import Log
from pter_gym.tools.identification.parameters import Shape
from pter_gym.tools.identification.windows import ENGAGED, Motion, W, lagged, smooth_force

Array = NDArray[np.float64]

_LINEAR: Any = np.linalg

TIME_CONSTANTS = tuple(np.geomspace(0.02, 0.3, 8))
DELAYS = (0.0, 0.01, 0.02)
KNEES = (0.3, 0.45, 0.6, 0.7, 0.8, 0.88)
"""Knees that are tried, over the highest voltage at which a clutch slipped."""

SLIPPING = 0.2
"""Slip velocity from which a clutch surely slips [rad/s]."""

FEWEST = 50
"""Fewest rows for a regression."""

EVERY = 0.006
"""Time between the rows that are used [s]."""


def first_estimate(log: Log, motion: Motion, shape: Shape) -> Array:
    """Return coordinates near those of the machine, or those of the start where the log does not suffice."""
    best = shape.coordinates(shape.start)
    rows = slipping_rows(log, motion, shape.start.clutch.time_constant)
    if len(rows) < FEWEST:
        return best
    signs = np.sign(motion.omega[rows] @ W.T)
    inertial, load = _inertial(log, motion, shape, rows)
    least = np.inf
    for time_constant, delay in product(TIME_CONSTANTS, DELAYS):
        volts = np.roll(log.volts, round(delay / log.interval), axis=0)
        linear = signs * lagged(log, volts, time_constant)[rows]
        for share in KNEES:
            above = signs * lagged(log, np.maximum(volts - share * shape.top, 0.0) ** 2, time_constant)[rows]
            slopes = [_both(linear[:, [x]] * W[x]) for x in range(4)]
            table = np.column_stack([*inertial, *slopes, _both(above @ W)])
            size = np.linalg.norm(table, axis=0) + 1e-12
            found: Array = _LINEAR.lstsq(table / size, load, rcond=1e-8)[0]
            misfit = float(np.sum((load - table @ (found / size)) ** 2))
            if misfit < least:
                least = misfit
                seen = size > 1e-6
                best = _coordinates(
                    shape, found / size, seen, (time_constant, delay, share * shape.top), log.force is None
                )
    return best.clip(at.LOWEST, shape.highest)


def slipping_rows(log: Log, motion: Motion, time_constant: float) -> NDArray[np.int64]:
    """Return rows at which each engaged clutch surely slips one way, and has for a while."""
    every = max(1, round(EVERY / log.interval))
    rows = np.arange(2 * motion.half, len(log.theta) - 2 * motion.half, every)
    engaged = lagged(log, log.volts, time_constant) > ENGAGED
    slip = motion.omega @ W.T
    near = np.stack([slip[rows + k] for k in range(-2 * motion.half, 2 * motion.half + 1, max(1, motion.half // 2))])
    one_way = (near.min(axis=0) > SLIPPING) | (near.max(axis=0) < -SLIPPING)
    good = (one_way | ~engaged[rows]).all(axis=1)
    if log.force is None and log.free is not None:
        free = np.stack([log.free[rows + k] for k in (-2 * motion.half, 0, 2 * motion.half)]).all(axis=0)
        good &= free
    return rows[good]


def _both(values: Array) -> Array:
    """Return values of the two links, shape (rows, 2), as one column."""
    return values.T.ravel()


def _inertial(log: Log, motion: Motion, shape: Shape, rows: NDArray[np.int64]) -> tuple[list[Array], Array]:
    """Return the columns of the inertias and of the coupling, and the load that all columns together carry [N·m]."""
    theta, omega, alpha = motion.theta[rows], motion.omega[rows], motion.alpha[rows]
    between = theta[:, 0] - theta[:, 1]
    coupling = np.cos(between)[:, None] * alpha[:, ::-1] + np.sin(between)[:, None] * omega[:, ::-1] ** 2 * [1.0, -1.0]
    inertia_a, inertia_b = _both(alpha * [1.0, 0.0]), _both(alpha * [0.0, 1.0])
    if log.force is None:
        return [inertia_b, _both(coupling)], -shape.start.arm.inertia_a * inertia_a
    force = smooth_force(log)[rows]
    arm = shape.start.arm
    lengths = np.array([arm.length_a, arm.length_b])
    return [inertia_a, inertia_b, _both(coupling)], _both(
        lengths * (np.cos(theta) * force[:, [1]] - np.sin(theta) * force[:, [0]])
    )


def _coordinates(
    shape: Shape, found: Array, seen: NDArray[np.bool_], grid: tuple[float, float, float], scaleless: bool
) -> Array:
    """Return the coordinates of what a regression found; what it cannot have found is that of the start."""
    p = shape.coordinates(shape.start)
    inertias = np.array([shape.start.arm.inertia_a, *found[:2]]) if scaleless else found[:3]
    slopes, curvature = found[-5:-1], found[-1]
    if min(inertias[:2]) > 0.0:
        p[[at.INERTIA_A, at.INERTIA_B]] = np.log(inertias[:2])
        p[at.COUPLING] = np.clip(inertias[2] / np.sqrt(inertias[0] * inertias[1]), -0.8, 0.8)
    for x, place in enumerate(at.SLOPES):
        if seen[-5:-1][x] and slopes[x] > 0.0:
            p[place] = np.log(slopes[x])
    p[at.TIME_CONSTANT], p[at.DELAY], p[at.KNEE] = np.log(grid[0]), grid[1], grid[2]
    slope = np.exp(p[list(at.SLOPES)]).mean()
    p[at.EXTRA] = np.clip(curvature / slope, -0.5 / shape.top, 50.0) * (shape.top - grid[2]) ** 2
    return p
