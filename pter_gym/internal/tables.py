"""Columns of numbers in CSV files."""

import csv
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pter_gym.errors import ParameterError
from pter_gym.internal.files import FilePath, find_path


def read_columns(file: FilePath, names: Sequence[str]) -> dict[str, NDArray[np.float64]]:
    """Return the named columns of a CSV file whose first line names its columns; others are left out.

    Raises
    ------
    ParameterError
        If the file cannot be read, a column is missing, or an entry is not a finite number; it names the line.
    """
    file = find_path("file", file)
    try:
        with file.open(newline="", encoding="utf-8-sig") as stream:
            rows = csv.DictReader(stream, skipinitialspace=True)
            header = [name.strip() for name in rows.fieldnames or ()]
            rows.fieldnames = header
            missing = [name for name in names if name not in header]
            if missing:
                raise ParameterError(f"{file}: no column {', '.join(missing)}; it has {', '.join(header) or 'none'}")
            values = [[_number(file, rows.line_num, name, row[name]) for name in names] for row in rows]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise ParameterError(f"{file} cannot be read as CSV: {error}") from None
    return dict(zip(names, np.array(values).reshape(-1, len(names)).T, strict=True))


def _number(file: Path, line: int, name: str, text: str | None) -> float:
    try:
        value = float(text or "")
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise ParameterError(f"{file}, line {line}: {name} must be a finite number, got {text!r}")
    return value
