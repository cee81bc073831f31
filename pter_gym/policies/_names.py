"""What policies are called, known without loading anything that compiles."""

from collections.abc import Mapping
from functools import cache
from pathlib import Path

from pter_gym._internal.files import has_ending
from pter_gym._internal.laws import LAWS
from pter_gym._internal.reading import read_toml
from pter_gym.errors import ParameterError, unknown_name
from pter_gym.policies._files import find_file, is_here, is_path, shipped_policies

TUNED_TABLE = Path(__file__).parents[1] / "presets" / "tuned.toml"

SUFFIX = "-tuned"

SCALED = "single-dof-scaled"
"""Name of the law whose gains follow the numbers of a device."""


@cache
def tuned_policies() -> tuple[str, ...]:
    """Return the names under which laws are found with shipped gains."""
    return (*tuned_names(read_toml(TUNED_TABLE, "tuned gains")), SCALED)


def tuned_names(table: Mapping[str, Mapping[str, object]]) -> tuple[str, ...]:
    """Return the names under which laws are found with the gains of a table."""
    there = {name for laws in table.values() for name in laws}
    return tuple(f"{name}{SUFFIX}" for name in LAWS if name in there)


def is_code(name: str) -> bool:
    """Return whether a name means an attribute of a file or of a module."""
    place, colon, _ = name.rpartition(":")
    return bool(colon) and (has_ending(place, ".py") or not is_path(name))


def is_exported(name: str) -> bool:
    """Return whether a name means a trained policy: a shipped one, or a file."""
    if name in shipped_policies() or is_path(name):
        return True
    return bool(name) and is_here(name) and name not in (*LAWS, *tuned_policies())


def check_policy(name: str) -> None:
    """Raise a ParameterError unless there is a policy of a name, or the file that it names."""
    if has_ending(name, ".py", ".py:"):
        example = f"{name.removesuffix(':')}:policy"
        raise ParameterError(
            f"policies must name an attribute of a file, as in {example}, got {name!r:.200}"
        )
    file = Path(name.rpartition(":")[0] if is_code(name) else name)
    if has_ending(file, ".py", ".toml"):
        if not file.is_file():
            raise ParameterError(
                f"policies must name a file that exists, there is no {str(file)!r}"
            )
    elif is_code(name):
        pass  # a module, which is found when it is imported
    elif is_exported(name):
        find_file(name)
    elif name not in (known := (*LAWS, *tuned_policies())):
        raise unknown_name("policies", name, (*known, *shipped_policies()))
