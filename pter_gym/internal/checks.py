"""Checks of arguments."""

import operator
from typing import Any

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
