"""NumPy archives (``.npz``) of plain arrays, read within bounds and without pickles."""

import io
import struct
import tokenize
import zipfile
import zlib
from collections.abc import Collection
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

DAMAGE = (zipfile.BadZipFile, zlib.error, struct.error, tokenize.TokenError, EOFError, KeyError)
"""What NumPy raises for damaged archives, besides a ValueError."""


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
    ValueError
        If it is not such an archive, or holds more or other parts.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            unpacked = sum(part.file_size for part in archive.infolist())
        if unpacked > most:
            raise ValueError(f"the content must have at most {most} B, got {unpacked}")
        with np.load(io.BytesIO(data), allow_pickle=False) as stored:
            if names is not None and set(stored.files) != set(names):
                other = ", ".join(sorted(set(names).symmetric_difference(stored.files)))
                raise ValueError(f"the archive must hold {', '.join(sorted(names))}; it differs in {other:.200}")
            return {name: _array(stored[name], name) for name in stored.files}
    except (*DAMAGE, MemoryError, RuntimeError) as error:
        raise ValueError(f"the archive is damaged: {error}") from None


def _array(found: Any, name: str) -> NDArray[Any]:
    if not isinstance(found, np.ndarray):
        raise ValueError(f"{name} must be an array, as numpy.savez writes it")
    return cast("NDArray[Any]", found)
