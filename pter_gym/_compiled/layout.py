# pyright: standard
"""Names, units and scales of the entries of a flat array: observations and telemetry."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pter_gym.errors import ParameterError


@dataclass(frozen=True)
class Field:
    """One entry of a flat array: its name, unit and meaning, and the value that is stored as 1."""

    name: str
    unit: str
    meaning: str
    scale: float = 1.0


@dataclass(frozen=True)
class Layout:
    """The fields of a flat array in their order. Raises ParameterError if two have one name."""

    fields: tuple[Field, ...]

    def __post_init__(self) -> None:
        """Check that each name means one field."""
        repeated = sorted({name for name in self.names if self.names.count(name) > 1})
        if repeated:
            raise ParameterError(
                f"fields must have different names, got several called {', '.join(repeated)}"
            )

    def __len__(self) -> int:
        """Return the number of entries."""
        return len(self.fields)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """The names in their order."""
        return tuple(field.name for field in self.fields)

    @cached_property
    def scales(self) -> NDArray[np.float64]:
        """The physical value that is stored as 1, for each entry."""
        return np.array([field.scale for field in self.fields])

    def index(self, name: str) -> int:
        """Return the position of a field. Raises KeyError with the known names."""
        try:
            return self.names.index(name)
        except ValueError:
            raise KeyError(f"no field {name!r}; the fields are {', '.join(self.names)}") from None

    def physical(self, values: NDArray[np.floating], name: str) -> NDArray[np.float64]:
        """Return one field of an array (..., len(layout)) in its unit."""
        index = self.index(name)
        return np.asarray(values[..., index], np.float64) * self.fields[index].scale

    def as_dict(self, values: NDArray[np.floating]) -> dict[str, float]:
        """Return one row (len(layout),) as a dictionary of physical values in their units."""
        return {
            f.name: float(value) * f.scale for f, value in zip(self.fields, values, strict=True)
        }
