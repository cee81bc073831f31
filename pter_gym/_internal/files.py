"""Paths as users give them, and files that are written whole or not at all."""

import os
import re
import secrets
import stat
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryFile

from pter_gym.errors import ParameterError, StorageError

FilePath = str | os.PathLike[str]
"""What is accepted as a path: a string or a ``pathlib.Path``, absolute, relative, or from ``~`` on."""

LONGEST = 255
"""Most bytes of a name in a path; common file systems allow no more."""

ROOM = 1 << 16
"""Bytes for which there must be room before any work begins."""

TEMPORARY = re.compile(r"\.[0-9a-f]{16}\.tmp")
"""Names of files that are not yet what they will be."""


def find_path(field: str, path: FilePath) -> Path:
    """Return a path that a user gave, with ``~`` expanded, or raise a ParameterError that names the field."""
    found = None
    with suppress(TypeError, ValueError, RuntimeError):  # not a path, a name that files cannot have, no such user
        expanded = Path(path).expanduser()
        if all(len(os.fsencode(part)) <= LONGEST for part in expanded.parts):
            found = expanded
    if found is None or os.fspath(path) == "" or "\0" in str(found):
        raise ParameterError(f"{field} must be a path, as a string or a pathlib.Path, got {path!r:.200}")
    return found


def check_target(field: str, path: Path) -> None:
    """Raise a ParameterError unless a file can be written: its folder exists, takes files, and has some room."""
    try:
        there = stat.S_ISDIR(path.stat().st_mode)
        folder = path.resolve().parent
    except FileNotFoundError:
        there, folder = False, path.resolve().parent
    except OSError as error:
        raise ParameterError(f"{field} must be a file that can be written, got {str(path)!r}: {error}") from None
    if there:
        raise ParameterError(f"{field} must be a file, got the folder {str(path)!r}")
    if not folder.is_dir():
        raise ParameterError(f"{field} must be a file in a folder that exists, got {str(path)!r}")
    check_folder(field, folder)


def check_folder(field: str, folder: Path) -> None:
    """Raise a ParameterError unless a folder can be written to and has some room; this writes a temporary file."""
    try:
        with TemporaryFile(dir=folder) as file:
            file.write(bytes(ROOM))
            file.flush()
    except OSError as error:
        raise ParameterError(
            f"{field} must be in a folder that can be written to, with room for {ROOM // 1024} kB, "
            f"got {str(folder)!r}: {error.strerror}"
        ) from None


def write_bytes_atomic(path: FilePath, data: bytes) -> None:
    """Write a file whole or not at all: no other process ever sees a part of it.

    The data go to a temporary file in the same directory, to the disk, and only then to their name. If anything fails
    or interrupts, an earlier file of that name stays as it was and the temporary file is removed.

    Parameters
    ----------
    path
        File to write or replace; its directory must exist. A symbolic link is followed.
    data
        The whole content.

    Raises
    ------
    StorageError
        If it cannot be written.
    """
    target = find_path("path", path)
    try:
        _replace(target, data)
    except OSError as error:
        raise StorageError(f"{str(target)!r} cannot be written: {error.strerror}") from error


def write_text_atomic(path: FilePath, text: str) -> None:
    """Write text in UTF-8, whole or not at all; see ``write_bytes_atomic``. Line ends stay as they are."""
    write_bytes_atomic(path, text.encode())


def write_files_atomic(folder: FilePath, files: Mapping[str, bytes]) -> None:
    """Write files to a folder in their order, each as ``write_bytes_atomic`` does."""
    for name, data in files.items():
        write_bytes_atomic(find_path("folder", folder) / name, data)


def _replace(path: Path, data: bytes) -> None:
    with suppress(FileNotFoundError):
        path.stat()  # refuses links in a circle, of which resolve says so in some versions of Python only
    target = path.resolve()
    temporary = target.with_name(f".{secrets.token_hex(8)}.tmp")
    try:
        with temporary.open("xb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(target)
    finally:
        with suppress(OSError):  # there is nothing to remove where nothing can be written
            temporary.unlink(missing_ok=True)


def remove_leftovers(folder: Path) -> None:
    """Remove the temporary files of killed processes from a folder, which no other process may write to now."""
    for path in folder.glob(".*.tmp"):
        if TEMPORARY.fullmatch(path.name):
            path.unlink(missing_ok=True)
