"""Laws whose gains can be searched: dataclasses with ``search``, the ranges of their gains."""

import hashlib
import inspect
import math
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, fields, is_dataclass, replace
from pathlib import Path
from typing import Any, cast

from pter_gym._internal.checks import is_finite
from pter_gym.controllers import AnyPolicy, Guided, PaceSchedule
from pter_gym.errors import ParameterError, unknown_name
from pter_gym.policies.find import find_policy, kind_of
from pter_gym.policies.tuned import SUFFIX, tuned_policies
from pter_gym.tasks.path_following import PathFollowing

__all__ = ["Range", "TunableLaw", "find_law"]

Gains = dict[str, float | bool]

BRAKING, DAMPING = "braking", "damping_tangential"
"""Of a guiding law, the force [N] that is searched, and the damper that it stands for."""

SHOWS: dict[str, Callable[[PathFollowing], bool]] = {
    "curvature": lambda task: task.path.max_curvature > 0.0
}
"""Whether an entry of the observation is ever other than 0 in a task."""

DIGITS = 4
"""Significant digits of a gain: what is printed is what was tried."""


@dataclass(frozen=True)
class Range:
    """Numbers from low to high, logarithmic where low > 0 and otherwise uniform."""

    low: float
    high: float

    @property
    def log(self) -> bool:
        """Whether the logarithm of the number is what is searched."""
        return self.low > 0.0

    def share(self, number: float) -> float:
        """Return where a number lies: 0 at the lower end, 1 at the upper one."""
        number, low, high = map(math.log if self.log else float, (number, self.low, self.high))
        return (number - low) / (high - low)

    def at(self, share: float) -> float:
        """Return the number that lies there."""
        low, high = map(math.log if self.log else float, (self.low, self.high))
        number = low + share * (high - low)
        return min(max(math.exp(number) if self.log else number, self.low), self.high)


Space = dict[str, Range | tuple[bool, bool]]
"""By the name of a gain its range, or ``(False, True)`` if it is on or off."""


@dataclass(frozen=True)
class TunableLaw:
    """A law at a commanded pace [m/s], and the coordinates of its search.

    Attributes
    ----------
    name, key
        Its name, and what identifies it: with a digest of its source if it is a user's.
    law
        The law with its default gains.
    pace
        Commanded pace [m/s].
    space
        What is searched: its gains, but of a guiding law ``braking`` in place of its damper.
    known
        Laws of its kind whose gains the search begins with, with the paces that they are for.
    """

    name: str
    key: str
    law: Any
    pace: float
    space: Space
    known: tuple[tuple[float, Any], ...]

    def shown_by(self, tasks: Collection[PathFollowing]) -> "TunableLaw":
        """Return the law without the gains that have no effect in any of these tasks.

        Raises
        ------
        ParameterError
            If one of its ``needs`` is not in ``SHOWS``.
        """
        space = dict(self.space)
        for gain, entry in getattr(self.law, "needs", {}).items():
            if entry not in SHOWS:
                raise unknown_name("needs", entry, SHOWS)
            if not any(map(SHOWS[entry], tasks)):
                space.pop(gain, None)
        return replace(self, space=space)

    def starts(self) -> list[Gains]:
        """Return the points of the search that are nearest to the known gains."""
        return [self._point(law, pace) for pace, law in self.known]

    def gains(self, point: Mapping[str, float | bool]) -> Gains:
        """Return the gains of a point, with ``DIGITS`` significant digits."""
        gains = dict(point)
        if BRAKING in gains:
            excess = self.pace * (1.0 - _rounded(gains["pace_fraction"]))
            gains = {DAMPING: gains.pop(BRAKING) / excess, **gains}
        return {name: _rounded(gain) for name, gain in gains.items()}

    def with_gains(self, gains: Gains) -> AnyPolicy:
        """Return the law with gains."""
        return cast(AnyPolicy, replace(self.law, **gains))

    def _point(self, law: Any, pace: float) -> Gains:
        gains = {item.name: getattr(law, item.name) for item in fields(law)}
        if BRAKING in self.space:
            gains[BRAKING] = gains[DAMPING] * pace * (1.0 - gains["pace_fraction"])
        return {
            name: min(max(gains[name], space.low), space.high)
            if isinstance(space, Range)
            else bool(gains[name])
            for name, space in self.space.items()
        }


def find_law(name: str, pace: float, scenario: str) -> TunableLaw:
    """Return the law that a user names, or ``FILE.py:attribute``.

    Raises
    ------
    ParameterError
        If there is none, or its ``search`` does not hold ranges of its fields.
    """
    kind = kind_of(name, "law", ("law", "code"))
    law: Any = find_policy(name, scenario=None)
    search = getattr(law, "search", None)
    if not is_dataclass(law) or not isinstance(search, Mapping) or not search:
        raise ParameterError(
            "law must be a dataclass with search = {'gain': (low, high), …}, "
            f"which {name!r}, a {type(law).__name__}, is not"
        )
    gains = [item.name for item in fields(law)] + [BRAKING] * isinstance(law, Guided)
    ranges = cast("Mapping[str, Any]", search).items()
    space = {gain: _space(gain, given, gains) for gain, given in ranges}
    tuned = name + SUFFIX
    known: list[Any] = [find_policy(tuned, scenario)] if tuned in tuned_policies() else []
    known.append(find_policy(name))
    key = f"{name} {_source_digest(law)}" if kind == "code" else name
    return TunableLaw(name, key, law, pace, space, tuple(_nearest(each, pace) for each in known))


def _source_digest(law: Any) -> str:
    source = inspect.getsourcefile(law.__class__)
    return hashlib.sha256(Path(source).read_bytes()).hexdigest()[:16] if source else ""


def _nearest(policy: Any, pace: float) -> tuple[float, Any]:
    """Return a law's pace and gains that are nearest to a pace [m/s]."""
    knots = policy.knots if isinstance(policy, PaceSchedule) else ((pace, policy),)
    return min(knots, key=lambda knot: abs(math.log(knot[0] / pace)))


def _space(gain: str, given: Any, known: list[str]) -> Range | tuple[bool, bool]:
    if gain not in known:
        raise unknown_name("search", gain, known)
    match given:
        case (False, True):
            return False, True
        case (low, high) if is_finite(low) and is_finite(high) and low < high:
            return Range(low, high)
        case _:
            raise ParameterError(
                f"search[{gain!r}] must be (low, high) or (False, True), got {given!r:.100}"
            )


def _rounded(gain: float | bool) -> float | bool:
    return gain if isinstance(gain, bool) else float(f"{gain:.{DIGITS}g}")
