"""What scores read from the telemetry of many episodes: error, pace and acceleration."""

import math
from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pter_gym._compiled.records import load, width
from pter_gym.benchmark.tally import PROGRESS, SUMS, Progress, Sums, tally_kernel
from pter_gym.haptics import apparent_stiffness, mean_resisting_force
from pter_gym.haptics.scores import total
from pter_gym.tasks.path_following import TELEMETRY, PathFollowing
from pter_gym.tasks.path_following._pace import ALLOWANCE, START

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

ACCELERATION_CUTOFF = 20.0
"""Cut-off [Hz] of the first-order low-pass on the tip acceleration."""

SEGMENTS = 10
"""Equal parts of a path, each with a pace error and a path error of its own."""


def column(telemetry: Array, name: str) -> Array:
    """Return one field of telemetry (..., len(TELEMETRY))."""
    return telemetry[..., TELEMETRY.index(name)]


def vector(telemetry: Array, name: str) -> Array:
    """Return the x and y parts of a field of telemetry, shape (..., 2)."""
    first = TELEMETRY.index(f"{name}_x")
    return telemetry[..., first : first + 2]


def per_clutch(telemetry: Array, name: str) -> Array:
    """Return the four clutches' parts of a field of telemetry, shape (..., 4)."""
    first = TELEMETRY.index(f"{name}_1")
    return telemetry[..., first : first + 4]


def pace_errors(relative_times: Array, finished: Mask) -> Array:
    """Return the pace errors of stretches: |t/T − 1|, at least 1 for an unfinished one."""
    errors = np.abs(relative_times - 1.0)
    return np.where(finished, errors, np.maximum(errors, 1.0))


def smoothness(speed: Array, acceleration: Array, counted: Mask, period: float) -> Array:
    """Return −ln(D) of the dimensionless jerk D = T³/v_peak²·∫|jerk|²dt, D ≥ 1, shape (N,).

    Hogan and Sternad, Journal of Motor Behavior 41 (2009); the logarithm as in Balasubramanian,
    Melendez-Calderon and Burdet, IEEE Transactions on Biomedical Engineering 59 (2012).

    Speed [m/s] and acceleration [m/s²] of the tip have the shapes (T, N) and (T, N, 2);
    ``counted``, (T, N), says which control steps count, and ``period`` is theirs [s].
    """
    both = counted[1:] & counted[:-1]
    squares = np.where(both, (np.diff(acceleration, axis=0) ** 2).sum(axis=-1), 0.0)
    duration = counted.sum(axis=0) * period
    peak = np.where(counted, speed, 0.0).max(axis=0)
    jerk = duration**3 * total(squares) / period
    return -np.log(
        np.maximum(jerk, peak**2) / np.where(peak > 0.0, peak**2, 1.0),
        where=peak > 0.0,
        out=0.0 * peak,
    )


def low_pass(values: Array, period: float) -> Array:
    """Return values (T, …) after a first-order low-pass, exact for inputs held for a period [s]."""
    decay = math.exp(-2.0 * math.pi * ACCELERATION_CUTOFF * period)
    filtered = np.empty_like(values)
    state = np.zeros_like(values[0])
    for k, value in enumerate(values):
        filtered[k] = state = value + (state - value) * decay
    return filtered


def norm(vectors: Array) -> Array:
    """Return the lengths of vectors (…, 2)."""
    return np.hypot(vectors[..., 0], vectors[..., 1])


def mean_over(values: ArrayLike, counted: Mask) -> Array:
    """Return the mean of the counted values over the first axis; at least one must count."""
    return total(np.where(counted, values, 0.0)) / counted.sum(axis=0)


START_UP = 0.2
"""Start-up interval [s] that accelerations leave out: no policy causes the push's jolt."""

TOUCH = 1e-4
"""Penetration [m] of a fixture's edge from which on its stiffness counts."""

PRICE = 2.0
"""Power of the time ratio by which the path error of a slow segment counts; a fast one's slope.

With less, a slower rollout within the limits would still pay, since errors grow with the speed.
"""


EACH: Any = slice(None)
"""In place of the number of a world: all of them."""


