"""Columns of numbers in CSV files."""

import csv
import io
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pter_gym._internal.files import FilePath, find_path
from pter_gym._internal.reading import read_bytes
from pter_gym.errors import ParameterError

MOST_CSV = 1 << 24
"""Largest file [B]."""


def read_columns(file: FilePath, names: Sequence[str]) -> dict[str, NDArray[np.float64]]:
    """Return the named columns of a CSV file whose first line names its columns; others are left out.

    Raises
    ------
    ParameterError
        If the file cannot be read or is larger than ``MOST_CSV``, a column is missing or occurs twice, a line has more
        entries than the first, or an entry is not a finite number; it names the line.
    """
    file = find_path("file", file)
    try:
        text = read_bytes(file, MOST_CSV).decode("utf-8-sig")
        rows = csv.reader(io.StringIO(text, newline=""), skipinitialspace=True)
        header = [name.strip() for name in next(rows, ())]
        for name in names:
            if header.count(name) != 1:
                raise ValueError(f"there must be one column {name}; the columns are {', '.join(header):.200}")
        values = [_numbers(row, names, header, rows.line_num) for row in rows if row]
    except (OSError, ValueError, csv.Error) as error:
        raise ParameterError(f"{file} cannot be read as CSV: {error}") from None
    return dict(zip(names, np.array(values, np.float64).reshape(-1, len(names)).T, strict=True))


def _numbers(row: Sequence[str], names: Sequence[str], header: Sequence[str], line: int) -> list[float]:
    """Return the numbers of a row in some columns: in ASCII, and without Python's underscores."""
    if len(row) > len(header):
        raise ValueError(f"line {line} has {len(row)} entries, the first has {len(header)}")
    texts = dict(zip(header, row, strict=False))
    found: list[float] = []
    for name in names:
        text = texts.get(name, "")
        try:
            value = float(text if text.isascii() and "_" not in text else "")
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            raise ValueError(f"line {line}: {name} must be a finite number, got {text!r:.60}")
        found.append(value)
    return found
