"""Episodes as scores are found from them: what several scores need is found once."""

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from pter_gym.benchmark.measures import (
    SEGMENTS,
    Array,
    Mask,
    Progress,
    column,
    find_progress,
    four,
    low_pass,
    mean_over,
    norm,
    pace_errors,
    path_averages,
    smoothness,
    vector,
)
from pter_gym.tasks.path_following import PathFollowing

START_UP = 0.2
"""Start-up interval [s] that accelerations leave out: the push begins at once, and its jolt is no policy's doing."""


class Travel:
    """N episodes along their paths: all that scores which decide on ranks are found from.

    Parameters
    ----------
    time, arc_length, errors, success
        These fields of the telemetry, from the reset on, shape (T + 1, N); NaN after the ends of the episodes.
    tasks
        The tasks that were followed, N of them.
    """

    def __init__(
        self, time: Array, arc_length: Array, errors: Array, success: Array, tasks: Sequence[PathFollowing]
    ) -> None:
        self.time, self.arc_length, self.errors, self.success = time, arc_length, np.abs(errors), success
        self.length = np.array([task.path.length for task in tasks])
        self.error_max = np.array([task.error_max for task in tasks])
        self.pace = np.array([task.pace for task in tasks])

    @cached_property
    def mean_error(self) -> Array:
        """Time average of the path error [m]."""
        return mean_over(self.errors[1:], np.isfinite(self.time[1:]))

    @cached_property
    def path_average(self) -> Array:
        """Path average of the path error [m]."""
        return path_averages(self.arc_length, self.errors, self.length, self.error_max)

    @cached_property
    def progress(self) -> Progress:
        """How far the episodes came, and when."""
        return find_progress(self.arc_length, self.time, self.length)

    # The pace error of a stretch of the path is |t·v/stretch − 1|. A stretch that was not finished counts with the time
    # that was spent on it, and with at least 1.

    def mean_pace_error(self) -> Array:
        """Return the pace error of the whole path but its first segment."""
        entered, left, end = self.progress.times[1], self.progress.times[-1], self.progress.end
        return pace_errors(entered, left, end, self.length * (1.0 - 1.0 / SEGMENTS), self.pace)

    def segment_pace_error(self) -> Array:
        """Return the mean pace error of the segments but the first."""
        entered, left = self.progress.times[1:-1], self.progress.times[2:]
        return pace_errors(entered, left, self.progress.end, self.length / SEGMENTS, self.pace).mean(axis=0)

    def mean_pace(self) -> Array:
        """Return the mean speed along the path [m/s], first segment left out; 0 for who never got past it."""
        entered, left, end = self.progress.times[1], self.progress.times[-1], self.progress.end
        way = np.maximum(self.progress.reached - self.length / SEGMENTS, 0.0)
        until = np.where(np.isfinite(left), left, end)
        taken = np.where(np.isfinite(entered), until - entered, np.inf)
        return np.where(way > 0.0, way / np.where(taken > 0.0, taken, np.inf), 0.0)

    def completed(self) -> Mask:
        """Return whether the end of the path was reached."""
        return (self.success[1:] == 1.0).any(axis=0)


class Recorded(Travel):
    """N episodes with all of their telemetry; parameters as of ``score_episodes``."""

    def __init__(self, telemetry: Array, tasks: Sequence[PathFollowing], voltage_max: float) -> None:
        time, arc_length, errors, success = (
            column(telemetry, name) for name in ("time", "arc_length", "normal_error", "is_success")
        )
        super().__init__(time, arc_length, errors, success, tasks)
        self.telemetry = telemetry
        self.steps = telemetry[1:]
        self.alive = np.isfinite(self.time[1:])
        self.period = tasks[0].control_period
        self.voltage_max = voltage_max

    @cached_property
    def volts(self) -> Array:
        """Clutch voltages [V], (T, N, 4)."""
        return four(self.steps, "volts")

    @cached_property
    def speed(self) -> Array:
        """Speed of the tip [m/s], (T, N)."""
        return norm(vector(self.steps, "tip_velocity"))

    @cached_property
    def counted(self) -> Mask:
        """Control steps whose accelerations count, (T, N): all after the start-up, or all if there are none."""
        settled = self.alive & (column(self.steps, "time") > START_UP)
        return np.where(settled.any(axis=0), settled, self.alive)

    @cached_property
    def raw_acceleration(self) -> Array:
        """Size of the tip's acceleration [m/s²], (T, N)."""
        return norm(vector(self.steps, "acceleration"))

    @cached_property
    def acceleration(self) -> Array:
        """Acceleration of the tip behind the low-pass [m/s²], (T, N)."""
        return norm(low_pass(vector(self.steps, "acceleration"), self.period))

    def mean(self, values: ArrayLike) -> Array:
        """Return the mean over an episode of values (T, N)."""
        return mean_over(values, self.alive)

    def total(self, name: str) -> Array:
        """Return the sum over an episode of a field of the telemetry."""
        return np.nansum(column(self.steps, name), axis=0)

    def mean_of(self, acceleration: Array) -> Array:
        """Return the time average of an acceleration."""
        return mean_over(acceleration, self.counted)

    def rms_of(self, acceleration: Array) -> Array:
        """Return the root of the mean square of an acceleration."""
        return np.sqrt(mean_over(acceleration**2, self.counted))

    def peak_of(self, acceleration: Array) -> Array:
        """Return the largest of an acceleration."""
        return np.where(self.counted, acceleration, 0.0).max(axis=0)

    def way(self) -> Array:
        """Return the length of the tip's way [m]."""
        return np.nansum(norm(np.diff(vector(self.telemetry, "tip"), axis=0)), axis=0)

    def effort(self) -> Array:
        """Return the mean of (V/V_max)² over time and clutches."""
        return self.mean((self.volts**2).mean(axis=-1)) / self.voltage_max**2

    def saturated(self) -> Array:
        """Return the fraction of the time with a clutch at its largest voltage."""
        return self.mean((self.volts >= (1.0 - 1e-6) * self.voltage_max).any(axis=-1))

    def smoothness(self) -> Array:
        """Return −ln of the dimensionless jerk."""
        return smoothness(self.speed, vector(self.steps, "acceleration"), self.counted, self.period)
