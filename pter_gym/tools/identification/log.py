"""A log of a machine: voltages, angles and forces over time, read from CSV and written to it."""

import csv
import io
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pter_gym._internal.files import FilePath, find_path, write_text_atomic
from pter_gym._internal.reading import read_bytes
from pter_gym._internal.tables import MOST_CSV, read_columns
from pter_gym.errors import ParameterError

Array = NDArray[np.float64]

TIME = "t_s"
VOLTS = ("V1", "V2", "V3", "V4")
ANGLES = ("theta_A", "theta_B")
FORCES = ("F_x", "F_y")
FREE = "free"

JITTER = 0.2
"""How far a row may be from its place in an even raster, over the interval of the rows; it is interpolated there."""

LONGEST_INTERVAL = 0.01
"""Longest time between two rows [s]: ten rows in the lag of a clutch."""

SHORTEST = 5.0
"""Shortest log [s]."""

LONGEST = 600.0
"""Longest log [s]."""

RANGES = {
    TIME: (-1e9, 1e9),
    **dict.fromkeys(VOLTS, (0.0, 1000.0)),
    **dict.fromkeys(ANGLES, (-1e3, 1e3)),
    **dict.fromkeys(FORCES, (-1e4, 1e4)),
    FREE: (0.0, 1.0),
}
"""Smallest and largest entry of each column."""

FASTEST = 50.0
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
        Force of the hand on the tip in the world frame [N], shape (rows, 2); None if it was not recorded.
    free
        Whether nobody touches the handle, bool (rows,); None if that was not recorded.
    name
        Of the file.
    """

    interval: float
    volts: Array
    theta: Array
    force: Array | None = None
    free: NDArray[np.bool_] | None = None
    name: str = "log"

    @property
    def times(self) -> Array:
        """Times of the rows from the first one on [s]."""
        return self.interval * np.arange(len(self.theta), dtype=np.float64)

    @property
    def duration(self) -> float:
        """From the first to the last row [s]."""
        return self.interval * (len(self.theta) - 1)


def read_log(path: FilePath) -> Log:
    """Read a log.

    Parameters
    ----------
    path
        CSV whose first line names its columns, in any order: ``t_s`` [s], ``V1`` to ``V4`` [V], ``theta_A`` and
        ``theta_B`` [rad], and if they are there ``F_x`` and ``F_y`` [N], and ``free``: 1 where nobody
        touches the handle, else 0.

    Raises
    ------
    ParameterError
        If the file cannot be read, a column is missing, an entry is not a number or out of its range, times do not
        increase or are uneven by more than ``JITTER`` of the interval, or the log is too short, too long or too coarse.
        The message names column and row.
    """
    file = find_path("log", path)
    names = [TIME, *VOLTS, *ANGLES, *optional_columns(file)]
    columns = read_columns(file, names)
    for name, values in columns.items():
        low, high = RANGES[name]
        wrong = np.flatnonzero((values < low) | (values > high))
        if len(wrong):
            raise ParameterError(
                f"{file}, row {wrong[0] + 1}: {name} must be within [{low:g}, {high:g}], got {values[wrong[0]]:g}"
            )
    times, interval = _raster(file, columns[TIME])
    raster = times[0] + interval * np.arange(len(times), dtype=np.float64)

    def stacked(names: tuple[str, ...]) -> Array:
        return np.column_stack([columns[name] for name in names])

    for name in ANGLES:
        jumps = np.abs(np.diff(columns[name]))
        if jumps.max() > FASTEST * interval:
            raise ParameterError(
                f"{file}, row {jumps.argmax() + 2}: {name} must turn by at most {FASTEST:g} rad/s: "
                "are these radians, without wrapping?"
            )
    return Log(
        interval=interval,
        volts=stacked(VOLTS),
        theta=interpolated(raster, times, stacked(ANGLES)),
        force=interpolated(raster, times, stacked(FORCES)) if FORCES[0] in columns else None,
        free=columns[FREE] > 0.5 if FREE in columns else None,
        name=file.name,
    )


def optional_columns(file: Path) -> list[str]:
    """Return which optional columns a CSV file has, or raise a ParameterError if it has one of the forces alone."""
    try:
        line = read_bytes(file, MOST_CSV).partition(b"\n")[0].decode("utf-8-sig", "replace")
        header = [name.strip() for name in next(csv.reader([line], skipinitialspace=True), ())]
    except (OSError, ValueError, csv.Error) as error:
        raise ParameterError(f"log {file} cannot be read: {error}") from None
    there = [name for name in FORCES if name in header]
    if len(there) == 1:
        raise ParameterError(f"{file}: columns {' and '.join(FORCES)} must be there both or not at all, got {there[0]}")
    return there + [FREE] * (FREE in header)


def interpolated(when: Array, times: Array, columns: Array) -> Array:
    """Return columns of values at ``times``, shape (T, k), between these times, shape (N, k)."""
    parts: list[Array] = [np.interp(when, times, columns[:, k]) for k in range(columns.shape[1])]
    return np.column_stack(parts)


def write_log(log: Log, path: FilePath) -> None:
    """Write a log as CSV, whole or not at all; ``read_log`` reads it back."""
    columns: dict[str, Array] = {TIME: log.times}
    columns |= dict(zip(VOLTS, log.volts.T, strict=True)) | dict(zip(ANGLES, log.theta.T, strict=True))
    if log.force is not None:
        columns |= dict(zip(FORCES, log.force.T, strict=True))
    if log.free is not None:
        columns[FREE] = np.where(log.free, 1.0, 0.0)
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(columns)
    table.writerows([f"{value:.9g}" for value in row] for row in zip(*columns.values(), strict=True))
    write_text_atomic(path, text.getvalue())


def _raster(file: Path, times: Array) -> tuple[Array, float]:
    """Return times and their interval [s], or raise a ParameterError."""
    if len(times) < 3:
        raise ParameterError(f"{file} must have at least 3 rows, got {len(times)}")
    steps = np.diff(times)
    if steps.min() <= 0.0:
        raise ParameterError(f"{file}, row {(steps <= 0.0).argmax() + 2}: {TIME} must increase from row to row")
    interval = float((times[-1] - times[0]) / (len(times) - 1))
    duration = float(times[-1] - times[0])
    if not SHORTEST <= duration <= LONGEST:
        raise ParameterError(
            f"{file}: {TIME} must span {SHORTEST:g} to {LONGEST:g} s, got {duration:g}: are these seconds?"
        )
    if interval > LONGEST_INTERVAL * (1.0 + 1e-6):
        raise ParameterError(f"{file}: {TIME} must have a row at least each {LONGEST_INTERVAL:g} s, got {interval:g} s")
    off = np.abs(times - times[0] - interval * np.arange(len(times)))
    if off.max() > JITTER * interval:
        row = int((off > JITTER * interval).argmax())
        raise ParameterError(
            f"{file}, row {row + 1}: {TIME} must be even: within {JITTER:g} of the interval of {interval:.6g} s, "
            f"got {times[row]:.9g}, off by {off[row] / interval:.2g} intervals; resample the log, or look for lost rows"
        )
    return times, interval
