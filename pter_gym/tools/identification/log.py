# pyright: standard
"""A log of a machine: voltages, angles and forces over time, read from CSV and written to it.

Loggers' clocks are uneven, so rows are interpolated to an even raster; stretches without rows are
marked.
"""

import io
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import reduce
from pathlib import Path
from typing import cast

import numpy as np
from numpy.typing import NDArray

from pter_gym._internal.files import FilePath, expand_path, write_text_atomic
from pter_gym._internal.tables import read_table
from pter_gym.errors import ParameterError

Array = NDArray[np.float64]
Rows = NDArray[np.int64]
Flags = NDArray[np.bool_]

TIME = "t_s"
VOLTS = ("V1", "V2", "V3", "V4")
ANGLES = ("theta_A", "theta_B")
FORCES = ("F_x", "F_y")
COLUMNS = (TIME, *VOLTS, *ANGLES, *FORCES)

UNITS = {
    TIME: "s",
    **dict.fromkeys(VOLTS, "V"),
    **dict.fromkeys(ANGLES, "rad"),
    **dict.fromkeys(FORCES, "N"),
}
"""Unit of each column, where the file states none."""

RANGES = {"V": (-0.05, 1000.0), "rad": (-1e5, 1e5), "N": (-1e4, 1e4)}
"""Smallest and largest entry by unit; a measured voltage may be a little below 0."""

CLOCKS = {"seconds": 1.0, "milliseconds": 1e-3, "microseconds": 1e-6, "nanoseconds": 1e-9}
"""Units of time stamps that a log may have without saying so [s]."""

COUNTER = 2.0**32
"""Where counters of 32 bits begin at 0 again."""

SLOWEST = 0.03
"""Mean time between rows up to which a unit of the stamps is believed [s]."""

BURST, COARSE = 0.1, 0.3
"""Time between two rows over the mean up to which they were stamped together; share of such rows
from which the clock is coarse."""

MAX_FILE = 1 << 30
"""Largest file [B]: far above what ``MAX_DURATION`` needs."""

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

ROUNDING, COMPLETE = 1e-9, 0.9
"""Differences of angles that are none [rad]; share of filled entries from which all columns of a
row were read at its time."""

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
        Of the file.
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
        """Times of the rows from the first one on [s]."""
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
        A table whose first line names its columns, in any order: ``t_s`` from any beginning, in s,
        ms, µs or ns; ``V1`` to ``V4`` [V], of which those that are missing are 0; ``theta_A`` and
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
    file = expand_path("log", path)
    found, lines, remarks = _read_columns(file, dict(columns or {}))
    times, unit = in_seconds(found.pop(TIME))
    if unit != "seconds":
        remarks.append(f"{TIME} is taken as {unit}, by the mean time between rows.")
    if not MIN_DURATION <= times[-1] <= MAX_DURATION:
        accepted = f"{TIME} must span {MIN_DURATION:g} to {MAX_DURATION:g} s"
        raise ParameterError(f"{file}: {accepted}, got {times[-1]:g}")
    known = {name: np.isfinite(values) for name, values in found.items()}
    if np.mean([known[name] for name in (*ANGLES, *FORCES)]) > COMPLETE:
        times, shared = _spread(times)
        if shared:
            remarks.append(f"{shared} rows share stamps with others: their times are counted.")
    clocks: dict[str, Array] = {}
    for name in (*ANGLES, *FORCES):
        clocks[name], _ = _spread(times[known[name]])
        usual = float(np.median(np.diff(clocks[name]))) if known[name].sum() > 2 else np.inf
        if usual > MAX_INTERVAL * (1.0 + 1e-3):
            accepted = f"{name} must be given at least each {MAX_INTERVAL:g} s of {TIME}"
            raise ParameterError(f"{file}: {accepted}, got {usual:g}")
    for name in ANGLES:
        found[name] *= np.radians(1.0) if degrees else 1.0
        turns = np.abs(np.diff(found[name][known[name]]))
        fast = turns > MAX_SPEED * np.maximum(np.diff(clocks[name]), MIN_TURN)
        accepted = f"{name} must turn by at most {MAX_SPEED:g} rad/s: radians, without wrapping"
        _refuse_rows(file, lines[known[name]][1:], fast, accepted)
    log = _on_raster(times, found, clocks, remarks)
    if relative_b:
        log.theta[:, 1] += log.theta[:, 0]
    named = tuple(f"{file.name}: {remark}" for remark in log.remarks)
    return replace(log, name=file.name, remarks=named)


