# pyright: standard
"""A log cut into windows: where each begins, which clutches hold then, and the angles."""

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

_SIGNAL: Any = signal

DURATION = 0.2
"""Length of a window [s]: angles tell accelerations well within it."""

CUTOFF = 200.0
"""Of the forces' filter [Hz], for logs of more than 500 rows a second. A filter cuts off the hand's
peaks, so clutches break away too late; 120 Hz makes the breakaway torque 0.1 % too small."""

SMOOTHING = 0.024
"""Half the length of the angles' smoothing [s], which gives velocities at starts of windows."""

GAIN = 1e-3
"""Relative change of the forces that shows what they do to the angles."""

INDEPENDENT = 0.006
"""Time between interpolated rows whose noise is compared [s], if they are closer."""

SHAKES = 4
"""How often noise is added to the forces, to see which windows it rules."""

ENGAGED, SLIPPING = 0.3, 0.2
"""Lagged voltage from which a clutch can hold [V], slip from which it surely slips [rad/s]."""

SUBSTEP = 1.02 * MAX_SUBSTEP
"""Longest substep of the model [s]: a logger's slow clock costs no further substeps."""

MIN_SEEN = 0.1
"""How long clutches have to slip at a voltage for the log to show it [s]."""

SAME, APART = 0.1, 0.5
"""Voltages of neighbouring rows that are one step, and those of two steps that are two [V]."""


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
    """The log as the fit sees it: windows begin with the rows ``first`` and have ``length`` more.

    Angles are ``measured`` there [rad], (windows, length, 2), with the standard deviation
    ``noise``. ``starts`` are angles and velocities [rad, rad/s] at the beginning, (windows, 4), and
    ``uncertain`` has as columns the changes that these admit, zero where a clutch holds. A window
    is not ``used`` if it holds a gap of the log, as ``gaps`` of them do, or if nobody can tell from
    the angles whether a clutch holds as it begins. The model's ``inputs`` are also there with half
    the substep, with forces larger by ``GAIN``, with voltages that fall half a row later, and
    shaken: with more noise of the forces, as much
    as they have. What that changes, no fit can tell.
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
    released: LogInputs
    shaken: tuple[LogInputs, ...]
    noise: float


def smooth(log: Log) -> Smoothed:
    """Return the motion of a log by local polynomials."""
    half = max(2, round(SMOOTHING / log.interval))
    width = 2 * half + 1
    theta = _SIGNAL.savgol_filter(log.theta, width, 2, axis=0)
    omega = _SIGNAL.savgol_filter(log.theta, width, 2, deriv=1, delta=log.interval, axis=0)
    alpha = _SIGNAL.savgol_filter(log.theta, 2 * width - 1, 3, deriv=2, delta=log.interval, axis=0)
    rough = np.diff(log.theta[:: _independent(log)], 3, axis=0) / np.sqrt(20.0)
    noise = min(float(np.median(np.abs(each))) / 0.6745 for each in (log.theta - theta, rough))
    least = (log.angle_step or angle_step(*log.theta.T)) / np.sqrt(12.0)  # that of an encoder
    return Smoothed(theta, omega, alpha, max(noise, least, 1e-7), half)


def _independent(log: Log) -> int:
    """Return how many rows apart noise is independent: interpolated rows share it."""
    return max(1, round(INDEPENDENT / log.interval)) if log.angle_step else 1


def smooth_force(log: Log, force: Array) -> Array:
    """Return forces [N] at the rows of a log without what is faster than a hand."""
    if CUTOFF * log.interval >= 0.4:
        return force
    low = _SIGNAL.butter(2, 2.0 * CUTOFF * log.interval)
    return _SIGNAL.filtfilt(low[0], low[1], force, axis=0)


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


def steps_of(log: Log) -> list[list[tuple[NDArray[np.int64], float]]]:
    """Return, for each clutch, the rows and the voltage [V] of the steps in which it was on."""
    rows, least = np.arange(len(log.volts)), MIN_SEEN / log.interval
    found: list[list[tuple[NDArray[np.int64], float]]] = []
    for volts in log.volts.T:
        parts = np.split(rows, np.flatnonzero(np.abs(np.diff(volts)) > SAME) + 1)
        steps = [(each, float(np.median(volts[each]))) for each in parts if len(each) >= least]
        found.append([(each, level) for each, level in steps if level > ENGAGED])
    return found


def has_one_way(log: Log) -> bool:
    """Return whether the voltages of each clutch only rise, or only fall, from step to step.

    Clutches that lose torque as they warm then look like clutches with another torque curve.
    """
    changes = [np.diff([level for _, level in steps]) for steps in steps_of(log)]
    ways = [(each.max(initial=0.0) > APART, each.min(initial=0.0) < -APART) for each in changes]
    return any(map(any, ways)) and not any(map(all, ways))


def comes_again(log: Log) -> Flags:
    """Return the rows at which a clutch has a voltage as before another one, shape (rows,)."""
    again = np.zeros(len(log.volts), np.bool_)
    for steps in steps_of(log):
        levels = np.array([level for _, level in steps])
        for k, (rows, level) in enumerate(steps):
            other = np.flatnonzero(np.abs(levels[:k] - level) > APART)
            again[rows] = (np.abs(levels[: other.max(initial=0)] - level) < SAME).any()
    return again


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
    inputs = make_inputs(log.interval, log.volts, smooth_force(log, log.force), SUBSTEP)
    spread = np.median(np.abs(np.diff(log.force[:: _independent(log)], 2, axis=0)), axis=0)
    spread *= (1.5 if log.angle_step else 1.0) ** 0.5 / (0.6745 * np.sqrt(6.0))  # less between rows
    rng = np.random.default_rng(0)
    more = [log.force + spread * rng.standard_normal(log.force.shape) for _ in range(SHAKES)]
    return Windows(
        length=length,
        first=first,
        measured=log.theta[rows[:, 1:]],
        starts=np.concatenate([motion.theta[first], omega], axis=1),
        uncertain=uncertain,
        used=~ambiguous[first] & ~gap,
        gaps=int(gap.sum()),
        inputs=inputs,
        finer=replace(inputs, step=0.5 * inputs.step, substeps=2 * inputs.substeps),
        released=replace(inputs, volts=_falling_later(log.volts)),
        harder=replace(inputs, force=(1.0 + GAIN) * inputs.force),
        shaken=tuple(replace(inputs, force=smooth_force(log, each)) for each in more),
        noise=motion.noise,
    )


def _falling_later(volts: Array) -> Array:
    """Return voltages (rows, 4) that fall half a row later, as the mean of each row has it."""
    before = np.concatenate([volts[:1], volts[:-1]])
    return volts + 0.5 * np.maximum(before - volts, 0.0)


def _holding(
    log: Log, motion: Smoothed, start: Machine, time_constant: float
) -> tuple[Flags, Flags]:
    """Return which clutches hold at rows, (rows, 4), and where that is uncertain, (rows,)."""
    engaged = lagged(log, log.volts, time_constant) > ENGAGED
    slip = np.abs(motion.omega @ slip_rows(start).T)
    width = 2 * motion.half + 1
    error = motion.noise * np.sqrt(12.0 / width) / (width * log.interval)
    slowest = 6.0 * error + 2e-3
    near = ndimage.maximum_filter1d(slip, width, axis=0, mode="nearest")
    held = engaged & (slip < slowest) & (near < 4.0 * slowest)
    return held, (engaged & (slip < 2.0 * slowest) & ~held).any(axis=1)


def _admitted(omega: Array, held: Flags, w: Array) -> tuple[Array, Array]:
    """Return velocities that held clutches admit, (N, 2), and the directions left, (N, 2, 2)."""
    # clutches of equal rows leave the same line
    same = (w[:, None] == w).all(axis=2).argmax(axis=1)
    held = np.stack([held[:, same == x].any(axis=1) for x in range(len(w))], axis=1)
    many = held.sum(axis=1)
    lines = w[:, ::-1] * (-1.0, 1.0) / np.linalg.norm(w, axis=1, keepdims=True)
    along = lines[held.argmax(axis=1)]
    free = np.zeros((len(omega), 2, 2))
    free[many == 0] = np.eye(2)
    free[many == 1, :, 0] = along[many == 1]
    return np.einsum("nij,nkj,nk->ni", free, free, omega), free
