"""NumPy archives (``.npz``) of plain arrays, read without believing their headers and without pickles.

Headers must be as ``numpy.savez`` writes them, so nothing is evaluated; sizes are compared before memory is taken.
"""

import io
import math
import re
import struct
import zipfile
from collections.abc import Collection
from typing import Any

import numpy as np
from numpy.typing import NDArray

ENDING = ".npy"

HEADER = re.compile(
    rb"\x93NUMPY\x01\x00(?P<size>..)\{'descr': '(?P<type>[<>|][biufU]\d{1,9})', "
    rb"'fortran_order': (?P<columns>False|True), 'shape': \((?P<shape>[\d, ]*)\), \} *\n",
    re.DOTALL,
)
"""Header of an array of numbers, booleans or texts, in version 1.0 of the format."""

FIXED = 10
"""Bytes of it before those that its size counts."""

ENCRYPTED = 1
"""Bit of a part's flags."""

CHUNK = 1 << 20
"""Bytes that are unpacked at once."""

METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)


def read_arrays(data: bytes, most: int, names: Collection[str] | None = None) -> dict[str, NDArray[Any]]:
    """Return the arrays of an archive by name; each can be written to.

    Parameters
    ----------
    data
        The content of the file.
    most
        Largest content of all its parts together [B].
    names
        Those that it must hold, and no others; any by default.

    Raises
    ------
    ValueError, TypeError, EOFError, OverflowError, zlib.error
        If it is no such archive, or holds more or other parts.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            parts = archive.infolist()
            _check(parts, most, names)
            return {part.filename.removesuffix(ENDING): _array(archive, part) for part in parts}
    except (zipfile.BadZipFile, struct.error, RuntimeError) as error:
        raise ValueError(f"it is no whole archive: {error}") from None


def _check(parts: list[zipfile.ZipInfo], most: int, names: Collection[str] | None) -> None:
    """Raise a ValueError unless an archive has the right parts, each once, and not too much in them."""
    found = [part.filename.removesuffix(ENDING) for part in parts]
    if names is not None and set(found) != set(names):
        other = ", ".join(sorted(set(names).symmetric_difference(found)))
        raise ValueError(f"it must hold {', '.join(sorted(names))}; it differs in {other:.200}")
    if len(set(found)) != len(found) or not all(part.filename.endswith(ENDING) for part in parts):
        raise ValueError("it must hold arrays, each name once")
    if any(part.flag_bits & ENCRYPTED or part.compress_type not in METHODS for part in parts):
        raise ValueError("its parts must be stored or deflated")
    if (unpacked := sum(part.file_size for part in parts)) > most:
        raise ValueError(f"its content must have at most {most} B, it has {unpacked}")


def _unpacked(archive: zipfile.ZipFile, part: zipfile.ZipInfo) -> bytearray:
    """Return the content of a part, of which there is one copy at any time."""
    content = bytearray(part.file_size)
    at = 0
    with archive.open(part) as stream:
        while piece := stream.read(CHUNK):
            content[at : at + len(piece)] = piece
            at += len(piece)
    return content[:at] if at < len(content) else content


def _array(archive: zipfile.ZipFile, part: zipfile.ZipInfo) -> NDArray[Any]:
    """Return the array in a part."""
    content, name = _unpacked(archive, part), part.filename
    header = HEADER.match(content)
    if header is None or header.end() != FIXED + int.from_bytes(header["size"], "little"):
        raise ValueError(f"{name} must hold plain numbers or texts, as numpy.savez writes them")
    dtype = np.dtype(header["type"].decode())
    shape = tuple(int(length) for length in header["shape"].decode().replace(",", " ").split())
    if dtype.itemsize == 0 or math.prod(shape) * dtype.itemsize != len(content) - header.end():
        raise ValueError(f"{name} has not as many bytes as its shape {shape!r:.60} needs")
    values = np.frombuffer(memoryview(content)[header.end() :], dtype)
    return values.reshape(shape, order="F" if header["columns"] == b"True" else "C")
