"""A log of a machine: voltages, angles and forces over time, read from CSV and written to it.

Loggers' clocks are uneven, so rows are interpolated to an even raster; stretches without rows are
marked.
"""

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray
from scipy import interpolate, ndimage

from pter_gym._internal.files import FilePath, find_path, write_text_atomic
from pter_gym._internal.tables import read_table
from pter_gym.errors import ParameterError

Array = NDArray[np.float64]
Rows = NDArray[np.int64]
Flags = NDArray[np.bool_]

_INTERPOLATE: Any = interpolate
_NDIMAGE: Any = ndimage

TIME = "t_s"
VOLTS = ("V1", "V2", "V3", "V4")
ANGLES = ("theta_A", "theta_B")
FORCES = ("F_x", "F_y")
COLUMNS = (TIME, *VOLTS, *ANGLES, *FORCES)

RANGES = {
    **dict.fromkeys(VOLTS, (0.0, 1000.0)),
    **dict.fromkeys(ANGLES, (-1e5, 1e5)),
    **dict.fromkeys(FORCES, (-1e4, 1e4)),
}
"""Smallest and largest entry by column."""

MAX_FILE = 1 << 30
"""Largest file [B]: far above what ``MAX_DURATION`` needs."""

MAX_INTERVAL = 0.01
"""Longest usual time between two rows [s]: ten rows in the lag of a clutch.

Also the longest that is interpolated.
"""

LATE = 1.5
"""Time between two rows over the usual one from which a row has been lost."""

EVEN = 0.01
"""How far rows may be from an even raster, over the interval, to be used as they are."""

SETTLING = 0.5
"""After a gap in which a voltage changed: until its clutch has settled [s]."""

MIN_DURATION, MAX_DURATION = 5.0, 600.0
"""Duration of a log [s]."""

MAX_SPEED = 50.0
"""Fastest turn of a link between two rows [rad/s]: faster is a sign of degrees, or of an angle that wraps."""

MIN_TURN = 1e-3
"""Shortest time over which that is judged [s]: rows may be logged in bursts."""

ROUNDING = 1e-9
"""Differences of angles that are none [rad]."""

NAMED = 5
"""Gaps that are named one by one."""


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
        Of the file.
    unmeasured
        Indices of rows that lie in gaps.
    angle_step
        Resolution of the angles before they were interpolated [rad]; 0 if they were not.
    drift
        Longest less shortest period of the logger's clock, as means over a second, over the usual
        one.
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
    drift: float = 0.0
    remarks: tuple[str, ...] = ()

    @property
    def times(self) -> Array:
        """Times of the rows from the first one on [s]."""
        return self.interval * np.arange(len(self.theta), dtype=np.float64)

    @property
    def duration(self) -> float:
        """Time from the first row to the last [s]."""
        return self.interval * (len(self.theta) - 1)

    def is_clear(self, margin: int) -> Flags:
        """Return which rows are more than ``margin`` rows away from any gap, shape (rows,)."""
        gaps = np.zeros(len(self.theta), np.bool_)
        gaps[self.unmeasured] = True
        return ~_NDIMAGE.binary_dilation(gaps, iterations=margin) if margin else ~gaps


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
        CSV whose first line names its columns, in any order: ``t_s`` [s], from any beginning;
        ``V1`` to ``V4`` [V], of which those that are missing are 0; ``theta_A`` and ``theta_B``
        [rad]; ``F_x`` and ``F_y`` [N]. Empty entries are interpolated; an empty voltage is the last
        one.
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
    file = find_path("log", path)
    found, lines, missing = _read_columns(file, dict(columns or {}))
    remarks = [
        f"{file.name} has no column {name}: its voltage is taken as 0 V." for name in missing
    ]
    repeated = np.diff(found[TIME], prepend=-np.inf) == 0.0
    if repeated.any():
        remarks.append(
            f"{file.name}: {repeated.sum()} rows repeat the {TIME} of the row before and are left out."
        )
        found, lines = {name: values[~repeated] for name, values in found.items()}, lines[~repeated]
    times = found[TIME] - found[TIME][0]
    volts, theta, force = (
        np.column_stack([found[name] for name in names]) for names in (VOLTS, ANGLES, FORCES)
    )
    theta = np.radians(theta) if degrees else theta
    theta = theta + np.outer(theta[:, 0], [0.0, 1.0]) if relative_b else theta
    _check_density(file, times, {ANGLES: theta, FORCES: force})
    for name, angles in zip(ANGLES, theta.T, strict=True):
        known = np.flatnonzero(np.isfinite(angles))
        speed = np.abs(np.diff(angles[known])) / np.maximum(np.diff(times[known]), MIN_TURN)
        wanted = (
            f"{name} must turn by at most {MAX_SPEED:g} rad/s: are these radians, without wrapping?"
        )
        _refuse_rows(file, lines[known[1:]], speed > MAX_SPEED, wanted)
    return _on_raster(times, volts, theta, force, file.name, remarks)


