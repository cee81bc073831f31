"""What commands share: text on the terminal, progress bars, and Ctrl-C."""

import io
import os
import signal
import socket
import sys
import time
from collections.abc import Generator, Iterable
from contextlib import contextmanager
from itertools import chain, repeat
from pathlib import Path
from threading import Event, Thread
from typing import Any

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    SpinnerColumn,
    Task,
    TextColumn,
    TimeElapsedColumn,
)
from rich.segment import Segment
from rich.text import Text

from pter_gym._internal.files import FilePath
from pter_gym.benchmark.cells import WIDTH, shorten
from pter_gym.errors import printable

INTERVAL = 10.0
"""Seconds between two lines of progress where there is no terminal."""

GRACE = 0.3
"""Seconds in which Python may end by itself after Ctrl-C."""


class Terminal(Console):
    """A console on which only rich moves the cursor: text is shown, whatever is in it."""

    def print(self, *objects: Any, **options: Any) -> None:
        """Print text and tables."""
        shown = (printable(each) if isinstance(each, str) else each for each in objects)
        super().print(*shown, **options)

    def render(self, *arguments: Any, **options: Any) -> Iterable[Segment]:
        """Yield the pieces of what is printed."""
        for text, style, control in super().render(*arguments, **options):
            yield Segment(text if control else printable(text), style, control)


def accept_all_characters() -> None:
    """Escape characters that the terminal cannot show, unless the user has chosen otherwise."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper) and stream.errors in ("strict", "surrogateescape"):
            stream.reconfigure(errors="backslashreplace")


def terminal(*, errors: bool = False) -> Console:
    """Return a console for the terminal, even for one that cannot show every character."""
    accept_all_characters()
    return Terminal(stderr=errors, highlight=False)


def say(text: str) -> None:
    """Print text as it is, without rich's markup and line breaks."""
    terminal().out(text)


class ShortColumn(TextColumn):
    """A column of text that loses its middle where bar and numbers would have no room."""

    def render(self, task: Task) -> Text:
        """Return the text of a task."""
        return Text(shorten(super().render(task).plain, WIDTH // 2))


class Lines(Progress):
    """A progress bar where no cursor can move: a line for each task every ``INTERVAL``."""

    def start(self) -> None:
        """Begin to print."""
        self._ended = Event()
        Thread(target=self._tell, daemon=True).start()

    def stop(self) -> None:
        """End."""
        self._ended.set()

    def _tell(self) -> None:
        while not self._ended.wait(INTERVAL):
            for task in self.tasks:
                share = f" {task.percentage:.0f} %," if task.total else ""
                self.console.out(f"{task.description}:{share} {task.elapsed or 0:.0f} s")


def progress_bar(console: Console | None = None) -> Progress:
    """Return the progress bar that all commands share; without a terminal, one of lines."""
    console = console or terminal(errors=True)
    if not console.is_terminal:
        return Lines(console=console, disable=True)
    text = ShortColumn("{task.description}", markup=False)
    columns = (SpinnerColumn("line"), text, BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    return Progress(*columns, console=console, transient=True, redirect_stdout=False)


@contextmanager
def waiting(activity: str) -> Generator[Progress]:
    """Show that something goes on whose end is not known."""
    with progress_bar() as progress:
        progress.add_task(activity, total=None)
        yield progress


def conclude(written: Iterable[FilePath], *commands: str) -> None:
    """Print what was written, and the commands that go on from there."""
    for each in written:
        say(f"wrote {each}")
    for start, command in zip(chain(["next:"], repeat("     ")), commands, strict=False):
        say(f"{start} {command}")


def open_streams() -> None:
    """Open streams that were closed when the process began on nothing.

    Otherwise the next file would get the number of standard output.
    """
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:
            setattr(sys, name, Path(os.devnull).open(mode, encoding="utf-8"))  # noqa: SIM115


def close_output() -> bool:
    """Drop what cannot be printed, so Python ends without a complaint of its own.

    Return whether all could be printed.
    """
    try:
        sys.stdout.flush()
    except OSError:
        with Path(os.devnull).open("wb") as nowhere:
            os.dup2(nowhere.fileno(), sys.stdout.fileno())
        return False
    return True


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
