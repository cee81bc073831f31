# pyright: standard
"""A log of a machine: voltages, angles and forces over time, read from CSV and written to it.

Loggers' clocks are uneven, so rows are interpolated to an even raster; stretches without rows are
marked.
"""

import io
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import reduce
from typing import cast

import numpy as np
from numpy.typing import NDArray

from pter_gym._internal.files import FilePath, write_text_atomic
from pter_gym.errors import ParameterError
from pter_gym.tools.identification.columns import TIME, Recording, read_columns

Array = NDArray[np.float64]
Rows = NDArray[np.int64]
Flags = NDArray[np.bool_]

VOLTS = ("V1", "V2", "V3", "V4")
ANGLES = ("theta_A", "theta_B")
FORCES = ("F_x", "F_y")

LOG_COLUMNS = {
    TIME: "s",
    **dict.fromkeys(VOLTS, "V"),
    **dict.fromkeys(ANGLES, "rad"),
    **dict.fromkeys(FORCES, "N"),
}
"""Columns of a log, and the unit of each where its name says none."""

MAX_INTERVAL = 0.01
"""Longest time between two rows, usual or interpolated [s]: ten rows in the lag of a clutch."""

LATE, EVEN = 1.5, 0.01
"""Time between two rows over the usual one from which a row has been lost; how far rows may be from
an even raster, over the interval, to be used as they are."""

SETTLING = 0.5
"""After a gap in which a voltage changed: until its clutch has settled [s]."""

MIN_DURATION, MAX_DURATION = 5.0, 600.0
"""Duration of a log [s]."""

MAX_SPEED, MIN_TURN = 50.0, 1e-3
"""Fastest turn of a link between two rows [rad/s], as faster are degrees or an angle that wraps;
shortest time over which that is judged [s], as rows may be logged in bursts."""

ROUNDING = 1e-9
"""Differences of angles that are none [rad]."""

MAX_LISTED = 5
"""Most gaps that a message lists."""


@dataclass(frozen=True, kw_only=True)
class Log:
    """Rows at even times.

    Attributes
    ----------
    interval
        Time between two rows [s].
    volts
        Voltages [V], each held until the next row, shape (rows, 4).
    theta
        Absolute link angles [rad], shape (rows, 2).
    force
        Force of the hand on the tip in the world frame [N], shape (rows, 2).
    name
        Name of the file.
    unmeasured
        Indices of rows that lie in gaps.
    angle_step
        Resolution of the angles before they were interpolated [rad]; 0 if they were not.
    remarks
        What was assumed or interpolated, as sentences.
    """

    interval: float
    volts: Array
    theta: Array
    force: Array
    name: str = "log"
    unmeasured: Rows = field(default_factory=lambda: np.empty(0, np.int64))
    angle_step: float = 0.0
    remarks: tuple[str, ...] = ()

    @property
    def times(self) -> Array:
        """Times of the rows since the first [s]."""
        return self.interval * np.arange(len(self.theta), dtype=np.float64)

    @property
    def duration(self) -> float:
        """Time from the first row to the last [s]."""
        return self.interval * (len(self.theta) - 1)

    def is_clear(self, margin: int) -> Flags:
        """Return which rows are more than ``margin`` rows away from any gap, shape (rows,)."""
        gaps = np.isin(np.arange(len(self.theta)), self.unmeasured)
        return np.convolve(gaps, np.ones(2 * margin + 1), "same") < 0.5


def read_log(
    path: FilePath,
    *,
    columns: Mapping[str, str] | None = None,
    degrees: bool = False,
    relative_b: bool = False,
) -> Log:
    """Read a log.

    Parameters
    ----------
    path
        A table whose first line names its columns, in any order: ``t_s`` with any origin, in s, ms,
        µs or ns; ``V1`` to ``V4`` [V], 0 if missing; ``theta_A`` and
        ``theta_B`` [rad]; ``F_x`` and ``F_y`` [N]. Names may state other units. Empty entries are
        interpolated, each column by itself; an empty voltage is the last one.
    columns
        Names of these columns in the file, where they differ.
    degrees
        Whether angles are in degrees.
    relative_b
        Whether ``theta_B`` is measured from link A instead of the x axis.

    Raises
    ------
    ParameterError
        If the file cannot be read, a column is missing, an entry is not a number or out of its
        range, times decrease, or the log is too short, too long or too coarse. The message names
        column and line.
    """
    recording = read_columns(path, LOG_COLUMNS, renamed=columns, optional=VOLTS, degrees=degrees)
    _check_span(recording)
    log = _on_raster(recording)
    if relative_b:
        log.theta[:, 1] += log.theta[:, 0]
    remarks = tuple(f"{recording.file.name}: {remark}" for remark in log.remarks)
    return replace(log, name=recording.file.name, remarks=remarks)


