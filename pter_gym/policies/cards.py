"""The card of a policy: all but the weights, as JSON. What is read is checked before it is believed."""

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from itertools import pairwise
from typing import Any, cast

from pter_gym.compiled.layout import Layout
from pter_gym.errors import DataError, ParameterError
from pter_gym.policies.interface import Base, Input, Interface

FORMAT = 1
"""Version of the format."""

ENVIRONMENT = "PTER/PathFollowing-v0"
"""Environment whose observations and actions these policies are made for."""

OUTPUTS = 4

MOST_INPUTS, MOST_UNITS, MOST_LAYERS = 256, 1024, 8
"""Largest sizes of a network."""

DEEPEST = 8
"""Deepest nesting of a card."""

KEYS = ("format", "name", "environment", "observation", "voltage_max", "interface", "hidden", "weights_sha256", "about")

Fields = tuple[tuple[str, str, float], ...]


@dataclass(frozen=True)
class Card:
    """What a policy is.

    Attributes
    ----------
    name
        Its name.
    observation
        Name, unit and scale of each entry of the observations that it was trained on.
    voltage_max
        Largest voltage of its clutches [V].
    interface
        What its network sees and does.
    hidden
        Units of the hidden layers.
    weights_sha256
        SHA-256 of the file of weights.
    about
        Scenario, training command, versions, scores: for people, nothing acts on it.
    environment
        Id of the environment.
    """

    name: str
    observation: Fields
    voltage_max: float
    interface: Interface
    hidden: tuple[int, ...]
    weights_sha256: str
    about: Mapping[str, Any] = field(default_factory=dict[str, Any])
    environment: str = ENVIRONMENT

    @property
    def shapes(self) -> dict[str, tuple[int, ...]]:
        """Names and shapes of the tensors that belong to it."""
        sizes = (self.interface.size, *self.hidden, OUTPUTS)
        found: dict[str, tuple[int, ...]] = {}
        for k, (before, after) in enumerate(pairwise(sizes)):
            found[f"layer_{k}.weight"] = (after, before)
            found[f"layer_{k}.bias"] = (after,)
        return found

    def check_layout(self, layout: Layout) -> None:
        """Raise a ParameterError unless observations of this layout are those that the policy was trained on."""
        other = fields_of(layout)
        if other != self.observation:
            raise ParameterError(
                f"policy {self.name!r} needs observations with the entries {_told(self.observation)}; "
                f"these have {_told(other)}"
            )

    def as_json(self) -> dict[str, Any]:
        """Return plain data."""
        return {
            "format": FORMAT,
            "name": self.name,
            "environment": self.environment,
            "observation": [{"name": name, "unit": unit, "scale": scale} for name, unit, scale in self.observation],
            "voltage_max": self.voltage_max,
            "interface": asdict(self.interface),
            "hidden": list(self.hidden),
            "weights_sha256": self.weights_sha256,
            "about": dict(self.about),
        }


def fields_of(layout: Layout) -> Fields:
    """Return name, unit and scale of each entry of a layout."""
    return tuple((each.name, each.unit, each.scale) for each in layout.fields)


def _told(entries: Fields) -> str:
    return ", ".join(f"{name} [{scale:g} {unit}]" for name, unit, scale in entries)


def read_card(data: bytes, what: str) -> Card:
    """Return the card in the bytes of a file.

    Parameters
    ----------
    data
        The file's content.
    what
        The file's name, for messages.

    Raises
    ------
    DataError
        If it is no whole card of this format, or made for another environment.
    """
    try:
        content = json.loads(data.decode("utf-8"), parse_constant=_refuse, object_pairs_hook=_unique)
        _check_depth(content, DEEPEST)
        _check_keys(content, KEYS, "card")
        if content["format"] != FORMAT:
            raise ValueError(f"format must be {FORMAT}, got {content['format']!r}")
        if content["environment"] != ENVIRONMENT:
            raise ValueError(f"it is made for {content['environment']!r}, this is {ENVIRONMENT!r}")
        return _card(content)
    except (ValueError, TypeError, OverflowError, RecursionError) as error:
        raise DataError(f"policy card {what} is refused: {error}") from None


