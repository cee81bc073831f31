"""What the commands share about their arguments: lists in one text, files to write, and modules."""

import sys
from pathlib import Path
from typing import Any

from tyro.constructors import ConstructorRegistry, PrimitiveConstructorSpec, PrimitiveTypeInfo

from pter_gym.errors import ParameterError
from pter_gym.internal.files import find_path

PATHS = ConstructorRegistry()
"""How arguments become paths: ``~`` is the home of the user, also where no shell has put it in."""


@PATHS.primitive_rule
def read_path_argument(info: PrimitiveTypeInfo) -> PrimitiveConstructorSpec[Any] | None:
    """Return how an argument becomes a path; None for other arguments."""
    if info.type is not Path:
        return None
    return PrimitiveConstructorSpec(
        nargs=1,
        metavar="PATH",
        instance_from_str=lambda texts: find_path("path", texts[0]),
        is_instance=lambda value: isinstance(value, Path),
        str_from_instance=lambda path: [str(path)],
    )


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