def _check_span(recording: Recording) -> None:
    """Refuse a log that is too short, too long or too coarse, or whose angles jump."""
    file, end = recording.file, recording.times[-1]
    if not MIN_DURATION <= end <= MAX_DURATION:
        accepted = f"{TIME} must span {MIN_DURATION:g} to {MAX_DURATION:g} s"
        raise ParameterError(f"{file}: {accepted}, got {end:g}")
    for name in (*ANGLES, *FORCES):
        clock = recording.clock(name)
        usual = float(np.median(np.diff(clock))) if len(clock) > 2 else np.inf
        if usual > MAX_INTERVAL * (1.0 + 1e-3):
            accepted = f"{name} must be given at least each {MAX_INTERVAL:g} s of {TIME}"
            raise ParameterError(f"{file}: {accepted}, got {usual:g}")
    for name in ANGLES:
        turns, clock = np.abs(np.diff(recording.values(name))), recording.clock(name)
        fast = np.zeros(len(recording.times), np.bool_)
        fast[recording.known(name)] = np.concatenate(
            [[False], turns > MAX_SPEED * np.maximum(np.diff(clock), MIN_TURN)]
        )
        recording.refuse(
            fast, f"{name} must turn by at most {MAX_SPEED:g} rad/s: radians, without wrapping"
        )


def write_log(log: Log, path: FilePath) -> None:
    """Write a log as CSV; ``read_log`` reads it back."""
    text, table = io.StringIO(), np.column_stack([log.times, log.volts, log.theta, log.force])
    np.savetxt(text, table, "%.9g", ",", header=",".join(LOG_COLUMNS), comments="")
    write_text_atomic(path, text.getvalue())


def join_logs(logs: Sequence[Log]) -> Log:
    """Return several logs of one machine as one, on the coarsest of their rasters.

    Between two of them lie ``SETTLING`` seconds without measurements, in which clutches settle at
    the voltages with which the next one begins.

    Raises
    ------
    ParameterError
        If there are none, or they are longer than ``MAX_DURATION`` together.
    """
    if not logs:
        raise ParameterError("log: there must be at least one")
    if sum(log.duration for log in logs) > MAX_DURATION:
        raise ParameterError(f"log: all logs together must last at most {MAX_DURATION:g} s")
    interval = max(log.interval for log in logs)
    return reduce(_joined, [_resampled(log, interval) for log in logs])


def _joined(log: Log, other: Log) -> Log:
    """Return two logs of one interval as one."""
    pause, begin = round(SETTLING / log.interval), len(log.theta)
    between = cast(Array, np.linspace(log.theta[-1], other.theta[0], pause))
    gap = begin + np.arange(pause)
    return Log(
        interval=log.interval,
        volts=np.concatenate([log.volts, np.tile(other.volts[0], (pause, 1)), other.volts]),
        theta=np.concatenate([log.theta, between, other.theta]),
        force=np.concatenate([log.force, np.zeros((pause, 2)), other.force]),
        name=f"{log.name} and {other.name}",
        unmeasured=np.concatenate([log.unmeasured, gap, begin + pause + other.unmeasured]),
        angle_step=max(log.angle_step, other.angle_step),
        remarks=(*log.remarks, *other.remarks),
    )


def _resampled(log: Log, interval: float) -> Log:
    """Return a log at a longer interval [s]."""
    if log.interval > (1.0 - 1e-6) * interval:
        return log
    times = interval * np.arange(int(log.duration / interval + 1e-6) + 1, dtype=np.float64)
    gaps = (log.unmeasured * (log.interval / interval)).astype(np.int64)
    both = np.column_stack([log.theta, log.force])
    columns: list[Array] = [np.interp(times, log.times, values) for values in both.T]
    moved = np.column_stack(columns)
    return replace(
        log,
        interval=interval,
        volts=np.column_stack([_mean_volts(times, log.times, volts) for volts in log.volts.T]),
        theta=moved[:, :2],
        force=moved[:, 2:],
        unmeasured=np.unique(gaps[:, None] + [0, 1]).clip(max=len(times) - 1),
        angle_step=log.angle_step or angle_step(*log.theta.T),
    )


def angle_step(*angles: Array) -> float:
    """Return the smallest change between two rows [rad]: an encoder's resolution; 0 for none."""
    steps = np.abs(np.concatenate([np.diff(each) for each in angles]))
    return float(steps[steps > ROUNDING].min(initial=1.0)) if (steps > ROUNDING).any() else 0.0


def _mean_volts(when: Array, times: Array, volts: Array) -> Array:
    """Return the mean voltage from each of even times to the next."""
    charge = np.concatenate([[0.0], np.cumsum(np.diff(times) * volts[:-1])])
    passed = np.interp(when, times, charge)
    passed += np.maximum(when - times[-1], 0.0) * volts[-1]
    means: Array = np.diff(passed) / (when[1] - when[0])
    return np.append(means, volts[-1]).round(6)


