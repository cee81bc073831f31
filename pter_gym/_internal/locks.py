"""Locks between processes, released at the latest when the process that holds them ends."""

from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

from filelock import FileLock, Timeout

from pter_gym.errors import ParameterError, StorageError

LOCK = ".lock"
"""Name of the lock in a folder of results, which stays there."""


def lock_beside(path: Path) -> Path:
    """Return the lock of a file, or of a folder that is replaced whole, which stays beside it."""
    path = path.resolve()
    return path.with_name(f".{path.name}{LOCK}")


@contextmanager
def locked(path: Path, *, busy: str | None = None) -> Generator[None]:
    """Hold the lock of a file; if it is taken, wait, or raise a ParameterError with ``busy``."""
    lock = FileLock(path)
    try:
        lock.acquire(blocking=busy is None)
    except Timeout:
        raise ParameterError(busy) from None
    except OSError as error:
        raise StorageError(f"{str(path)!r} cannot be locked: {error.strerror or error}") from error
    try:
        yield
    finally:
        lock.release()
