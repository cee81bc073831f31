"""Columns of numbers in CSV files."""

import csv
import io
import math
from array import array
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pter_gym.errors import ParameterError
from pter_gym.internal.files import FilePath, find_path
from pter_gym.internal.reading import read_bytes

MOST_CSV = 1 << 24
"""Largest file [B]."""

MOST_ROWS = 1 << 19
"""Most rows of a file."""


def read_columns(file: FilePath, names: Sequence[str]) -> dict[str, NDArray[np.float64]]:
    """Return the named columns of a CSV file whose first line names its columns; others are left out.

    Raises
    ------
    ParameterError
        If the file cannot be read, is larger than ``MOST_CSV`` or has more than ``MOST_ROWS`` rows, a column is missing
        or there twice, a line has more entries than the first, or an entry is not a finite number; it names the line.
    """
    file = find_path("file", file)
    try:
        values = _values(read_bytes(file, MOST_CSV), names)
    except (OSError, ValueError, csv.Error) as error:
        raise ParameterError(f"{file} cannot be read as CSV: {error}") from None
    return dict(zip(names, np.array(values).reshape(-1, len(names)).T, strict=True))


def _values(data: bytes, names: Sequence[str]) -> "array[float]":
    """Return the numbers in the named columns, row by row."""
    rows = csv.reader(io.TextIOWrapper(io.BytesIO(data), encoding="utf-8-sig", newline=""), skipinitialspace=True)
    header = [name.strip() for name in next(rows, ())]
    if missing := [name for name in names if name not in header]:
        raise ValueError(f"no column {', '.join(missing)}; it has {', '.join(header) or 'none':.200}")
    if twice := [name for name in names if header.count(name) > 1]:
        raise ValueError(f"more than one column {', '.join(twice)}")
    places = [header.index(name) for name in names]
    values = array("d")
    for row in filter(None, rows):
        if len(values) == MOST_ROWS * len(names):
            raise ValueError(f"it must have at most {MOST_ROWS} rows")
        if len(row) > len(header):
            raise ValueError(f"line {rows.line_num} has {len(row)} entries, the first has {len(header)}")
        padded = (*row, *[""] * (len(header) - len(row)))
        values.extend(_number(padded[at], name, rows.line_num) for at, name in zip(places, names, strict=True))
    return values


def _number(text: str, name: str, line: int) -> float:
    """Return the number that a text writes in ASCII and without Python's underscores."""
    try:
        value = float(text if text.isascii() and "_" not in text else "")
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise ValueError(f"line {line}: {name} must be a finite number, got {text!r:.60}")
    return value