def _read_columns(file: Path, renamed: dict[str, str]) -> tuple[dict[str, Array], Rows, list[str]]:
    """Return columns by their usual names, the lines of their rows, and the names of missing voltages."""
    if unknown := renamed.keys() - set(COLUMNS):
        raise ParameterError(
            f"columns: {', '.join(sorted(unknown))} must be of {', '.join(COLUMNS)}"
        )
    needed = [renamed.get(name, name) for name in COLUMNS if name in renamed or name not in VOLTS]
    table = read_table(file, needed, optional=VOLTS, blanks=True, max_size=MAX_FILE)
    lines, in_file = (
        np.array(table.lines, np.int64),
        {name: renamed.get(name, name) for name in COLUMNS},
    )
    missing = [name for name in VOLTS if in_file[name] not in table.columns]
    if len(missing) == len(VOLTS):
        raise ParameterError(f"{file} must have a column V1, V2, V3 or V4; columns may name others")
    if len(lines) < 3:
        raise ParameterError(f"{file} must have at least 3 rows, got {len(lines)}")
    found = {name: table.columns.get(in_file[name], np.zeros(len(lines))) for name in COLUMNS}
    for name, (low, high) in RANGES.items():
        wrong = (found[name] < low) | (found[name] > high)
        _refuse_rows(file, lines, wrong, f"{name} must be in [{low:g}, {high:g}]")
    _refuse_rows(file, lines, np.isnan(found[TIME]), f"{TIME} must be a number")
    _refuse_rows(file, lines[1:], np.diff(found[TIME]) < 0.0, f"{TIME} must not decrease")
    for name in VOLTS:
        last = np.maximum.accumulate(np.where(np.isnan(found[name]), 0, np.arange(len(lines))))
        found[name] = np.nan_to_num(found[name][last])
    return found, lines, missing


def _refuse_rows(file: Path, lines: Rows, wrong: Flags, wanted: str) -> None:
    """Raise a ParameterError that names the line of the first wrong row."""
    if wrong.any():
        raise ParameterError(f"{file}, line {lines[wrong.argmax()]}: {wanted}")


def _check_density(file: Path, times: Array, sensors: Mapping[tuple[str, str], Array]) -> None:
    """Raise a ParameterError unless rows [s] span a log, and each sensor is given often enough."""
    if not MIN_DURATION <= times[-1] <= MAX_DURATION:
        wanted = f"{TIME} must span {MIN_DURATION:g} to {MAX_DURATION:g} s"
        raise ParameterError(f"{file}: {wanted}, got {times[-1]:g}: are these seconds?")
    for names, values in sensors.items():
        known = times[np.isfinite(values).all(axis=1)]
        usual = float(np.median(np.diff(known))) if len(known) > 1 else np.inf
        if usual > MAX_INTERVAL * (1.0 + 1e-3):
            wanted = (
                f"{' and '.join(names)} must be given at least each {MAX_INTERVAL:g} s of {TIME}"
            )
            raise ParameterError(f"{file}: {wanted}, got {usual:g}: are these seconds?")


def write_log(log: Log, path: FilePath) -> None:
    """Write a log as CSV; ``read_log`` reads it back."""
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(COLUMNS)
    rows = np.column_stack([log.times, log.volts, log.theta, log.force])
    table.writerows([f"{value:.9g}" for value in row] for row in rows.tolist())
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
    joined = _resampled(logs[0], interval)
    for log in logs[1:]:
        joined = _joined(joined, _resampled(log, interval))
    return joined


def _joined(log: Log, other: Log) -> Log:
    """Return two logs of one interval as one."""
    pause, begin = round(SETTLING / log.interval), len(log.theta)
    between = cast(Array, np.linspace(log.theta[-1], other.theta[0], pause))
    return Log(
        interval=log.interval,
        volts=np.concatenate([log.volts, np.tile(other.volts[0], (pause, 1)), other.volts]),
        theta=np.concatenate([log.theta, between, other.theta]),
        force=np.concatenate([log.force, np.zeros((pause, 2)), other.force]),
        name=f"{log.name} and {other.name}",
        unmeasured=np.concatenate(
            [log.unmeasured, begin + np.arange(pause), begin + pause + other.unmeasured]
        ),
        angle_step=max(log.angle_step, other.angle_step),
        drift=max(log.drift, other.drift),
        remarks=(*log.remarks, *other.remarks),
    )


