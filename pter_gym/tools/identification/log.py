"""A log of a machine: voltages, angles and forces over time, read from CSV and written to it."""

import csv
import io
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pter_gym._internal.files import FilePath, find_path, write_text_atomic
from pter_gym._internal.tables import read_columns
from pter_gym.errors import ParameterError

Array = NDArray[np.float64]

TIME = "t_s"
VOLTS = ("V1", "V2", "V3", "V4")
ANGLES = ("theta_A", "theta_B")
FORCES = ("F_x", "F_y")

RANGES = {
    TIME: (-1e9, 1e9),
    **dict.fromkeys(VOLTS, (0.0, 1000.0)),
    **dict.fromkeys(ANGLES, (-1e3, 1e3)),
    **dict.fromkeys(FORCES, (-1e4, 1e4)),
}
"""Columns of a log, each with its smallest and largest entry."""

MAX_JITTER = 0.2
"""How far a row may be from its place in an even raster, over the interval of the rows; it is interpolated there."""

MAX_INTERVAL = 0.01
"""Longest time between two rows [s]: ten rows in the lag of a clutch."""

MIN_DURATION, MAX_DURATION = 5.0, 600.0
"""Duration of a log [s]."""

MAX_SPEED = 50.0
"""Fastest turn of a link between two rows [rad/s]: faster is a sign of degrees, or of an angle that wraps."""


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
    """

    interval: float
    volts: Array
    theta: Array
    force: Array
    name: str = "log"

    @property
    def times(self) -> Array:
        """Times of the rows from the first one on [s]."""
        return self.interval * np.arange(len(self.theta), dtype=np.float64)


def read_log(path: FilePath) -> Log:
    """Read a log.

    Parameters
    ----------
    path
        CSV whose first line names its columns, in any order: ``t_s`` [s], ``V1`` to ``V4`` [V], ``theta_A`` and
        ``theta_B`` [rad], ``F_x`` and ``F_y`` [N].

    Raises
    ------
    ParameterError
        If the file cannot be read, a column is missing, an entry is not a number or out of its range, times do not
        increase or are uneven by more than ``MAX_JITTER`` of the interval, or the log is too short, too long or too
        coarse. The message names column and row.
    """
    file = find_path("log", path)
    columns = read_columns(file, list(RANGES))
    for name, (low, high) in RANGES.items():
        _refuse_rows(file, (columns[name] < low) | (columns[name] > high), 1, f"{name} must be in [{low:g}, {high:g}]")
    times = columns[TIME]
    interval = _interval(file, times)
    for name in ANGLES:
        fast = np.abs(np.diff(columns[name])) > MAX_SPEED * interval
        wanted = f"{name} must turn by at most {MAX_SPEED:g} rad/s: are these radians, without wrapping?"
        _refuse_rows(file, fast, 2, wanted)
    raster = times[0] + interval * np.arange(len(times), dtype=np.float64)
    return Log(
        interval=interval,
        volts=_stacked(columns, VOLTS),
        theta=interpolated(raster, times, _stacked(columns, ANGLES)),
        force=interpolated(raster, times, _stacked(columns, FORCES)),
        name=file.name,
    )


def write_log(log: Log, path: FilePath) -> None:
    """Write a log as CSV; ``read_log`` reads it back."""
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(RANGES)
    rows = np.column_stack([log.times, log.volts, log.theta, log.force])
    table.writerows([f"{value:.9g}" for value in row] for row in rows.tolist())
    write_text_atomic(path, text.getvalue())


def interpolated(when: Array, times: Array, columns: Array) -> Array:
    """Return columns of values at ``times``, shape (T, k), between these times, shape (N, k)."""
    parts: list[Array] = [np.interp(when, times, values) for values in columns.T]
    return np.column_stack(parts)


def _stacked(columns: dict[str, Array], names: tuple[str, ...]) -> Array:
    return np.column_stack([columns[name] for name in names])


def _refuse_rows(file: Path, wrong: NDArray[np.bool_], first: int, wanted: str) -> None:
    """Raise a ParameterError that names the first wrong row, counted from ``first``."""
    if wrong.any():
        raise ParameterError(f"{file}, row {int(wrong.argmax()) + first}: {wanted}")


def _interval(file: Path, times: Array) -> float:
    """Return the interval of the rows [s], or raise a ParameterError."""
    if len(times) < 3:
        raise ParameterError(f"{file} must have at least 3 rows, got {len(times)}")
    _refuse_rows(file, np.diff(times) <= 0.0, 2, f"{TIME} must increase from row to row")
    duration = float(times[-1] - times[0])
    if not MIN_DURATION <= duration <= MAX_DURATION:
        wanted = f"{TIME} must span {MIN_DURATION:g} to {MAX_DURATION:g} s"
        raise ParameterError(f"{file}: {wanted}, got {duration:g}: are these seconds?")
    interval = duration / (len(times) - 1)
    if interval > MAX_INTERVAL * (1.0 + 1e-6):
        raise ParameterError(f"{file}: {TIME} must have a row at least each {MAX_INTERVAL:g} s, got {interval:g} s")
    off = np.abs(times - times[0] - interval * np.arange(len(times)))
    wanted = f"{TIME} must be even: within {MAX_JITTER:g} of the interval of {interval:.6g} s"
    _refuse_rows(file, off > MAX_JITTER * interval, 1, f"{wanted}; resample the log, or look for lost rows")
    return interval
