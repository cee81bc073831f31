"""What commands share: folders for results, text on the terminal, progress bars, and Ctrl-C."""

import io
import os
import signal
import socket
import sys
import time
from pathlib import Path
from threading import Thread

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from pter_gym._internal.files import FilePath, check_target, find_path
from pter_gym.errors import ParameterError

WIDTH = 80
"""Characters in a line of a table."""

GRACE = 0.3
"""Seconds in which Python may end by itself after Ctrl-C."""


def make_folder(path: FilePath, field: str = "out") -> None:
    """Make a folder that can be written to, or raise a ParameterError."""
    path = find_path(field, path)
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ParameterError(f"{field} must be a folder that can be written to: {error}") from None
    check_target(field, path / "file")


def accept_all_characters() -> None:
    """Escape characters that the terminal cannot show, unless the user has chosen otherwise."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper) and stream.errors in ("strict", "surrogateescape"):
            stream.reconfigure(errors="backslashreplace")


def terminal(*, errors: bool = False) -> Console:
    """Return a console for the terminal, even for one that cannot show every character."""
    accept_all_characters()
    return Console(stderr=errors, highlight=False)


def say(text: str) -> None:
    """Print text as it is, without rich's markup and line breaks."""
    terminal().out(text, highlight=False)


def shorten(text: str, width: int) -> str:
    """Return text of at most so many characters, ≥ 3; a longer one loses its middle."""
    half = (width - 1) // 2
    return text if len(text) <= width else f"{text[: width - 1 - half]}…{text[-half:]}"


def progress_bar() -> Progress:
    """Return the progress bar that all commands share; without a terminal nothing is shown."""
    console = terminal(errors=True)
    text = TextColumn("{task.description}", markup=False)
    columns = (text, BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    return Progress(
        *columns,
        console=console,
        transient=True,
        redirect_stdout=False,
        disable=not console.is_terminal,
    )


def close_output() -> None:
    """Drop what cannot be printed, so Python ends without a complaint of its own."""
    try:
        sys.stdout.flush()
    except OSError:
        with Path(os.devnull).open("wb") as nowhere:
            os.dup2(nowhere.fileno(), sys.stdout.fileno())


def end_on_interrupt(status: int) -> None:
    """Let Ctrl-C end this process after ``GRACE``, even while compiled code runs.

    Until then Python may end by itself: the main thread gets a KeyboardInterrupt as usual. Call it
    in the main thread.
    """
    heard, signals = socket.socketpair()
    signals.setblocking(False)
    signal.set_wakeup_fd(signals.fileno(), warn_on_full_buffer=False)

    def wait() -> None:
        while heard.recv(1)[0] != signal.SIGINT:
            pass
        time.sleep(GRACE)
        Console(stderr=True).show_cursor()
        signals.close()
        os._exit(status)

    Thread(target=wait, daemon=True).start()
