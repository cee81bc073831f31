"""The card of a policy: everything but the weights, as JSON. A card is checked on reading, before it is used."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from itertools import pairwise
from typing import Any, cast

from pter_gym._compiled.layout import Layout
from pter_gym._internal.checks import is_finite
from pter_gym._internal.reading import parse_json, reading
from pter_gym.errors import ParameterError, unknown_name
from pter_gym.params import (
    PAPER_CLUTCHES,
    SLOTS,
    Connection,
    require,
    require_flag,
    require_kind,
    require_number,
)
from pter_gym.policies._interface import Base, Input, Interface

FORMAT = 1
"""Version of the format."""

ENVIRONMENT = "PTER/PathFollowing-v0"
"""Environment that these policies are made for."""

OUTPUTS = 4

MOST_INPUTS, MOST_UNITS, MOST_LAYERS, MOST_LSTM = 256, 1024, 8, 512
"""Largest sizes of a network: inputs, units of a layer, layers, units of an LSTM."""

ADDED = ("frame_skip", "clutches")
"""Fields that older cards lack, which mean their defaults there."""

Fields = tuple[tuple[str, str, float], ...]

PAPER_ROWS = tuple(each.row for each in PAPER_CLUTCHES)


@dataclass(frozen=True)
class Card:
    """The description of a policy.

    Attributes
    ----------
    name
        Its name.
    observation
        Name, unit and scale of each entry in the observations that it was trained on.
    voltage_max
        Largest voltage of its clutches [V].
    interface
        Inputs and outputs of its network.
    hidden
        Units of the hidden layers.
    weights_sha256
        SHA-256 of the file of weights.
    about
        Scenario, training command, versions, scores: for people; they do not affect how the policy acts.
    environment
        Id of the environment.
    squashed
        Whether the network's outputs go through tanh.
    lstm
        Units of the LSTM between the inputs and the hidden layers; 0 for none.
    clutches
        Rows of W of the clutches that it was trained with.
    """

    name: str
    observation: Fields
    voltage_max: float
    interface: Interface
    hidden: tuple[int, ...]
    weights_sha256: str
    about: Mapping[str, Any] = field(default_factory=dict[str, Any])
    environment: str = ENVIRONMENT
    squashed: bool = False
    lstm: int = 0
    clutches: tuple[tuple[float, float], ...] = PAPER_ROWS

    def __post_init__(self) -> None:
        """Check each field by itself."""
        for name in ("name", "weights_sha256", "environment"):
            require_kind(self, name, str)
        require_kind(self, "about", dict)
        require(self.environment == ENVIRONMENT, self, "environment", self.environment, ENVIRONMENT)
        require_number(self, "voltage_max", above=0.0)
        require_flag(self, "squashed")
        sizes = f"1 to {MOST_LAYERS} whole numbers from 1 to {MOST_UNITS}"
        whole = all(type(size) is int and 1 <= size <= MOST_UNITS for size in self.hidden)
        require(whole and 1 <= len(self.hidden) <= MOST_LAYERS, self, "hidden", self.hidden, sizes)
        whole = type(self.lstm) is int and 0 <= self.lstm <= MOST_LSTM
        require(whole, self, "lstm", self.lstm, f"a whole number from 0 to {MOST_LSTM}")

    @property
    def shapes(self) -> dict[str, tuple[int, ...]]:
        """Names and shapes of its tensors."""
        sizes = (self.lstm or self.interface.size, *self.hidden, OUTPUTS)
        found: dict[str, tuple[int, ...]] = {}
        if self.lstm:
            gates = 4 * self.lstm
            found["lstm.weight_inputs"] = (gates, self.interface.size)
            found["lstm.weight_hidden"] = (gates, self.lstm)
            found["lstm.bias"] = (gates,)
        for k, (before, after) in enumerate(pairwise(sizes)):
            found[f"layer_{k}.weight"] = (after, before)
            found[f"layer_{k}.bias"] = (after,)
        return found

    def check_layout(self, layout: Layout) -> None:
        """Raise a ParameterError unless this layout has all entries of the observations that it was trained on."""
        there = fields_of(layout)
        known = {(name, unit) for name, unit, _ in there}
        lacking = tuple(entry for entry in self.observation if entry[:2] not in known)
        if lacking:
            raise ParameterError(
                f"policy {self.name!r} needs observations with {_told(lacking)}; these have {_told(there)}"
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
            "squashed": self.squashed,
            "lstm": self.lstm,
            "clutches": [list(row) for row in self.clutches],
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
        If it is not a complete card of this format, or was made for another environment.
    """
    with reading(f"policy card {what} is refused"):
        values = dict(_object(parse_json(data), "it"))
        if (found := values.pop("format", None)) != FORMAT:
            raise ValueError(f"format must be {FORMAT}, got {found!r}")
        values = _fields(Card, values)
        values.update(
            observation=tuple(map(_entry, _list(values["observation"], "observation", MOST_INPUTS))),
            interface=read_interface(values["interface"]),
            hidden=_list(values["hidden"], "hidden", MOST_LAYERS),
            clutches=tuple(
                Connection("of a card", _list(row, "clutches", 2)).row
                for row in _list(values.get("clutches", PAPER_ROWS), "clutches", SLOTS)
            ),
        )
        return Card(**values)


def read_interface(content: Any) -> Interface:
    """Return an interface from plain data, as made by ``dataclasses.asdict``.

    Raises
    ------
    ValueError
        If it is not one.
    """
    values = _fields(Interface, _object(content, "interface"))
    base: Any = values["base"]
    values.update(
        inputs=tuple(
            Input(**_fields(Input, _object(each, "inputs"))) for each in _list(values["inputs"], "inputs", MOST_INPUTS)
        ),
        base=None if base is None else _base(base),
        history=_list(values["history"], "history", MOST_LAYERS),
        averages=_list(values["averages"], "averages", MOST_LAYERS),
    )
    return Interface(**values)


def _base(content: Any) -> Base:
    values = _fields(Base, _object(content, "base"))
    gains = tuple(_object(each, "gains") for each in _list(values["gains"], "gains", MOST_INPUTS))
    return Base(values["controller"], _list(values["paces"], "paces", MOST_INPUTS), gains)


def _entry(content: Any) -> tuple[str, str, float]:
    entry = _object(content, "observation")
    name, unit, scale = (entry.get(key, "") for key in ("name", "unit", "scale"))
    if len(entry) != 3 or type(name) is not str or type(unit) is not str or not is_finite(scale) or not scale > 0.0:
        raise ValueError(f"observation must hold objects with name, unit and scale > 0, got {content!r:.200}")
    return name, unit, float(scale)


def _fields(kind: type[Any], content: dict[str, Any]) -> dict[str, Any]:
    """Return an object, or raise a ValueError unless it has the fields of a dataclass and no others."""
    known = [item.name for item in fields(kind)]
    for name in content:
        if name not in known:
            raise unknown_name(f"fields of {kind.__name__}", name, known)
    if missing := [name for name in known if name not in content and name not in ADDED]:
        raise ValueError(f"{kind.__name__} must have {', '.join(known)}; {', '.join(missing)} is missing")
    return content


def _object(content: Any, what: str) -> dict[str, Any]:
    if not isinstance(content, dict):
        raise ValueError(f"{what} must be an object, got {content!r:.40}")
    return cast("dict[str, Any]", content)


def _list(value: Any, what: str, most: int) -> tuple[Any, ...]:
    if not isinstance(value, (list, tuple)) or len(cast("list[Any]", value)) > most:
        raise ValueError(f"{what} must be a list of at most {most}, got {value!r:.40}")
    return tuple(cast("list[Any]", value))