def _resampled(log: Log, interval: float) -> Log:
    """Return a log at a longer interval [s]."""
    if log.interval > (1.0 - 1e-6) * interval:
        return log
    times = interval * np.arange(int(log.duration / interval + 1e-6) + 1, dtype=np.float64)
    gaps = (log.unmeasured * (log.interval / interval)).astype(np.int64)
    return replace(
        log,
        interval=interval,
        volts=_mean_volts(times, log.times, log.volts),
        theta=interpolated(times, log.times, log.theta),
        force=interpolated(times, log.times, log.force),
        unmeasured=np.unique(gaps[:, None] + [0, 1]).clip(max=len(times) - 1),
        angle_step=log.angle_step or angle_step(log.theta),
    )


def interpolated(when: Array, times: Array, columns: Array) -> Array:
    """Return columns of values at ``times``, shape (T, k), between these times, shape (N, k)."""
    parts: list[Array] = [np.interp(when, times, values) for values in columns.T]
    return np.column_stack(parts)


def angle_step(theta: Array) -> float:
    """Return the smallest change of angles between two rows [rad], which is an encoder's resolution; 0 for none."""
    steps = np.abs(np.diff(theta, axis=0))
    return float(steps[steps > ROUNDING].min(initial=1.0)) if (steps > ROUNDING).any() else 0.0


def _mean_volts(when: Array, times: Array, volts: Array) -> Array:
    """Return the mean voltages from each of even times to the next, with the integral of those held from row to row."""
    charge = np.concatenate(
        [np.zeros((1, 4)), np.cumsum(np.diff(times)[:, None] * volts[:-1], axis=0)]
    )
    means = np.diff(interpolated(when, times, charge), axis=0) / (when[1] - when[0])
    return np.round(np.concatenate([means, volts[-1:]]), 6)


def _on_raster(
    times: Array, volts: Array, theta: Array, force: Array, name: str, remarks: list[str]
) -> Log:
    """Return the log of rows at uneven times from 0 on [s], of which some may be NaN."""
    step, even = np.diff(times), float(times[-1]) / (len(times) - 1)
    complete = np.isfinite(theta).all() and np.isfinite(force).all()
    if complete and np.abs(times - even * np.arange(len(times))).max() <= EVEN * even:
        return Log(
            interval=even, volts=volts, theta=theta, force=force, name=name, remarks=tuple(remarks)
        )
    on_time = step <= LATE * np.median(step) * (1.0 + 1e-6)
    interval = float(np.mean(step[on_time]))
    raster = interval * np.arange(int(times[-1] / interval + 1e-6) + 1, dtype=np.float64)
    switched = (step > LATE * interval) & (np.diff(volts, axis=0) != 0.0).any(axis=1)
    gaps = [(times[k], times[k + 1] + SETTLING) for k in np.flatnonzero(switched)]
    parts: list[Array] = []
    for values in (theta, force):
        known = np.isfinite(values).all(axis=1)
        measured = times[known]
        parts.append(
            _INTERPOLATE.PchipInterpolator(measured, values[known])(
                raster.clip(measured[0], measured[-1])
            )
        )
        longest = max(MAX_INTERVAL, LATE * float(np.median(np.diff(measured))))
        ends = np.concatenate(
            [[-interval], measured, [times[-1] + interval]]
        )  # its first and last rows may be empty
        gaps += [
            (ends[k], ends[k + 1]) for k in np.flatnonzero(np.diff(ends) > longest * (1.0 + 1e-6))
        ]
    unmeasured = np.zeros(len(raster), np.bool_)
    for begin, end in gaps:
        unmeasured |= (raster > begin) & (raster < end)
    periods = [np.mean(each) for each in np.array_split(step[on_time], max(1, int(times[-1])))]
    drift = float(np.ptp(periods) / interval)
    remarks.append(
        f"{name}: rows were interpolated to {1e3 * interval:.6g} ms; the clock's period varies by {100 * drift:.2g} %."
    )
    if gaps:
        places = sorted(
            {f"{max(begin, 0.0):.2f}": begin for begin, _ in gaps}.items(), key=lambda each: each[1]
        )
        more = f" and {len(places) - NAMED} more" if len(places) > NAMED else ""
        at = ", ".join(place for place, _ in places[:NAMED])
        remarks.append(
            f"{name}: rows are missing at {at} s{more}; windows with these are left out."
        )
    return Log(
        interval=interval,
        volts=_mean_volts(raster, times, volts),
        theta=parts[0],
        force=parts[1],
        name=name,
        unmeasured=np.flatnonzero(unmeasured),
        angle_step=angle_step(theta),
        drift=drift,
        remarks=tuple(remarks),
    )
