"""How parameters are declared and checked: a unit and a provenance for each field, one message for each bad value."""

import math
from dataclasses import MISSING, field, fields
from typing import Any, cast

from pter_gym.errors import ParameterError
from pter_gym.internal.codec import declared
from pter_gym.params.preset import PRESET


def quantity(unit: str, provenance: str, *, absent: Any = MISSING, **options: Any) -> Any:
    """Declare a field with its unit and where its value comes from.

    A field that is added to a stored dataclass needs ``absent``: the value with which data from before the field mean
    what they meant.
    """
    return field(metadata={"unit": unit, "provenance": provenance, **declared(absent)}, **options)


def preset(section: str, name: str) -> Any:
    """Declare a field with unit, provenance and value from the preset that the package ships."""
    values = getattr(PRESET, section)
    unit = next(item.metadata["unit"] for item in fields(values) if item.name == name)
    return quantity(unit, PRESET.provenance[f"{section}.{name}"], default=getattr(values, name))


def require(condition: bool, owner: object, name: str, value: object, accepted: str) -> None:
    """Raise a ParameterError that names the field and what it accepts, unless the condition holds."""
    if not condition:
        raise ParameterError(f"{type(owner).__name__}.{name} must be {accepted}, got {value!r}")


def require_number(
    owner: object,
    name: str,
    *,
    above: float = -math.inf,
    at_least: float = -math.inf,
    at_most: float = math.inf,
    below: float = math.inf,
) -> None:
    """Raise a ParameterError unless the field is a finite real number within the range."""
    value = getattr(owner, name)
    bounds = [
        f"{sign} {bound:g}"
        for sign, bound in ((">", above), ("≥", at_least), ("≤", at_most), ("<", below))
        if math.isfinite(bound)
    ]
    accepted = " and ".join(["a finite number", *bounds])
    is_number = isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)
    require(
        is_number and above < value and at_least <= value <= at_most and value < below, owner, name, value, accepted
    )


def require_kind(owner: object, name: str, *kinds: type) -> None:
    """Raise a ParameterError unless the field is of one of these types."""
    value = getattr(owner, name)
    accepted = " or ".join(kind.__name__ for kind in kinds)
    require(isinstance(value, kinds), owner, name, value, f"of type {accepted}")


def require_flag(owner: object, name: str) -> None:
    """Raise a ParameterError unless the field is True or False."""
    value = getattr(owner, name)
    require(isinstance(value, bool), owner, name, value, "True or False")


def require_numbers(owner: object, name: str, accepted: str, *, count: int | None = None) -> None:
    """Raise a ParameterError unless the field is a tuple of finite real numbers, of the given count."""
    value = getattr(owner, name)
    require(isinstance(value, tuple), owner, name, value, accepted)
    numbers = cast(tuple[object, ...], value)
    fits = all(isinstance(x, (int, float)) and math.isfinite(x) for x in numbers)
    require(fits and (count is None or len(numbers) == count), owner, name, numbers, accepted)
