"""The card of a policy: all but the weights, as JSON. What is read is checked before it is believed."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from itertools import pairwise
from typing import Any, cast

from pter_gym.compiled.layout import Layout
from pter_gym.errors import ParameterError
from pter_gym.internal.checks import is_finite
from pter_gym.internal.codec import completed
from pter_gym.internal.reading import parse_json, reading
from pter_gym.policies.interface import Base, Input, Interface
from pter_gym.policies.stored_gains import gains_of, make_guided

FORMAT = 1
"""Version of the format."""

ENVIRONMENT = "PTER/PathFollowing-v0"
"""Environment whose observations and actions these policies are made for."""

OUTPUTS = 4

MOST_INPUTS, MOST_UNITS, MOST_LAYERS = 256, 1024, 8
"""Largest sizes of a network."""

MOST_LSTM = 512
"""Most units of an LSTM."""

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
    squashed
        Whether the network's outputs go through tanh.
    lstm
        Units of the LSTM between the inputs and the hidden layers; 0 for none.
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

    @property
    def shapes(self) -> dict[str, tuple[int, ...]]:
        """Names and shapes of the tensors that belong to it."""
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
        """Raise a ParameterError unless observations of this layout have all entries that it was trained on."""
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
            "interface": plain_interface(self.interface),
            "hidden": list(self.hidden),
            "weights_sha256": self.weights_sha256,
            "about": dict(self.about),
            "squashed": self.squashed,
            "lstm": self.lstm,
        }


def plain_interface(interface: Interface) -> dict[str, Any]:
    """Return an interface as plain data that rely on no default."""
    base = interface.base
    return asdict(interface if base is None else replace(interface, base=base.complete()))


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
    with reading(f"policy card {what} is refused"):
        values = dict(_object(parse_json(data)))
        if (found := values.pop("format", None)) != FORMAT:
            raise ValueError(f"format must be {FORMAT}, got {found!r}")
        return _card(values)


def read_interface(content: Any) -> Interface:
    """Return an interface from plain data, as ``plain_interface`` gives it.

    Raises
    ------
    ValueError
        If it is not one.
    """
    values = _fields(Interface, content, "interface")
    inputs = _list(values["inputs"], "inputs", MOST_INPUTS)
    base: Any = values["base"]
    values.update(
        inputs=tuple(Input(**_fields(Input, entry, "input")) for entry in inputs),
        reach=_number(values["reach"], "reach"),
        base=None if base is None else _base(base),
        history=tuple(_list(values["history"], "history", MOST_LAYERS, at_least=0)),
        averages=tuple(_list(values["averages"], "averages", MOST_LAYERS, at_least=0)),
    )
    return Interface(**values)


def _card(content: Any) -> Card:
    values = _fields(Card, content, "card")
    if values["environment"] != ENVIRONMENT:
        raise ValueError(f"it is made for {values['environment']!r}, this is {ENVIRONMENT!r}")
    hidden = _list(values["hidden"], "hidden", MOST_LAYERS)
    for size in hidden:
        if type(size) is not int or not 1 <= size <= MOST_UNITS:
            raise ValueError(f"hidden must hold whole numbers from 1 to {MOST_UNITS}, got {size!r}")
    if type(values["squashed"]) is not bool:
        raise ValueError(f"squashed must be true or false, got {values['squashed']!r}")
    if type(values["lstm"]) is not int or not 0 <= values["lstm"] <= MOST_LSTM:
        raise ValueError(f"lstm must be a whole number from 0 to {MOST_LSTM}, got {values['lstm']!r}")
    if not isinstance(values["about"], dict):
        raise ValueError("about must be an object")
    values.update(
        name=_text(values["name"], "name"),
        observation=tuple(map(_entry, _list(values["observation"], "observation", MOST_INPUTS))),
        voltage_max=_number(values["voltage_max"], "voltage_max"),
        interface=read_interface(values["interface"]),
        hidden=tuple(hidden),
        weights_sha256=_text(values["weights_sha256"], "weights_sha256"),
    )
    return Card(**values)


def _entry(content: Any) -> tuple[str, str, float]:
    if set(_object(content)) != {"name", "unit", "scale"}:
        raise ValueError("observation must hold objects with name, unit, scale")
    return _text(content["name"], "name"), _text(content["unit"], "unit"), _number(content["scale"], "scale")


def _base(content: Any) -> Base:
    values = _fields(Base, content, "base")
    controller = _text(values["controller"], "controller")
    gains = _list(values["gains"], "gains", MOST_INPUTS)
    if not all(isinstance(each, dict) for each in gains):
        raise ValueError("gains must be objects")
    values.update(
        controller=controller,
        paces=tuple(_number(pace, "paces") for pace in _list(values["paces"], "paces", MOST_INPUTS)),
        gains=tuple({**gains_of(make_guided(controller, each)), **each} for each in gains),
    )
    return Base(**values)


def _fields(kind: type[Any], content: Any, what: str) -> dict[str, Any]:
    """Return a value for each field of a dataclass from an object."""
    try:
        return completed(kind, _object(content))
    except ValueError as error:
        raise ValueError(f"{what} must be an object with the fields of {kind.__name__}: {error}") from None


def _object(content: Any) -> dict[str, Any]:
    if not isinstance(content, dict):
        raise ValueError(f"there must be an object, there is {content!r:.40}")
    return cast("dict[str, Any]", content)


def _list(value: Any, what: str, most: int, *, at_least: int = 1) -> list[Any]:
    if not isinstance(value, (list, tuple)) or not at_least <= len(cast(list[Any], value)) <= most:
        raise ValueError(f"{what} must be a list of {at_least} to {most}")
    return list(cast(list[Any], value))


def _number(value: Any, what: str) -> float:
    if not is_finite(value) or value <= 0.0:
        raise ValueError(f"{what} must be a finite number > 0, got {value!r}")
    return float(value)


def _text(value: Any, what: str) -> str:
    if not isinstance(value, str):
        raise ValueError(f"{what} must be a string, got {value!r}")
    return value
