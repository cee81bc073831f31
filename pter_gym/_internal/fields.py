"""How fields are declared and checked: unit, provenance and range of each, one form of message."""

import math
from collections.abc import Callable
from dataclasses import MISSING, field, fields
from functools import cache
from operator import attrgetter
from typing import Any, Literal, cast, get_args, get_origin, get_type_hints

from pter_gym._internal.checks import builtin, is_finite
from pter_gym.errors import ParameterError

MAX_NUMBER = 1e12
"""Largest size of a number that has no bound of its own."""

MIN_POSITIVE = 1e-12
"""Smallest size of a number that has to be positive. Products of such numbers do not underflow."""


def parameter(
    unit: str, provenance: str, *, default: Any = MISSING, later: bool = False, **limits: float
) -> Any:
    """Declare a field with its unit, its provenance and the limits that ``Checked`` requires.

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
    metadata = {"unit": unit, "provenance": provenance, "later": later, "limits": limits}
    return field(default=default, metadata=metadata)


@cache
def types_of(kind: type) -> dict[str, Any]:
    """Return the types of a class's fields by name, also where its module has them as text.

    Raises
    ------
    ParameterError
        If the module does not have a type that it names.
    """
    try:
        return get_type_hints(kind)
    except NameError as error:
        raise ParameterError(f"{kind.__name__} must have fields of known types: {error}") from None


class Checked:
    """Base of frozen dataclasses that check each field: its type, and the limits of ``parameter``.

    NumPy's numbers become Python's, also in tuples.

    Raises
    ------
    ParameterError
        If a field has a wrong type or is out of range; the message names the field and what it
        accepts.
    """

    def __post_init__(self) -> None:
        """Check each field by itself."""
        for require_fit, name, accepted, limits in _checks_of(type(self)):
            require_fit(self, name, *accepted, **limits)


@cache
def _checks_of(
    kind: type,
) -> tuple[tuple[Callable[..., None], str, tuple[Any, ...], dict[str, Any]], ...]:
    """Return what is required of each field of a class: by which function, and its arguments."""
    types = types_of(kind)

    def check_of(item: Any) -> tuple[Callable[..., None], tuple[Any, ...]] | None:
        hint: Any = types[item.name]
        if hint is float:
            return require_number, ()
        if hint is int:
            return require_whole, ()
        if get_origin(hint) is tuple and get_args(hint)[0] is float:
            return require_numbers, ()
        if get_origin(hint) is Literal:
            return require_option, get_args(hint)
        return (require_kind, (hint,)) if isinstance(hint, type) else None

    checks = ((item, check_of(item)) for item in fields(cast("Any", kind)))
    return tuple(
        (check[0], item.name, check[1], item.metadata.get("limits", {}))
        for item, check in checks
        if check
    )


def plain_field(owner: object, name: str) -> Any:
    """Return a field's value; a number of NumPy's in it becomes Python's, also within a tuple."""
    value: Any = getattr(owner, name)
    if type(value) is float:
        return value
    is_tuple = isinstance(value, tuple)
    plain = tuple(map(builtin, cast("tuple[Any, ...]", value))) if is_tuple else builtin(value)
    object.__setattr__(owner, name, plain)
    return plain


def require(condition: bool, owner: object, name: str, accepted: str, *, got: Any = None) -> None:
    """Raise a ParameterError that names a field and what it accepts, unless a condition holds.

    ``got`` is what the message shows in place of the field's value; a name may have several parts.
    """
    if not condition:
        value = attrgetter(name)(owner) if got is None else got
        raise ParameterError(
            f"{type(owner).__name__}.{name} must be {accepted}, got {value!r:.200}"
        )


def require_number(owner: object, name: str, **bounds: float) -> None:
    """Raise a ParameterError unless a field is a finite number; bounds as in ``check_number``."""
    check_number(f"{type(owner).__name__}.{name}", plain_field(owner, name), **bounds)


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
        accepted = [f"{sign}{bound:g}" for sign, bound in bounds if math.isfinite(bound)]
        if min(at_most, below) == math.inf:
            accepted.append(f"at most {MAX_NUMBER:g}{'' if accepted else ' in size'}")
        raise ParameterError(
            f"{field} must be {' and '.join(['a finite number', *accepted])}, got {value!r:.400}"
        )


def require_whole(owner: object, name: str, *, at_least: int = 1, below: float = math.inf) -> None:
    """Raise a ParameterError unless a field is a whole number within a range."""
    value = plain_field(owner, name)
    fits = type(value) is not bool and isinstance(value, int) and at_least <= value < below
    accepted = f"a whole number ≥ {at_least}{f' and < {below:g}' if math.isfinite(below) else ''}"
    require(fits, owner, name, accepted)


def require_option(owner: object, name: str, *options: object) -> None:
    """Raise a ParameterError unless a field is one of these values."""
    accepted = f"one of {', '.join(map(str, options))}"
    require(getattr(owner, name) in options, owner, name, accepted)


def require_kind(owner: object, name: str, *kinds: type) -> None:
    """Raise a ParameterError unless the field is of one of these types."""
    value = plain_field(owner, name)
    accepted = " or ".join(kind.__name__ for kind in kinds)
    require(isinstance(value, kinds), owner, name, f"of type {accepted}")


def require_flag(owner: object, name: str) -> None:
    """Raise a ParameterError unless the field is True or False."""
    require_kind(owner, name, bool)


def require_numbers(
    owner: object, name: str, *, count: int | None = None, at_least: float = -MAX_NUMBER
) -> None:
    """Raise a ParameterError unless a field is a tuple of ``count`` numbers ≥ ``at_least``."""
    value = plain_field(owner, name)
    numbers = cast("tuple[float, ...]", value) if isinstance(value, tuple) else ()
    fits = numbers is value and all(is_finite(x) and at_least <= x <= MAX_NUMBER for x in numbers)
    size = "" if count is None else f"{count} "
    accepted = f"a tuple of {size}finite numbers from {at_least:g} to {MAX_NUMBER:g}"
    require(fits and count in (None, len(numbers)), owner, name, accepted)
