"""A log cut into windows: where each begins, which clutches hold then, and the angles."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage, signal

from pter_gym.params import Machine
from pter_gym.tools.identification.log import Log, angle_step
from pter_gym.tools.identification.shooting import MAX_SUBSTEP, LogInputs, make_inputs

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

_NDIMAGE: Any = ndimage
_SIGNAL: Any = signal

DURATION = 0.2
"""Length of a window [s]: angles tell accelerations well within it."""

CUTOFF = 200.0
"""Cutoff frequency of the forces [Hz]: a log of up to 500 rows a second is not filtered. A filter
cuts off the hand's peaks, so that clutches break away too late; 120 Hz makes the breakaway torque
0.1 % too small."""

SMOOTHING = 0.024
"""Half the length of the angles' smoothing [s], which gives velocities at starts of windows."""

GAIN = 1e-3
"""Relative change of the forces that shows what they do to the angles."""

INDEPENDENT = 0.006
"""Time between interpolated rows whose noise is compared [s], if they are closer."""

SHAKES = 4
"""How often noise is added to the forces, to see which windows it rules."""

ENGAGED = 0.3
"""Lagged voltage from which a clutch can hold [V]."""

SLIPPING = 0.2
"""Slip velocity from which a clutch surely slips [rad/s]."""

SUBSTEP = 1.02 * MAX_SUBSTEP
"""Longest substep of the model [s]: a logger's slow clock costs no further substeps."""

MIN_SEEN = 0.1
"""How long clutches have to slip at a voltage for the log to show it [s]."""


@dataclass(frozen=True)
class Smoothed:
    """Smoothed angles [rad], velocities [rad/s] and accelerations [rad/s²], shape (rows, 2).

    ``noise`` is the standard deviation of the measured angles [rad], ``half`` the rows on each side
    that count.
    """

    theta: Array
    omega: Array
    alpha: Array
    noise: float
    half: int


@dataclass(frozen=True)
class Windows:
    """The log as the fit sees it.

    Attributes
    ----------
    length
        Rows of a window after its first.
    first
        Rows with which windows begin, shape (windows,).
    measured
        Angles [rad], shape (windows, length, 2).
    starts
        Angles [rad] and velocities [rad/s] at the beginning, shape (windows, 4).
    uncertain
        Changes of a start that are admitted, as columns, zero where a clutch holds, shape (windows,
        4, 4).
    used
        Whether a window is used: it is not where it holds a gap of the log, or where nobody can
        tell from the angles whether a clutch holds as it begins.
    gaps
        How many windows hold a gap.
    inputs, finer, harder
        Of the model: as recorded, with half the substep, and with forces larger by ``GAIN``.
    shaken
        Inputs with more noise of the forces, as much as they have: what they change, no fit can
        tell.
    noise
        Standard deviation of the angles [rad].
    """

    length: int
    first: NDArray[np.int64]
    measured: Array
    starts: Array
    uncertain: Array
    used: Flags
    gaps: int
    inputs: LogInputs
    finer: LogInputs
    harder: LogInputs
    shaken: tuple[LogInputs, ...]
    noise: float


def smooth(log: Log) -> Smoothed:
    """Return the motion of a log by local polynomials."""
    half = max(2, round(SMOOTHING / log.interval))
    width = 2 * half + 1
    theta = _SIGNAL.savgol_filter(log.theta, width, 2, axis=0)
    omega = _SIGNAL.savgol_filter(log.theta, width, 2, deriv=1, delta=log.interval, axis=0)
    alpha = _SIGNAL.savgol_filter(log.theta, 2 * width - 1, 3, deriv=2, delta=log.interval, axis=0)
    return Smoothed(theta, omega, alpha, _noise(log, theta), half)


def _noise(log: Log, smoothed: Array) -> float:
    """Return the standard deviation of the angles' noise [rad], at least an encoder's."""
    rough = np.diff(log.theta[:: _independent(log)], 3, axis=0) / np.sqrt(20.0)
    spread = min(
        float(np.median(np.abs(values))) / 0.6745 for values in (log.theta - smoothed, rough)
    )
    return max(spread, (log.angle_step or angle_step(*log.theta.T)) / np.sqrt(12.0), 1e-7)


def _independent(log: Log) -> int:
    """Return how many rows apart noise is independent: interpolated rows share it."""
    return max(1, round(INDEPENDENT / log.interval)) if log.angle_step else 1


def smooth_force(log: Log) -> Array:
    """Return the forces [N] without what is faster than a hand."""
    if CUTOFF * log.interval >= 0.4:
        return log.force
    low = _SIGNAL.butter(2, 2.0 * CUTOFF * log.interval)
    return _SIGNAL.filtfilt(low[0], low[1], log.force, axis=0)


def lagged(log: Log, values: Array, time_constant: float) -> Array:
    """Return values (rows, …) behind the lag of the clutches, settled at the first row."""
    left = float(np.exp(-log.interval / time_constant))
    before = np.concatenate([values[:1], values[:-1]])
    return _SIGNAL.lfilter([1.0 - left], [1.0, -left], before, axis=0, zi=values[:1] * left)[0]


