"""Paths as users give them, and files that are written whole or not at all."""

import os
import re
import secrets
import shutil
import stat
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryFile, mkdtemp
from typing import cast

from pter_gym.errors import ParameterError, StorageError

FilePath = str | os.PathLike[str]
"""What is accepted as a path: a string or a ``pathlib.Path``, absolute, relative, or from ``~`` on."""

LONGEST = 255
"""Most bytes of a name in a path; the usual file systems hold no longer ones."""

ROOM = 1 << 16
"""Bytes for which there must be room before any work begins."""

TEMPORARY = re.compile(r"\.[0-9a-f]{16}\.tmp")
"""Names of files that are not yet what they will be."""

REFUGES = (None, "/dev/shm")
"""Where new folders are made for content that could not be written: that for temporary files, then memory."""


def find_path(field: str, path: FilePath) -> Path:
    """Return a path that a user gave, in which ``~`` is their home, or raise a ParameterError that names the field."""
    given = cast("object", path)
    if isinstance(given, (str, os.PathLike)) and os.fspath(given) != "":
        try:
            found = Path(cast("FilePath", given)).expanduser()
            longest = max((len(os.fsencode(part)) for part in found.parts), default=0)
        except (TypeError, RuntimeError):  # bytes, and the home of a user that there is none of
            pass
        except UnicodeEncodeError:
            raise ParameterError(f"{field} must be a path that files can have, got {given!r:.200}") from None
        else:
            if longest > LONGEST:
                raise ParameterError(f"{field} must be a path of names of at most {LONGEST} B, got {given!r:.200}")
            if "\0" not in str(found):
                return found
    raise ParameterError(f"{field} must be a path, as a string or a pathlib.Path, got {given!r:.200}")


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
    """Raise a ParameterError unless a folder takes files and has some room; it is tried with a file without a name."""
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
    """Write a file whole or not at all: nobody ever sees a part of it.

    The data go to a temporary file in the same directory, to the disk, and only then to their name. When anything fails
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
        If it cannot be written. The content is kept in a folder for temporary files, if there is room.
    """
    target = find_path("path", path)
    write_files_atomic(target.parent, {target.name: data})


def write_text_atomic(path: FilePath, text: str) -> None:
    """Write text in UTF-8, whole or not at all; see ``write_bytes_atomic``. Line ends stay as they are."""
    write_bytes_atomic(path, text.encode())


def write_files_atomic(folder: FilePath, files: Mapping[str, bytes]) -> None:
    """Write files to a folder in their order, each as ``write_bytes_atomic`` does; if one fails, all are kept."""
    for name, data in files.items():
        path = find_path("folder", folder) / name
        try:
            _replace(path, data)
        except OSError as error:
            raise StorageError(f"{str(path)!r} cannot be written: {error.strerror}; {_keep(files)}") from error


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
        with suppress(OSError):  # where nothing can be written there is nothing to remove
            temporary.unlink(missing_ok=True)


def remove_leftovers(folder: Path) -> None:
    """Remove from a folder what processes left that were killed as they wrote; nobody else may write there now."""
    for path in folder.glob(".*.tmp"):
        if TEMPORARY.fullmatch(path.name):
            path.unlink(missing_ok=True)


def _keep(files: Mapping[str, bytes]) -> str:
    """Write files to a new folder wherever there is room, and return in words where they are."""
    for place in REFUGES:
        folder = None
        try:
            folder = Path(mkdtemp(prefix="pter-", dir=place))
            for name, data in files.items():
                (folder / name).parent.mkdir(parents=True, exist_ok=True)
                (folder / name).write_bytes(data)
        except OSError:
            if folder is not None:
                shutil.rmtree(folder, ignore_errors=True)
        else:
            return f"what was to be written is in {str(folder)!r}"
    return "there is no room elsewhere either, so it is lost"
