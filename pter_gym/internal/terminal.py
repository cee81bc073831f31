"""What the commands share on the terminal: folders for results, text, the progress bar, and Ctrl-C."""

import atexit
import io
import os
import signal
import socket
import sys
import time
from contextlib import suppress
from pathlib import Path
from threading import Lock, Thread

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from pter_gym.errors import ParameterError
from pter_gym.internal.files import FilePath, check_folder, find_path


def make_folder(path: FilePath) -> None:
    """Make a folder that can be written to, with some room, or raise a ParameterError."""
    path = find_path("out", path)
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ParameterError(f"out must be a folder that can be written to: {error}") from None
    check_folder("out", path)


def accept_all_characters() -> None:
    """Let characters that the terminal cannot show be written by their numbers; a way of the user's own stays."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper) and stream.errors in ("strict", "surrogateescape"):
            stream.reconfigure(errors="backslashreplace")


def terminal(*, errors: bool = False) -> Console:
    """Return what prints to the terminal, whatever characters it knows."""
    accept_all_characters()
    return Console(stderr=errors, highlight=False)


def say(text: str) -> None:
    """Print text as it is: brackets in a name are brackets, and a long line stays one."""
    terminal().out(text, highlight=False)


def progress_bar() -> Progress:
    """Return the progress bar that all commands share; where there is no terminal nothing is shown."""
    console = terminal(errors=True)
    text = TextColumn("{task.description}", markup=False)
    columns = (text, BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    return Progress(*columns, console=console, transient=True, redirect_stdout=False, disable=not console.is_terminal)


def close_output() -> None:
    """Give up what cannot be printed, so that Python ends without a complaint of its own."""
    try:
        sys.stdout.flush()
    except OSError:
        with Path(os.devnull).open("wb") as nowhere:
            os.dup2(nowhere.fileno(), sys.stdout.fileno())


class Interrupts:
    """Ctrl-C ends a process within a second, whatever its threads and compiled code are at.

    Files are written whole or not at all, so nothing is lost. Python ends by itself, with an exception in the main
    thread, where it can: processes are stopped then and temporary files removed. Otherwise it is ended.

    Parameters
    ----------
    status
        Exit status of a process that is ended.
    """

    GRACE = 0.3
    """Seconds in which Python may end by itself."""

    def __init__(self, status: int) -> None:
        self._status = status
        self._telling = Lock()

    def watch(self) -> None:
        """Begin to wait for interrupts; for the main thread of a process that does nothing else."""
        self._heard, self._signals = socket.socketpair()
        self._signals.setblocking(False)
        signal.set_wakeup_fd(self._signals.fileno(), warn_on_full_buffer=False)
        Thread(target=self._wait, name="pter-interrupts", daemon=True).start()

    def tell(self) -> None:
        """Say that there was an interrupt, once."""
        if self._telling.acquire(blocking=False):
            console = terminal(errors=True)
            console.show_cursor()
            console.print("interrupted; results that were written are whole")

    def end(self) -> None:
        """End the process after what is registered for its exit; Python's own way takes a second to unload torch."""
        with suppress(OSError):
            sys.stdout.flush()
        atexit._run_exitfuncs()  # pyright: ignore[reportPrivateUsage]
        os._exit(self._status)

    def _wait(self) -> None:
        while self._heard.recv(1)[0] != signal.SIGINT:
            pass
        time.sleep(self.GRACE)
        self.tell()
        os._exit(self._status)
