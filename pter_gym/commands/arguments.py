"""What the commands share about their arguments: lists in one text, files to write, and modules."""

import sys
from pathlib import Path

from pter_gym.errors import ParameterError


def split(text: str) -> list[str]:
    """Return the parts of a list that is separated by commas, without repeats."""
    return list(dict.fromkeys(part.strip() for part in text.split(",") if part.strip()))


def numbers(field: str, text: str) -> list[float]:
    """Return the numbers of a list that is separated by commas, or raise a ParameterError that names the field."""
    try:
        found = [float(part) for part in split(text)]
    except ValueError:
        found = []
    if not found:
        raise ParameterError(f"{field} must be numbers separated by commas, got {text!r}")
    return found


def check_folder_of(out: Path) -> None:
    """Raise a ParameterError unless the folder of a file to write exists."""
    if not out.parent.is_dir():
        raise ParameterError(f"out must be a file in a folder that exists, got {str(out)!r}")


def import_from_here() -> None:
    """Let ``package.module:attribute`` name what is in the present folder, as Python does for its scripts."""
    if (here := str(Path.cwd())) not in sys.path:
        sys.path.insert(0, here)
