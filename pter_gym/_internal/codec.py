"""Frozen dataclasses as plain data, for JSON and TOML, and back.

A dataclass becomes a dictionary with its name under ``"type"`` and its fields, a tuple a list.
Floats keep every bit, since JSON writes them by ``repr``. A field that data lack takes its default.
"""

import math
from collections.abc import Iterable, Iterator
from dataclasses import fields, is_dataclass
from types import ModuleType
from typing import Any, cast

from cattrs import BaseValidationError, Converter, transform_error
from cattrs.gen import make_dict_structure_fn, make_dict_unstructure_fn, override
from cattrs.v import format_exception

from pter_gym.errors import ParameterError, PterError, unknown_name

TYPE = "type"

Plain = None | bool | int | float | str | list["Plain"] | dict[str, "Plain"]


class Codec:
    """Turns some dataclasses into plain data and back; no other class is ever made from data.

    Parameters
    ----------
    kinds
        The dataclasses, which data refer to by name; no two have the same.
    """

    def __init__(self, kinds: Iterable[type[Any]]) -> None:
        converter: Any = Converter()
        self._kinds = {kind.__name__: kind for kind in kinds}
        self._readers: dict[str, Any] = {}
        self._writers: dict[str, Any] = {}
        for name, kind in self._kinds.items():
            items = [item for item in fields(kind) if item.init]
            hooks: Any = {
                item.name: override(
                    struct_hook=self._read,
                    unstruct_hook=self.to_plain,
                    omit_if_default=item.metadata.get("later"),
                )
                for item in items
            }
            self._readers[name] = make_dict_structure_fn(
                kind, converter, _cattrs_forbid_extra_keys=True, **hooks
            )
            self._writers[name] = make_dict_unstructure_fn(kind, converter, **hooks)

    def to_plain(self, value: Any) -> Plain:
        """Return a value as plain data.

        Raises
        ------
        ParameterError
            If it holds anything but these dataclasses, tuples, finite numbers, strings, booleans
            and None.
        """
        if value is None or isinstance(value, (bool, str, int)):
            return value
        if isinstance(value, float):
            if not math.isfinite(value):
                raise ParameterError(f"stored numbers must be finite, got {value!r}")
            return float(value)
        if isinstance(value, tuple):
            return [self.to_plain(item) for item in cast("tuple[Any, ...]", value)]
        name = type(value).__name__
        if self._kinds.get(name) is not type(value):
            raise unknown_name("stored type", name, self._kinds)
        return {TYPE: name, **self._writers[name](value)}

    def from_plain(self, data: object) -> Any:
        """Return the value that ``to_plain`` made the data from; dataclasses check themselves.

        Raises
        ------
        ParameterError
            If a type or field is unknown, a field without a default is missing, or a dataclass
            refuses a value.
        """
        try:
            return self._read(data)
        except BaseValidationError as error:
            raise ParameterError(
                "; ".join(transform_error(error, format_exception=_message))
            ) from None

    def _read(self, data: Any, _: Any = None) -> Any:
        if data is None or isinstance(data, (bool, int, float, str)):
            return data
        if isinstance(data, list):
            return tuple(map(self._read, cast("list[Any]", data)))
        if not isinstance(data, dict):
            raise ParameterError(
                f"stored data must be of the types that JSON has, got {type(data).__name__}"
            )
        entries = dict(cast("dict[str, Any]", data))
        name = entries.pop(TYPE, None)
        if not isinstance(name, str) or name not in self._kinds:
            raise unknown_name("stored type", name, self._kinds)
        return self._readers[name](entries, self._kinds[name])


def _message(error: BaseException, kind: type[Any] | None) -> str:
    return str(error) if isinstance(error, PterError) else format_exception(error, kind)


def dataclasses_in(*modules: ModuleType) -> Iterator[type[Any]]:
    """Yield the dataclasses that are named in modules or packages and defined there."""
    for module in modules:
        within = f"{module.__name__}."
        for kind in (getattr(module, name) for name in dir(module)):  # some are loaded lazily
            if (
                isinstance(kind, type)
                and is_dataclass(kind)
                and f"{kind.__module__}.".startswith(within)
            ):
                yield kind


def tuple_of(value: Any) -> Any:
    """Return a value as dataclasses have it: files have lists in place of tuples."""
    return tuple(map(tuple_of, cast("list[Any]", value))) if isinstance(value, list) else value
