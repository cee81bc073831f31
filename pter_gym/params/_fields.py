"""How parameters are declared and checked: a unit, a provenance and a range for each field, one form of message."""

import math
from dataclasses import MISSING, field, fields
from numbers import Integral
from pathlib import Path
from typing import Any, Literal, cast, get_args, get_origin

from pter_gym._internal.checks import is_finite
from pter_gym._internal.reading import parse_toml
from pter_gym.errors import ParameterError

SHIPPED = parse_toml((Path(__file__).parents[1] / "presets" / "pter.toml").read_text("utf-8"))
"""The numbers that the paper does not print: value, unit and source (``from``) by section and field."""

MAX_NUMBER = 1e12
"""Largest size of a number that has no bound of its own."""

MIN_POSITIVE = 1e-12
"""Smallest size of a number that has to be positive. Products of such numbers do not underflow."""


def quantity(
    unit: str, provenance: str, *, default: Any = MISSING, later: bool = False, **limits: float
) -> Any:
    """Declare a field with its unit, where its value comes from, and the limits that ``Checked``
    requires.

    Parameters
    ----------
    unit, provenance, default
        Unit of the value, its source, and its default, if it has one.
    later
        Whether the field is stored only if it differs from its default, so that older stored data
        keep their bytes.
    **limits
        Keywords of ``check_number`` or, for a tuple, of ``require_numbers``.
    """
    told = {"unit": unit, "provenance": provenance, "later": later, "limits": limits}
    return field(default=default, metadata=told)


def preset(section: str, name: str, **limits: Any) -> Any:
    """Declare a field with unit, provenance and value from the preset that the package ships, and its limits."""
    entry = SHIPPED[section][name]
    value = (
        tuple(cast("list[float]", entry["value"]))
        if isinstance(entry["value"], list)
        else entry["value"]
    )
    return quantity(entry["unit"], entry["from"], default=value, **limits)


class Checked:
    """Base of frozen dataclasses that check each field by its annotation and by the limits that
    ``quantity`` declares.

    Raises
    ------
    ParameterError
        If a field has a wrong type or is out of range; the message names the field and what it
        accepts.
    """

    def __post_init__(self) -> None:
        """Check each field by itself."""
        for item in fields(cast(Any, self)):
            kind, limits, name = cast(Any, item.type), item.metadata.get("limits", {}), item.name
            if kind is float:
                require_number(self, name, **limits)
            elif kind is int:
                require_whole(self, name, **limits)
            elif get_origin(kind) is tuple and get_args(kind)[0] is float:
                require_numbers(self, name, **limits)
            elif get_origin(kind) is Literal:
                value = getattr(self, name)
                require(
                    value in get_args(kind),
                    self,
                    name,
                    value,
                    f"one of {', '.join(get_args(kind))}",
                )
            elif isinstance(kind, type):
                require_kind(self, name, kind)


def require(condition: bool, owner: object, name: str, value: object, accepted: str) -> None:
    """Raise a ParameterError that names the field and what it accepts, unless the condition holds."""
    if not condition:
        raise ParameterError(
            f"{type(owner).__name__}.{name} must be {accepted}, got {value!r:.200}"
        )


def require_number(owner: object, name: str, **bounds: float) -> None:
    """Raise a ParameterError unless the field is a finite real number within bounds; see ``check_number``."""
    check_number(f"{type(owner).__name__}.{name}", getattr(owner, name), **bounds)


def check_number(
    field: str,
    value: Any,
    *,
    above: float = -math.inf,
    at_least: float = -math.inf,
    at_most: float = math.inf,
    below: float = math.inf,
) -> None:
    """Raise a ParameterError unless a value is a finite real number within the range.

    A range without an upper bound ends at ``MAX_NUMBER``; one that excludes 0 begins at
    ``MIN_POSITIVE``.
    """
    least = MIN_POSITIVE if above == 0.0 else max(at_least, -MAX_NUMBER)
    if not (
        is_finite(value) and least <= value <= min(at_most, MAX_NUMBER) and above < value < below
    ):
        bounds = (("> ", above), ("≥ ", at_least), ("≤ ", at_most), ("< ", below))
        told = [f"{sign}{bound:g}" for sign, bound in bounds if math.isfinite(bound)]
        if min(at_most, below) == math.inf:
            told.append(f"at most {MAX_NUMBER:g}" if told else f"at most {MAX_NUMBER:g} in size")
        raise ParameterError(
            f"{field} must be {' and '.join(['a finite number', *told])}, got {value!r:.400}"
        )


def require_whole(owner: object, name: str, *, at_least: int = 1, below: float = math.inf) -> None:
    """Raise a ParameterError unless the field of a frozen dataclass is a whole number within the
    range.

    It is converted to an int, so NumPy's integer types are accepted too.
    """
    given: Any = getattr(owner, name)
    fits = (
        type(given) is not bool and isinstance(given, Integral) and at_least <= int(given) < below
    )
    accepted = f"a whole number ≥ {at_least}{f' and < {below:g}' if math.isfinite(below) else ''}"
    require(fits, owner, name, given, accepted)
    object.__setattr__(owner, name, int(given))


def require_kind(owner: object, name: str, *kinds: type) -> None:
    """Raise a ParameterError unless the field is of one of these types."""
    value = getattr(owner, name)
    accepted = " or ".join(kind.__name__ for kind in kinds)
    require(isinstance(value, kinds), owner, name, value, f"of type {accepted}")


def require_flag(owner: object, name: str) -> None:
    """Raise a ParameterError unless the field is True or False."""
    require_kind(owner, name, bool)


def require_numbers(
    owner: object, name: str, *, count: int | None = None, at_least: float = -MAX_NUMBER
) -> None:
    """Raise a ParameterError unless the field is a tuple of numbers ≥ ``at_least``, of the given count."""
    value: Any = getattr(owner, name)
    numbers = cast("tuple[float, ...]", value) if isinstance(value, tuple) else ()
    fits = numbers is value and all(is_finite(x) and at_least <= x <= MAX_NUMBER for x in numbers)
    accepted = f"a tuple of {'' if count is None else f'{count} '}finite numbers from {at_least:g} to {MAX_NUMBER:g}"
    require(fits and count in (None, len(numbers)), owner, name, cast(Any, value), accepted)
