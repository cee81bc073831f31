"""Scores of episodes, from their telemetry."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pter_gym.params import BASELINE, quantity
from pter_gym.physics.friction import ClutchMode
from pter_gym.tasks.path_following import TELEMETRY, PathFollowing

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

START_UP = 0.2
"""Start-up interval [s] that accelerations leave out: the push begins at once, and its jolt is no policy's doing."""

CUTOFF = 20.0
"""Cut-off [Hz] of the first-order low-pass on the tip acceleration."""

SEGMENTS = 10
"""Equal parts of a path in which the pace is held against the commanded one; the first is left out."""


@dataclass(frozen=True, kw_only=True)
class Score:
    """Scores of one episode. Accelerations leave out the start-up interval and are low-pass filtered unless called raw.

    Every score is finite, whatever the episode. One that ends within the start-up interval counts whole.
    """

    path_error_m: float = quantity("m", "the larger of the two averages of |e|, over time and over the path")
    mean_error_m: float = quantity("m", "time average of |e|")
    path_average_error_m: float = quantity(
        "m", "∫|e|ds/L over new arc length, unfinished parts at the worst error or the bound"
    )
    mean_pace_error: float = quantity("1", "|T·v/L − 1| with the commanded pace v, first segment left out")
    segment_pace_error: float = quantity("1", "mean of |t·v/(L/10) − 1| over ten segments but the first")
    mean_pace_m_s: float = quantity("m/s", "mean speed along the path, first segment left out")
    mean_speed_m_s: float = quantity("m/s", "time average of the tip's speed")
    mean_acceleration_m_s2: float = quantity("m/s²", "time average")
    rms_acceleration_m_s2: float = quantity("m/s²", "root of the mean square")
    peak_acceleration_m_s2: float = quantity("m/s²", "largest")
    raw_mean_acceleration_m_s2: float = quantity("m/s²", "time average, not filtered")
    raw_rms_acceleration_m_s2: float = quantity("m/s²", "root of the mean square, not filtered")
    raw_peak_acceleration_m_s2: float = quantity("m/s²", "largest, not filtered")
    smoothness: float = quantity("1", "−ln of the dimensionless jerk; larger is smoother")
    path_length_m: float = quantity("m", "way of the tip")
    completed: bool = quantity("1", "the end of the path was reached")
    duration_s: float = quantity("s", "length of the episode")
    effort: float = quantity("1", "mean of (V/V_max)² over time and clutches")
    dissipated_j: float = quantity("J", "energy taken by the clutches")
    hand_work_j: float = quantity("J", "work of the hand")
    saturated: float = quantity("1", "fraction of the time with a clutch at its largest voltage")
    stuck: float = quantity("1", "fraction of the time at zero degrees of freedom")


Scores = dict[str, NDArray[Any]]
"""The fields of ``Score`` by name, each an array (N,) over episodes; ``completed`` is bool, the others are float64."""

SCORES = tuple(item.name for item in fields(Score))


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


def score(telemetry: Array, task: PathFollowing, *, voltage_max: float = BASELINE.clutch.voltage_max) -> Score:
    """Score one episode.

    Parameters
    ----------
    telemetry
        Shape (steps + 1, len(TELEMETRY)): the row of the reset, then one row per control step.
    task
        The task that was followed.
    voltage_max
        Largest voltage of the clutches [V].
    """
    found = score_episodes(np.asarray(telemetry)[:, None], [task], voltage_max=voltage_max)
    return Score(**{name: values[0].item() for name, values in found.items()})


def score_episodes(
    telemetry: Array, tasks: Sequence[PathFollowing], *, voltage_max: float = BASELINE.clutch.voltage_max
) -> Scores:
    """Score many episodes at once; none depends on the others.

    Parameters
    ----------
    telemetry
        Shape (T + 1, N, len(TELEMETRY)): the rows of the reset, then one per control step, NaN after the end of an
        episode.
    tasks
        The tasks that were followed, N of them, with one control period.
    voltage_max
        Largest voltage of the clutches [V].
    """
    if len(telemetry) < 2:
        raise ValueError(f"an episode needs its reset and at least one step, got {len(telemetry)} rows")
    steps = telemetry[1:]
    time = column(steps, "time")
    alive = np.isfinite(time)
    if not alive[0].all():
        raise ValueError(f"an episode needs its reset and at least one step, episode {alive[0].argmin()} has none")
    period = tasks[0].control_period
    arc_length, errors = column(telemetry, "arc_length"), column(telemetry, "normal_error")
    ranked = ranked_scores(column(telemetry, "time"), arc_length, errors, column(telemetry, "is_success"), tasks)
    volts = four(steps, "volts")
    found = {
        **ranked,
        "mean_speed_m_s": mean_over(norm(vector(steps, "tip_velocity")), alive),
        **acceleration_scores(steps, alive, period),
        "path_length_m": np.nansum(norm(np.diff(vector(telemetry, "tip"), axis=0)), axis=0),
        "effort": mean_over((volts**2).mean(axis=-1), alive) / voltage_max**2,
        "dissipated_j": np.nansum(column(steps, "dissipated"), axis=0),
        "hand_work_j": np.nansum(column(steps, "hand_work"), axis=0),
        "saturated": mean_over((volts >= (1.0 - 1e-6) * voltage_max).any(axis=-1), alive),
        "stuck": mean_over(column(steps, "mode") == ClutchMode.ZERO_DOF, alive),
    }
    return {name: found[name] for name in SCORES}


