"""Find the policy that a user names: by name, by the path of an exported one, or as ``package.module:attribute``."""

import os
import sys
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any, cast
from urllib.parse import quote

from pter_gym._internal.files import FilePath, find_path
from pter_gym.benchmark.simulation import AnyPolicy
from pter_gym.benchmark.tuned import TUNED, find_tuned
from pter_gym.controllers import CONTROLLERS, Impedance
from pter_gym.errors import ParameterError, unknown_name
from pter_gym.policies import read_policy, shipped_policies
from pter_gym.policies._files import is_here, is_path

MAX_NAME = 180
"""Most characters of a policy's name, which is part of a file name."""


def find_policy(name: FilePath, scenario: str | None = "standard") -> AnyPolicy:
    """Return the policy that a user names.

    Parameters
    ----------
    name
        One of:

        - a built-in controller, such as ``impedance``, with a damper for each commanded pace where the paper's gains
          need one;
        - a controller with tuned gains, such as ``impedance-tuned``;
        - a trained policy of the package, such as ``residual``, or the path of an exported one;
        - ``package.module:attribute``: a controller or a callable from observations to volts. A class is called
          without arguments. The module is imported into this process; if it is found nowhere else, it is looked up in
          the current folder, which is then appended to ``sys.path``.
    scenario
        Scenario whose gains and dampers to use. With None, as in the paper's standard test, controllers have their
        default gains.

    Raises
    ------
    ParameterError
        If there is no such policy; the message suggests the nearest names.
    DataError
        If a file of an exported policy is damaged.
    """
    name = text_of(name)
    if is_code(name):
        return _import(name)
    if name.endswith(".py"):
        module = name.removesuffix(".py").replace(os.sep, ".").strip(".")
        raise ParameterError(f"policies must name an attribute of a module, as in {module}:policy, got {name!r:.200}")
    known = (*CONTROLLERS, *TUNED, *shipped_policies())
    if is_path(name) or name in shipped_policies() or (name not in known and is_here(name)):
        return read_policy(name)
    if name not in known:
        raise unknown_name("policies", name, known)
    if name in TUNED:
        return find_tuned(name, scenario)
    controller = CONTROLLERS[name]()
    if not isinstance(controller, Impedance) or scenario is None:
        return controller
    from pter_gym.benchmark._pacing import damping_table, paced

    dampers = damping_table().get(scenario, {}).get(name)
    return paced(controller, dampers) if dampers else controller


def is_code(name: str) -> bool:
    """Return whether a name means an attribute of a module, ``package.module:attribute``."""
    return ":" in name and not is_path(name)


def text_of(name: FilePath) -> str:
    """Return a name or path as text that shows which of the two it is, or raise a ParameterError."""
    given = cast("object", name)
    if isinstance(given, str):
        return given
    if not isinstance(given, os.PathLike):
        hint = "; give a policy of your own under a name, as in {'mine': policy}" if callable(given) else ""
        raise ParameterError(f"policies must be names or paths, got {given!r:.200}{hint}")
    text = str(find_path("policies", name))
    return text if is_path(text) else f"./{text}"


def check_name(name: object) -> None:
    """Raise a ParameterError unless something can name a policy in tables and in file names."""
    good = isinstance(name, str) and name.strip() == name != "" and name.isprintable()
    if not good or len(quote(str(name), safe=" ")) > MAX_NAME:
        raise ParameterError(f"policies must have printable names of 1 to {MAX_NAME} characters, got {name!r:.60}")


def _import(name: str) -> Any:
    """Return the policy that is an attribute of a module, or an instance of it if it is a class."""
    if (here := str(Path.cwd())) not in sys.path:
        sys.path.append(here)
    entry = EntryPoint(name, name, "")
    if not entry.pattern.fullmatch(name):
        raise ParameterError(f"policies must be written as package.module:attribute, got {name!r:.200}")
    try:
        found = entry.load()
    except (ImportError, AttributeError) as error:
        raise ParameterError(f"policies must name code that can be imported, got {name!r}: {error}") from None
    if not isinstance(found, type):
        return found
    try:
        return found()
    except TypeError as error:
        raise ParameterError(
            f"policies must name an instance, or a class that needs no arguments, got {name!r}: {error}"
        ) from None
