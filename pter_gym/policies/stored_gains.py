"""Gains of controllers as stored data, which may name only some: the others are those of when they were written.

``pter_gym/presets/gain_defaults.toml`` has the defaults of all data that do not hold their own.
"""

import tomllib
from collections.abc import Mapping
from dataclasses import fields
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pter_gym.errors import ParameterError, unknown_name
from pter_gym.internal.codec import completed, stored_fields, tuple_of

if TYPE_CHECKING:
    from pter_gym.controllers import Guided

DEFAULTS = Path(__file__).parents[1] / "presets" / "gain_defaults.toml"
"""Gains that data rely on which neither name them nor hold defaults."""

Values = Mapping[str, Any]


def gains_of(controller: "Guided") -> dict[str, Any]:
    """Return all gains of a controller by name."""
    return {item.name: getattr(controller, item.name) for item in fields(controller)}


def make_guided(name: str, gains: Values) -> "Guided":
    """Return a controller; gains that are not named are its defaults of today.

    Raises
    ------
    ParameterError
        If there is no such controller or gain, which tells the nearest, or a gain is refused.
    """
    return _kind(name, gains)(**{gain: tuple_of(value) for gain, value in gains.items()})


def restore_guided(name: str, gains: Values, defaults: Values | None = None) -> "Guided":
    """Return a controller from stored gains.

    Parameters
    ----------
    name
        In ``pter_gym.controllers.CONTROLLERS``.
    gains
        Those that the data name.
    defaults
        Those that the data rely on and do not name; by default, those in ``DEFAULTS``.

    Raises
    ------
    ParameterError
        If a gain is unknown or refused, or is in neither and does not declare what its absence meant.
    """
    named = {**(_defaults().get(name, {}) if defaults is None else defaults), **gains}
    return make_guided(name, completed(_kind(name, named), named))


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


@cache
def _defaults() -> Mapping[str, Values]:
    return tomllib.loads(DEFAULTS.read_text(encoding="utf-8"))
