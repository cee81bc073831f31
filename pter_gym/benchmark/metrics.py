"""Scores of an episode, from its telemetry."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pter_gym.params import quantity
from pter_gym.tasks.path_following import TELEMETRY, PathFollowing

Array = NDArray[np.float64]

START_UP = 0.2
"""Start-up interval [s] that accelerations leave out: the push begins at once, and its jolt is no policy's doing."""

CUTOFF = 20.0
"""Cut-off [Hz] of the first-order low-pass on the tip acceleration."""


@dataclass(frozen=True, kw_only=True)
class Score:
    """Scores of one episode. Accelerations are means over a control period, low-pass filtered unless called raw."""

    path_error_m: float = quantity(
        "m", "∫|e|ds/L over new arc length, unfinished parts at the worst error or the bound"
    )
    mean_error_m: float = quantity("m", "time average of |e|")
    mean_speed_m_s: float = quantity("m/s", "time average of the tip's speed")
    mean_acceleration_m_s2: float = quantity("m/s²", "time average after the start-up interval")
    peak_acceleration_m_s2: float = quantity("m/s²", "largest after the start-up interval")
    raw_mean_acceleration_m_s2: float = quantity("m/s²", "not filtered, start-up included")
    raw_peak_acceleration_m_s2: float = quantity("m/s²", "not filtered, start-up included")
    path_length_m: float = quantity("m", "way of the tip")
    completed: bool = quantity("1", "the end of the path was reached")
    duration_s: float = quantity("s", "length of the episode")
    dissipated_j: float = quantity("J", "energy taken by the clutches")


def column(telemetry: Array, name: str) -> Array:
    """Return one field of telemetry (..., len(TELEMETRY))."""
    return telemetry[..., TELEMETRY.index(name)]


def vector(telemetry: Array, name: str) -> Array:
    """Return the x and y parts of a field of telemetry, shape (..., 2)."""
    first = TELEMETRY.index(f"{name}_x")
    return telemetry[..., first : first + 2]


def score(telemetry: Array, task: PathFollowing) -> Score:
    """Score one episode.

    Parameters
    ----------
    telemetry
        Shape (steps + 1, len(TELEMETRY)): the row of the reset, then one row per control step.
    task
        The task that was followed.
    """
    if len(telemetry) < 2:
        raise ValueError(f"an episode needs its reset and at least one step, got {len(telemetry)} rows")
    time = column(telemetry, "time")[1:]
    error = np.abs(column(telemetry, "normal_error"))
    raw = np.linalg.norm(vector(telemetry, "acceleration")[1:], axis=1)
    filtered = np.linalg.norm(low_pass(vector(telemetry, "acceleration")[1:], task.control_period), axis=1)
    settled = filtered[time > START_UP]
    return Score(
        path_error_m=path_error(column(telemetry, "arc_length"), error, task.path.length, task.error_max),
        mean_error_m=float(error[1:].mean()),
        mean_speed_m_s=float(np.linalg.norm(vector(telemetry, "tip_velocity")[1:], axis=1).mean()),
        mean_acceleration_m_s2=float(settled.mean()) if len(settled) else 0.0,
        peak_acceleration_m_s2=float(settled.max()) if len(settled) else 0.0,
        raw_mean_acceleration_m_s2=float(raw.mean()),
        raw_peak_acceleration_m_s2=float(raw.max()),
        path_length_m=float(np.linalg.norm(np.diff(vector(telemetry, "tip"), axis=0), axis=1).sum()),
        completed=bool(column(telemetry, "is_success")[-1]),
        duration_s=float(time[-1]),
        dissipated_j=float(column(telemetry, "dissipated").sum()),
    )


def low_pass(values: Array, period: float) -> Array:
    """Return values (T, …) behind a first-order low-pass of ``CUTOFF``, exact for inputs held over the period [s]."""
    decay = math.exp(-2.0 * math.pi * CUTOFF * period)
    filtered = np.empty_like(values)
    state = np.zeros_like(values[0])
    for k, value in enumerate(values):
        state = value + (state - value) * decay
        filtered[k] = state
    return filtered


def path_error(arc_length: Array, error: Array, length: float, error_max: float) -> float:
    """Return the path-average error ∫|e|ds/L [m] of one episode.

    Each new increment of arc length counts with the largest error since the previous one, so that neither an excursion
    at a standstill nor a step back is free. The part of the path that was not reached counts with the worst error seen
    or ``error_max``, whichever is larger.

    Parameters
    ----------
    arc_length, error
        Projection on the path [m] and |normal error| [m] at each control instant, shape (T,).
    length, error_max
        Length of the path and workspace bound [m].
    """
    reached = min(max(arc_length[0], 0.0), length)
    begin = reached
    worst_since = 0.0
    integral = 0.0
    for s, e in zip(arc_length[1:], error[1:], strict=True):
        worst_since = max(worst_since, e)
        if min(s, length) > reached:
            integral += worst_since * (min(s, length) - reached)
            reached = min(s, length)
            worst_since = 0.0
    integral += (length - reached) * max(float(error.max()), error_max)
    return float(integral / (length - begin))
