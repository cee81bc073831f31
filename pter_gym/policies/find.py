"""What a policy's name means: ``kind_of`` classifies it, and ``find_policy`` returns the policy.

A new kind of name is an entry of ``Kind`` and ``NAMES``, and a line in each of these functions.
Nothing that compiles is loaded before ``find_policy``.
"""

import os
from collections.abc import Callable, Collection
from pathlib import Path
from typing import TYPE_CHECKING, Literal, cast

from pter_gym._internal.files import FilePath, expand_path, has_ending
from pter_gym.controllers._names import LAWS
from pter_gym.errors import ParameterError, unknown_name
from pter_gym.policies._code import load_attribute
from pter_gym.policies._files import (
    ENDING,
    find_file,
    is_here,
    is_path,
    read_policy,
    shipped_policies,
)
from pter_gym.policies.tuned import find_paced, find_tuned, read_tuned, tuned_policies

if TYPE_CHECKING:
    from pter_gym.controllers import AnyPolicy, Controller

Kind = Literal["law", "tuned law", "gains", "table", "network", "code", "fault-tolerant"]

DETECTOR = "+detector"
"""What follows the name of a policy that goes on without a clutch that a detector names."""

NAMES: dict[Kind, Callable[[], Collection[str]]] = {
    "law": LAWS.keys,
    "tuned law": tuned_policies,
    "network": shipped_policies,
    "gains": lambda: ["FILE.toml"],
    "table": lambda: ["FILE.csv"],
    "code": lambda: ["FILE.py:attribute"],
    "fault-tolerant": lambda: [f"NAME{DETECTOR}"],
}
"""The known names of each kind, or how one is written."""


def kind_of(name: str, field: str = "policies", among: Collection[Kind] = tuple(NAMES)) -> Kind:
    """Return what a name means.

    Parameters
    ----------
    name
        What a user has written.
    field
        What the error calls it.
    among
        What it may mean.

    Raises
    ------
    ParameterError
        If it is nothing of these, or names a file that does not exist.
    """
    if name.endswith(DETECTOR) and "fault-tolerant" in among:
        kind_of(name.removesuffix(DETECTOR), field, among)
        return "fault-tolerant"
    kind = _meant_by(name)
    if kind is None or kind not in among:
        raise unknown_name(field, name, [each for kind in among for each in NAMES[kind]()])
    file = name.rpartition(":")[0] if kind == "code" else name
    if kind == "network":
        find_file(name)
    elif has_ending(file, ".py", ".toml", ".csv") and not Path(file).expanduser().is_file():
        raise ParameterError(f"{field} must name a file that exists, there is no {file!r}")
    return kind


def _meant_by(name: str) -> Kind | None:
    """Return what a name would mean if what it names were there; None for an unknown one."""
    place, colon, _ = name.rpartition(":")
    if name in LAWS:
        return "law"
    if name in tuned_policies():
        return "tuned law"
    if has_ending(name, ".py", ".py:"):
        example = f"{name.removesuffix(':')}:policy"
        raise ParameterError(
            f"policies must name an attribute of a file, as in {example}, got {name!r:.200}"
        )
    if colon and (has_ending(place, ".py") or not is_path(name)):
        return "code"
    if has_ending(name, ".toml"):
        return "gains"
    if has_ending(name, ".csv"):
        return "table"
    if name in shipped_policies() or is_path(name) or (name and is_here(name)):
        return "network"
    return None


def find_policy(name: FilePath, scenario: str | None = "standard") -> "AnyPolicy":
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
          ``sys.path``;
        - a table of voltages over time, such as the file of ``pter identify --pulses``;
        - any of these with ``+detector`` at the end: it goes on without a clutch once a detector
          says that this has failed; see ``FaultTolerant``.
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
    name = text_of(name)
    match kind_of(name):
        case "law":
            return find_paced(name, scenario)
        case "tuned law":
            return find_tuned(name, scenario)
        case "gains":
            return read_tuned(name, scenario)
        case "table":
            from pter_gym.controllers import read_playback

            return read_playback(name)
        case "network":
            return read_policy(name)
        case "code":
            return load_attribute(name)
        case "fault-tolerant":
            from pter_gym.controllers import FaultTolerant

            policy = find_policy(name.removesuffix(DETECTOR), scenario)
            return FaultTolerant(cast("Controller", policy))


def text_of(name: object) -> str:
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


def split(text: str) -> list[str]:
    """Return the names between commas, without repeats; commas in FILE and FILE:NAME stay."""
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
