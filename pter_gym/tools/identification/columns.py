# pyright: standard
"""Recorded columns of a log, of a machine or of one clutch on a bench.

What a column's name says of its unit decides. Only stamps whose name says nothing are judged by
their mean interval. All that was taken from names or assumed is in the remarks.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pter_gym._internal.column_units import size_of
from pter_gym._internal.files import FilePath, expand_path
from pter_gym._internal.tables import Table, read_table
from pter_gym.errors import ParameterError

Array = NDArray[np.float64]
Rows = NDArray[np.int64]
Flags = NDArray[np.bool_]

TIME = "t_s"

RANGES = {
    "V": (0.0, 1e3),
    "rad": (-1e5, 1e5),
    "rad/s": (-1e5, 1e5),
    "N": (-1e4, 1e4),
    "N·m": (-1e5, 1e5),
}
"""Smallest and largest entry by unit."""

OFF = 0.01
"""How far below 0 a voltage may be measured, over the largest: it is 0 then."""

CLOCKS = {"s": "seconds", "ms": "milliseconds", "us": "microseconds", "ns": "nanoseconds"}
"""Units of time stamps whose name says none."""

COUNTER = 2.0**32
"""Where counters of 32 bits begin at 0 again."""

SLOWEST = 0.1001
"""Mean time between rows up to which a unit of the stamps is believed [s]: slow benches have 10 Hz,
and no logger is a thousand times as fast."""

BURST, COARSE = 0.1, 0.3
"""Time between two rows over the mean up to which they were stamped together; share of such rows
from which the clock is coarse."""

COMPLETE = 0.9
"""Share of filled entries from which all columns of a row were read at its time."""

MAX_FILE = 1 << 30
"""Largest file [B]: far above what ten minutes need."""

MIN_ROWS = 3


@dataclass(frozen=True, kw_only=True)
class Recording:
    """The columns of a log.

    Attributes
    ----------
    file
        Where they are from.
    times
        Of the rows, from the first one on [s], shape (rows,).
    columns
        Values by the usual names, in SI units, NaN where a row has none.
    lines
        Lines of the rows in the file.
    drive
        "V", or "A" if the file has currents in place of voltages.
    remarks
        What was taken from names, or assumed, as sentences.
    """

    file: Path
    times: Array
    columns: dict[str, Array]
    lines: Rows
    drive: str
    remarks: tuple[str, ...]

    def known(self, name: str) -> Flags:
        """Return the rows that have a value, shape (rows,)."""
        return np.isfinite(self.columns[name])

    def values(self, name: str) -> Array:
        """Return the values of the rows that have one."""
        return self.columns[name][self.known(name)]

    def clock(self, name: str) -> Array:
        """Return the times of these rows [s], spread where some share a stamp."""
        return spread(self.times[self.known(name)])[0]

    def refuse(self, rows: Flags, wanted: str) -> None:
        """Raise a ParameterError that names the line of the first wrong row."""
        if rows.any():
            raise ParameterError(f"{self.file}, line {self.lines[rows.argmax()]}: {wanted}")


def read_columns(
    path: FilePath,
    units: Mapping[str, str],
    *,
    renamed: Mapping[str, str] | None = None,
    optional: Sequence[str] = (),
    degrees: bool = False,
) -> Recording:
    """Read the columns of a log.

    Parameters
    ----------
    path
        The table.
    units
        Usual names of the columns, and the unit of each where its name says none.
    renamed
        Names of these columns in the file, where they differ.
    optional
        Columns that may be missing: all of them 0, but one at least is there.
    degrees
        Whether angles and speeds are in degrees where their names say no unit.

    Raises
    ------
    ParameterError
        If the file cannot be read, a column is missing, an entry is not a number or out of its
        range, or times decrease. The message names column and line.
    """
    file, renamed = expand_path("log", path), renamed or {}
    if unknown := renamed.keys() - units.keys():
        raise ParameterError(f"columns: {', '.join(sorted(unknown))} must be of {', '.join(units)}")
    in_file = {name: renamed.get(name, name) for name in units}
    if len(set(in_file.values())) < len(in_file):
        raise ParameterError("columns must name another column of the file for each of theirs")
    table = read_table(
        file,
        [in_file[name] for name in units if name in renamed or name not in optional],
        optional=[in_file[name] for name in optional if name not in renamed],
        unit={in_file[name]: unit for name, unit in units.items()},
        blanks=True,
        max_size=MAX_FILE,
    )
    there = {name: in_file[name] for name in units if in_file[name] in table.columns}
    if optional and not there.keys() & set(optional):
        raise ParameterError(
            f"{file} must have a column {', '.join(optional)}; columns may name others"
        )
    if len(table.lines) < MIN_ROWS:
        raise ParameterError(f"{file} must have at least {MIN_ROWS} rows, got {len(table.lines)}")
    stated = {name: table.stated[column] for name, column in there.items()}
    times, unit = _times(table, in_file[TIME])
    columns = {name: table.columns[there[name]] for name in there if name != TIME}
    recording = Recording(
        file=file,
        times=times,
        columns=columns | {name: np.zeros_like(times) for name in units.keys() - there.keys()},
        lines=np.array(table.lines, np.int64),
        drive=_drive(file, [stated[name] for name in stated if units[name] == "V"]),
        remarks=(
            *_taken(there, stated, units),
            *([f"{TIME} is taken as {unit}, by the mean time between rows."] if unit else []),
            *(f"there is no column {n}: it is taken as 0." for n in optional if n not in there),
        ),
    )
    return _checked(recording, units, _in_degrees(file, stated, units) if degrees else ())


def _times(table: Table, column: str) -> tuple[Array, str]:
    """Return times from the first row on [s], and their unit in words if no name says it."""
    stated, stamps = table.stated[column], table.columns[column]
    size = (size_of(stated, "s") if stated else None) or 1.0
    passed = size * unwrapped(stamps / size)
    passed -= passed[0]
    if stated:
        return passed, ""
    unit = unit_by_interval(float(passed[-1]) / (len(passed) - 1))
    return (size_of(unit, "s") or 1.0) * passed, CLOCKS[unit]


def _drive(file: Path, stated: Sequence[str]) -> str:
    """Return the unit in which clutches are driven."""
    amperes = [text.lower().endswith(("a", "amp", "amps", "ampere", "amperes")) for text in stated]
    if any(amperes) and not all(amperes):
        raise ParameterError(f"{file}: all drives must be in V, or all in A, got {stated}")
    return "A" if any(amperes) else "V"


def _taken(
    there: Mapping[str, str], stated: Mapping[str, str], units: Mapping[str, str]
) -> Iterator[str]:
    """Yield a sentence on the columns that are not called as usual, or in another unit."""
    said = list[str]()
    for name, column in there.items():
        unit = stated[name]
        if column != name:
            said.append(f"{name} is {column}" + (f" in {unit}" if unit else ""))
        elif unit not in ("", units[name]):
            said.append(f"{name} is in {unit}")
    if said:
        yield f"{', '.join(said)}."


def _in_degrees(file: Path, stated: Mapping[str, str], units: Mapping[str, str]) -> Sequence[str]:
    """Return the columns that ``degrees`` converts: those whose names say no unit."""
    turning = [name for name in stated if units[name] in ("rad", "rad/s")]
    for name in turning:
        if stated[name] and size_of(stated[name], units[name]) == 1.0:
            raise ParameterError(f"{file}: degrees must not be given where {name} is in rad")
    return [name for name in turning if not stated[name]]


def _checked(
    recording: Recording, units: Mapping[str, str], in_degrees: Sequence[str]
) -> Recording:
    """Return a recording with checked rows and drives from 0 on, angles and speeds in radians."""
    columns, remarks = dict(recording.columns), list(recording.remarks)
    recording.refuse(np.isnan(recording.times), f"{TIME} must be a number")
    recording.refuse(
        np.concatenate([[False], np.diff(recording.times) < 0.0]), f"{TIME} must not decrease"
    )
    for name in in_degrees:
        columns[name] = np.radians(columns[name])
    for name, values in columns.items():
        low, high = RANGES[units[name]]
        if units[name] == "V":
            low = -OFF * float(np.nanmax(values, initial=0.0))
        recording.refuse((values < low) | (values > high), f"{name} must be in [{low:g}, {high:g}]")
        if units[name] == "V" and (values < 0.0).any():
            columns[name] = np.maximum(values, 0.0)  # NaN stays
            remarks.append(
                f"{name} is below 0 {recording.drive} in places: it is taken as 0 there."
            )
    times, sensors = recording.times, [columns[n] for n in columns if units[n] != "V"]
    if np.mean(np.isfinite(sensors)) > COMPLETE:
        times, shared = spread(times)
        if shared:
            remarks.append(f"{shared} rows share stamps with others: their times are counted.")
    return replace(recording, times=times, columns=columns, remarks=tuple(remarks))


def unwrapped(stamps: Array) -> Array:
    """Return the stamps of a counter of 32 bits, such as Arduino's ``micros()``, as they go on."""
    return stamps + COUNTER * np.cumsum(np.diff(stamps, prepend=stamps[:1]) < -0.5 * COUNTER)


def unit_by_interval(mean: float) -> str:
    """Return the unit of stamps by the mean interval between rows."""
    sizes = {unit: size_of(unit, "s") or 1.0 for unit in CLOCKS}
    return next((unit for unit, size in sizes.items() if size * mean <= SLOWEST), "s")


def spread(times: Array) -> tuple[Array, int]:
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
