"""Files that others may have written, read within bounds.

Nothing here names a file: what is refused raises a ValueError or an OSError, which ``reading`` turns into a DataError.
"""

import json
import math
import os
import tomllib
import zlib
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from pter_gym.errors import DataError

MOST_JSON, MOST_TOML = 1 << 22, 1 << 18
"""Largest texts that are parsed [B]; their values take up to 60 times as much memory."""

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
"""What reading damaged data can raise."""


MOST_PARTS = 1 << 17
"""Most lists and objects in JSON; brackets in texts count too. A million of them would take seconds."""

MOST_DOTS = 64
"""Most dots in a line of TOML: the time for a key grows with their square."""


@contextmanager
def reading(what: str) -> Generator[None, None, None]:
    """Turn any complaint about some data into a DataError that begins with their name."""
    try:
        yield
    except COMPLAINTS as error:
        reason = f"{error.args[0]!r} is missing" if isinstance(error, KeyError) else error
        raise DataError(f"{what}: {reason}") from None


def read_bytes(path: Path, most: int) -> bytes:
    """Return the content of a file.

    Raises
    ------
    OSError
        If it cannot be read.
    ValueError
        If there is no such file, it is not a regular file, or it is larger than ``most`` [B].
    """
    if not path.is_file():
        raise ValueError("it is not a regular file" if os.path.lexists(path) else "there is no such file")
    with path.open("rb") as file:
        size = min(os.fstat(file.fileno()).st_size, most)
        return bounded(file.read(size + 1), most)  # read allocates as much as it is asked for


def read_text(path: Path, most: int) -> str:
    """Return the content of a file in UTF-8; raises as ``read_bytes``, and a ValueError for another encoding."""
    return read_bytes(path, most).decode("utf-8")


def bounded(data: bytes, most: int) -> bytes:
    """Return data, or raise a ValueError if they are larger [B]."""
    if len(data) > most:
        raise ValueError(f"it is larger than {most} bytes")
    return data


def inflate(data: bytes, most: int) -> bytes:
    """Return the content of a gzip file, or raise a ValueError or zlib.error; at most ``most`` [B] are unpacked."""
    unpacker = zlib.decompressobj(GZIP)
    content = bounded(unpacker.decompress(data, most + 1), most)
    if not unpacker.eof or unpacker.unused_data:
        raise ValueError("it is not one complete gzip file")
    return content


def parse_json(data: bytes, most: int = MOST_JSON) -> Any:
    """Return the values in a JSON text in UTF-8.

    Raises
    ------
    ValueError
        If it is not JSON, is larger than ``most`` [B], is nested too deeply, has more than ``MOST_PARTS`` lists and
        objects, a name twice in one object, a number that no float64 holds, or text that UTF-8 cannot write.
    """
    text = bounded(data, most).decode("utf-8")
    if text.count("[") + text.count("{") > MOST_PARTS:
        raise ValueError(f"it has more than {MOST_PARTS} lists and objects")
    try:
        content = json.loads(text, object_pairs_hook=_unique, parse_float=_finite, parse_constant=_finite)
        if "\\u" in text:
            json.dumps(content, ensure_ascii=False).encode("utf-8")  # halves of characters cannot be written
    except RecursionError:
        raise ValueError("it is nested too deeply") from None
    return content


def parse_toml(text: str) -> dict[str, Any]:
    """Return the values in a TOML text.

    Raises
    ------
    ValueError
        If it is not TOML, is larger than ``MOST_TOML`` [B], is nested too deeply, or has a number that is not finite.
    """
    bounded(text.encode(), MOST_TOML)
    if max(line.count(".") for line in (*text.splitlines(), "")) > MOST_DOTS:
        raise ValueError(f"a line must have at most {MOST_DOTS} dots")
    try:
        return tomllib.loads(text, parse_float=_finite)
    except RecursionError:
        raise ValueError("it is nested too deeply") from None


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) != len(pairs):
        raise ValueError("a name occurs twice in one object")
    return found


def _finite(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(f"numbers must be finite, got {text:.40}")
    return value
