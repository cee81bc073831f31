"""Locks between processes, released at the latest when the process that holds them ends."""

from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

from filelock import FileLock, Timeout

from pter_gym.errors import ParameterError, StorageError


@contextmanager
def locked(path: Path, *, busy: str | None = None) -> Generator[None]:
    """Hold the lock of a file, which is not removed afterwards.

    By default this waits for another process that holds it; with a message ``busy`` it raises a ParameterError. It
    raises a StorageError if the file cannot be created.
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