def read_interface(content: Any) -> Interface:
    """Return an interface from plain data, as ``dataclasses.asdict`` gives it.

    Raises
    ------
    ValueError
        If it is not one.
    """
    _check_keys(content, ("inputs", "reach", "base", "history", "averages"), "interface")
    entries = _list(content["inputs"], "inputs", MOST_INPUTS)
    for entry in entries:
        _check_keys(entry, ("name", "center", "scale"), "input")
    base: Any = content["base"]
    return Interface(
        inputs=tuple(Input(**entry) for entry in entries),
        reach=_number(content["reach"], "reach"),
        base=None if base is None else _base(base),
        history=tuple(_list(content["history"], "history", MOST_LAYERS, at_least=0)),
        averages=tuple(_list(content["averages"], "averages", MOST_LAYERS, at_least=0)),
    )


def _card(content: dict[str, Any]) -> Card:
    observation: list[tuple[str, str, float]] = []
    for entry in _list(content["observation"], "observation", MOST_INPUTS):
        _check_keys(entry, ("name", "unit", "scale"), "observation")
        scale = _number(entry["scale"], "scale")
        observation.append((_text(entry["name"], "name"), _text(entry["unit"], "unit"), scale))
    hidden = _list(content["hidden"], "hidden", MOST_LAYERS)
    for size in hidden:
        if type(size) is not int or not 1 <= size <= MOST_UNITS:
            raise ValueError(f"hidden must hold whole numbers from 1 to {MOST_UNITS}, got {size!r}")
    if not isinstance(content["about"], dict):
        raise ValueError("about must be an object")
    return Card(
        name=_text(content["name"], "name"),
        observation=tuple(observation),
        voltage_max=_number(content["voltage_max"], "voltage_max"),
        interface=read_interface(content["interface"]),
        hidden=tuple(hidden),
        weights_sha256=_text(content["weights_sha256"], "weights_sha256"),
        about=cast(dict[str, Any], content["about"]),
    )


def _base(content: Any) -> Base:
    _check_keys(content, ("controller", "paces", "gains"), "base")
    gains = _list(content["gains"], "gains", MOST_INPUTS)
    if not all(isinstance(each, dict) for each in gains):
        raise ValueError("gains must be objects")
    paces = [_number(pace, "paces") for pace in _list(content["paces"], "paces", MOST_INPUTS)]
    return Base(controller=_text(content["controller"], "controller"), paces=tuple(paces), gains=tuple(gains))


def _check_keys(content: Any, keys: tuple[str, ...], what: str) -> None:
    if not isinstance(content, dict) or set(cast(dict[str, Any], content)) != set(keys):
        raise ValueError(f"{what} must be an object with {', '.join(keys)}")


def _list(value: Any, what: str, most: int, *, at_least: int = 1) -> list[Any]:
    if not isinstance(value, (list, tuple)) or not at_least <= len(cast(list[Any], value)) <= most:
        raise ValueError(f"{what} must be a list of {at_least} to {most}")
    return list(cast(list[Any], value))


def _number(value: Any, what: str) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value) or value <= 0.0:
        raise ValueError(f"{what} must be a finite number > 0, got {value!r}")
    return float(value)


def _text(value: Any, what: str) -> str:
    if not isinstance(value, str):
        raise ValueError(f"{what} must be a string, got {value!r}")
    return value


def _check_depth(content: Any, left: int) -> None:
    if left == 0:
        raise ValueError(f"it is nested deeper than {DEEPEST}")
    if isinstance(content, (dict, list)):
        parts = cast(list[Any], list(content.values()) if isinstance(content, dict) else content)  # pyright: ignore[reportUnknownArgumentType]
        for part in parts:
            _check_depth(part, left - 1)


def _refuse(constant: str) -> float:
    raise ValueError(f"numbers are finite, and not {constant}")


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) != len(pairs):
        raise ValueError("a name stands twice in one object")
    return found
