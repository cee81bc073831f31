"""How parameters are declared and checked: a unit and a provenance for each field, one message for each bad value."""

import math
from dataclasses import field
from numbers import Integral
from pathlib import Path
from typing import Any, cast

from pter_gym._internal.checks import is_finite
from pter_gym._internal.reading import parse_toml
from pter_gym.errors import ParameterError

SHIPPED = parse_toml((Path(__file__).parents[1] / "presets" / "pter.toml").read_text("utf-8"))
"""The numbers that the paper does not print: value, unit and source (``from``) by section and field."""

LARGEST = 1e12
"""Largest size of a number that has no bound of its own."""

SMALLEST = 1e-12
"""Smallest size of a number that has to be positive. Products of such numbers do not underflow."""


def quantity(unit: str, provenance: str, *, later: bool = False, **options: Any) -> Any:
    """Declare a field with its unit and where its value comes from; ``options`` go to ``dataclasses.field``.

    A field added ``later`` is stored only if it differs from its default, so that older stored data keep their bytes.
    """
    return field(metadata={"unit": unit, "provenance": provenance, "later": later}, **options)


def preset(section: str, name: str) -> Any:
    """Declare a field with unit, provenance and value from the preset that the package ships."""
    entry = SHIPPED[section][name]
    value = entry["value"]
    return quantity(
        entry["unit"], entry["from"], default=tuple(cast("list[float]", value)) if isinstance(value, list) else value
    )


def require(condition: bool, owner: object, name: str, value: object, accepted: str) -> None:
    """Raise a ParameterError that names the field and what it accepts, unless the condition holds."""
    if not condition:
        raise ParameterError(f"{type(owner).__name__}.{name} must be {accepted}, got {value!r:.200}")


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

    A range without an upper bound ends at ``LARGEST``; one that excludes 0 begins at ``SMALLEST``.
    """
    bounds = (("> ", above), ("≥ ", at_least), ("≤ ", at_most), ("< ", below))
    told = [f"{sign}{bound:g}" for sign, bound in bounds if math.isfinite(bound)]
    if min(at_most, below) == math.inf:
        told.append(f"at most {LARGEST:g}" if told else f"at most {LARGEST:g} in size")
    least = SMALLEST if above == 0.0 else max(at_least, -LARGEST)
    if not (is_finite(value) and least <= value <= min(at_most, LARGEST) and above < value < below):
        accepted = " and ".join(["a finite number", *told])
        raise ParameterError(f"{field} must be {accepted}, got {value!r:.400}")


def require_whole(owner: object, name: str, *, at_least: int = 1, below: float = math.inf) -> None:
    """Raise a ParameterError unless the field of a frozen dataclass is a whole number within the range.

    It is converted to an int, so NumPy's integer types are accepted too.
    """
    given: Any = getattr(owner, name)
    fits = type(given) is not bool and isinstance(given, Integral) and at_least <= int(given) < below
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
    value = getattr(owner, name)
    require(isinstance(value, bool), owner, name, value, "True or False")


def require_numbers(owner: object, name: str, accepted: str, *, count: int | None = None) -> None:
    """Raise a ParameterError unless the field is a tuple of finite real numbers, of the given count.

    No number may exceed ``LARGEST`` in magnitude.
    """
    value: Any = getattr(owner, name)
    numbers = cast("tuple[float, ...]", value) if isinstance(value, tuple) else None
    fits = numbers is not None and all(map(is_finite, numbers)) and (count is None or len(numbers) == count)
    require(fits, owner, name, cast(Any, value), accepted)
    small = all(abs(x) <= LARGEST for x in numbers or ())
    require(small, owner, name, numbers, f"of numbers of at most {LARGEST:g} in size")