def ranked_scores(
    time: Array, arc_length: Array, errors: Array, success: Array, tasks: Sequence[PathFollowing]
) -> Scores:
    """Return the scores by which policies are ranked, and what they are made of: path errors, pace, completion.

    Parameters
    ----------
    time, arc_length, errors, success
        These fields of the telemetry of N episodes, from the reset on, shape (T + 1, N); NaN after their ends.
    tasks
        The tasks that were followed, N of them.
    """
    length = np.array([task.path.length for task in tasks])
    errors = np.abs(errors)
    mean_error = mean_over(errors[1:], np.isfinite(time[1:]))
    path_average = path_averages(arc_length, errors, length, np.array([task.error_max for task in tasks]))
    progress = find_progress(arc_length, time, length)
    return {
        "path_error_m": np.maximum(mean_error, path_average),
        "mean_error_m": mean_error,
        "path_average_error_m": path_average,
        **pace_scores(progress, length, np.array([task.pace for task in tasks])),
        "completed": (success[1:] == 1.0).any(axis=0),
        "duration_s": progress.end,
    }


def path_averages(arc_length: Array, errors: Array, length: Array, error_max: Array) -> Array:
    """Return the path-average error ∫|e|ds/L [m] of each episode, shape (N,).

    Each new increment of arc length counts with the largest error since the previous one, so that neither an excursion
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


def pace_scores(progress: Progress, length: Array, pace: Array) -> Scores:
    """Return how well the commanded pace [m/s] was kept, shape (N,).

    The pace error of a stretch of the path is |t·v/stretch − 1|. A stretch that was not finished counts with the time
    that was spent on it, and with at least 1.
    """
    entered, left = progress.times[:-1], progress.times[1:]
    segments = pace_errors(entered[1:], left[1:], progress.end, length / SEGMENTS, pace)
    whole = pace_errors(entered[1], left[-1], progress.end, length * (1.0 - 1.0 / SEGMENTS), pace)
    way = np.maximum(progress.reached - length / SEGMENTS, 0.0)
    until = np.where(np.isfinite(left[-1]), left[-1], progress.end)
    taken = np.where(np.isfinite(entered[1]), until - entered[1], np.inf)
    return {
        "mean_pace_error": whole,
        "segment_pace_error": segments.mean(axis=0),
        "mean_pace_m_s": np.where(way > 0.0, way / np.where(taken > 0.0, taken, np.inf), 0.0),
    }


def pace_errors(entered: Array, left: Array, end: Array, stretch: Array, pace: Array) -> Array:
    """Return the pace errors of stretches [m] by when they were entered and left [s], NaN for never."""
    until = np.where(np.isfinite(left), left, end)
    errors = np.abs((until - np.where(np.isfinite(entered), entered, end)) * pace / stretch - 1.0)
    return np.where(np.isfinite(left), errors, np.maximum(errors, 1.0))


def acceleration_scores(steps: Array, alive: Mask, period: float) -> Scores:
    """Return the scores of the tip's acceleration from telemetry (T, N, …), shape (N,)."""
    settled = alive & (column(steps, "time") > START_UP)
    counted = np.where(settled.any(axis=0), settled, alive)
    acceleration = vector(steps, "acceleration")
    found: Scores = {}
    for prefix, values in (("", norm(low_pass(acceleration, period))), ("raw_", norm(acceleration))):
        found[f"{prefix}mean_acceleration_m_s2"] = mean_over(values, counted)
        found[f"{prefix}rms_acceleration_m_s2"] = np.sqrt(mean_over(values**2, counted))
        found[f"{prefix}peak_acceleration_m_s2"] = np.where(counted, values, 0.0).max(axis=0)
    found["smoothness"] = smoothness(norm(vector(steps, "tip_velocity")), acceleration, counted, period)
    return found


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