class Travel:
    """N episodes along their paths: everything needed for the scores that decide ranks.

    ``add`` goes on with rows of telemetry, (T, N, len(TELEMETRY)), which start with the reset and
    are NaN after the ends of the episodes.
    """

    def __init__(self, tasks: Sequence[PathFollowing]) -> None:
        self.length = np.array([task.path.length for task in tasks])
        self.error_max = np.array([task.error_max for task in tasks])
        self.pace = np.array([task.pace for task in tasks])
        tenths = self.length * np.linspace(0.0, 1.0, SEGMENTS + 1)[:, None]
        self._marks = np.concatenate([tenths, self.length[None] * START])
        self._progress = np.zeros((width(Progress), len(tasks)))
        self._passed = np.full((width(Sums), *self._marks.shape), math.nan)
        # arrays in place of numbers, which look at what is summed up
        self._now: Any = load(self._progress, PROGRESS, EACH)
        self._then: Any = load(self._passed, SUMS, EACH)
        self._now.sums.time.fill(math.nan)

    def add(self, telemetry: Array) -> None:
        """Go on with rows of telemetry."""
        passed = self._passed.reshape(len(self._passed), -1)
        tally_kernel()(np.ascontiguousarray(telemetry), self._marks, self._progress, passed)

    @property
    def end(self) -> Array:
        """Lengths of the episodes [s]."""
        return self._now.sums.time

    @property
    def furthest(self) -> Array:
        """Largest arc lengths [m]."""
        return self._now.furthest

    @cached_property
    def worst(self) -> Array:
        """The error of the part of the path not reached [m]: the largest, at least the bound."""
        return np.maximum(self._now.largest, self.error_max)

    def path_average(self) -> Array:
        """Return the path average of the path error [m]."""
        return self._average_on_path("on_path", self.worst)

    def rms_error(self) -> Array:
        """Return the root mean square of the path error over the path [m]."""
        return np.sqrt(self._average_on_path("squared", self.worst**2))

    def _average_on_path(self, name: str, missed: Array) -> Array:
        """Return an integral over the path's length, ``missed`` where not reached."""
        whole: Array = self._at_marks(name)[-1]
        so_far: Array = getattr(self._now.sums, name)
        missing = np.maximum(self.length - self.furthest, 0.0)
        return np.where(np.isfinite(whole), whole, so_far + missing * missed) / self.length

    def _at_marks(self, name: str) -> Array:
        """Return an entry of ``Sums`` at 0, 1, … ``SEGMENTS`` tenths of the paths."""
        return getattr(self._then, name)[: SEGMENTS + 1]

    @cached_property
    def lost_at_start(self) -> Array:
        """The delay on the first ``START`` of the path that does not count [s]: ≤ ``ALLOWANCE``."""
        begun = self._then.time[-1]
        return np.clip(
            np.where(np.isfinite(begun), begun, self.end) - self._marks[-1] / self.pace,
            0.0,
            ALLOWANCE,
        )

    @cached_property
    def passed(self) -> Array:
        """Counted times when the tenths of the path were passed [s]; the end for the others."""
        times = np.where(self.reached, self._at_marks("time"), self.end)
        return np.concatenate([times[:1], times[1:] - self.lost_at_start])

    @cached_property
    def reached(self) -> Mask:
        """Which of the tenths of the path were passed, (SEGMENTS + 1, N)."""
        return np.isfinite(self._at_marks("time"))

    @property
    def finished(self) -> Mask:
        """Which segments were finished, (SEGMENTS, N)."""
        return self.reached[1:]

    @cached_property
    def relative_times(self) -> Array:
        """Times spent in the segments over the time at the pace, (SEGMENTS, N)."""
        return np.diff(self.passed, axis=0) / (self.length / SEGMENTS / self.pace)

    def segment_errors(self) -> Array:
        """Return the path errors of the segments [m], (SEGMENTS, N).

        Each is the larger of the averages of |e| over the time and over the length of the segment,
        times its ``pace_factor``. An unfinished segment counts with ``worst`` and with at least its
        time at the pace.
        """
        in_time, on_path = (
            np.diff(self._at_marks(name), axis=0) for name in ("in_time", "on_path")
        )
        spent = self.relative_times * (self.length / SEGMENTS / self.pace)
        in_time = np.divide(in_time, spent, where=spent > 0.0, out=np.zeros_like(spent))
        larger = np.maximum(in_time, on_path * SEGMENTS / self.length)
        ratios = np.where(self.finished, self.relative_times, np.maximum(self.relative_times, 1.0))
        return np.where(self.finished, larger, self.worst) * pace_factor(ratios)

    def path_error(self) -> Array:
        """Return the mean of the segments' path errors [m], which ranks policies.

        It is at most ``worst``, so a stuck episode counts the same however long it lasts.
        """
        return np.minimum(total(self.segment_errors()) / SEGMENTS, self.worst)

    def mean_pace_error(self) -> Array:
        """Return the pace error of the whole path."""
        return pace_errors(total(self.relative_times) / SEGMENTS, self.finished[-1])

    def segment_pace_error(self) -> Array:
        """Return the mean pace error of the segments."""
        return total(pace_errors(self.relative_times, self.finished)) / SEGMENTS

    def mean_pace(self, first: int = 0) -> Array:
        """Return the mean speed along the path from a segment on [m/s]; 0 without any time."""
        distance = np.minimum(self.furthest, self.length) - self.length / SEGMENTS * first
        time = self.passed[-1] - (self.passed[1] if first else 0.0)
        return np.divide(distance, time, where=time > 0.0, out=np.zeros_like(distance))

    def completed(self) -> Mask:
        """Return whether the end of the path was reached."""
        return self._now.success == 1.0


