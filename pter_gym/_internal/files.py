"""Paths as users give them, and files that are written whole or not at all."""

import errno
import os
import secrets
import stat
from collections.abc import Mapping
from contextlib import AbstractContextManager, nullcontext, suppress
from pathlib import Path

from pter_gym.errors import ParameterError, StorageError

FilePath = str | os.PathLike[str]
"""A path: a string or a ``pathlib.Path``, absolute, relative, or beginning with ``~``."""

TABLE_ENDINGS = (".csv", ".txt", ".tsv", ".dat")
"""Endings of the names of tables, which ``tables.read_table`` reads."""

MAX_NAME_BYTES = 255
"""Longest name in a path that common file systems allow [B]."""


def expand_path(field: str, path: FilePath) -> Path:
    """Return a user's path with ``~`` expanded, or raise a ParameterError that names the field."""
    file = None
    # not a path, a name that files cannot have, no such user
    with suppress(TypeError, ValueError, RuntimeError):
        expanded = Path(path).expanduser()
        if all(len(os.fsencode(part)) <= MAX_NAME_BYTES for part in expanded.parts):
            file = expanded
    if file is None or os.fspath(path) == "" or "\0" in str(file):
        raise ParameterError(
            f"{field} must be a path, as a string or a pathlib.Path, got {path!r:.200}"
        )
    return file


def has_ending(name: object, *endings: str) -> bool:
    """Return whether a name, or a path, ends in one of these endings, in capitals or not."""
    return str(name).lower().endswith(endings)


def check_target(field: str, path: Path) -> None:
    """Raise a ParameterError unless a file can be written: its folder exists and takes files."""
    folder = path.resolve().parent
    if path.is_dir() or not folder.is_dir() or not os.access(folder, os.W_OK | os.X_OK):
        raise ParameterError(
            f"{field} must be a file in a folder that can be written to, got {str(path)!r}"
        )


def make_folder(path: FilePath, field: str = "out") -> None:
    """Make a folder that can be written to, or raise a ParameterError."""
    path = expand_path(field, path)
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ParameterError(f"{field} must be a folder that can be written to: {error}") from None
    check_target(field, path / "file")


def write_bytes_atomic(path: FilePath, data: bytes) -> None:
    """Write or replace a file atomically: no other process ever sees part of it.

    The data are written to a temporary file in the same folder, which must exist, flushed to disk
    and then renamed. A symbolic link is followed; a file that is replaced keeps its mode.

    Raises
    ------
    StorageError
        If it cannot be written; an earlier file of that name stays as it was.
    """
    path = expand_path("path", path)
    write_files_atomic(path.parent, {path.name: data})


def write_text_atomic(path: FilePath, text: str) -> None:
    """Write text in UTF-8, whole or not at all; see ``write_bytes_atomic``.

    Line ends stay as they are.
    """
    write_bytes_atomic(path, text.encode())


def write_files_atomic(folder: FilePath, files: Mapping[str, bytes]) -> None:
    """Write files to a folder, each as ``write_bytes_atomic`` does, all or none.

    None gets its name before all are on the disk, and no two processes name some of theirs at once.
    """
    inside = expand_path("folder", folder)
    targets = {inside.joinpath(name).resolve(): data for name, data in files.items()}
    written: dict[Path, Path] = {}
    target = Path()
    try:
        for target, data in targets.items():
            written[target] = target.with_name(f".{secrets.token_hex(8)}.tmp")
            with written[target].open("xb") as file:
                if target.is_file():
                    written[target].chmod(stat.S_IMODE(target.stat().st_mode))
                file.write(data)
                file.flush()
                os.fsync(file.fileno())
            if target.is_dir():
                raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
        with _lock_of(inside) if len(files) > 1 else nullcontext():
            for target, temporary in written.items():
                temporary.replace(target)
    except OSError as error:
        raise StorageError(f"{str(target)!r} cannot be written: {error.strerror}") from error
    finally:
        for temporary in written.values():
            with suppress(OSError):  # there is nothing to remove where nothing can be written
                temporary.unlink(missing_ok=True)


def _lock_of(folder: Path) -> AbstractContextManager[None]:
    from pter_gym._internal.locks import lock_beside, locked  # loads filelock

    return locked(lock_beside(folder))


def remove_leftovers(folder: Path) -> None:
    """Remove temporary files of killed processes; no other process may write to the folder."""
    for path in folder.glob(f".{'[0-9a-f]' * 16}.tmp"):
        path.unlink(missing_ok=True)
