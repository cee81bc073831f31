"""Find the policy that a user names: by its name, by a path, or as code, ``FILE.py:attribute``."""

import linecache
import os
import sys
from collections.abc import Iterable, Mapping, Sequence
from importlib.machinery import SourceFileLoader
from importlib.metadata import EntryPoint
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from traceback import extract_tb
from types import ModuleType
from typing import Any, cast
from urllib.parse import quote

from numba.core.dispatcher import Dispatcher

from pter_gym._internal.checks import names_in
from pter_gym._internal.files import FilePath, expand_path, has_ending
from pter_gym.controllers import CONTROLLERS, AnyPolicy, Controller, Policy
from pter_gym.errors import ParameterError, nearest
from pter_gym.policies import read_policy
from pter_gym.policies._files import is_path
from pter_gym.policies._library import from_actions, from_sb3
from pter_gym.policies._names import check_policy, is_code, is_exported
from pter_gym.policies.tuned import find_paced, find_tuned, read_tuned

__all__ = ["find_policies", "find_policy", "from_actions", "from_sb3"]

MAX_NAME = 180
"""Most characters of a policy's name, which is part of a file name."""


def find_policy(name: FilePath, scenario: str | None = "standard") -> AnyPolicy:
    """Return the policy that a user names.

    Parameters
    ----------
    name
        One of:

        - a built-in law, such as ``impedance``, with a damper for each commanded pace where
          the paper's gains need one;
        - a law with tuned gains, such as ``impedance-tuned``, or the file of ``pter tune
          --out``;
        - a trained policy of the package, such as ``residual``, or the path of an exported one;
        - ``FILE.py:attribute`` or ``package.module:attribute``: a law or a callable from
          observations to volts. A class is called without arguments. The file is run, or the module
          imported, in this process, if need be from the current folder, which is then appended to
          ``sys.path``.
    scenario
        Scenario whose gains and dampers to use. With None, as in the paper's standard test,
        laws have their default gains.

    Raises
    ------
    ParameterError
        If there is no such policy; the message suggests the nearest names.
    DataError
        If a file of an exported policy is damaged.
    """
    name = _text_of(name)
    if name in CONTROLLERS:
        return find_paced(name, scenario)
    check_policy(name)
    if is_code(name):
        return _import(name)
    if has_ending(name, ".toml"):
        return read_tuned(name, scenario)
    if is_exported(name):
        return read_policy(name)
    return find_tuned(name, scenario)


Policies = Mapping[str, "AnyPolicy | FilePath | Sequence[AnyPolicy | FilePath]"]
"""Policies by name; a sequence holds those of several training seeds."""


def find_policies(
    policies: Policies | Iterable[FilePath] | FilePath, scenario: str
) -> dict[str, tuple[AnyPolicy, ...]]:
    """Return policies by name, those of each training seed, with the gains for a scenario.

    Raises
    ------
    ParameterError
        If there are none, or one has no name, is a class, or is the same for two training seeds.
    """
    if callable(policies) or isinstance(policies, Controller | Policy):
        raise ParameterError(
            f"policies must have names, as in {{'mine': policy}}, got {policies!r:.200}"
        )
    by_text: Mapping[str, Any] = (
        cast("Mapping[str, Any]", policies)
        if isinstance(policies, Mapping)
        else {_text_of(name): name for name in names_in("policies", cast("Any", policies))}
    )
    if not by_text:
        raise ParameterError("policies must hold at least one name")
    by_name: dict[str, tuple[AnyPolicy, ...]] = {}
    for name, policy in by_text.items():
        _check_name(name)
        several = isinstance(policy, Sequence) and not isinstance(policy, str)
        seeds = cast("Sequence[Any]", policy if several else (policy,))
        if not seeds or len({id(each) for each in seeds}) < len(seeds):
            raise ParameterError(
                "policies must hold one policy or more for a name, a different one for each "
                f"training seed, {name!r} is {policy!r:.200}"
            )
        by_name[name] = tuple(_resolve(name, each, scenario) for each in seeds)
    return by_name


