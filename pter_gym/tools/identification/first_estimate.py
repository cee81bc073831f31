# pyright: standard
"""A first estimate: the balance of torques as a linear regression, on a grid of what is not linear.

Where all engaged clutches slip one way, the paper's Eqs. 3 and 4 are linear in inertias, friction
of the axes, slopes and curvature, once time constant, delay and knee are chosen. It needs no start,
and its noise on accelerations does not matter for one.
"""

from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from pter_gym._physics.arm import cos_difference, joint_torque, motion_of, velocity_torque
from pter_gym._physics.model import model_of
from pter_gym.params import Machine
from pter_gym.tools.identification.log import Log
from pter_gym.tools.identification.parameters import AT, SCALES, Shape, places
from pter_gym.tools.identification.windows import (
    ENGAGED,
    SLIPPING,
    Smoothed,
    lagged,
    slip_rows,
    smooth_force,
)

Array = NDArray[np.float64]

TIME_CONSTANTS = np.geomspace(0.02, 0.3, 8).tolist()
DELAYS = (0.0, 0.01, 0.02)
KNEES = (0.3, 0.45, 0.6, 0.7, 0.8, 0.88)
"""Candidate lags and delays [s], and knees as fractions of the highest voltage at which a clutch
slipped."""

MIN_ROWS, EVERY = 50, 0.006
"""Fewest rows for a regression, and time between those that are used [s]."""

RIDGE, NEGLIGIBLE = 1e-10, 1e-3
"""What keeps normal equations positive definite, over their diagonal; share of the load below which
a term counts as none."""

LINEAR = (
    *("inertia_a", "inertia_b", "coupling", "dry_a", "dry_b", "viscous_a", "viscous_b"),
    *(*SCALES, "curvature"),
)
"""Unknowns of the regression, in SI units."""

SIGNED = [LINEAR.index("coupling"), LINEAR.index("curvature")]
"""Those that may be negative."""


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
    best, (lag, delay, share), found = np.inf, (0.0, 0.0, 0.0), dict.fromkeys(LINEAR, 0.0)
    for tried in product(TIME_CONSTANTS, DELAYS, KNEES):
        volts = np.roll(log.volts, round(tried[1] / log.interval), axis=0)
        beyond = np.maximum(volts - tried[2] * shape.top, 0.0) ** 2
        linear, above = (signs * lagged(log, v, tried[0])[rows] for v in (volts, beyond))
        slopes = [_both(linear[:, [x]] * w[x]) for x in range(4)]
        table = np.column_stack([*inertial, *axes, *slopes, _both(above @ w)])
        size = np.linalg.norm(table, axis=0) + 1e-12
        columns = np.column_stack([table / size, -table[:, SIGNED] / size[SIGNED], load])
        normal = columns.T @ columns
        ridge = RIDGE * np.diag(np.diag(normal) + 1e-300)
        triangle = np.linalg.cholesky(normal + ridge).T  # far shorter than the columns
        positive, left = optimize.nnls(triangle[:, :-1], triangle[:, -1])
        if left < best:
            positive[SIGNED] -= positive[len(size) :]
            positive[np.abs(positive) < NEGLIGIBLE * np.linalg.norm(load)] = 0.0
            best, (lag, delay, share) = left, tried
            found = dict(zip(LINEAR, (positive[: len(size)] / size).tolist(), strict=True))
    for axis in "ab":
        if (inertia := found[f"inertia_{axis}"]) > 0.0:
            p[AT[f"inertia_{axis}"]] = np.log(inertia)
            for kind in ("dry", "viscous"):
                p[AT[f"{kind}_{axis}"]] = found[f"{kind}_{axis}"] / inertia
    if (both := found["inertia_a"] * found["inertia_b"]) > 0.0:
        p[AT["coupling"]] = np.clip(found["coupling"] / np.sqrt(both), -0.8, 0.8)
    for name in SCALES:
        p[AT[name]] = np.log(found[name]) if found[name] > 0.0 else p[AT[name]]
    p[places(("time_constant", "delay", "knee"))] = np.log(lag), delay, share * shape.top
    curvature = found["curvature"] / np.exp(p[places(SCALES)]).mean()
    quadratic = float(np.clip(curvature, -0.5 / shape.top, 50.0))
    p[AT["curvature"]] = quadratic * ((1.0 - share) * shape.top) ** 2
    return shape.within(p)


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
    cos = np.asarray(cos_difference(q))
    coupling = cos[:, None] * alpha[:, ::-1] + np.stack(velocity_torque(arm, q), axis=-1)
    force_x, force_y = smooth_force(log, log.force)[rows].T
    load = np.stack(joint_torque(arm, q, force_x, force_y), axis=-1)
    return [_both(alpha * [1.0, 0.0]), _both(alpha * [0.0, 1.0]), _both(coupling)], _both(load)
