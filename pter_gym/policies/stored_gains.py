"""Gains of controllers as stored data."""

from collections.abc import Mapping
from dataclasses import fields
from typing import TYPE_CHECKING, Any

from pter_gym.errors import ParameterError, unknown_name
from pter_gym.internal.codec import stored_fields, tuple_of

if TYPE_CHECKING:
    from pter_gym.controllers import Guided

Values = Mapping[str, Any]


def gains_of(controller: "Guided") -> dict[str, Any]:
    """Return all gains of a controller by name."""
    return {item.name: getattr(controller, item.name) for item in fields(controller)}


def make_guided(name: str, gains: Values) -> "Guided":
    """Return a controller; gains that are not named are its defaults.

    Raises
    ------
    ParameterError
        If there is no such controller or gain, which tells the nearest, or a gain is refused.
    """
    return _kind(name, gains)(**{gain: tuple_of(value) for gain, value in gains.items()})


def _kind(name: str, gains: Values) -> "type[Guided]":
    """Return a kind of controller, or raise a ParameterError if there is none or it has no gain of some name."""
    from pter_gym.controllers import CONTROLLERS, Guided  # numba is not needed to read policies without a controller

    guided = {known: kind for known, kind in CONTROLLERS.items() if issubclass(kind, Guided)}
    if name not in guided:
        raise unknown_name("controller", name, guided)
    known = stored_fields(guided[name])
    for gain in gains:
        if gain not in known:
            raise ParameterError(f"{name} has no gain {gain!r}: {unknown_name('gains', gain, known)}")
    return guided[name]
