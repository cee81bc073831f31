"""Frozen dataclasses of parameters as plain data, and back: what can be stored as JSON and read without running it.

A dataclass becomes a dictionary with its name under ``"type"`` and its fields, a tuple a list. Floats keep every bit,
since JSON writes them by ``repr``.
"""

import math
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from functools import cache
from types import ModuleType
from typing import Any, cast

from pter_gym import hands, params, paths
from pter_gym.errors import ParameterError, unknown_name
from pter_gym.tasks import path_following

MODULES: tuple[ModuleType, ...] = (params, hands, paths, path_following)
"""Modules and packages that define the dataclasses that can be stored."""

TYPE = "type"

Plain = None | bool | int | float | str | list["Plain"] | dict[str, "Plain"]


def to_plain(value: object) -> Plain:
    """Return a value as plain data.

    Raises
    ------
    ParameterError
        If it holds anything but the package's frozen dataclasses, tuples, finite numbers, strings, booleans and None.
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
        return [to_plain(item) for item in cast("tuple[object, ...]", value)]
    name = type(value).__name__
    if known_types().get(name) is not type(value):
        raise unknown_name("stored type", name, known_types())
    return {TYPE: name} | {item.name: to_plain(getattr(value, item.name)) for item in _stored_fields(type(value))}


def from_plain(data: object) -> Any:
    """Return the value that ``to_plain`` made the data from; dataclasses check themselves as always.

    Raises
    ------
    ParameterError
        If a type or field is unknown, a field is missing, or a value is refused by its dataclass.
    """
    if data is None or isinstance(data, (bool, int, float, str)):
        return data
    if isinstance(data, list):
        return tuple(from_plain(item) for item in cast("list[object]", data))
    if isinstance(data, Mapping):
        return _dataclass_from(cast("Mapping[str, object]", data))
    raise ParameterError(f"stored data must be what JSON holds, got {type(data).__name__}")


@cache
def known_types() -> dict[str, type[Any]]:
    """Return the dataclasses that can be stored by name."""
    found: dict[str, type[Any]] = {}
    for module in MODULES:
        for name, kind in vars(module).items():
            if isinstance(kind, type) and is_dataclass(kind) and _belongs(kind, module):
                if name in found:
                    raise TypeError(f"two dataclasses are called {name}")
                found[name] = kind
    return found


def _belongs(kind: type[Any], module: ModuleType) -> bool:
    """Tell whether a class is defined in a module, or in one of a package's."""
    return f"{kind.__module__}.".startswith(f"{module.__name__}.")


def _dataclass_from(data: Mapping[str, object]) -> Any:
    name = data.get(TYPE)
    if not isinstance(name, str) or name not in known_types():
        raise unknown_name("stored type", name, known_types())
    kind = known_types()[name]
    known = [item.name for item in _stored_fields(kind)]
    for key in data:
        if key != TYPE and key not in known:
            raise unknown_name(f"stored fields of {name}", key, known)
    for key in known:
        if key not in data:
            raise ParameterError(f"stored {name} has no field {key!r}; it needs {', '.join(known)}")
    return kind(**{key: from_plain(data[key]) for key in known})


def _stored_fields(kind: type[Any]) -> list[Any]:
    return [item for item in fields(kind) if item.init]
