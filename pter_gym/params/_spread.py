"""Machines about one: what a log leaves open of its numbers."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any, cast

import numpy as np

from pter_gym.errors import ParameterError
from pter_gym.params._fields import Checked, require
from pter_gym.params._machine import Machine

TRIES = 1000
"""Draws of which one must be a machine."""


@dataclass(frozen=True, kw_only=True)
class MachineSpread(Checked):
    """Machines whose numbers are normally distributed about those of one.

    ``pter identify`` writes one into its machine file, for what the log leaves open. A number below
    the least that its field accepts becomes the least, and what is no machine is drawn again.

    Attributes
    ----------
    machine
        The machine in the middle.
    places
        What varies: the places of numbers, such as ``arm.inertia_a`` or ``clutch_scale.0``.
    covariance
        Covariance of these numbers, a row for each, in products of their units.

    Raises
    ------
    ParameterError
        If a place is not that of a number, or the covariance is not one of as many numbers.
    """

    machine: Machine
    places: tuple[str, ...]
    covariance: tuple[tuple[float, ...], ...]

    def __post_init__(self) -> None:
        """Check places and covariance."""
        super().__post_init__()
        known = numbers_with_limits(self.machine)
        for place in self.places:
            require(place in known, self, "places", "places of a machine's numbers", got=place)
        count = len(self.places)
        require(
            len(self.covariance) == count and all(len(row) == count for row in self.covariance),
            self,
            "covariance",
            f"{count} rows of {count} numbers",
        )
        matrix = np.array(self.covariance, np.float64).reshape(count, count)
        sizes = np.abs(matrix).max(initial=0.0)
        sound = np.isfinite(sizes) and np.abs(matrix - matrix.T).max(initial=0.0) <= 1e-9 * sizes
        require(
            bool(sound) and np.linalg.eigvalsh(matrix).min(initial=0.0) >= -1e-9 * sizes,
            self,
            "covariance",
            "finite, symmetric and without negative eigenvalues",
        )

    def draw(self, rng: np.random.Generator) -> Machine:
        """Return a machine drawn with a generator."""
        known = numbers_with_limits(self.machine)
        middle = np.array([known[place][0] for place in self.places])
        least = np.array([known[place][1] for place in self.places])
        sizes, directions = np.linalg.eigh(np.array(self.covariance, np.float64))
        factor = directions * np.sqrt(sizes.clip(0.0))
        for attempt in range(TRIES):
            numbers = middle + factor @ rng.standard_normal(len(middle))
            by_place = dict(zip(self.places, numbers.clip(least).tolist(), strict=True))
            try:
                return with_numbers(self.machine, by_place)
            except ParameterError:
                if attempt == TRIES - 1:
                    raise
        raise AssertionError

    def extremes(self) -> Sequence[Machine]:
        """Return the machine in the middle: a normal distribution has no ends."""
        return [self.machine]


def middle_of(machine: Machine | MachineSpread) -> Machine:
    """Return a machine, or the one in the middle of several."""
    return machine.machine if isinstance(machine, MachineSpread) else machine


def numbers_with_limits(owner: Any, place: str = "") -> dict[str, tuple[float, float]]:
    """Return the numbers of a dataclass by their places, each with the least that is accepted."""
    return dict(_numbers(owner, place))


def _numbers(owner: Any, place: str) -> Iterator[tuple[str, tuple[float, float]]]:
    for item in fields(owner):
        value, where = getattr(owner, item.name), f"{place}{item.name}"
        least = item.metadata.get("limits", {}).get("at_least", -np.inf)
        if is_dataclass(value):
            yield from _numbers(value, f"{where}.")
        elif isinstance(value, float):
            yield where, (value, least)
        elif isinstance(value, tuple):
            entries = enumerate(cast("tuple[Any, ...]", value))
            yield from ((f"{where}.{k}", (x, least)) for k, x in entries if isinstance(x, float))


def with_numbers(owner: Any, numbers: Mapping[str, float]) -> Any:
    """Return a dataclass with other numbers at places, or raise a ParameterError."""
    parts: dict[str, dict[str, float]] = {}
    for place, value in numbers.items():
        name, _, rest = place.partition(".")
        parts.setdefault(name, {})[rest] = value
    changes: dict[str, Any] = {}
    for name, inner in parts.items():
        old = getattr(owner, name)
        if is_dataclass(old):
            changes[name] = with_numbers(old, inner)
        elif isinstance(old, tuple):
            entries = enumerate(cast("tuple[Any, ...]", old))
            changes[name] = tuple(inner.get(str(k), x) for k, x in entries)
        else:
            changes[name] = inner[""]
    return replace(owner, **changes)
