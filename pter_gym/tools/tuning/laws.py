"""Laws whose gains can be searched: the package's by name, and a user's own, which brings its ranges."""

import hashlib
import inspect
import math
from collections.abc import Mapping
from dataclasses import dataclass, fields, is_dataclass, replace
from pathlib import Path
from typing import Any, cast

from pter_gym._internal.checks import is_finite
from pter_gym.benchmark._find_policy import find_policy, is_code
from pter_gym.benchmark.simulation import AnyPolicy
from pter_gym.benchmark.tuned import SUFFIX, TUNABLE
from pter_gym.controllers import PaceSchedule
from pter_gym.errors import ParameterError, unknown_name
from pter_gym.policies._stored_gains import make_guided
from pter_gym.tools.tuning.spaces import (
    SPACES,
    SWITCH,
    Range,
    Space,
    gains_at,
    point_at,
    rounded,
    within,
)

Gains = dict[str, float | bool]

SEARCH = "search"
"""Attribute of a user's law: by the name of a gain its range, ``(low, high)``, or ``(False, True)``."""


@dataclass(frozen=True)
class NamedLaw:
    """A controller of the package at a commanded pace [m/s]."""

    name: str
    pace: float
    scenario: str

    @property
    def key(self) -> str:
        """What tells it from other laws."""
        return self.name

    @property
    def space(self) -> Space:
        """The coordinates of its search."""
        return SPACES[self.name]

    def starts(self) -> list[Gains]:
        """Return the points where its search begins: the shipped gains, and the defaults."""
        found: list[Gains] = []
        for known in (find_policy(self.name + SUFFIX, self.scenario), find_policy(self.name)):
            knots: Any = known.knots if isinstance(known, PaceSchedule) else ((self.pace, known),)
            pace, law = min(knots, key=lambda knot: abs(math.log(knot[0] / self.pace)))
            found.append(point_at(self.name, law, pace))
        return found

    def gains(self, point: Mapping[str, float | bool]) -> Gains:
        """Return the gains of a point."""
        return gains_at(point, self.pace)

    def with_gains(self, gains: Gains) -> AnyPolicy:
        """Return the law with gains."""
        return make_guided(self.name, gains)


@dataclass(frozen=True)
class OwnLaw:
    """A law of a user's own, with its name: a dataclass with the attribute ``search``."""

    name: str
    law: Any
    space: Space

    @property
    def key(self) -> str:
        """What tells it from other laws: its name, and a digest of its source."""
        source = inspect.getsourcefile(self.law.__class__) or self.name
        return f"{self.name} {hashlib.sha256(Path(source).read_bytes()).hexdigest()[:16]}"

    def starts(self) -> list[Gains]:
        """Return the point where its search begins: its own gains."""
        return [
            {name: within(space, getattr(self.law, name)) for name, space in self.space.items()}
        ]

    def gains(self, point: Mapping[str, float | bool]) -> Gains:
        """Return the gains of a point."""
        return {name: rounded(value) for name, value in point.items()}

    def with_gains(self, gains: Gains) -> AnyPolicy:
        """Return the law with gains."""
        return cast(AnyPolicy, replace(self.law, **gains))


def find_law(name: str, pace: float, scenario: str) -> NamedLaw | OwnLaw:
    """Return the law that a user names: a controller, or ``FILE.py:attribute``.

    Raises
    ------
    ParameterError
        If there is none, or its ``search`` does not hold ranges of its fields.
    """
    if not is_code(name):
        if name not in TUNABLE:
            raise unknown_name("controller", name, (*TUNABLE, "FILE.py:Law"))
        return NamedLaw(name, pace, scenario)
    law: Any = find_policy(name)
    search = getattr(law, SEARCH, None)
    if not is_dataclass(law) or not isinstance(search, Mapping) or not search:
        raise ParameterError(
            f"controller must be a dataclass with {SEARCH} = {{'gain': (low, high), …}}, "
            f"which {name!r}, a {type(law).__name__}, is not"
        )
    known = [item.name for item in fields(law)]
    ranges = {
        gain: _space(gain, given, known)
        for gain, given in cast("Mapping[str, Any]", search).items()
    }
    return OwnLaw(name, law, ranges)


def _space(gain: str, given: Any, known: list[str]) -> Range | tuple[bool, bool]:
    if gain not in known:
        raise unknown_name(SEARCH, gain, known)
    match given:
        case (False, True):
            return SWITCH
        case (low, high) if is_finite(low) and is_finite(high) and low < high:
            return Range(low, high, log=low > 0.0)
        case _:
            raise ParameterError(
                f"{SEARCH}[{gain!r}] must be (low, high) or (False, True), got {given!r:.100}"
            )
