"""Columns of numbers in text files, as programs write them."""

import codecs
import csv
import math
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from datetime import UTC, datetime
from itertools import chain
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pter_gym._internal.column_units import (
    is_known,
    is_like_a_unit,
    shown_units,
    size_of,
    split_unit,
)
from pter_gym._internal.files import FilePath, expand_path
from pter_gym._internal.reading import UTF_16
from pter_gym.errors import ParameterError

MAX_SIZE = 1 << 24
"""Largest file [B]."""

_MISSING = re.compile(
    r"[+-]?(nan(\(.*\))?|1\.#(qnan|snan|ind)\d*)|#?n/?a|<na>|null|none|[-?]?", re.IGNORECASE
)
"""Entries that are no number, as C, Windows, spreadsheets and databases write them."""

_COMMENT = re.compile(r"(?:#(?!n/a)|//|%)+\s*", re.IGNORECASE)
_MINUTES = re.compile(r"(\d+):([0-5]?\d[.,]\d+)")


def _as_windows(error: UnicodeError) -> tuple[str, int]:
    """Return the characters of Windows-1252 where a text is not UTF-8."""
    assert isinstance(error, UnicodeDecodeError)
    return error.object[error.start : error.end].decode("cp1252", "replace"), error.end


codecs.register_error("windows-1252", _as_windows)


class Table(NamedTuple):
    """Columns of numbers (N,) by name, the line of the file, from 1, of each row, and their units.

    ``stated`` is the unit that the file states of each column, "" for none.
    """

    columns: dict[str, NDArray[np.float64]]
    lines: list[int]
    stated: dict[str, str]


class Header(NamedTuple):
    """Names of columns, and the unit that a line of its own states of each, "" for none."""

    names: list[str]
    units: list[str]


class Place(NamedTuple):
    """Where a wanted column is: its number, what its unit is called, and the unit's size."""

    column: int
    stated: str = ""
    size: float = 1.0


