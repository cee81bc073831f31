"""The identity of a policy: a hash of what determines its actions, never of what it says about itself.

The content of compiled laws and of the package's own policies is known, with all settings, gains and weights. The
content of other callables cannot be determined, so they have no identity.
"""

import hashlib
import json
import sys
from collections.abc import Mapping
from dataclasses import Field, fields, is_dataclass
from types import MappingProxyType
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from pter_gym._compiled.compiler import content_digest
from pter_gym.benchmark.simulation import AnyPolicy
from pter_gym.controllers import BoundPolicy
from pter_gym.controllers._base import Policy
from pter_gym.policies._cards import Card
from pter_gym.policies._interface import Interface

PROSE: Mapping[type, tuple[str, ...]] = MappingProxyType({Card: ("name", "about", "weights_sha256")})
"""Fields that describe a policy and do not change what it does."""


ADDED: Mapping[type, tuple[str, ...]] = MappingProxyType({Interface: ("frame_skip",), Card: ("clutches",)})
"""Fields that came later: with their defaults they do not count, so what is older stays what it was."""


class _UnknownError(Exception):
    """The content of something cannot be known."""


def identity_of(policy: AnyPolicy, bound: BoundPolicy) -> str | None:
    """Return the SHA-256 of what determines a policy's actions, or None if that cannot be known.

    Parameters
    ----------
    policy, bound
        The policy as given, and as it acts. For a compiled law, the gains, the law and the observation layout count;
        for any other policy of the package, all its parts.
    """
    try:
        if type(bound) is not Policy:
            return _sha256(["policy", _plain(policy)])
        digest = content_digest(bound.law)
        return _sha256(["law", bound.gains.tobytes().hex(), digest, _plain(bound.layout)]) if digest else None
    except _UnknownError:
        return None


def _plain(value: object) -> object:
    """Return the content of a value as plain data; different contents give different data."""
    kind = type(value)
    if value is None or kind in (bool, int, str):
        return value
    if isinstance(value, float):
        return ["float", float(value).hex()]
    if kind in (tuple, list):
        return ["tuple", *map(_plain, cast("tuple[object, ...]", value))]
    if kind in (dict, MappingProxyType):
        return ["map", *sorted([str(key), _plain(item)] for key, item in cast("Mapping[str, object]", value).items())]
    if kind is np.ndarray:
        array = cast("NDArray[Any]", value)
        if array.dtype.kind in "biuf":
            return ["array", array.dtype.str, list(array.shape), hashlib.sha256(array.tobytes()).hexdigest()]
    if not is_dataclass(kind) or not _is_ours(kind):
        raise _UnknownError
    left_out = {*PROSE.get(kind, ())}
    left_out |= {field.name for field in fields(kind) if _is_added(kind, field, getattr(value, field.name))}
    names = [field.name for field in fields(kind) if field.name not in left_out]
    return [f"{kind.__module__}.{kind.__qualname__}", {name: _plain(getattr(value, name)) for name in names}]


def _is_added(kind: type, field: Field[Any], value: object) -> bool:
    """Tell whether a field came later and has its default."""
    return field.name in ADDED.get(kind, ()) and value == field.default


def _is_ours(kind: type) -> bool:
    """Tell whether a class is really one of this package, whatever it claims."""
    ours = kind.__module__.startswith(f"{__name__.partition('.')[0]}.")
    return ours and getattr(sys.modules.get(kind.__module__), kind.__qualname__, None) is kind


def _sha256(parts: object) -> str:
    return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()
