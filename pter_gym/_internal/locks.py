"""Locks between processes, released at the latest when the process that holds them ends."""

from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

from filelock import FileLock, Timeout

from pter_gym.errors import ParameterError, StorageError


@contextmanager
def locked(path: Path, *, busy: str | None = None) -> Generator[None]:
    """Hold a lock.

    Parameters
    ----------
    path
        File of the lock, in a folder that exists; it is not removed.
    busy
        Message of the ParameterError raised if another process holds the lock; by default this waits for it.

    Raises
    ------
    StorageError
        If the file cannot be created.
    """
    lock = FileLock(path)
    try:
        lock.acquire(timeout=-1 if busy is None else 0)
    except Timeout:
        raise ParameterError(busy) from None
    except OSError as error:
        raise StorageError(f"{str(path)!r} cannot be locked: {error.strerror or error}") from error
    try:
        yield
    finally:
        lock.release()