Line = tuple[int, list[str]]


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
    Names are in the first line, or in a comment (``#``, ``//``, ``%``) above it. With a ``unit``
    (of all columns, or by name), names or a line below them may state another one of ``UNITS``
    (``x_mm``, ``X [cm]``, ``x/mm``; ``names`` may have it or not), seconds may be times of ISO 8601
    or minutes as ``02:05.250``, and a file of just these columns may have no names. With
    ``blanks``, an empty entry or NaN is NaN. Rows without entries are none. Texts are UTF-8, with
    single characters of Windows-1252, or UTF-16 with its mark.

    Raises
    ------
    ParameterError
        If the file cannot be read or is larger than ``max_size`` [B], a column is missing, occurs
        twice or is in another unit, a line has more or fewer entries than there are names, or an
        entry is not a finite number; it names the line.
    """
    path = expand_path("file", file)
    kinds: Mapping[str, str] = (
        dict.fromkeys((*names, *optional), unit) if isinstance(unit, str) else unit
    )
    try:
        comments: list[str] = []
        rows = _rows(path, max_size, comments)
        header, rows = _find_header(rows, comments, names, kinds)
        wanted = [*names, *(name for name in optional if _columns_of(name, header, kinds))]
        first = next(rows, None)
        rows = chain([first] if first else [], rows)
        places = {name: _place(name, header, kinds.get(name, ""), first) for name in wanted}
        values: list[list[float]] = []
        lines: list[int] = []
        for line, row in rows:
            _check_length(row, header, line)
            entries = ((row[places[name].column], name) for name in wanted)
            values.append(
                [_number(entry, n, line, blanks, kinds.get(n, "")) for entry, n in entries]
            )
            lines.append(line)
    except (OSError, ValueError, csv.Error) as error:
        raise ParameterError(f"{path} cannot be read as a table: {error}") from None
    columns = np.array(values, np.float64).reshape(-1, len(wanted)).T
    return Table(
        {n: places[n].size * column for n, column in zip(wanted, columns, strict=True)},
        lines,
        {name: place.stated for name, place in places.items()},
    )


def _find_header(
    rows: Iterator[Line], comments: list[str], names: Sequence[str], kinds: Mapping[str, str]
) -> tuple[Header, Iterator[Line]]:
    """Return the header, and the rows behind it."""
    first = next(rows, None)
    if first and any(map(_is_number, first[1])):
        return _header_above(first[1], comments, names, kinds), chain([first], rows)
    if first is None:
        return _header_above([], comments, names, kinds), rows
    below = next(rows, None)
    if below and _are_units(below[1]):
        return _with_units(first[1], below[1]), rows
    return _with_units(first[1]), chain([below] if below else [], rows)


def _header_above(
    row: list[str], comments: list[str], names: Sequence[str], kinds: Mapping[str, str]
) -> Header:
    """Return the header of rows that begin at once: the last comment with all names, if any.

    A file of the named columns alone may have none, unless a comment has as many other names.
    """
    entries = [_entries(comment, _separator(comment)) for comment in comments]
    for k in reversed(range(len(entries))):
        below = entries[k + 1] if k + 1 < len(entries) else []
        units = below if _are_units(below) and all(map(is_like_a_unit, _bare(below))) else ()
        header = _with_units(entries[k], units)
        if all(_columns_of(name, header, kinds) for name in names):
            return header
    filled = len(row) - (row[-1:] == [""])
    others = [each for each in entries if len(each) == filled > 1 and not _are_units(each)]
    if filled == len(names) and any(kinds.values()) and not others:
        return Header([*names], [])
    if others:
        return _with_units(others[-1])
    raise ValueError(f"its first line must name the columns {', '.join(names)}")


def _with_units(names: list[str], units: Sequence[str] = ()) -> Header:
    """Return a header of names, but for empty ones at the end, and a line of units below it."""
    while names and not names[-1]:
        names = names[:-1]
    return Header(names, [*_bare(units), *[""] * len(names)][: len(names)])


def _are_units(entries: Sequence[str]) -> bool:
    """Return whether a line below the names states units, of which at least one is known."""
    texts = _bare(entries)
    return any(map(is_known, texts)) and not any(_is_number(text) and text != "1" for text in texts)


def _bare(units: Sequence[str]) -> list[str]:
    """Return units without brackets."""
    return [text.strip("[]()") for text in units]


def _check_length(row: list[str], header: Header, line: int) -> None:
    """Refuse a row whose entries cannot be told to belong to the names."""
    count = len(header.names)
    if len(row) < count or any(row[count:]):
        raise ValueError(f"line {line} has {len(row)} entries, the names are {count}")


def _rows(path: Path, max_size: int, comments: list[str]) -> Iterator[Line]:
    """Yield numbers of lines and their entries as they are read; collect comments above them."""
    if not path.is_file():
        raise ValueError(
            "it is not a regular file" if os.path.lexists(path) else "there is no such file"
        )
    with path.open("rb") as file:
        if os.fstat(file.fileno()).st_size > max_size:
            raise ValueError(f"it is larger than {max_size} bytes")
        encoding = "utf-16" if file.read(2) in UTF_16 else "utf-8-sig"
    separator: str | None = ""
    with path.open(encoding=encoding, errors="windows-1252") as text:
        for number, line in enumerate(text, 1):
            bare = line.strip("\0\r\n ")
            if comment := _COMMENT.match(bare):
                comments += [] if separator else [bare[comment.end() :]]
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


def _columns_of(name: str, header: Header, kinds: Mapping[str, str]) -> list[int]:
    """Return the numbers of the columns of a name, which may have its unit or not."""
    kind = kinds.get(name, "")
    exact = [k for k, entry in enumerate(header.names) if entry == name]
    if exact or not kind:
        return exact
    bare = split_unit(name, kind)[0].lower()
    return [k for k, entry in enumerate(header.names) if split_unit(entry, kind)[0].lower() == bare]


def _place(name: str, header: Header, kind: str, first: Line | None) -> Place:
    """Return where the column of a name is, and its unit."""
    found = _columns_of(name, header, {name: kind})
    if len(found) != 1:
        columns = ", ".join(header.names)
        raise ValueError(f"there must be one column {name}; the columns are {columns:.200}")
    if kind == "s" and first and ":" in "".join(first[1][found[0] : found[0] + 1]):
        return Place(found[0], "s")  # of times such as 20:59:01
    if not kind or not header.units:
        return Place(found[0])
    entry, below = header.names[found[0]], header.units[found[0]]
    stated = split_unit(entry, kind)[1]
    for text in filter(None, (stated, below)):
        if size_of(text, kind) is None:
            raise ValueError(f"{entry} must be in {shown_units(kind)}, not in {text}")
    if stated and below and size_of(stated, kind) != size_of(below, kind):
        raise ValueError(f"{entry} is in {below} by the line below it: one of them must be right")
    text = stated or below
    return Place(found[0], text, (size_of(text, kind) if text else None) or 1.0)


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
    """Return a time of ISO 8601 since 1970, or since midnight, or of minutes [s]."""
    if minutes := _MINUTES.fullmatch(stamp):  # as spreadsheets show times with milliseconds
        return 60.0 * float(minutes[1]) + float(minutes[2].replace(",", "."))
    try:
        if stamp.count(":") < 2:
            raise ValueError
        date = datetime.fromisoformat(f"1970-01-01T{stamp}" if stamp.find(":") < 3 else stamp)
    except ValueError:
        usual = f"seconds, or as 2026-11-28T20:59:01.002 or 59:01.002, got {stamp!r:.60}"
        raise ValueError(f"line {line}: times must be {usual}") from None
    return (date if date.tzinfo else date.replace(tzinfo=UTC)).timestamp()


def _is_number(text: str) -> bool:
    """Return whether a text is a finite number: in ASCII, and without Python's underscores."""
    try:
        text = text.replace("\N{MINUS SIGN}", "-")
        return math.isfinite(float(text if text.isascii() and "_" not in text else ""))
    except ValueError:
        return False
