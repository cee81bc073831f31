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
        values = self.__dict__
        for name, fits, explain in _checks_of(type(self)):
            if not fits(values[name]):
                explain(self)


Check = tuple[str, Callable[[Any], bool], Callable[[object], None]]
"""A field's name, whether a value surely fits, and what looks more closely where it may not."""


@cache
def _checks_of(kind: type) -> tuple[Check, ...]:
    """Return the checks of a class's fields."""
    types = types_of(kind)
    checks = (_check_of(item, types[item.name]) for item in fields(cast("Any", kind)))
    return tuple(check for check in checks if check)


def _check_of(item: Any, hint: Any) -> Check | None:
    """Return the check of a field of a type; None for a type that the class itself checks."""
    name, limits = item.name, item.metadata.get("limits", {})

    def doubtful(_: object) -> bool:
        return False

    if hint is float:
        return name, _within(**limits), lambda owner: require_number(owner, name, **limits)
    if hint is int:
        return name, doubtful, lambda owner: require_whole(owner, name, **limits)
    if get_origin(hint) is tuple and get_args(hint)[0] is float:
        return name, doubtful, lambda owner: require_numbers(owner, name, **limits)
    if get_origin(hint) is Literal:
        options = get_args(hint)
        return name, doubtful, lambda owner: require_option(owner, name, *options)
    if isinstance(hint, type):
        return name, _is_a(hint), lambda owner: require_kind(owner, name, hint)
    return None


def _is_a(kind: type) -> Callable[[Any], bool]:
    """Return whether ``require_kind`` surely accepts a value, which is none of NumPy's."""
    return lambda value: (
        type(value) is kind or (isinstance(value, Checked) and isinstance(value, kind))
    )


def _within(**bounds: float) -> Callable[[Any], bool]:
    """Return whether ``check_number`` surely accepts a value: a Python float within the range."""
    low, high = MIN_POSITIVE if bounds.get("above") == 0.0 else -MAX_NUMBER, MAX_NUMBER
    low = max(low, bounds.get("at_least", low), math.nextafter(bounds.get("above", low), math.inf))
    high = min(
        high, bounds.get("at_most", high), math.nextafter(bounds.get("below", high), -math.inf)
    )
    return lambda value: type(value) is float and low <= value <= high


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
