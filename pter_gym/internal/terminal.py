"""What the commands share on the terminal: folders for results, and the progress bar."""

import os

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from pter_gym.errors import ParameterError
from pter_gym.internal.files import FilePath, find_path


def make_folder(path: FilePath) -> None:
    """Make a folder that can be written to, or raise a ParameterError."""
    path = find_path("out", path)
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ParameterError(f"out must be a folder that can be written to: {error}") from None
    if not os.access(path, os.W_OK | os.X_OK):
        raise ParameterError(f"out must be a folder that can be written to: no permission for {str(path)!r}")


def progress_bar(console: Console) -> Progress:
    """Return the progress bar that all commands share."""
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    return Progress(*columns, console=console, transient=True)