def slip_rows(machine: Machine) -> Array:
    """Return W of a machine, shape (4, 2)."""
    return np.array(machine.slot_rows)


def experience(log: Log, motion: Smoothed, start: Machine) -> tuple[Array, float, int]:
    """Return what the log shows of the clutches.

    How long each slipped while it was on [s], shape (4,); the highest voltage at which one slipped
    [V]; and at how many voltages, at least half a volt apart, clutches slipped.
    """
    behind = lagged(log, log.volts, start.clutch.time_constant)
    slips = (np.abs(motion.omega @ slip_rows(start).T) > SLIPPING) & (behind > ENGAGED)
    slips &= log.is_clear(motion.half)[:, None]
    at_work = np.sort(np.where(slips, np.minimum(behind, log.volts), 0.0).ravel())
    enough = round(MIN_SEEN / log.interval)
    top = float(at_work[-enough]) if len(at_work) > enough else 0.0
    if top <= ENGAGED:
        top = max(float(log.volts.max()), 1.0)
    nearest = log.volts[(log.volts >= top) & (log.volts <= 1.15 * top)]
    settled = slips & (log.volts > ENGAGED) & (behind > 0.5 * log.volts)
    _, counts = np.unique(np.round(2.0 * log.volts[settled]), return_counts=True)
    levels = int((counts * log.interval >= MIN_SEEN).sum())
    return log.interval * slips.sum(axis=0), float(nearest.min()) if len(nearest) else top, levels


def cut(log: Log, motion: Smoothed, start: Machine, time_constant: float) -> Windows:
    """Return the windows of a log; the time constant [s] needn't be exact."""
    length = max(4, round(DURATION / log.interval))
    first = np.arange((len(log.theta) - 1) // length) * length
    rows = first[:, None] + np.arange(length + 1)
    gap = ~log.is_clear(motion.half)[rows].all(axis=1)
    holds, ambiguous = _holding(log, motion, start, time_constant)
    omega, free = _admitted(motion.omega[first], holds[first], slip_rows(start))
    uncertain = np.zeros((len(first), 4, 4))
    uncertain[:, 0, 0] = uncertain[:, 1, 1] = 1.0
    uncertain[:, 2:, 2:] = free
    force, shaken = smooth_force(log), [smooth_force(each) for each in _shaken_logs(log)]

    def inputs(force: Array, substep: float = SUBSTEP) -> LogInputs:
        return make_inputs(log.interval, log.volts, force, substep)

    return Windows(
        length=length,
        first=first,
        measured=log.theta[rows[:, 1:]],
        starts=np.concatenate([motion.theta[first], omega], axis=1),
        uncertain=uncertain,
        used=~ambiguous[first] & ~gap,
        gaps=int(gap.sum()),
        inputs=inputs(force),
        finer=inputs(force, 0.5 * SUBSTEP),
        harder=inputs((1.0 + GAIN) * force),
        shaken=tuple(inputs(each) for each in shaken),
        noise=motion.noise,
    )


def _shaken_logs(log: Log) -> Iterator[Log]:
    """Yield the log with as much noise added to its forces as they have."""
    rough = np.median(np.abs(np.diff(log.force[:: _independent(log)], 2, axis=0)), axis=0)
    noise = (
        rough / (0.6745 * np.sqrt(6.0)) * (np.sqrt(1.5) if log.angle_step else 1.0)
    )  # less of it is left between rows
    rng = np.random.default_rng(0)
    for _ in range(SHAKES):
        yield replace(log, force=log.force + noise * rng.standard_normal(log.force.shape))


def _holding(
    log: Log, motion: Smoothed, start: Machine, time_constant: float
) -> tuple[Flags, Flags]:
    """Return which clutches hold at rows, (rows, 4), and where that is uncertain, (rows,)."""
    engaged = lagged(log, log.volts, time_constant) > ENGAGED
    slip = np.abs(motion.omega @ slip_rows(start).T)
    width = 2 * motion.half + 1
    error = motion.noise * np.sqrt(12.0 / width) / (width * log.interval)
    slowest = 6.0 * error + 2e-3
    near = _NDIMAGE.maximum_filter1d(slip, width, axis=0, mode="nearest")
    held = engaged & (slip < slowest) & (near < 4.0 * slowest)
    return held, (engaged & (slip < 2.0 * slowest) & ~held).any(axis=1)


def _admitted(omega: Array, held: Flags, w: Array) -> tuple[Array, Array]:
    """Return velocities that held clutches admit, (N, 2), and the directions left, (N, 2, 2)."""
    same = (
        (w[:, None] == w).all(axis=2).argmax(axis=1)
    )  # clutches of equal rows leave the same line
    held = np.stack([held[:, same == x].any(axis=1) for x in range(len(w))], axis=1)
    many = held.sum(axis=1)
    lines = w[:, ::-1] * (-1.0, 1.0) / np.linalg.norm(w, axis=1, keepdims=True)
    along = lines[held.argmax(axis=1)]
    free = np.zeros((len(omega), 2, 2))
    free[many == 0] = np.eye(2)
    free[many == 1, :, 0] = along[many == 1]
    return np.einsum("nij,nkj,nk->ni", free, free, omega), free
