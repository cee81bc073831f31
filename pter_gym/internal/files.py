"""Paths as users give them, and files that are written whole or not at all."""

import os
import secrets
from pathlib import Path
from typing import cast

from pter_gym.errors import ParameterError

FilePath = str | os.PathLike[str]
"""What is accepted as a path: a string or a ``pathlib.Path``, absolute, relative, or from ``~`` on."""


def find_path(field: str, path: FilePath) -> Path:
    """Return a path that a user gave, in which ``~`` is their home, or raise a ParameterError that names the field."""
    given = cast("object", path)
    if isinstance(given, (str, os.PathLike)) and os.fspath(given) != "":
        try:
            found = Path(cast("FilePath", given)).expanduser()
        except (TypeError, RuntimeError):  # bytes, and the home of a user that there is none of
            pass
        else:
            if "\0" not in str(found):
                return found
    raise ParameterError(f"{field} must be a path, as a string or a pathlib.Path, got {given!r}")


def write_bytes_atomic(path: FilePath, data: bytes) -> None:
    """Write a file whole or not at all: nobody ever sees a part of it.

    The data go to a temporary file in the same directory, to the disk, and only then to their name. When anything fails
    or interrupts, an earlier file of that name stays as it was and the temporary file is removed.

    Parameters
    ----------
    path
        File to write or replace; its directory must exist. A symbolic link is followed.
    data
        The whole content.
    """
    target = find_path("path", path).resolve()
    temporary = target.with_name(f".{secrets.token_hex(8)}.tmp")
    try:
        with temporary.open("xb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(target)
    finally:
        temporary.unlink(missing_ok=True)


def write_text_atomic(path: FilePath, text: str) -> None:
    """Write text in UTF-8, whole or not at all; see ``write_bytes_atomic``. Line ends stay as they are."""
    write_bytes_atomic(path, text.encode())
