"""Find the policy that a user names: by name, by the path of an exported one, or as code, ``FILE.py:attribute``."""

import os
import sys
from collections.abc import Iterable, Mapping
from functools import cache
from importlib.metadata import EntryPoint
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from traceback import extract_tb
from types import ModuleType
from typing import Any, cast
from urllib.parse import quote

from numba.core.dispatcher import Dispatcher

from pter_gym._internal.checks import names_in
from pter_gym._internal.files import FilePath, find_path
from pter_gym.benchmark.simulation import AnyPolicy
from pter_gym.benchmark.tuned import TUNED, find_paced, find_tuned, read_tuned
from pter_gym.controllers import CONTROLLERS, Controller
from pter_gym.errors import ParameterError, nearest, unknown_name
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

        - a built-in controller, such as ``impedance``, with a damper for each commanded pace where
          the paper's gains need one;
        - a controller with tuned gains, such as ``impedance-tuned``, or the file of ``pter tune
          --out``;
        - a trained policy of the package, such as ``residual``, or the path of an exported one;
        - ``FILE.py:attribute`` or ``package.module:attribute``: a controller or a callable from
          observations to volts. A class is called without arguments. The file is run, or the module
          imported, in this process, if need be from the current folder, which is then appended to
          ``sys.path``.
    scenario
        Scenario whose gains and dampers to use. With None, as in the paper's standard test,
        controllers have their default gains.

    Raises
    ------
    ParameterError
        If there is no such policy; the message suggests the nearest names.
    DataError
        If a file of an exported policy is damaged.
    """
    name = _text_of(name)
    if name.endswith((".py", ".py:")):
        example = f"{name.removesuffix(':')}:policy"
        raise ParameterError(
            f"policies must name an attribute of a file, as in {example}, got {name!r:.200}"
        )
    if is_code(name):
        return _import(name)
    if name.endswith(".toml"):
        return read_tuned(name, scenario)
    known = (*CONTROLLERS, *TUNED, *shipped_policies())
    if (
        is_path(name)
        or name in shipped_policies()
        or (name not in known and name and is_here(name))
    ):
        return read_policy(name)
    if name not in known:
        raise unknown_name("policies", name, known)
    return find_tuned(name, scenario) if name in TUNED else find_paced(name, scenario)


def is_code(name: str) -> bool:
    """Return whether a name means an attribute of a file or of a module."""
    place, colon, _ = name.rpartition(":")
    return bool(colon) and (place.endswith(".py") or not is_path(name))


def find_policies(policies: Any, scenario: str) -> dict[str, tuple[AnyPolicy, ...]]:
    """Return policies by name, those of each training seed, or raise a ParameterError; see ``run_scenario``."""
    if callable(policies) or isinstance(policies, Controller | PerSeed):
        raise ParameterError(
            f"policies must have names, as in {{'mine': policy}}, got {policies!r:.200}"
        )
    if not isinstance(policies, Mapping):
        policies = {_text_of(given): given for given in names_in("policies", policies)}
    if not policies:
        raise ParameterError("policies must hold at least one name")
    found: dict[str, tuple[AnyPolicy, ...]] = {}
    for name, given in cast("Mapping[str, Any]", policies).items():
        _check_name(name)
        seeds = given.policies if isinstance(given, PerSeed) else (given,)
        found[name] = tuple(_resolve(name, each, scenario) for each in seeds)
    return found


class PerSeed:
    """One policy trained with several seeds, which share a row of the leaderboard.

    Parameters
    ----------
    policies
        A policy for each seed, all of them different, as ``run_scenario`` takes them: a copy is not
        another seed.
    """

    def __init__(self, policies: Iterable[AnyPolicy | FilePath]) -> None:
        given = cast("object", policies)
        if isinstance(given, str | bytes | Mapping) or not isinstance(given, Iterable):
            raise ParameterError(
                f"policies must be a sequence of policies, one for each seed, got {given!r:.200}"
            )
        self.policies = tuple(cast("Iterable[AnyPolicy | FilePath]", given))
        if not self.policies or len({id(each) for each in self.policies}) < len(self.policies):
            raise ParameterError(
                f"policies must be one or more, all of them different, got {self.policies!r:.200}"
            )


def _resolve(name: str, given: Any, scenario: str) -> AnyPolicy:
    """Return a policy given by itself or by its name."""
    if isinstance(given, str | os.PathLike):
        return find_policy(cast("FilePath", given), scenario)
    if isinstance(given, type) or not (isinstance(given, Controller) or callable(given)):
        raise ParameterError(
            "policies must be names, have a method bind or be callable, not classes (PerSeed holds those of several "
            f"seeds), {name!r} is {given!r:.200}"
        )
    return given


def _text_of(name: object) -> str:
    """Return a name or path as text that shows which of the two it is, or raise a ParameterError."""
    if isinstance(name, str):
        return name
    if not isinstance(name, os.PathLike):
        hint = (
            "; give a policy of your own under a name, as in {'mine': policy}"
            if callable(name)
            else ""
        )
        raise ParameterError(f"policies must be names or paths, got {name!r:.200}{hint}")
    text = str(find_path("policies", cast("FilePath", name)))
    return text if is_path(text) else f"./{text}"


def _check_name(name: object) -> None:
    """Raise a ParameterError unless something can name a policy in tables and in file names."""
    good = isinstance(name, str) and name.strip() == name != "" and name.isprintable()
    if not good or len(quote(str(name), safe=" ")) > MAX_NAME:
        raise ParameterError(
            f"policies must have printable names of 1 to {MAX_NAME} characters, got {name!r:.60}"
        )


def _import(name: str) -> Any:
    """Return the policy that is an attribute of a module, or an instance of it if it is a class."""
    if (here := str(Path.cwd())) not in sys.path:
        sys.path.append(here)
    place, _, attribute = name.rpartition(":")
    entry = EntryPoint(name, name, "")
    if not place.endswith(".py") and not entry.pattern.fullmatch(name):
        raise ParameterError(
            f"policies must be written as package.module:attribute, got {name!r:.200}"
        )
    try:
        found = _attribute_of(Path(place), attribute) if place.endswith(".py") else entry.load()
        if isinstance(found, Dispatcher):
            raise ParameterError(
                f"policies must name a class whose bind returns the law, {name!r} is the law itself"
            )
        return found() if isinstance(found, type) else found
    except (ImportError, AttributeError) as error:
        raise ParameterError(
            f"policies must name code that can be imported, got {name!r}: {error}"
        ) from None
    except TypeError as error:
        raise ParameterError(
            f"policies must name an instance, or a class that needs no arguments, got {name!r}: {error}"
        ) from None


def _attribute_of(file: Path, name: str) -> Any:
    """Return an attribute of a file of Python."""
    known = {
        each: value
        for each, value in vars(_run_file(file.resolve())).items()
        if not each.startswith("_")
    }
    if name not in known:
        raise ParameterError(
            f"policies must name what is in {file}, there is no {name!r}{nearest(name, known)}"
        )
    return known[name]


@cache
def _run_file(path: Path) -> ModuleType:
    """Return the module that a file of Python is, run once, with its folder at the end of ``sys.path``."""
    if not path.is_file():
        raise ParameterError(f"policies must name a file that exists, there is no {str(path)!r}")
    spec: Any = spec_from_file_location(f"file:{path}", path)  # a name that no other module has
    module = sys.modules[spec.name] = module_from_spec(spec)
    sys.path.append(str(path.parent))
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        lines = [
            frame.lineno for frame in extract_tb(error.__traceback__) if frame.filename == str(path)
        ]
        line = error.lineno if isinstance(error, SyntaxError) else lines[-1]
        told = f"{path.name}, line {line}: {type(error).__name__}: {error}"
        raise ParameterError(f"policies must name code that runs, {told}") from error
    return module
