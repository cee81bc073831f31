"""Checks of arguments."""

import operator
import os
import sys
from collections.abc import Iterable
from itertools import pairwise
from typing import Any, cast

from pter_gym.errors import ParameterError


def whole_number(field: str, value: Any, *, at_least: int = 1) -> int:
    """Return a whole number, or raise a ParameterError that names the field."""
    try:
        number = operator.index(value)
    except TypeError:
        number = at_least - 1
    if number < at_least or isinstance(value, bool):
        raise ParameterError(f"{field} must be a whole number ≥ {at_least}, got {value!r}")
    return number


def are_rising(steps: object, largest: int) -> bool:
    """Return whether these are rising whole numbers from 1 to the largest, in a tuple."""
    numbers: tuple[Any, ...] = cast("Any", steps) if isinstance(steps, tuple) else (None,)
    whole = all(type(number) is int for number in numbers)
    return whole and all(a < b for a, b in pairwise((0, *numbers, largest + 1)))


def builtin(value: Any) -> Any:
    """Return a number of NumPy's or a path as Python's own, and anything else as it is."""
    if isinstance(value, os.PathLike):
        return os.fspath(cast("os.PathLike[str]", value))
    is_numpy = hasattr(value, "item") and getattr(value, "ndim", None) == 0
    return value.item() if is_numpy else value


def is_finite(value: object) -> bool:
    """Return whether a value is a number of Python's that a float64 holds; True is not."""
    return (
        isinstance(value, (int, float))
        and not isinstance(value, bool)
        and abs(value) <= sys.float_info.max
    )


def names_in(field: str, names: Iterable[Any]) -> list[Any]:
    """Return a list of names, also of a single one, or raise a ParameterError if it is empty."""
    value: Any = names
    single = isinstance(value, (str, os.PathLike)) and value != ""
    several = isinstance(cast("object", names), Iterable)
    listed: list[Any] = [value] if single else list(names) if several else []
    if not listed or isinstance(value, bytes):
        raise ParameterError(f"{field} must hold at least one name, in a list, got {value!r:.200}")
    return listed
