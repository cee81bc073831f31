"""Frozen dataclasses as plain data, and back: what can be stored as JSON and read without running it.

A dataclass becomes a dictionary with its name under ``"type"`` and its fields, a tuple a list. Floats keep every bit,
since JSON writes them by ``repr``. All fields are written, but for one that came ``later`` and has its default; one
that data lack takes its default.
"""

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import MISSING, Field, fields, is_dataclass
from types import MappingProxyType, ModuleType
from typing import Any, cast

from pter_gym.errors import ParameterError, unknown_name

TYPE = "type"

Plain = None | bool | int | float | str | list["Plain"] | dict[str, "Plain"]


class Codec:
    """Turns values of some dataclasses to plain data and back; no other class is ever made from data.

    Parameters
    ----------
    kinds
        The dataclasses, which data refer to by name.
    """

    def __init__(self, kinds: Iterable[type[Any]]) -> None:
        found: dict[str, type[Any]] = {}
        for kind in kinds:
            if found.setdefault(kind.__name__, kind) is not kind:
                raise TypeError(f"two dataclasses are called {kind.__name__}")
        self.kinds: Mapping[str, type[Any]] = MappingProxyType(found)

    def to_plain(self, value: object) -> Plain:
        """Return a value as plain data.

        Raises
        ------
        ParameterError
            If it holds anything but these dataclasses, tuples, finite numbers, strings, booleans and None.
        """
        if value is None or isinstance(value, (bool, str)):
            return value
        if isinstance(value, int):
            return int(value)
        if isinstance(value, float):
            if not math.isfinite(value):
                raise ParameterError(f"stored numbers must be finite, got {value!r}")
            return float(value)
        if isinstance(value, tuple):
            return [self.to_plain(item) for item in cast("tuple[object, ...]", value)]
        name = type(value).__name__
        if self.kinds.get(name) is not type(value):
            raise unknown_name("stored type", name, self.kinds)
        held = {field: (getattr(value, field), item) for field, item in stored_fields(type(value)).items()}
        usual = {field for field, (part, item) in held.items() if item.metadata.get("later") and part == item.default}
        return {TYPE: name} | {field: self.to_plain(part) for field, (part, _) in held.items() if field not in usual}

    def from_plain(self, data: object) -> Any:
        """Return the value that ``to_plain`` made the data from; dataclasses check themselves as always.

        Raises
        ------
        ParameterError
            If a type or field is unknown, a field without a default is missing, or a dataclass refuses a value.
        """
        if data is None or isinstance(data, (bool, int, float, str)):
            return data
        if isinstance(data, list):
            return tuple(self.from_plain(item) for item in cast("list[object]", data))
        if not isinstance(data, Mapping):
            raise ParameterError(f"stored data must be of the types that JSON has, got {type(data).__name__}")
        given = dict(cast("Mapping[str, object]", data))
        name = given.pop(TYPE, None)
        if not isinstance(name, str) or name not in self.kinds:
            raise unknown_name("stored type", name, self.kinds)
        kind = self.kinds[name]
        return kind(**completed(kind, {field: self.from_plain(value) for field, value in given.items()}))


def dataclasses_in(*modules: ModuleType) -> Iterator[type[Any]]:
    """Yield the dataclasses that are named in modules or packages and defined there."""
    for module in modules:
        within = f"{module.__name__}."
        for kind in vars(module).values():
            if isinstance(kind, type) and is_dataclass(kind) and f"{kind.__module__}.".startswith(within):
                yield kind


def stored_fields(kind: type[Any]) -> dict[str, Field[Any]]:
    """Return the fields of a dataclass that data hold, by name."""
    return {item.name: item for item in fields(kind) if item.init}


def completed(kind: type[Any], given: Mapping[str, Any]) -> dict[str, Any]:
    """Return the values of a dataclass's fields from stored ones; those that are missing are the defaults.

    Raises
    ------
    ParameterError
        If a field is unknown, or one without a default is missing.
    """
    known = stored_fields(kind)
    for name in given:
        if name not in known:
            raise unknown_name(f"stored fields of {kind.__name__}", name, known)
    found = dict(given)
    for name, item in known.items():
        if name in found:
            continue
        if item.default is not MISSING:
            found[name] = item.default
        elif item.default_factory is not MISSING:
            found[name] = item.default_factory()
        else:
            raise ParameterError(f"stored {kind.__name__} has no field {name!r}; it needs {', '.join(known)}")
    return found


def tuple_of(value: Any) -> Any:
    """Return a value as dataclasses have it: files have lists in place of tuples."""
    return tuple(map(tuple_of, cast("list[Any]", value))) if isinstance(value, list) else value
