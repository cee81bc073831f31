"""The journal file of a search's trials: Optuna's, with a lock that ends with its process, and whole lines."""

from collections.abc import Generator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

from pter_gym.errors import StorageError
from pter_gym.internal.locks import locked

BEGIN = b'{"op_code":'
"""How each line of a journal begins."""

LONGEST_LINE = 1 << 16
"""More bytes than any line has."""


class JournalLock:
    """Whoever has it may append to a journal, whose last line is whole.

    Optuna's own locks are files that outlive a process that was killed, by half a minute. And half a line, where a disk
    was full, would make the journal unreadable as soon as another line is behind it.

    Parameters
    ----------
    journal
        Its file.
    """

    def __init__(self, journal: Path) -> None:
        self._journal = journal
        self._held = ExitStack()

    def acquire(self) -> bool:
        """Wait for the lock, and cut off half a line that somebody left."""
        self._held.enter_context(locked(self._journal.with_name(f".{self._journal.name}.lock")))
        try:
            cut_half_line(self._journal)
        except BaseException:
            self.release()
            raise
        return True

    def release(self) -> None:
        """Let others have it."""
        self._held.close()


def open_journal(path: Path) -> Any:
    """Return Optuna's storage in a journal file, which is made if need be."""
    from optuna.storages import JournalStorage
    from optuna.storages.journal import JournalFileBackend

    lock: Any = JournalLock(path)
    return JournalStorage(JournalFileBackend(str(path), lock))


def cut_half_line(path: Path) -> None:
    """Let a journal end with its last whole line; nobody else may write to it meanwhile.

    Raises
    ------
    ValueError
        If what is behind the last whole line is not of a journal. The file is as it was.
    """
    with path.open("rb+") as file:
        size = file.seek(0, 2)
        file.seek(max(size - LONGEST_LINE, 0))
        half = file.read().rpartition(b"\n")[2]
        if not half:
            return
        if not (half.startswith(BEGIN) or BEGIN.startswith(half)):
            raise ValueError("its last line is not one of a journal")
        file.truncate(size - len(half))


@contextmanager
def keeping(path: Path) -> Generator[None]:
    """Raise a StorageError in the place of any complaint that a journal cannot be written."""
    try:
        yield
    except OSError as error:
        raise StorageError(
            f"storage {str(path)!r} cannot be written: {error.strerror or error}; "
            "the same search goes on from the trials that it holds"
        ) from error
