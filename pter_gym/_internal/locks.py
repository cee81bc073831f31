"""Locks between processes, released at the latest when the process that holds them ends."""

import errno
import logging
from collections.abc import Generator
from contextlib import contextmanager
from functools import cache
from pathlib import Path

from filelock import FileLock, Timeout

from pter_gym.errors import ParameterError, StorageError

LOCK = ".lock"
"""Name of the lock in a folder of results, which stays there."""

WITHOUT_LOCKS = (errno.EINVAL, errno.ENOLCK, errno.EOPNOTSUPP)
"""How a file system says that it has no locks; for ENOSYS, FileLock has another kind."""


def lock_beside(path: Path) -> Path:
    """Return the lock of a file, or of a folder that is replaced whole, which stays beside it."""
    path = path.resolve()
    return path.with_name(f".{path.name}{LOCK}")


@cache
def tell_once(folder: Path) -> None:
    """Warn that a folder is on a file system without locks."""
    logging.getLogger("pter_gym").warning(
        "%s is on a file system without locks: let one process at a time write there", folder
    )


@contextmanager
def locked(path: Path, *, busy: str | None = None) -> Generator[None]:
    """Hold the lock of a file; if it is taken, wait, or raise a ParameterError with ``busy``.

    Where the file system has no locks, it goes on without, with a warning of ``pter_gym``.
    """
    lock = FileLock(path)
    try:
        lock.acquire(blocking=busy is None)
    except Timeout:
        raise ParameterError(busy) from None
    except OSError as error:
        if error.errno not in WITHOUT_LOCKS:
            reason = error.strerror or error
            raise StorageError(f"{str(path)!r} cannot be locked: {reason}") from error
        tell_once(path.parent)
    try:
        yield
    finally:
        lock.release()
