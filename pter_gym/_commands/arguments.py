"""What the commands share about their arguments: how they are read and checked, and how errors name them."""

import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, get_args, get_type_hints

import tyro
from tyro.conf import Positional
from tyro.constructors import ConstructorRegistry, PrimitiveConstructorSpec, PrimitiveTypeInfo

from pter_gym._internal.files import check_target, find_path
from pter_gym.errors import ParameterError, nearest, unknown_name

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


@dataclass(frozen=True)
class Check:
    """Part of an argument's annotation: what it must be, decided before the command imports what takes seconds.

    Attributes
    ----------
    of
        Called with the argument's name and its value unless that is None; raises a PterError.
    """

    of: Callable[[str, Any], object]


def check_arguments(command: Callable[..., Any], given: dict[str, Any]) -> None:
    """Check those arguments of a command whose annotations say how."""
    for name, hint in get_type_hints(command, include_extras=True).items():
        for part in get_args(hint):
            if isinstance(part, Check) and given.get(name) is not None:
                part.of(name, given[name])


def among(known: Callable[[], Iterable[str]], *, several: bool = False) -> Check:
    """Check that an argument is one of the names that are known, or a list of such, separated by commas."""

    def check(field: str, text: str) -> None:
        for each in split(text) if several else [text]:
            if each not in (names := list(known())):
                raise unknown_name(field, each, names)

    return Check(check)


def at_least(least: int) -> Check:
    """Check that an argument is not smaller."""

    def check(field: str, value: int) -> None:
        if value < least:
            raise ParameterError(f"{field} must be a whole number ≥ {least}, got {value}")

    return Check(check)


def _check_exists(field: str, path: Path) -> None:
    if not path.is_file():
        raise ParameterError(f"{field} must be a file, and {str(path)!r} does not exist")


def _check_machine(field: str, text: str) -> None:
    from pter_gym.params import MACHINES, find_machine, is_preset

    if text not in MACHINES and not is_preset(text):
        raise ParameterError(
            f"{field} must be the path of a preset (.toml) or among {', '.join(MACHINES)}, got {text!r:.200}"
            f"{nearest(text, MACHINES)}"
        )
    find_machine(text)


IS_FILE = Check(_check_exists)
"""An argument that is a file to read."""

IS_MACHINE = Check(_check_machine)
"""An argument that is the name of a machine, or the path of a preset."""

MachineName = Annotated[str | None, tyro.conf.arg(metavar="NAME|FILE.toml"), IS_MACHINE]
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