def _resolve(name: str, policy: Any, scenario: str) -> AnyPolicy:
    """Return a policy that may be there by its name."""
    if isinstance(policy, str | os.PathLike):
        return find_policy(cast("FilePath", policy), scenario)
    acts = isinstance(policy, Controller | Policy) or callable(policy)
    if isinstance(policy, type) or not acts:
        raise ParameterError(
            "policies must be names, have a method bind or be callable, and no classes; "
            f"{name!r} is {policy!r:.200}"
        )
    return policy


def _text_of(name: object) -> str:
    """Return a name or path as text; a bare path gets ``./``."""
    if isinstance(name, str):
        return name
    if not isinstance(name, os.PathLike):
        hint = (
            "; give a policy of your own under a name, as in {'mine': policy}"
            if callable(name)
            else ""
        )
        raise ParameterError(f"policies must be names or paths, got {name!r:.200}{hint}")
    text = str(expand_path("policies", cast("FilePath", name)))
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
    if not has_ending(place, ".py") and not entry.pattern.fullmatch(name):
        raise ParameterError(
            f"policies must be written as package.module:attribute, got {name!r:.200}"
        )
    try:
        is_file = has_ending(place, ".py")
        value = _attribute_of(Path(place), attribute) if is_file else _load(entry)
        if isinstance(value, Dispatcher):
            raise ParameterError(
                f"policies must name a class whose bind returns the law, {name!r} is the law itself"
            )
        return value() if isinstance(value, type) else value
    except (ImportError, AttributeError) as error:
        raise ParameterError(
            f"policies must name code that can be imported, got {name!r}: {error}"
        ) from None
    except TypeError as error:
        raise ParameterError(
            "policies must name an instance, or a class that needs no arguments, "
            f"got {name!r}: {error}"
        ) from None


def _attribute_of(file: Path, name: str) -> Any:
    """Return an attribute of a file of Python."""
    attributes = {
        each: value
        for each, value in vars(_run_file(file.resolve())).items()
        if not each.startswith("_")
    }
    if name not in attributes:
        raise ParameterError(
            f"policies must name what is in {file}, there is no {name!r}{nearest(name, attributes)}"
        )
    return attributes[name]


def _load(entry: EntryPoint) -> Any:
    """Return an attribute of a module."""
    try:
        return entry.load()
    except (ImportError, AttributeError):
        raise
    except Exception as error:
        raise _does_not_run(error, Path.cwd()) from error


def _run_file(path: Path) -> ModuleType:
    """Return the module that a file of Python is, with its folder at the end of ``sys.path``.

    A file whose content has changed is run again.
    """
    name, content = f"file:{path}", path.read_bytes()  # a name that no other module has
    if name in sys.modules and sys.modules[name].__dict__["__content__"] == content:
        return sys.modules[name]
    loader = SourceFileLoader(name, str(path))  # which needs no .py in lower case
    spec: Any = spec_from_file_location(name, path, loader=loader)
    module = sys.modules[name] = module_from_spec(spec)
    if str(path.parent) not in sys.path:
        sys.path.append(str(path.parent))
    try:
        exec(compile(content, path, "exec"), vars(module))
    except Exception as error:
        sys.modules.pop(name)
        raise _does_not_run(error, path.parent) from error
    vars(module)["__content__"] = content
    linecache.checkcache()
    return module


def _does_not_run(error: Exception, folder: Path) -> ParameterError:
    """Return the error for a user's code, with the place in the innermost of the user's files."""
    frames = [(frame.filename, frame.lineno) for frame in extract_tb(error.__traceback__)]
    if isinstance(error, SyntaxError) and error.filename:
        frames.append((error.filename, error.lineno))
    own = [frame for frame in frames if folder in Path(frame[0]).parents] or frames[-1:]
    file, line = own[-1]
    reason = error.msg if isinstance(error, SyntaxError) else error
    place = f"{Path(file).name}, line {line}: {type(error).__name__}: {reason}"
    return ParameterError(f"policies must name code that runs, {place}")
