"""Columns of numbers in text files, as programs write them."""

import codecs
import csv
import math
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pter_gym._internal.files import FilePath, expand_path
from pter_gym.errors import ParameterError

MAX_SIZE = 1 << 24
"""Largest file [B]."""

UNITS: Mapping[str, Mapping[str, float]] = {
    "m": {"m": 1.0, "cm": 1e-2, "mm": 1e-3},
    "s": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "μs": 1e-6, "ns": 1e-9},
    "V": {"V": 1.0, "mV": 1e-3},
    "rad": {"rad": 1.0, "mrad": 1e-3, "deg": math.pi / 180.0, "°": math.pi / 180.0},
    "rad/s": {
        "rad/s": 1.0,
        "deg/s": math.pi / 180.0,
        "°/s": math.pi / 180.0,
        **dict.fromkeys(("rpm", "1/min", "U/min"), math.pi / 30.0),
    },
    "N": {"N": 1.0, "mN": 1e-3, "kN": 1e3, "lbf": 4.4482216},
    "N·m": {
        **dict.fromkeys(("N·m", "Nm", "N*m", "N m"), 1.0),
        **dict.fromkeys(("mN·m", "mNm"), 1e-3),
        "lbf·in": 0.1129848,
    },
}
"""Units in which a column may be, by that in which it is returned, and their sizes."""

_MISSING = re.compile(
    r"[+-]?(nan(\(.*\))?|1\.#(qnan|snan|ind)\d*)|#?n/?a|<na>|null|none|[-?]?", re.IGNORECASE
)
"""Entries that are no number, as C, Windows, spreadsheets and databases write them."""

_UNIT_TEXTS = {unit for sizes in UNITS.values() for unit in sizes} | {"", "1", "-"}
_FORMS = ("_{}", " [{}]", " ({})", "[{}]", "({})")
_BRACKETS = re.compile(r"\[(.*)\]$")
_UTF_16 = (b"\xff\xfe", b"\xfe\xff")


def _as_windows(error: UnicodeError) -> tuple[str, int]:
    """Return the characters of Windows-1252 where a text is not UTF-8."""
    assert isinstance(error, UnicodeDecodeError)
    return error.object[error.start : error.end].decode("cp1252", "replace"), error.end


codecs.register_error("windows-1252", _as_windows)


class Table(NamedTuple):
    """Columns of numbers (N,) by name, and the line of the file, from 1, that holds each row."""

    columns: dict[str, NDArray[np.float64]]
    lines: list[int]


def read_table(
    file: FilePath,
    names: Sequence[str],
    *,
    optional: Sequence[str] = (),
    unit: str | Mapping[str, str] = "",
    blanks: bool = False,
    max_size: int = MAX_SIZE,
) -> Table:
    """Return the named columns of a text file and those of the optional ones that it has.

    Columns are separated by tabs, semicolons, commas or blanks, judged by the first line that is
    no comment; a line ``sep=;`` may say which. But after commas, numbers may have decimal commas.
    Names are in the first line, or in the last one of those that begin with ``#``. With a ``unit``
    (of all columns, or by name), names or a line below them may state another one of ``UNITS``
    (``x_mm``, ``X [cm]``; ``names`` may have it or not), seconds may be times of ISO 8601, and a
    file of as many columns, or one more, may have no names. With ``blanks``, an empty entry or NaN
    is NaN. Rows without entries are none. Texts are UTF-8, with single characters of Windows-1252,
    or UTF-16 with its mark.

    Raises
    ------
    ParameterError
        If the file cannot be read or is larger than ``max_size`` [B], a column is missing, occurs
        twice or is in another unit, a line has more entries than there are names, or an entry is
        not a finite number; it names the line.
    """
    path = expand_path("file", file)
    units = unit if isinstance(unit, Mapping) else dict.fromkeys((*names, *optional), unit)
    try:
        comments: list[str] = []
        rows = _rows(path, max_size, comments)
        first = next(rows, None)
        header = _entries(comments[-1], _separator(comments[-1])) if comments else []
        if first is None or not any(map(_is_number, first[1])):
            header, first = (header, None) if first is None else (first[1], next(rows, None))
        elif unit and len(first[1]) <= len(names) + 1 and not _have(names, header, units):
            header = [*names, ""][: len(first[1])]
        if first and _are_units(first[1]):
            texts = [*(text.strip("[]()") for text in first[1]), *[""] * len(header)]
            header = [f"{name} [{text}]" if text else name for name, text in zip(header, texts)]  # noqa: B905
            first = next(rows, None)
        names = [*names, *(name for name in optional if _have([name], header, units))]
        places = [_place(name, header, units.get(name, "")) for name in names]
        values: list[list[float]] = []
        lines: list[int] = []
        while first:
            line, row = first
            if any(row[len(header) :]):
                raise ValueError(f"line {line} has {len(row)} entries, the first has {len(header)}")
            entries = [row[place] if place < len(row) else "" for place, _ in places]
            values.append(
                [
                    _number(entry, name, line, blanks, units.get(name, ""))
                    for entry, name in zip(entries, names, strict=True)
                ]
            )
            lines.append(line)
            first = next(rows, None)
    except (OSError, ValueError, csv.Error) as error:
        raise ParameterError(f"{path} cannot be read as a table: {error}") from None
    columns = np.array(values, np.float64).reshape(-1, len(names)).T
    by_name = {
        name: UNITS[units[name]][text] * values if text else values
        for name, values, (_, text) in zip(names, columns, places, strict=True)
    }
    return Table(by_name, lines)


