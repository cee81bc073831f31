"""Building blocks of scores: parts of telemetry, and path error, pace and acceleration over many episodes."""

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
"""Equal parts of a path, in each of which the pace is held against the commanded one and the error is judged."""


class Marks(NamedTuple):
    """The instants when the running maximum of the arc length passed K marks on each of N paths.

    Each was passed between the rows ``before`` and ``after``, at ``part`` of the way from one to the other, which is
    NaN if it was never passed; all have the shape (K, N).
    """

    before: NDArray[np.intp]
    after: NDArray[np.intp]
    part: Array

    def find(self, values: Array) -> Array:
        """Interpolate values, one row for each arc length, linearly at the marks; NaN where a mark was never passed."""
        first, last = (np.take_along_axis(values, rows, axis=0) for rows in (self.before, self.after))
        return first + self.part * (last - first)


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


def find_marks(furthest: Array, marks: Array) -> Marks:
    """Return when marks (K, N) were passed by the running maximum of the arc length (R, N), from 0 on, all in m."""
    passed = np.stack([furthest >= mark for mark in marks], axis=1)
    after = passed.argmax(axis=0)
    before = np.maximum(after - 1, 0)
    low, high = (np.take_along_axis(furthest, rows, axis=0) for rows in (before, after))
    part = np.divide(marks - low, high - low, where=high > low, out=np.ones_like(marks))
    return Marks(before, after, np.where(passed.any(axis=0), part, np.nan))


def way_integral(furthest: Array, errors: Array) -> Array:
    """Return ∫|e|ds [m²] up to each row, shape (T + 2, N).

    Each new increment of arc length is weighted by the largest error since the previous one, so excursions at a
    standstill and steps back are counted too. ``furthest``, (T + 2, N) [m], is the running maximum of the arc length,
    from 0 on; ``errors``, (T + 1, N) [m], are |normal error| at each control instant, NaN after the end of an episode.
    """
    parts = np.zeros_like(furthest)
    worst_since = np.zeros_like(furthest[0])
    for part, increment, error in zip(parts[1:], np.diff(furthest, axis=0), np.nan_to_num(errors), strict=True):
        worst_since = np.maximum(worst_since, error)
        part[:] = worst_since * increment
        worst_since[increment > 0.0] = 0.0
    return parts.cumsum(axis=0)


def pace_errors(relative_times: Array, finished: Mask) -> Array:
    """Return the pace errors of stretches: |t/T − 1|, at least 1 for an unfinished one."""
    errors = np.abs(relative_times - 1.0)
    return np.where(finished, errors, np.maximum(errors, 1.0))


def smoothness(speed: Array, acceleration: Array, counted: Mask, period: float) -> Array:
    """Return −ln(D) of the dimensionless jerk D = T³/v_peak²·∫|jerk|²dt, shape (N,); D below 1 counts as 1.

    Hogan and Sternad, "Sensitivity of smoothness measures to movement duration, amplitude, and arrests", Journal of
    Motor Behavior 41 (2009); the logarithm as in Balasubramanian, Melendez-Calderon and Burdet, IEEE Transactions on
    Biomedical Engineering 59 (2012).

    Speed [m/s] and acceleration [m/s²] of the tip have the shapes (T, N) and (T, N, 2); ``counted``, (T, N), says which
    control steps count, and ``period`` is theirs [s].
    """
    both = counted[1:] & counted[:-1]
    squares = np.where(both, (np.diff(acceleration, axis=0) ** 2).sum(axis=-1), 0.0)
    duration = counted.sum(axis=0) * period
    peak = np.where(counted, speed, 0.0).max(axis=0)
    jerk = duration**3 * squares.sum(axis=0) / period
    return -np.log(np.maximum(jerk, peak**2) / np.where(peak > 0.0, peak**2, 1.0), where=peak > 0.0, out=0.0 * peak)


def low_pass(values: Array, period: float) -> Array:
    """Return values (T, …) after a first-order low-pass of ``CUTOFF``, exact for inputs held over the period [s]."""
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
    """Return the mean of the counted values over the first axis; at least one must count."""
    return np.where(counted, values, 0.0).sum(axis=0) / counted.sum(axis=0)
