"""What the commands share about their arguments: lists in one text, files to write, modules, and errors."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, get_args, get_type_hints

import tyro
from tyro.conf import Positional
from tyro.constructors import ConstructorRegistry, PrimitiveConstructorSpec, PrimitiveTypeInfo

from pter_gym._internal.files import check_target, find_path
from pter_gym.errors import ParameterError

PATHS = ConstructorRegistry()
"""How arguments become paths: ``~`` is expanded even where the shell has not done so."""


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


def check_file(out: Path, suffix: str) -> None:
    """Raise a ParameterError unless a file to write has the ending of what is written, and can be written."""
    if out.suffix != suffix:
        raise ParameterError(f"out must end in {suffix}, which is what is written, got {str(out)!r}")
    check_target("out", out)


MachineName = Annotated[str | None, tyro.conf.arg(metavar="NAME|FILE.toml")]
"""A machine by its name or its preset; None for what is usual."""

FIELD = re.compile(r"(?:[A-Z]\w*\.)?(\w+)(?= must\b| needs\b|:)")
"""How an error names a field, with its class or without."""


def as_typed(message: str, command: Callable[..., Any] | None) -> str:
    """Return an error whose field is written as the user writes the argument: ``--policies``, or ``CONTROLLER``."""
    found = FIELD.match(message)
    if command is None or found is None:
        return message
    hints = get_type_hints(command, include_extras=True)
    name = next((name for name in hints if name != "return" and _bare(name) == _bare(found[1])), None)
    if name is None:
        return message
    typed = name.upper() if Positional in get_args(hints[name]) else f"--{name.replace('_', '-')}"
    return typed + message[found.end() :]


def _bare(word: str) -> str:
    """Return a word as singular, and in the short form of an argument."""
    singular = f"{word.removesuffix('ies')}y" if word.endswith("ies") else word.removesuffix("s")
    return {"algorithm": "algo"}.get(singular, singular)
