"""Machines around an identified one, as far as a log leaves its numbers open."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any, NamedTuple, cast

import numpy as np

from pter_gym._internal.fields import Checked, require
from pter_gym.errors import ParameterError
from pter_gym.params._machine import Machine

MACHINE_TRIES = 1000
"""Draws of which one must be a machine."""


@dataclass(frozen=True, kw_only=True)
class MachineSpread(Checked):
    """Machines whose numbers are normally distributed about those of one.

    ``pter identify`` writes one into its machine file, for the numbers that the log leaves
    uncertain. A number below the minimum of its field becomes the minimum, and an invalid machine
    is drawn again.

    Attributes
    ----------
    machine
        The machine in the middle.
    places
        What varies: the places of numbers, such as ``arm.inertia_a`` or ``clutch_scale.1``, the
        strength of clutch 1.
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
        known = numbers_of(self.machine)
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
        known = numbers_of(self.machine)
        middle, least = np.array([known[place] for place in self.places]).reshape(-1, 2).T
        sizes, directions = np.linalg.eigh(np.array(self.covariance, np.float64))
        factor = directions * np.sqrt(sizes.clip(0.0))
        for attempt in range(MACHINE_TRIES):
            numbers = middle + factor @ rng.standard_normal(len(middle))
            by_place = dict(zip(self.places, numbers.clip(least).tolist(), strict=True))
            try:
                return with_numbers(self.machine, by_place)
            except ParameterError:
                if attempt == MACHINE_TRIES - 1:
                    raise
        raise AssertionError

    def extremes(self) -> Sequence[Machine]:
        """Return the machine in the middle: a normal distribution has no ends."""
        return [self.machine]


class Number(NamedTuple):
    """A number of a machine: its value, and the least that its field accepts."""

    value: float
    least: float


def numbers_of(machine: Machine) -> dict[str, Number]:
    """Return the numbers of a machine by their places; entries of tuples count from 1."""
    found: dict[str, Number] = {}

    def note(place: str, number: Number) -> float:
        return found.setdefault(place, number).value

    map_numbers(machine, note, replace)
    return found


def with_numbers(machine: Machine, values: Mapping[str, float]) -> Machine:
    """Return a machine with other numbers at places, or raise a ParameterError."""
    return map_numbers(machine, lambda place, number: values.get(place, number.value), replace)


def map_numbers(
    owner: Any, at: Callable[[str, Number], Any], make: Callable[..., Any], before: str = ""
) -> Any:
    """Return ``make(owner, **fields)``, each number in the fields replaced by ``at(place, it)``.

    ``owner`` is a machine or a part of one, whose places begin with ``before``. The strengths of
    clutches that it has not are no numbers.
    """
    made: dict[str, Any] = {}
    for item in fields(owner):
        value, place = getattr(owner, item.name), before + item.name
        least = item.metadata.get("limits", {}).get("at_least", -np.inf)
        if is_dataclass(value):
            value = map_numbers(value, at, make, f"{place}.")
        elif isinstance(value, tuple) and item.name != "clutches":
            entries = cast("tuple[float, ...]", value)
            count = len(owner.clutches) if item.name == "clutch_scale" else len(entries)
            numbered = enumerate(entries[:count], 1)
            value = *(at(f"{place}.{k}", Number(x, least)) for k, x in numbered), *entries[count:]
        elif isinstance(value, int | float) and not isinstance(value, bool):
            value = at(place, Number(value, least))
        made[item.name] = value
    return make(owner, **made)
