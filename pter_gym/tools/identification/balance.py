# pyright: standard
"""A first estimate: the balance of torques as a linear regression, on a grid of what is not linear.

Where all engaged clutches slip one way, the paper's Eqs. 3 and 4 are linear in inertias, friction
of the axes, slopes and curvature, once time constant, delay and knee are chosen. It needs no start,
and its noise on accelerations does not matter for one.
"""

from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from pter_gym._physics.arm import cos_difference, joint_torque, motion_of, velocity_torque
from pter_gym._physics.model import model_of
from pter_gym.params import Machine
from pter_gym.tools.identification import parameters as at
from pter_gym.tools.identification.log import Log
from pter_gym.tools.identification.parameters import Shape
from pter_gym.tools.identification.windows import (
    ENGAGED,
    SLIPPING,
    Smoothed,
    lagged,
    slip_rows,
    smooth_force,
)

Array = NDArray[np.float64]

_LINEAR: Any = np.linalg
_OPTIMIZE: Any = optimize

TIME_CONSTANTS = np.geomspace(0.02, 0.3, 8)
DELAYS = (0.0, 0.01, 0.02)
KNEES = (0.3, 0.45, 0.6, 0.7, 0.8, 0.88)
"""What is tried: lags and delays [s], knees over the highest voltage at which a clutch slipped."""

MIN_ROWS, EVERY = 50, 0.006
"""Fewest rows for a regression, and time between those that are used [s]."""

RIDGE, NEGLIGIBLE = 1e-10, 1e-3
"""What keeps normal equations positive definite, over their diagonal; share of the load below which
a term counts as none."""


def first_estimate(log: Log, motion: Smoothed, shape: Shape) -> Array:
    """Return coordinates near the machine, or of the start where the log does not suffice."""
    p = shape.coordinates(shape.start)
    rows = _slipping_rows(log, motion, shape.start)
    if len(rows) < MIN_ROWS:
        return p
    w, omega = slip_rows(shape.start), motion.omega[rows]
    signs = np.sign(omega @ w.T)
    inertial, load = _inertial(log, motion, shape, rows)
    axes = [_both(values * axis) for values in (np.sign(omega), omega) for axis in ([1, 0], [0, 1])]
    best, grid, found = np.inf, (0.0, 0.0, 0.0), np.zeros(12)
    for time_constant, delay, share in product(TIME_CONSTANTS, DELAYS, KNEES):
        volts = np.roll(log.volts, round(delay / log.interval), axis=0)
        beyond = np.maximum(volts - share * shape.top, 0.0) ** 2
        linear, above = (signs * lagged(log, v, time_constant)[rows] for v in (volts, beyond))
        slopes = [_both(linear[:, [x]] * w[x]) for x in range(4)]
        table = np.column_stack([*inertial, *axes, *slopes, _both(above @ w)])
        size = np.linalg.norm(table, axis=0) + 1e-12
        signed = [2, table.shape[1] - 1]  # coupling and curvature may be negative
        columns = np.column_stack([table / size, -table[:, signed] / size[signed], load])
        normal = columns.T @ columns
        ridge = RIDGE * np.diag(np.diag(normal) + 1e-300)
        triangle: Array = _LINEAR.cholesky(normal + ridge).T  # far shorter than the columns
        positive, left = _OPTIMIZE.nnls(triangle[:, :-1], triangle[:, -1])
        if left < best:
            positive[signed] -= positive[len(size) :]
            positive[np.abs(positive) < NEGLIGIBLE * np.linalg.norm(load)] = 0.0
            best, grid, found = left, (time_constant, delay, share), positive[: len(size)] / size
    inertias, friction, slopes, curvature = np.split(found, [3, 7, 11])
    for link in np.flatnonzero(inertias[:2] > 0.0):
        p[link] = np.log(inertias[link])
        p[[at.DRY[link], at.VISCOUS[link]]] = friction[[link, link + 2]] / inertias[link]
    if min(inertias[:2]) > 0.0:
        p[at.COUPLING] = np.clip(inertias[2] / np.sqrt(inertias[0] * inertias[1]), -0.8, 0.8)
    for place, slope in zip(at.SLOPES, slopes, strict=True):
        p[place] = np.log(slope) if slope > 0.0 else p[place]
    p[at.TIME_CONSTANT], p[at.DELAY], p[at.KNEE] = np.log(grid[0]), grid[1], grid[2] * shape.top
    extra = np.clip(curvature[0] / np.exp(p[list(at.SLOPES)]).mean(), -0.5 / shape.top, 50.0)
    p[at.EXTRA] = extra * ((1.0 - grid[2]) * shape.top) ** 2
    return p.clip(at.LOWEST, shape.highest)


def _slipping_rows(log: Log, motion: Smoothed, start: Machine) -> NDArray[np.int64]:
    """Return rows at which each engaged clutch surely slips one way, and has for a while."""
    every, half = max(1, round(EVERY / log.interval)), motion.half
    rows = np.arange(2 * half, len(log.theta) - 2 * half, every)
    engaged = lagged(log, log.volts, start.clutch.time_constant) > ENGAGED
    slip = motion.omega @ slip_rows(start).T
    near = np.stack([slip[rows + k] for k in range(-2 * half, 2 * half + 1, max(1, half // 2))])
    one_way = (near.min(axis=0) > SLIPPING) | (near.max(axis=0) < -SLIPPING)
    return rows[(one_way | ~engaged[rows]).all(axis=1) & log.is_clear(2 * half)[rows]]


def _both(values: Array) -> Array:
    """Return values of the two links, shape (rows, 2), as one column."""
    return values.T.ravel()


def _inertial(
    log: Log, motion: Smoothed, shape: Shape, rows: NDArray[np.int64]
) -> tuple[list[Array], Array]:
    """Return the columns of inertias and coupling, and the load that all columns carry [N·m]."""
    theta, omega, alpha = motion.theta[rows], motion.omega[rows], motion.alpha[rows]
    arm, q = model_of(shape.start).arm._replace(coupling=1.0), motion_of(theta, omega)
    cos: Any = cos_difference(q)
    coupling = cos[:, None] * alpha[:, ::-1] + np.stack(velocity_torque(arm, q), axis=-1)
    force: Any = smooth_force(log, log.force)[rows].T
    load = np.stack(joint_torque(arm, q, *force), axis=-1)
    return [_both(alpha * [1.0, 0.0]), _both(alpha * [0.0, 1.0]), _both(coupling)], _both(load)
