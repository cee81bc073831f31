"""Machines, or hands, about an identified one, as far as a log leaves its numbers open."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any, Generic, NamedTuple, TypeVar, cast

import numpy as np

from pter_gym._internal.fields import Checked, require
from pter_gym.errors import ParameterError
from pter_gym.params._machine import Machine

TRIES = 1000
"""Draws of which one must be valid."""

Middle = TypeVar("Middle")


class Spread(Checked, Generic[Middle]):
    """Base of dataclasses whose numbers are normally distributed about those in the ``middle``.

    A number below the minimum of its field becomes the minimum, and what is invalid is drawn again.
    """

    places: tuple[str, ...]
    covariance: tuple[tuple[float, ...], ...]

    @property
    def middle(self) -> Middle:
        """What is in the middle."""
        raise NotImplementedError

    def __post_init__(self) -> None:
        """Check places and covariance."""
        super().__post_init__()
        known = numbers_of(self.middle)
        for place in self.places:
            require(place in known, self, "places", f"among {', '.join(known)}", got=place)
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

    def draw(self, rng: np.random.Generator) -> Middle:
        """Return one drawn with a generator."""
        known = numbers_of(self.middle)
        middle, least = np.array([known[place] for place in self.places]).reshape(-1, 2).T
        covariance = np.array(self.covariance, np.float64).reshape(len(middle), len(middle))
        sizes, directions = np.linalg.eigh(covariance)
        factor = directions * np.sqrt(sizes.clip(0.0))
        for attempt in range(TRIES):
            numbers = middle + factor @ rng.standard_normal(len(middle))
            by_place = dict(zip(self.places, numbers.clip(least).tolist(), strict=True))
            try:
                return with_numbers(self.middle, by_place)
            except ParameterError:
                if attempt == TRIES - 1:
                    raise
        raise AssertionError

    def extremes(self) -> Sequence[Middle]:
        """Return what is in the middle: a normal distribution has no ends."""
        return [self.middle]


@dataclass(frozen=True, kw_only=True)
class MachineSpread(Spread[Machine]):
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

    @property
    def middle(self) -> Machine:
        """The machine in the middle."""
        return self.machine


class Number(NamedTuple):
    """A number: its value, and the least that its field accepts."""

    value: float
    least: float


def numbers_of(owner: object) -> dict[str, Number]:
    """Return the numbers of a dataclass by their places; entries of tuples count from 1."""
    found: dict[str, Number] = {}

    def note(place: str, number: Number) -> float:
        return found.setdefault(place, number).value

    map_numbers(owner, note, replace)
    return found


def with_numbers(owner: Middle, values: Mapping[str, float]) -> Middle:
    """Return a dataclass with other numbers at places, or raise a ParameterError."""
    return map_numbers(owner, lambda place, number: values.get(place, number.value), replace)


def map_numbers(
    owner: Any, at: Callable[[str, Number], Any], make: Callable[..., Any], before: str = ""
) -> Any:
    """Return ``make(owner, **fields)``, each number in the fields replaced by ``at(place, it)``.

    ``owner`` may be a part of another, whose places begin with ``before``. The strengths of
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
