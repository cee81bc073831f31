"""What the commands share about their arguments."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from pter_gym._internal.files import check_target
from pter_gym.errors import ParameterError
from pter_gym.scenarios import PACES, SCENARIOS

if TYPE_CHECKING:
    ScenarioName = str
    PaceName = str
else:
    ScenarioName = Literal[tuple(SCENARIOS)]
    """Name of a scenario; the help lists all."""

    PaceName = Literal[tuple(PACES)]
    """Name of a commanded pace; the help lists all."""

_PACE = f"{'|'.join(PACES)}|M/S"

AnyPace = Annotated[str, tyro.conf.arg(metavar=_PACE)]
"""A commanded pace, by its name or as a speed [m/s]."""

AnyPaces = Annotated[tuple[str, ...], tyro.conf.arg(metavar=f"{_PACE} …", aliases=("--pace",))]
"""Commanded paces, each as ``AnyPace``."""

PathName = Annotated[str | None, tyro.conf.arg(metavar="NAME|FILE.csv")]
"""A path by its name, or a file of waypoints; None for what is usual."""

MachineName = Annotated[str | None, tyro.conf.arg(metavar="NAME|FILE.toml")]
"""A machine by its name or its file; None for what is usual."""


def split(text: str) -> list[str]:
    """Return the parts between commas, without repeats; FILE and FILE:NAME are one part."""
    file, _, name = text.rpartition(":")
    if Path(text).is_file() or ("," not in name and Path(file).is_file()):
        return [text]
    return list(dict.fromkeys(part.strip() for part in text.split(",") if part.strip()))


def numbers(field: str, text: str) -> list[float]:
    """Return numbers that are separated by commas, or raise a ParameterError for the field."""
    try:
        return [float(part) for part in text.split(",")]
    except ValueError:
        raise ParameterError(f"{field} must be numbers separated by commas, got {text!r}") from None


def check_file(out: Path, suffix: str) -> None:
    """Raise a ParameterError unless a file with this suffix can be written."""
    if out.suffix != suffix:
        raise ParameterError(f"out must end in {suffix}, got {str(out)!r}")
    check_target("out", out)