def _read_columns(file: Path, renamed: dict[str, str]) -> tuple[dict[str, Array], Rows, list[str]]:
    """Return columns by their usual names, the lines of their rows, and remarks."""
    if unknown := renamed.keys() - set(COLUMNS):
        raise ParameterError(
            f"columns: {', '.join(sorted(unknown))} must be of {', '.join(COLUMNS)}"
        )
    in_file = {name: renamed.get(name, name) for name in COLUMNS}
    if len(set(in_file.values())) < len(in_file):
        raise ParameterError("columns must name another column of the file for each of theirs")
    needed = [in_file[name] for name in COLUMNS if name in renamed or name not in VOLTS]
    optional = [in_file[name] for name in VOLTS if name not in renamed]
    units = {in_file[name]: unit for name, unit in UNITS.items()}
    table = read_table(file, needed, optional=optional, unit=units, blanks=True, max_size=MAX_FILE)
    lines = np.array(table.lines, np.int64)
    missing = [name for name in VOLTS if in_file[name] not in table.columns]
    if len(missing) == len(VOLTS):
        raise ParameterError(f"{file} must have a column V1, V2, V3 or V4; columns may name others")
    if len(lines) < 3:
        raise ParameterError(f"{file} must have at least 3 rows, got {len(lines)}")
    values = {name: table.columns.get(in_file[name], np.zeros(len(lines))) for name in COLUMNS}
    values[TIME] = unwrapped(values[TIME])
    for name in COLUMNS[1:]:
        low, high = RANGES[UNITS[name]]
        wrong = (values[name] < low) | (values[name] > high)
        _refuse_rows(file, lines, wrong, f"{name} must be in [{low:g}, {high:g}]")
    _refuse_rows(file, lines, np.isnan(values[TIME]), f"{TIME} must be a number")
    _refuse_rows(file, lines[1:], np.diff(values[TIME]) < 0.0, f"{TIME} must not decrease")
    remarks = [f"there is no column {name}: its voltage is taken as 0 V." for name in missing]
    below = [name for name in VOLTS if (values[name] < 0.0).any()]
    remarks += [f"{name} is below 0 V in places: it is taken as 0 V there." for name in below]
    return values, lines, remarks


def _refuse_rows(file: Path, lines: Rows, wrong: Flags, wanted: str) -> None:
    """Raise a ParameterError that names the line of the first wrong row."""
    if wrong.any():
        raise ParameterError(f"{file}, line {lines[wrong.argmax()]}: {wanted}")


def unwrapped(stamps: Array) -> Array:
    """Return the stamps of a counter of 32 bits, such as Arduino's ``micros()``, as they go on."""
    return stamps + COUNTER * np.cumsum(np.diff(stamps, prepend=stamps[:1]) < -0.5 * COUNTER)


def in_seconds(stamps: Array) -> tuple[Array, str]:
    """Return times from the first stamp on [s], and the unit of stamps, by their mean interval."""
    passed = stamps - stamps[0]
    mean = float(passed[-1]) / (len(passed) - 1)
    for unit, size in CLOCKS.items():
        if size * mean <= SLOWEST:
            return size * passed, unit
    return passed, "seconds"


def _spread(times: Array) -> tuple[Array, int]:
    """Return times of rows of which some were stamped together, spread evenly, and how many were.

    Under a coarse clock, or where rows come in bursts, rows are counted, if they are even.
    """
    step = np.diff(times)
    together = step < BURST * float(np.mean(step)) if len(step) else np.zeros(0, np.bool_)
    count, number = int(together.sum()), np.arange(len(times), dtype=np.float64)
    if not count:
        return times, 0
    even = np.polyval(np.polyfit(number, times, 1), number)
    if count > COARSE * len(times) and np.abs(even - times).max() <= step.max():
        return even - even[0], count
    first = np.flatnonzero(np.concatenate([[True], ~together]))
    end = times[first[-1]] + float(np.mean(step)) * (len(times) - first[-1])
    return np.interp(number, np.append(first, len(times)), np.append(times[first], end)), count