class Recorded(Travel):
    """N episodes with all their telemetry, and the largest voltage of the clutches [V]."""

    def __init__(
        self, telemetry: Array, tasks: Sequence[PathFollowing], voltage_max: float
    ) -> None:
        super().__init__(tasks)
        self.add(telemetry)
        self.tasks = tasks
        self.telemetry = telemetry
        self.steps = telemetry[1:]
        self.alive = np.isfinite(column(self.steps, "time"))
        self.period = tasks[0].control_period
        self.voltage_max = voltage_max

    @cached_property
    def volts(self) -> Array:
        """Clutch voltages [V], (T, N, 4)."""
        return per_clutch(self.steps, "volts")

    @cached_property
    def speed(self) -> Array:
        """Speed of the tip [m/s], (T, N)."""
        return norm(vector(self.steps, "tip_velocity"))

    @cached_property
    def counted(self) -> Mask:
        """Control steps whose accelerations count, (T, N): those after the start-up, if any."""
        settled = self.alive & (column(self.steps, "time") > START_UP)
        return settled | (self.alive & ~settled.any(axis=0))

    @cached_property
    def acceleration(self) -> Array:
        """Acceleration of the tip after the low-pass [m/s²], (T, N)."""
        return norm(low_pass(vector(self.steps, "acceleration"), self.period))

    def mean_error(self) -> Array:
        """Return the time average of the path error [m]."""
        return self.mean(np.abs(column(self.steps, "normal_error")))

    def mean(self, values: ArrayLike) -> Array:
        """Return the mean over an episode of values (T, N)."""
        return mean_over(values, self.alive)

    def total(self, name: str) -> Array:
        """Return the sum over an episode of a field of the telemetry."""
        return total(np.nan_to_num(column(self.steps, name)))

    def distance_travelled(self) -> Array:
        """Return the distance travelled by the tip [m]."""
        return total(np.nan_to_num(norm(np.diff(vector(self.telemetry, "tip"), axis=0))))

    @cached_property
    def force(self) -> Array:
        """Size of the hand's force on the tip [N], (T, N), 0 after the end."""
        return np.nan_to_num(norm(vector(self.steps, "force")))

    @cached_property
    def heading(self) -> Array:
        """Heading of the path at the tip's projection [rad], (T, N)."""
        arcs = zip(self.tasks, column(self.steps, "arc_length").T, strict=True)
        return np.stack([task.path.arcs.at(s)[2] for task, s in arcs], axis=1)

    def apparent_stiffness(self) -> Array | None:
        """Return the apparent stiffness of fixtures [N/m], 0 if untouched; None without any."""
        if not all(task.free_left or task.free_right for task in self.tasks):
            return None
        force, error = vector(self.steps, "force"), column(self.steps, "normal_error")
        into = np.copysign(1.0, error) * (
            force[..., 1] * np.cos(self.heading) - force[..., 0] * np.sin(self.heading)
        )
        depth = np.where(np.abs(error) > TOUCH, np.abs(error), 0.0)
        return np.nan_to_num(
            [apparent_stiffness(*pair) for pair in zip(np.nan_to_num(into).T, depth.T, strict=True)]
        )

    def resisting_force(self) -> Array:
        """Return the mean force of the clutches against the tip's motion [N]."""
        return mean_resisting_force(per_clutch(self.steps, "power").sum(axis=-1), self.speed)

    def smoothness(self) -> Array:
        """Return −ln of the dimensionless jerk."""
        return smoothness(self.speed, vector(self.steps, "acceleration"), self.counted, self.period)


def pace_factor(ratios: Array) -> Array:
    """Return the weight of a segment's error, given its time over the time at the pace.

    For a ratio r, the weight is r to the power of ``PRICE`` if too slow, r > 1, and
    1 + ``PRICE``·(1 − r) if too fast.
    """
    return np.where(ratios > 1.0, ratios**PRICE, 1.0 + PRICE * (1.0 - ratios))