def _on_raster(recording: Recording) -> Log:
    """Return the log of columns at uneven times, each known at times of its own."""
    times = recording.times
    even = float(times[-1]) / (len(times) - 1)
    apart = np.abs(times - even * np.arange(len(times))).max()
    if all(map(np.all, map(recording.known, recording.columns))) and apart <= EVEN * even:
        return _as_log(even, recording.columns, recording.remarks)
    step = np.diff(recording.clock(ANGLES[0]))
    step = step[step <= LATE * np.median(step) * (1.0 + 1e-6)]
    interval = float(np.mean(step))
    raster = interval * np.arange(int(times[-1] / interval + 1e-6) + 1, dtype=np.float64)
    columns = {name: _held(recording, name, raster) for name in VOLTS}
    columns |= {name: _interpolated(recording, name, raster) for name in (*ANGLES, *FORCES)}
    gaps = sorted([*_gaps_of_commands(recording), *_gaps_of_sensors(recording, interval)])
    missing = [(raster > begin) & (raster < end) for begin, end in gaps]
    periods = [np.mean(part) for part in np.array_split(step, max(1, int(times[-1])))]
    clock = (
        f"rows were interpolated to {1e3 * interval:.6g} ms; "
        f"the clock's period varies by {100 * np.ptp(periods) / interval:.2g} %."
    )
    log = _as_log(interval, columns, (*recording.remarks, clock, *_remark_on(gaps)))
    return replace(
        log,
        unmeasured=np.flatnonzero(np.any(missing, axis=0)) if missing else log.unmeasured,
        angle_step=angle_step(*(recording.values(name) for name in ANGLES)),
    )


def _as_log(interval: float, columns: Mapping[str, Array], remarks: tuple[str, ...]) -> Log:
    """Return the log of columns at even times."""
    volts, theta, force = (
        np.column_stack([columns[name] for name in names]) for names in (VOLTS, ANGLES, FORCES)
    )
    return Log(interval=interval, volts=volts, theta=theta, force=force, remarks=remarks)


def _held(recording: Recording, name: str, raster: Array) -> Array:
    """Return a voltage [V] at even times; before its first row it is what it is there."""
    values = recording.values(name)
    if not len(values):
        return np.zeros_like(raster)
    when = np.append(0.0, recording.times[recording.known(name)])
    return _mean_volts(raster, when, np.append(values[0], values))


def _interpolated(recording: Recording, name: str, raster: Array) -> Array:
    """Return an angle or a force at even times."""
    from scipy import interpolate

    clock = recording.clock(name)
    curve = interpolate.PchipInterpolator(clock, recording.values(name))
    return curve(raster.clip(clock[0], clock[-1]))


def _gaps_of_commands(recording: Recording) -> Iterator[tuple[float, float]]:
    """Yield begins and ends [s] of stretches in which a voltage is unknown.

    Voltages that have a row where one changes are known at their own times, others in between.
    """
    given = [name for name in VOLTS if recording.known(name).any()]
    when = recording.times[np.any([recording.known(name) for name in given], axis=0)]
    apart = np.diff(when)
    commands = [
        np.interp(when, recording.times[recording.known(name)], recording.values(name))
        for name in given
    ]
    changed = np.any(np.diff(commands, axis=1) != 0.0, axis=0)
    if len(changed) and changed.mean() < 0.5:
        late = changed & (apart > LATE * np.median(apart) * (1.0 + 1e-6))
        yield from ((when[k], when[k + 1] + SETTLING) for k in np.flatnonzero(late))


def _gaps_of_sensors(recording: Recording, interval: float) -> Iterator[tuple[float, float]]:
    """Yield begins and ends [s] of stretches without a row of an angle or a force."""
    for name in (*ANGLES, *FORCES):
        clock = recording.clock(name)
        longest = max(MAX_INTERVAL, LATE * float(np.median(np.diff(clock))))
        ends = np.concatenate([[-interval], clock, [recording.times[-1] + interval]])
        late = np.diff(ends) > longest * (1.0 + 1e-6)
        yield from ((ends[k], ends[k + 1]) for k in np.flatnonzero(late))


def _remark_on(gaps: Sequence[tuple[float, float]]) -> Iterator[str]:
    """Yield a sentence that lists gaps."""
    places = list(dict.fromkeys(f"{max(begin, 0.0):.2f}" for begin, _ in gaps))
    more = f" and {len(places) - MAX_LISTED} more" if len(places) > MAX_LISTED else ""
    if listed := ", ".join(places[:MAX_LISTED]):
        yield f"rows are missing at {listed} s{more}; windows with these are left out."
