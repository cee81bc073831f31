"""Files that others may have written, read within bounds: how large, how deep, how many, and each name once.

Nothing here names a file: what is refused is a ValueError or an OSError, of which ``reading`` makes a DataError.
"""

import json
import math
import os
import tomllib
import zlib
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, cast

from pter_gym.errors import DataError

MOST_JSON, MOST_TOML = 1 << 22, 1 << 18
"""Largest texts that are parsed [B]; their values take up to 60 times as much memory."""

DEEPEST = 16
"""Deepest nesting of JSON."""

MOST_PARTS = 1 << 17
"""Most lists and objects in JSON; brackets in texts count, too. A million of them would take seconds."""

TOO_DEEP = f"it is nested deeper than {DEEPEST}"

MOST_DIGITS = 40
"""Most digits of a whole number in JSON; the state of a random generator has 39."""

MOST_DOTS = 64
"""Most dots in a line of TOML: the time for a key grows with their square."""

GZIP = 31
"""What zlib calls the format of gzip."""

COMPLAINTS = (
    ValueError,
    TypeError,
    LookupError,
    AttributeError,
    ArithmeticError,
    RecursionError,
    OSError,
    EOFError,
    zlib.error,
)
"""What reading data that make no sense can raise."""


@contextmanager
def reading(what: str) -> Generator[None, None, None]:
    """Raise a DataError that begins with the name of some data in the place of any complaint about them."""
    try:
        yield
    except COMPLAINTS as error:
        told = f"{error.args[0]!r} is missing" if isinstance(error, KeyError) else error
        raise DataError(f"{what}: {told}") from None


def read_bytes(path: Path, most: int) -> bytes:
    """Return the content of a file.

    Raises
    ------
    OSError
        If it cannot be read.
    ValueError
        If there is no such file, it is none, or it is larger than ``most`` [B]; no more than that is read.
    """
    if not path.is_file():
        raise ValueError("it is no regular file" if os.path.lexists(path) else "there is no such file")
    with path.open("rb") as file:
        size = min(os.fstat(file.fileno()).st_size, most)
        return bounded(file.read(size + 1), most)  # what is asked for is taken, also where there is less


def read_text(path: Path, most: int) -> str:
    """Return the content of a file in UTF-8; raises as ``read_bytes``, and a ValueError for another encoding."""
    return read_bytes(path, most).decode("utf-8")


def bounded(data: bytes, most: int) -> bytes:
    """Return data, or raise a ValueError if they are larger [B]."""
    if len(data) > most:
        raise ValueError(f"it is larger than {most} bytes")
    return data


def inflate(data: bytes, most: int) -> bytes:
    """Return what a file of gzip holds, or raise a ValueError or zlib.error; no more than ``most`` [B] is unpacked."""
    unpacker = zlib.decompressobj(GZIP)
    content = bounded(unpacker.decompress(data, most + 1), most)
    if not unpacker.eof or unpacker.unused_data:
        raise ValueError("it is no whole file of gzip, or has more behind it")
    return content


def parse_json(data: bytes, most: int = MOST_JSON) -> Any:
    """Return the values in a JSON text in UTF-8.

    Raises
    ------
    ValueError
        If it is none, is larger than ``most`` [B] or nested deeper than ``DEEPEST``, has more than ``MOST_PARTS`` lists
        and objects, a name twice in one object, a number that no float64 holds, or text that UTF-8 cannot write.
    """
    text = bounded(data, most).decode("utf-8")
    if text.count("[") + text.count("{") > MOST_PARTS:
        raise ValueError(f"it has more than {MOST_PARTS} lists and objects")
    try:
        content = json.loads(
            text, object_pairs_hook=_unique, parse_float=_finite, parse_int=_whole, parse_constant=_finite
        )
    except RecursionError:
        raise ValueError(TOO_DEEP) from None
    _check_parts(content, DEEPEST)
    return content


def parse_toml(text: str) -> dict[str, Any]:
    """Return the values in a TOML text.

    Raises
    ------
    ValueError
        If it is none, is larger than ``MOST_TOML`` [B], is nested too deep, or has a number that is not finite.
    """
    bounded(text.encode(), MOST_TOML)
    if max(line.count(".") for line in (*text.splitlines(), "")) > MOST_DOTS:
        raise ValueError(f"a line must have at most {MOST_DOTS} dots")
    try:
        content = tomllib.loads(text)
    except RecursionError:
        raise ValueError(TOO_DEEP) from None
    _check_finite(content, "")
    return content


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) != len(pairs):
        raise ValueError("a name occurs twice in one object")
    return found


def _check_finite(content: Any, name: str) -> None:
    """Raise a ValueError that names a number that is not finite."""
    if isinstance(content, dict):
        for key, value in cast(dict[str, Any], content).items():
            _check_finite(value, f"{name}.{key}" if name else key)
    elif isinstance(content, list):
        for value in cast(list[Any], content):
            _check_finite(value, name)
    elif isinstance(content, float) and not math.isfinite(content):
        raise ValueError(f"{name} must be a finite number, got {content}")


def _finite(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(f"numbers are finite, and not {text:.40}")
    return value


def _whole(text: str) -> int:
    if len(text) > MOST_DIGITS:
        raise ValueError(f"whole numbers have at most {MOST_DIGITS} digits")
    return int(text)


def _check_parts(content: Any, left: int) -> None:
    """Raise a ValueError if content is nested deeper than so many levels, or holds half of a character."""
    if isinstance(content, str):
        content.encode()
    elif isinstance(content, (dict, list)):
        if left == 0:
            raise ValueError(TOO_DEEP)
        held = cast("dict[str, Any] | list[Any]", content)
        for part in (*held, *held.values()) if isinstance(held, dict) else held:
            _check_parts(part, left - 1)
