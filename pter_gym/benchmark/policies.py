"""Policies under the names that tables show, one or several training seeds for each."""

import os
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, cast
from urllib.parse import quote

from pter_gym._internal.checks import names_in
from pter_gym._internal.files import FilePath
from pter_gym.controllers import AnyPolicy, Controller, Policy
from pter_gym.errors import ParameterError
from pter_gym.policies._library import from_actions, from_sb3
from pter_gym.policies.find import find_policy, text_of

__all__ = ["find_policies", "find_policy", "from_actions", "from_sb3"]

MAX_NAME = 180
"""Most characters of a policy's name, which is part of a file name."""

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
        else {text_of(name): name for name in names_in("policies", cast("Any", policies))}
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


def _check_name(name: object) -> None:
    """Raise a ParameterError unless something can name a policy in tables and in file names."""
    good = isinstance(name, str) and name.strip() == name != "" and name.isprintable()
    if not good or len(quote(str(name), safe=" ")) > MAX_NAME:
        raise ParameterError(
            f"policies must have printable names of 1 to {MAX_NAME} characters, got {name!r:.60}"
        )
