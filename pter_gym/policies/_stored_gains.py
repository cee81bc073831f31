"""Gains of controllers as plain data: by name, in SI."""

from collections.abc import Mapping
from dataclasses import fields
from typing import TYPE_CHECKING, Any

from pter_gym._internal.codec import tuple_of
from pter_gym.errors import ParameterError, unknown_name

if TYPE_CHECKING:
    from pter_gym.controllers import Guided


def gains_of(controller: "Guided") -> dict[str, Any]:
    """Return all gains of a controller by name."""
    return {item.name: getattr(controller, item.name) for item in fields(controller)}


def make_guided(name: str, gains: Mapping[str, Any]) -> "Guided":
    """Return a controller by its name in ``CONTROLLERS``; unnamed gains take their defaults.

    Raises
    ------
    ParameterError
        If there is no such controller or gain (the nearest is suggested), or a gain is rejected.
    """
    from pter_gym.controllers import (
        CONTROLLERS,
        Guided,
    )  # loads numba, which policies without a base do not need

    guided = {known: kind for known, kind in CONTROLLERS.items() if issubclass(kind, Guided)}
    if name not in guided:
        raise unknown_name("controller", name, guided)
    known = [item.name for item in fields(guided[name])]
    for gain in gains:
        if gain not in known:
            raise ParameterError(
                f"{name} has no gain {gain!r}: {unknown_name('gains', gain, known)}"
            )
    return guided[name](**{gain: tuple_of(value) for gain, value in gains.items()})
