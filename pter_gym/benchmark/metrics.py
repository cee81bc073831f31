"""Scores of episodes, each declared once, as a field of ``Score``, with its unit, meaning, bounds and function."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pter_gym._physics.friction import ClutchMode
from pter_gym.benchmark._measures import column
from pter_gym.benchmark._recorded import PRICE, Array, Recorded, Travel
from pter_gym.params import BASELINE
from pter_gym.tasks.path_following import PathFollowing

Values = NDArray[Any]

Scores = dict[str, Values]
"""The fields of ``Score`` by name, each an array (N,) over episodes; ``completed`` is bool, the others are float64."""


class Metric(NamedTuple):
    """The declaration of a score.

    Attributes
    ----------
    unit, meaning
        In words.
    find
        Computes the scores, (N,), of many episodes.
    from_travel
        Whether ``find`` takes ``Travel``, as for the scores that decide ranks; otherwise it takes ``Recorded``.
    low, high
        Smallest and largest possible value, None where there is no bound.
    """

    unit: str
    meaning: str
    find: Callable[[Any], Values]
    from_travel: bool = False
    low: float | None = 0.0
    high: float | None = None


def _of_travel(unit: str, meaning: str, find: Callable[[Travel], Values], *, high: float | None = None) -> Any:
    return field(metadata={"metric": Metric(unit, meaning, find, True, high=high)})


def _of_record(
    unit: str,
    meaning: str,
    find: Callable[[Recorded], Values],
    *,
    low: float | None = 0.0,
    high: float | None = None,
) -> Any:
    return field(metadata={"metric": Metric(unit, meaning, find, False, low, high)})


@dataclass(frozen=True, kw_only=True)
class Score:
    """Scores of one episode. Accelerations leave out the start-up interval and are low-pass filtered unless called raw.

    Every score is finite, whatever the episode. An episode that ends within the start-up interval counts in full.
    """

    path_error_m: float = _of_travel(
        "m",
        f"mean over ten segments of the larger of ∫|e|dt/t and ∫|e|ds/(L/10), times r^{PRICE:g} if r = t·v/(L/10) > 1, "
        f"else {1.0 + PRICE:g} − {PRICE:g}r; at most the largest |e| or the workspace's bound, whichever is larger",
        Travel.path_error,
    )
    later_path_error_m: float = _of_travel(
        "m", "the same without the first segment; ranks do not use it", Travel.later_path_error
    )
    rms_error_m: float = _of_travel("m", "√(∫e²ds/L); ranks do not use it", Travel.rms_error)
    mean_error_m: float = _of_travel("m", "time average of |e|; ranks do not use it", Travel.mean_error)
    path_average_error_m: float = _of_travel("m", "path average ∫|e|ds/L; ranks do not use it", Travel.path_average)
    mean_pace_error: float = _of_travel("1", "|T·v/L − 1| with the commanded pace v", Travel.mean_pace_error)
    segment_pace_error: float = _of_travel("1", "mean of |t·v/(L/10) − 1| over ten segments", Travel.segment_pace_error)
    mean_pace_m_s: float = _of_travel("m/s", "mean speed along the path", Travel.mean_pace)
    mean_speed_m_s: float = _of_record("m/s", "time average of the tip's speed", lambda e: e.mean(e.speed))
    mean_acceleration_m_s2: float = _of_record("m/s²", "time average", lambda e: e.mean_of(e.acceleration))
    rms_acceleration_m_s2: float = _of_record("m/s²", "root of the mean square", lambda e: e.rms_of(e.acceleration))
    peak_acceleration_m_s2: float = _of_record("m/s²", "largest", lambda e: e.peak_of(e.acceleration))
    raw_mean_acceleration_m_s2: float = _of_record(
        "m/s²", "time average, not filtered", lambda e: e.mean_of(e.raw_acceleration)
    )
    raw_rms_acceleration_m_s2: float = _of_record(
        "m/s²", "root of the mean square, not filtered", lambda e: e.rms_of(e.raw_acceleration)
    )
    raw_peak_acceleration_m_s2: float = _of_record(
        "m/s²", "largest, not filtered", lambda e: e.peak_of(e.raw_acceleration)
    )
    smoothness: float = _of_record(
        "1", "−ln of the dimensionless jerk; larger is smoother", Recorded.smoothness, low=None, high=0.0
    )
    path_length_m: float = _of_record("m", "way of the tip", Recorded.way)
    completed: bool = _of_travel("1", "the end of the path was reached", Travel.completed, high=1.0)
    duration_s: float = _of_travel("s", "length of the episode", lambda e: e.end)
    effort: float = _of_record("1", "mean of (V/V_max)² over time and clutches", Recorded.effort, high=1.0)
    dissipated_j: float = _of_record("J", "energy taken by the clutches", lambda e: e.total("dissipated"))
    hand_work_j: float = _of_record("J", "work of the hand", lambda e: e.total("hand_work"), low=None)
    saturated: float = _of_record(
        "1", "fraction of the time with a clutch at its largest voltage", Recorded.saturated, high=1.0
    )
    stuck: float = _of_record(
        "1",
        "fraction of the time at zero degrees of freedom",
        lambda e: e.mean(column(e.steps, "mode") == ClutchMode.ZERO_DOF),
        high=1.0,
    )


METRICS: MappingProxyType[str, Metric] = MappingProxyType(
    {item.name: item.metadata["metric"] for item in fields(Score)}
)
"""What each score is, by its name."""

SCORES = tuple(METRICS)


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
    """Score many episodes at once, each independently of the others.

    Parameters
    ----------
    telemetry
        Shape (T + 1, N, len(TELEMETRY)): the rows of the reset, then one per control step, NaN after the end of an
        episode.
    tasks
        The tasks that were followed, N of them, with one control period.
    voltage_max
        Largest voltage of the clutches [V].

    Raises
    ------
    ValueError
        If an episode has no step.
    """
    if len(telemetry) < 2:
        raise ValueError(f"an episode needs its reset and at least one step, got {len(telemetry)} rows")
    begun = np.isfinite(column(telemetry[1], "time"))
    if not begun.all():
        raise ValueError(f"an episode needs its reset and at least one step, episode {begun.argmin()} has none")
    episodes = Recorded(telemetry, tasks, voltage_max)
    return {name: metric.find(episodes) for name, metric in METRICS.items()}


def ranked_scores(travel: Travel) -> Scores:
    """Return the scores that decide ranks and their ingredients: path errors, pace, completion."""
    return {name: metric.find(travel) for name, metric in METRICS.items() if metric.from_travel}
