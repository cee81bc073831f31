"""What the commands share about their arguments."""

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from pter_gym._internal.files import check_target
from pter_gym._internal.tables import read_table
from pter_gym.errors import ParameterError, unknown_name
from pter_gym.params import find_machine
from pter_gym.policies._files import ENDING
from pter_gym.policies._names import check_policy
from pter_gym.scenarios import PACES, SCENARIOS, find_pace

if TYPE_CHECKING:
    ScenarioName = str
    PaceName = str
else:
    ScenarioName = Literal[tuple(SCENARIOS)]
    """Name of a scenario; the help lists all."""

    PaceName = Literal[tuple(PACES)]
    """Name of a commanded pace; the help lists all."""

PATH_NAMES = ("line", "arc", "circle", "sine")
"""Names of paths, in their order in ``PATHS``, known without loading anything that compiles."""

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
    """Return the parts between commas, without repeats; commas in FILE and FILE:NAME stay."""
    pieces, parts = text.split(","), list[str]()
    while pieces:
        ends = range(len(pieces), 1, -1)
        end = next((k for k in ends if _is_there(",".join(pieces[:k]).strip())), 1)
        parts.append(",".join(pieces[:end]).strip())
        del pieces[:end]
    return list(dict.fromkeys(part for part in parts if part))


def _is_there(name: str) -> bool:
    """Return whether a name is that of a file, with or without its ending, or FILE:NAME."""
    file, _, attribute = name.rpartition(":")
    paths = (name, f"{name}{ENDING}", *([file] if "," not in attribute else []))
    return any(path and Path(path).exists() for path in paths)


def look_at(
    *,
    policies: Iterable[str] = (),
    paces: Iterable[str] = (),
    path: str | None = None,
    machine: str | None = None,
) -> None:
    """Look at what a user has named before anything that takes seconds is imported.

    What is mistyped raises the error at once that it would later.
    """
    for pace in paces:
        find_pace(pace, "paces")
    for policy in policies:
        check_policy(policy)
    find_machine(machine)
    if path is not None and path.endswith(".csv"):
        read_table(path, ("x", "y"), unit="m")
    elif path is not None and path not in PATH_NAMES:
        raise unknown_name("path", path, (*PATH_NAMES, "FILE.csv"))


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