def write_log(log: Log, path: FilePath) -> None:
    """Write a log as CSV; ``read_log`` reads it back."""
    text, table = io.StringIO(), np.column_stack([log.times, log.volts, log.theta, log.force])
    np.savetxt(text, table, "%.9g", ",", header=",".join(COLUMNS), comments="")
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


def _on_raster(
    times: Array, found: Mapping[str, Array], clocks: Mapping[str, Array], remarks: list[str]
) -> Log:
    """Return the log of columns at uneven times from 0 on [s], each known at times of its own."""
    known = {name: np.isfinite(values) for name, values in found.items()}
    volts = {name: np.maximum(found[name][known[name]], 0.0) for name in VOLTS}
    even = float(times[-1]) / (len(times) - 1)
    if (
        all(each.all() for each in known.values())
        and np.abs(times - even * np.arange(len(times))).max() <= EVEN * even
    ):
        applied, theta, force = _stacked({**found, **volts})
        return Log(interval=even, volts=applied, theta=theta, force=force, remarks=tuple(remarks))
    step = np.diff(clocks[ANGLES[0]])
    step = step[step <= LATE * np.median(step) * (1.0 + 1e-6)]
    interval = float(np.mean(step))
    raster = interval * np.arange(int(times[-1] / interval + 1e-6) + 1, dtype=np.float64)
    gaps: list[tuple[float, float]] = []
    columns: dict[str, Array] = {}
    for name, values in volts.items():
        columns[name] = np.zeros_like(raster)
        if len(values):
            when = np.append(0.0, times[known[name]])
            columns[name] = _mean_volts(raster, when, np.append(values[0], values))
    # voltages that have a row where one changes are known at their own times, others in between
    commanded: Flags = np.any([known[name] for name in VOLTS], axis=0)
    when, apart = times[commanded], np.diff(times[commanded])
    commands = np.stack(
        [np.interp(when, times[known[n]], volts[n]) for n in VOLTS if len(volts[n])]
    )
    changed = np.any(np.diff(commands, axis=1) != 0.0, axis=0)
    if len(changed) and changed.mean() < 0.5:
        late = changed & (apart > LATE * np.median(apart) * (1.0 + 1e-6))
        gaps += [(when[k], when[k + 1] + SETTLING) for k in np.flatnonzero(late)]
    from scipy import interpolate

    for name, when in clocks.items():
        curve = interpolate.PchipInterpolator(when, found[name][known[name]])
        columns[name] = curve(raster.clip(when[0], when[-1]))
        longest = max(MAX_INTERVAL, LATE * float(np.median(np.diff(when))))
        ends = np.concatenate([[-interval], when, [times[-1] + interval]])
        late = np.diff(ends) > longest * (1.0 + 1e-6)
        gaps += [(ends[k], ends[k + 1]) for k in np.flatnonzero(late)]
    unmeasured = np.zeros(len(raster), np.bool_)
    for begin, end in gaps:
        unmeasured |= (raster > begin) & (raster < end)
    periods = [np.mean(part) for part in np.array_split(step, max(1, int(times[-1])))]
    remarks.append(
        f"rows were interpolated to {1e3 * interval:.6g} ms; "
        f"the clock's period varies by {100 * np.ptp(periods) / interval:.2g} %."
    )
    if gaps:
        places = list(dict.fromkeys(f"{max(begin, 0.0):.2f}" for begin, _ in sorted(gaps)))
        more = f" and {len(places) - MAX_LISTED} more" if len(places) > MAX_LISTED else ""
        listed = ", ".join(places[:MAX_LISTED])
        remarks.append(f"rows are missing at {listed} s{more}; windows with these are left out.")
    applied, theta, force = _stacked(columns)
    return Log(
        interval=interval,
        volts=applied,
        theta=theta,
        force=force,
        unmeasured=np.flatnonzero(unmeasured),
        angle_step=angle_step(*(found[name][known[name]] for name in ANGLES)),
        remarks=tuple(remarks),
    )


def _stacked(columns: Mapping[str, Array]) -> Iterator[Array]:
    """Yield voltages, angles and forces, shapes (rows, 4), (rows, 2) and (rows, 2)."""
    for names in (VOLTS, ANGLES, FORCES):
        yield np.column_stack([columns[name] for name in names])
