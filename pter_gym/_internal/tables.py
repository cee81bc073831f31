"""Columns of numbers in CSV files."""

import csv
import io
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pter_gym._internal.files import FilePath, find_path
from pter_gym._internal.reading import read_bytes
from pter_gym.errors import ParameterError

MAX_CSV_SIZE = 1 << 24
"""Largest file [B]."""


class Table(NamedTuple):
    """Columns of numbers (N,) by name, and the line of the file, from 1, that holds each row."""

    columns: dict[str, NDArray[np.float64]]
    lines: list[int]


def read_table(
    file: FilePath,
    names: Sequence[str],
    *,
    optional: Sequence[str] = (),
    unit: str = "",
    blanks: bool = False,
    max_size: int = MAX_CSV_SIZE,
) -> Table:
    """Return the named columns of a CSV file, and the optional ones that it has.

    Columns are separated by commas, or by semicolons, after which numbers may have decimal commas.
    Their names are in the first line, or in the last one of those that begin with ``#``. With a
    ``unit`` they may carry it (``x_m``, ``X [m]``), and a file of as many columns, or one more, may
    have no names. With ``blanks``, an empty entry is NaN.

    Raises
    ------
    ParameterError
        If the file cannot be read or is larger than ``max_size`` [B], a column is missing or occurs
        twice, a line has more entries than there are names, or an entry is not a finite number; it
        names the line.
    """
    file = find_path("file", file)
    try:
        text = read_bytes(file, max_size).decode("utf-8-sig")
        separator = ";" if ";" in text else ","
        reader = csv.reader(
            io.StringIO(text, newline=""), delimiter=separator, skipinitialspace=True
        )
        rows = [(reader.line_num, [entry.strip() for entry in row]) for row in reader if row]
        begin = next(
            (k for k, (_, row) in enumerate(rows) if not row[0].startswith("#")), len(rows)
        )
        header = rows[begin - 1][1] if begin else []
        header[:1] = [name.lstrip("# ") for name in header[:1]]
        first = rows[begin][1] if begin < len(rows) else []
        if not any(map(_is_number, first)):
            header, begin = first, begin + 1
        elif unit and not header and len(first) <= len(names) + 1:
            header = [*names, ""][: len(first)]
        names = [*names, *(name for name in optional if name in header)]
        places = [_place(name, header, unit) for name in names]
        values = [
            _numbers(row, names, places, line, len(header), separator, blanks=blanks)
            for line, row in rows[begin:]
        ]
    except (OSError, ValueError, csv.Error) as error:
        raise ParameterError(f"{file} cannot be read as CSV: {error}") from None
    columns = np.array(values, np.float64).reshape(-1, len(names)).T
    return Table(dict(zip(names, columns, strict=True)), [line for line, _ in rows[begin:]])


def _place(name: str, header: Sequence[str], unit: str) -> int:
    """Return the number of the column of a name."""
    forms = {
        f"{name}{before}{unit}{after}"
        for before, after in (("_", ""), (" [", "]"), (" (", ")"), ("[", "]"))
    }
    found = [
        k
        for k, each in enumerate(header)
        if each == name or (unit and each.lower() in {name, *forms})
    ]
    if len(found) != 1:
        raise ValueError(
            f"there must be one column {name}; the columns are {', '.join(header):.200}"
        )
    return found[0]


def _numbers(
    row: Sequence[str],
    names: Sequence[str],
    places: Sequence[int],
    line: int,
    most: int,
    separator: str,
    *,
    blanks: bool,
) -> list[float]:
    if len(row) > most:
        raise ValueError(f"line {line} has {len(row)} entries, the first has {most}")
    found: list[float] = []
    for name, place in zip(names, places, strict=True):
        text = row[place] if place < len(row) else ""
        if blanks and not text:
            found.append(math.nan)
            continue
        plain = text.replace(",", ".") if separator == ";" else text
        if not _is_number(plain):
            raise ValueError(f"line {line}: {name} must be a finite number, got {text!r:.60}")
        found.append(float(plain))
    return found


def _is_number(text: str) -> bool:
    """Return whether a text is a finite number: in ASCII, and without Python's underscores."""
    try:
        return math.isfinite(float(text if text.isascii() and "_" not in text else ""))
    except ValueError:
        return False
