"""What scores are made of: parts of telemetry, and measures of path error, pace and acceleration over many episodes."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pter_gym.tasks.path_following import TELEMETRY

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

CUTOFF = 20.0
"""Cut-off [Hz] of the first-order low-pass on the tip acceleration."""

SEGMENTS = 10
"""Equal parts of a path in which the pace is held against the commanded one; the first is left out."""


class Progress(NamedTuple):
    """How far episodes came along their paths.

    Attributes
    ----------
    times
        When the running maximum of the arc length passed 0, 1, … ``SEGMENTS`` tenths of the path [s], linear between
        control instants, NaN where it never did; shape (SEGMENTS + 1, N).
    reached
        The largest arc length, within [0, length] [m], shape (N,).
    end
        Length of the episode [s], shape (N,).
    """

    times: Array
    reached: Array
    end: Array


def column(telemetry: Array, name: str) -> Array:
    """Return one field of telemetry (..., len(TELEMETRY))."""
    return telemetry[..., TELEMETRY.index(name)]


def vector(telemetry: Array, name: str) -> Array:
    """Return the x and y parts of a field of telemetry, shape (..., 2)."""
    first = TELEMETRY.index(f"{name}_x")
    return telemetry[..., first : first + 2]


def four(telemetry: Array, name: str) -> Array:
    """Return the four clutches' parts of a field of telemetry, shape (..., 4)."""
    first = TELEMETRY.index(f"{name}_1")
    return telemetry[..., first : first + 4]


def path_averages(arc_length: Array, errors: Array, length: Array, error_max: Array) -> Array:
    """Return the path-average error ∫|e|ds/L [m] of each episode, shape (N,).

    Each new increment of arc length counts with the largest error since the previous one, so neither an excursion
    at a standstill nor a step back is free. The part of the path that was not reached counts with the worst error seen
    or ``error_max``, whichever is larger.

    Parameters
    ----------
    arc_length, errors
        Projection on the path [m] and |normal error| [m] at each control instant from the reset on, shape (T + 1, N);
        NaN after the end of an episode.
    length, error_max
        Length of the path and workspace bound [m], shape (N,).
    """
    errors = np.nan_to_num(errors)
    increments = np.diff(running_maximum(np.clip(arc_length, 0.0, length)), axis=0)
    worst_since = np.zeros_like(length)
    integral = np.zeros_like(length)
    for increment, error in zip(increments, errors[1:], strict=True):
        worst_since = np.maximum(worst_since, error)
        integral += worst_since * increment
        worst_since[increment > 0.0] = 0.0
    begin = np.clip(arc_length[0], 0.0, length)
    missing = length - begin - increments.sum(axis=0)
    worst = np.maximum(errors.max(axis=0), error_max)
    return (integral + begin * errors[0] + np.maximum(missing, 0.0) * worst) / length


def running_maximum(values: Array) -> Array:
    """Return the largest value so far, over the first axis; NaN leaves it as it is."""
    return np.fmax.accumulate(values, axis=0)


def find_progress(arc_length: Array, time: Array, length: Array) -> Progress:
    """Return how far episodes came along their paths and when; shapes as in ``path_averages``, times [s]."""
    furthest = running_maximum(arc_length)
    end = np.nanmax(time, axis=0)
    worlds = np.arange(len(length))
    times = np.full((SEGMENTS + 1, len(length)), np.nan)
    for k in range(SEGMENTS + 1):
        mark = length * k / SEGMENTS if k < SEGMENTS else length
        passed = furthest >= mark
        after = passed.argmax(axis=0)
        before = np.maximum(after - 1, 0)
        s_before, s_after = furthest[before, worlds], furthest[after, worlds]
        t_before, t_after = time[before, worlds], time[after, worlds]
        part = np.where(s_after > s_before, (mark - s_before) / np.where(s_after > s_before, s_after - s_before, 1), 1)
        times[k] = np.where(passed.any(axis=0), t_before + part * (t_after - t_before), np.nan)
    return Progress(times, np.clip(furthest[-1], 0.0, length), end)


def pace_errors(entered: Array, left: Array, end: Array, stretch: Array, pace: Array) -> Array:
    """Return the pace errors of stretches [m] by when they were entered and left [s], NaN for never."""
    until = np.where(np.isfinite(left), left, end)
    errors = np.abs((until - np.where(np.isfinite(entered), entered, end)) * pace / stretch - 1.0)
    return np.where(np.isfinite(left), errors, np.maximum(errors, 1.0))


def smoothness(speed: Array, acceleration: Array, counted: Mask, period: float) -> Array:
    """Return −ln(D) of the dimensionless jerk D = T³/v_peak²·∫|jerk|²dt, shape (N,); D below 1 counts as 1.

    Hogan and Sternad, "Sensitivity of smoothness measures to movement duration, amplitude, and arrests", Journal of
    Motor Behavior 41 (2009); its logarithm as in Balasubramanian, Melendez-Calderon and Burdet, IEEE Transactions on
    Biomedical Engineering 59 (2012).

    Parameters
    ----------
    speed, acceleration
        Of the tip [m/s, m/s²], shapes (T, N) and (T, N, 2).
    counted
        Which control steps count, shape (T, N).
    period
        Control period [s].
    """
    both = counted[1:] & counted[:-1]
    squares = np.where(both, (np.diff(acceleration, axis=0) ** 2).sum(axis=-1), 0.0)
    duration = counted.sum(axis=0) * period
    peak = np.where(counted, speed, 0.0).max(axis=0)
    jerk = duration**3 * squares.sum(axis=0) / period
    return -np.log(np.maximum(jerk, peak**2) / np.where(peak > 0.0, peak**2, 1.0), where=peak > 0.0, out=0.0 * peak)


def low_pass(values: Array, period: float) -> Array:
    """Return values (T, …) behind a first-order low-pass of ``CUTOFF``, exact for inputs held over the period [s]."""
    decay = math.exp(-2.0 * math.pi * CUTOFF * period)
    filtered = np.empty_like(values)
    state = np.zeros_like(values[0])
    for k, value in enumerate(values):
        state = value + (state - value) * decay
        filtered[k] = state
    return filtered


def norm(vectors: Array) -> Array:
    """Return the lengths of vectors (…, 2)."""
    return np.hypot(vectors[..., 0], vectors[..., 1])


def mean_over(values: ArrayLike, counted: Mask) -> Array:
    """Return the mean over the first axis of what counts; at least one must."""
    return np.where(counted, values, 0.0).sum(axis=0) / counted.sum(axis=0)
