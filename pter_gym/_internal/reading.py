"""Files that others may have written, read within bounds.

Nothing here names a file: what is refused raises a ValueError or an OSError, which ``reading``
turns into a DataError.
"""

import codecs
import gzip
import io
import json
import math
import os
import re
import tomllib
import zlib
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from pter_gym.errors import DataError

MAX_JSON_SIZE, MAX_TOML_SIZE = 1 << 22, 1 << 18
"""Largest texts that are parsed [B]."""

UTF_16 = codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE
"""With what texts in UTF-16 begin."""

MAX_KEY_PARTS = 8
"""Most parts of a key in TOML, as ``a.b`` has two."""

_NO_KEY = re.compile(
    r'"""[\s\S]*?"""|' + r"'''[\s\S]*?'''|" + r'"(?:\\.|[^"\\\n])*"' + r"|'[^'\n]*'|#[^\n]*"
)
"""A string or a comment, in which dots mean nothing."""

_LONG_KEY = re.compile(rf"(?<![\w#-])(?:[\w#-]+[ \t]*\.[ \t]*){{{MAX_KEY_PARTS}}}")
"""More parts than a key may have, with # for each string."""

READ_ERRORS = (
    *(
        ValueError,
        TypeError,
        LookupError,
        AttributeError,
        ArithmeticError,
        OSError,
        EOFError,
        zlib.error,
    ),
    RecursionError,  # from data that are nested too deeply
)
"""What reading damaged data can raise."""


@contextmanager
def reading(source: str) -> Generator[None, None, None]:
    """Turn any error from reading some data into a DataError that begins with their name."""
    try:
        yield
    except READ_ERRORS as error:
        reason = f"{error.args[0]!r} is missing" if isinstance(error, KeyError) else error
        raise DataError(f"{source}: {reason}") from None


def read_bytes(path: Path, most: int) -> bytes:
    """Return the content of a regular file of at most ``most`` [B].

    It raises an OSError or a ValueError.
    """
    if not path.is_file():
        raise ValueError(
            "it is not a regular file" if os.path.lexists(path) else "there is no such file"
        )
    with path.open("rb") as file:
        size = min(os.fstat(file.fileno()).st_size, most)
        return _bounded(file.read(size + 1), most)  # read allocates as much as it is asked for


def read_text(path: Path, most: int) -> str:
    """Return a file's text in UTF-8, or UTF-16 with its mark; raises as ``read_bytes``.

    It raises a ValueError for other encodings.
    """
    data = read_bytes(path, most)
    return data.decode("utf-16" if data.startswith(UTF_16) else "utf-8")


def inflate(data: bytes, most: int) -> bytes:
    """Return the content of a gzip file, at most ``most`` [B]; raises one of ``READ_ERRORS``."""
    with gzip.open(io.BytesIO(data)) as file:
        return _bounded(file.read(most + 1), most)


def parse_json(data: bytes, most: int = MAX_JSON_SIZE) -> Any:
    """Return the values in a JSON text of at most ``most`` [B] in UTF-8, all numbers finite.

    It raises a ValueError where they are not.
    """
    return json.loads(
        _bounded(data, most).decode("utf-8"), parse_float=_finite, parse_constant=_finite
    )


def read_toml(path: Path, content: str) -> dict[str, Any]:
    """Return the values in a TOML file, or raise a DataError that names its ``content``."""
    with reading(f"{content} {path}"):
        return parse_toml(read_text(path, MAX_TOML_SIZE))


def parse_toml(text: str) -> dict[str, Any]:
    """Return the values in a TOML text of at most ``MAX_TOML_SIZE`` [B], all numbers finite.

    It raises a ValueError where they are not, or where a key has more parts than ``MAX_KEY_PARTS``:
    the time that tomllib takes grows with their square.
    """
    _bounded(text.encode(), MAX_TOML_SIZE)
    text = text.removeprefix("\ufeff")  # which some editors write
    if _LONG_KEY.search(_NO_KEY.sub(lambda match: "" if match[0][0] == "#" else "#", text)):
        raise ValueError(f"keys must have at most {MAX_KEY_PARTS} parts")
    return tomllib.loads(text, parse_float=_finite)


def _bounded(data: bytes, most: int) -> bytes:
    if len(data) > most:
        raise ValueError(f"it is larger than {most} bytes")
    return data


def _finite(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(f"numbers must be finite, got {text:.40}")
    return value