def _are_units(entries: Sequence[str]) -> bool:
    """Return whether a line below the names states units; 1 alone is a number."""
    known = {text.strip("[]()") for text in entries} <= _UNIT_TEXTS
    return known and not all(map(_is_number, entries))


def _rows(path: Path, max_size: int, comments: list[str]) -> Iterator[tuple[int, list[str]]]:
    """Yield numbers of lines and their entries as they are read; collect comments above them."""
    if not path.is_file():
        raise ValueError(
            "it is no regular file" if os.path.lexists(path) else "there is no such file"
        )
    with path.open("rb") as file:
        if os.fstat(file.fileno()).st_size > max_size:
            raise ValueError(f"it is larger than {max_size} bytes")
        encoding = "utf-16" if file.read(2) in _UTF_16 else "utf-8-sig"
    separator: str | None = ""
    with path.open(encoding=encoding, errors="windows-1252") as text:
        for number, line in enumerate(text, 1):
            bare = line.strip("\0\r\n ")
            if bare.startswith("#") and not bare.upper().startswith("#N/A"):
                comments += [] if separator else [bare.lstrip("# ")]
            elif not separator and bare.startswith("sep=") and len(bare) == 5:
                separator = bare[4]
            elif bare.strip():
                separator = _separator(bare) if separator == "" else separator
                if any(entries := _entries(bare, separator)):
                    yield number, entries


def _separator(line: str) -> str | None:
    """Return what separates the entries of a line: None for blanks."""
    return next((each for each in "\t;," if each in line), None)


def _entries(line: str, separator: str | None) -> list[str]:
    """Return the entries of a line; unless commas separate them, decimal commas become points."""
    if separator is None:
        entries = line.split()
    elif '"' in line:
        entries = next(csv.reader([line], delimiter=separator, skipinitialspace=True))
    else:
        entries = line.split(separator)
    entries = [entry.strip() for entry in entries]
    if separator == "," or "," not in line:
        return entries
    points = [entry.replace(",", ".") for entry in entries]
    return [b if _is_number(b) else a for a, b in zip(entries, points, strict=True)]


def _have(names: Sequence[str], header: Sequence[str], units: Mapping[str, str]) -> bool:
    """Return whether there are columns of all names."""
    return all(
        any(_unit_in(entry, name, units.get(name, "")) is not None for entry in header)
        for name in names
    )


def _place(name: str, header: Sequence[str], unit: str) -> tuple[int, str]:
    """Return the number of the column of a name, and the unit that it states."""
    stated = [_unit_in(entry, name, unit) for entry in header]
    found = [k for k, text in enumerate(stated) if text is not None]
    found = [k for k in found if header[k] == name] or found
    if len(found) != 1:
        columns = ", ".join(header)
        raise ValueError(f"there must be one column {name}; the columns are {columns:.200}")
    text = stated[found[0]] or ""
    if unit and not text and (other := _BRACKETS.search(header[found[0]])):
        units = ", ".join(UNITS[unit])
        raise ValueError(f"{header[found[0]]} must be in {units}, not in {other[1]}")
    return found[0], text


def _unit_in(entry: str, name: str, unit: str) -> str | None:
    """Return the unit that an entry of the header states, "" for none; None for another name."""
    bare, text = _without_unit(entry, unit)
    if entry == name:
        return text
    same = unit and name.lower() in (entry.lower(), bare.lower())
    return text if same else None


def _without_unit(entry: str, unit: str) -> tuple[str, str]:
    """Return a name and the unit that it states, "" for none."""
    endings = ((form.format(text), text) for text in UNITS.get(unit, ()) for form in _FORMS)
    for ending, text in sorted(endings, key=lambda each: -len(each[0])):
        if entry.lower().endswith(ending.lower()) and len(entry) > len(ending):
            return entry[: -len(ending)], text
    return entry, ""


def _number(entry: str, name: str, line: int, blanks: bool, unit: str) -> float:
    if blanks and _MISSING.fullmatch(entry):
        return math.nan
    entry = entry.replace("\N{MINUS SIGN}", "-")
    if unit == "s" and ":" in entry:
        return _seconds_of(entry, line)
    if not _is_number(entry):
        raise ValueError(f"line {line}: {name} must be a finite number, got {entry!r:.60}")
    return float(entry)


def _seconds_of(stamp: str, line: int) -> float:
    """Return a time of ISO 8601 since 1970, or since midnight [s]."""
    try:
        date = datetime.fromisoformat(f"1970-01-01T{stamp}" if stamp.find(":") < 3 else stamp)
    except ValueError:
        usual = f"seconds, or as 2026-11-28T20:59:01.002, got {stamp!r:.60}"
        raise ValueError(f"line {line}: times must be {usual}") from None
    return (date if date.tzinfo else date.replace(tzinfo=UTC)).timestamp()


def _is_number(text: str) -> bool:
    """Return whether a text is a finite number: in ASCII, and without Python's underscores."""
    try:
        text = text.replace("\N{MINUS SIGN}", "-")
        return math.isfinite(float(text if text.isascii() and "_" not in text else ""))
    except ValueError:
        return False
