"""What policies are called, known without loading anything that compiles."""

from functools import cache
from pathlib import Path

from pter_gym._internal.files import has_ending
from pter_gym._internal.reading import read_toml
from pter_gym.errors import ParameterError, unknown_name
from pter_gym.policies._files import find_file, is_here, is_path, shipped_policies

BUILT_IN = (
    "impedance",
    "torque-feedback",
    "single-dof",
    "velocity-ratio",
    "free",
    "locked",
    "random",
)
"""Names of the built-in laws, in their order in ``CONTROLLERS``."""

TUNED_TABLE = Path(__file__).parents[1] / "presets" / "tuned.toml"

SUFFIX = "-tuned"


@cache
def tuned_policies() -> tuple[str, ...]:
    """Return the names under which laws are found with shipped gains."""
    scenarios = read_toml(TUNED_TABLE, "tuned gains").values()
    return tuple(f"{name}{SUFFIX}" for name in BUILT_IN if any(name in each for each in scenarios))


def is_code(name: str) -> bool:
    """Return whether a name means an attribute of a file or of a module."""
    place, colon, _ = name.rpartition(":")
    return bool(colon) and (has_ending(place, ".py") or not is_path(name))


def is_exported(name: str) -> bool:
    """Return whether a name means a trained policy: a shipped one, or a file."""
    known = (*BUILT_IN, *tuned_policies())
    shipped = name in shipped_policies()
    return shipped or is_path(name) or (name not in known and bool(name) and is_here(name))


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
    elif name not in (known := (*BUILT_IN, *tuned_policies())):
        raise unknown_name("policies", name, (*known, *shipped_policies()))
