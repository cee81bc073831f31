"""Distributions over machines and tasks: what varies from episode to episode.

``Vary(base, field=distribution, …)`` draws some fields of a frozen dataclass ``base``; a field's
value may itself be a ``Vary``. ``Randomisation`` draws a list of pairs of machine and task from one
seed; a world draws one pair at each reset. Each distribution has ``draw(rng)``, and ``extremes()``,
with which a ``Vary`` is checked when it is built.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, Generic, Protocol, TypeVar, cast

import numpy as np

from pter_gym.errors import ParameterError
from pter_gym.params import BASELINE, Checked, Machine, quantity, require, require_number
from pter_gym.scenarios._fixed_machine import FixedMachine, with_delay
from pter_gym.tasks.path_following import PathFollowing, check_machine

Drawn = TypeVar("Drawn")
Pair = tuple[Machine, PathFollowing]

TRIES = 200
"""Draws of one pair of machine and task before a randomisation is refused for paths that leave the arm's reach."""

ROOM = 1.5
"""Distance of drawn paths from singular poses over the workspace's margin, so no episode ends as it begins."""


class Distribution(Protocol):
    """A distribution that a value is drawn from."""

    def draw(self, rng: np.random.Generator) -> Any:
        """Return a value drawn with a generator."""
        ...

    def extremes(self) -> Sequence[Any]:
        """Return the extreme values of the distribution."""
        ...


def drawn(value: Any, rng: np.random.Generator) -> Any:
    """Return a draw from a distribution, a tuple with a draw from each of its entries, or the value itself."""
    if isinstance(value, tuple):
        return tuple(drawn(each, rng) for each in cast("tuple[Any, ...]", value))
    return value.draw(rng) if hasattr(value, "draw") else value


def extremes(value: Any) -> Sequence[Any]:
    """Return the extreme values of a distribution, tuples of all first and all last ones, or the value itself."""
    if isinstance(value, tuple):
        ends = [extremes(each) for each in cast("tuple[Any, ...]", value)]
        return [tuple(values[place] for values in ends) for place in (0, -1)]
    return value.extremes() if hasattr(value, "draw") else [value]


@dataclass(frozen=True)
class _Range(Checked):
    low: float
    high: float

    def __post_init__(self) -> None:
        """Check that both are finite and in order."""
        super().__post_init__()
        require_number(self, "high", at_least=self.low)

    def extremes(self) -> Sequence[float]:
        """Return the smallest and the largest number."""
        return self.low, self.high


class Uniform(_Range):
    """A uniform draw from [low, high]."""

    def draw(self, rng: np.random.Generator) -> float:
        """Return a number drawn uniformly."""
        return float(rng.uniform(self.low, self.high))


class LogUniform(_Range):
    """A draw from [low, high], 0 < low, whose logarithm is uniform."""

    def __post_init__(self) -> None:
        """Check that both are finite, positive and in order."""
        require_number(self, "low", above=0.0)
        super().__post_init__()

    def draw(self, rng: np.random.Generator) -> float:
        """Return a number whose logarithm is drawn uniformly."""
        return math.exp(rng.uniform(math.log(self.low), math.log(self.high)))


@dataclass(frozen=True)
class Shared:
    """A tuple of ``count`` products: one shared factor times an individual factor each."""

    common: Distribution
    individual: Distribution
    count: int

    def draw(self, rng: np.random.Generator) -> tuple[float, ...]:
        """Return ``count`` products of one shared draw and one individual draw each."""
        factor = self.common.draw(rng)
        return tuple(factor * self.individual.draw(rng) for _ in range(self.count))

    def extremes(self) -> Sequence[tuple[float, ...]]:
        """Return tuples of the products of extremes."""
        return [
            (a * b,) * self.count
            for a in self.common.extremes()
            for b in self.individual.extremes()
        ]


@dataclass(frozen=True)
class OneOf:
    """One of several values, distributions or tuples of them, all equally likely."""

    options: tuple[Any, ...]

    def __post_init__(self) -> None:
        """Check that there is an option."""
        require(len(self.options) > 0, self, "options", self.options, "at least one option")

    def draw(self, rng: np.random.Generator) -> Any:
        """Return an option, or a draw from it."""
        return drawn(self.options[int(rng.integers(len(self.options)))], rng)

    def extremes(self) -> Sequence[Any]:
        """Return the extremes of all options."""
        return [end for option in self.options for end in extremes(option)]


class Vary(Generic[Drawn]):
    """A frozen dataclass some of whose fields are drawn.

    Parameters
    ----------
    base
        The dataclass that provides the other fields.
    **fields
        By the name of the field: a distribution, a tuple of distributions, or a value.

    Raises
    ------
    ParameterError
        If there is no such field, or the dataclass rejects an extreme value, of one field or of all
        fields together. The message names the field.
    """

    def __init__(self, base: Drawn, **fields: Any) -> None:
        self.base = base
        self.fields = fields
        known = getattr(base, "__dataclass_fields__", {})
        for name in fields:
            if name not in known:
                raise ParameterError(
                    f"{type(base).__name__} has no field {name!r}; it has {', '.join(known)}"
                )
        self.extremes()

    def draw(self, rng: np.random.Generator) -> Drawn:
        """Return the base with its drawn fields."""
        return cast(
            Drawn,
            replace(cast(Any, self.base), **{k: drawn(v, rng) for k, v in self.fields.items()}),
        )

    def extremes(self) -> Sequence[Drawn]:
        """Return draws with one field at an end, and with all at their first and at their last ends."""
        ends = {name: extremes(field) for name, field in self.fields.items()}
        changes = [{name: end} for name, values in ends.items() for end in values]
        changes += [{name: values[place] for name, values in ends.items()} for place in (0, -1)]
        return [cast(Drawn, replace(cast(Any, self.base), **change)) for change in changes]

    def __repr__(self) -> str:
        """Return the call that makes this object."""
        fields = "".join(f", {name}={field!r}" for name, field in self.fields.items())
        return f"Vary({self.base!r}{fields})"


@dataclass(frozen=True, kw_only=True)
class Randomisation(Checked):
    """Pairs of machine and task to train on.

    Attributes
    ----------
    machine, task
        Distributions or fixed values.
    contexts
        Number of pairs in the list that worlds draw from.
    seed
        Seed ≥ 0 of the list.
    fixed_machine
        A machine and the delay of its sensors in place of drawn ones; everything else is drawn as
        before.
    """

    machine: Machine | Vary[Machine] = BASELINE
    task: PathFollowing | Vary[PathFollowing]
    contexts: int = quantity("1", "chosen", at_least=1, default=512)
    seed: int = quantity("1", "chosen", at_least=0, default=0)
    fixed_machine: FixedMachine | None = None

    def pairs(self) -> list[Pair]:
        """Return the pairs, the same for the same seed; they are drawn once and shared.

        Raises
        ------
        ParameterError
            If too few of the drawn tasks suit their machines.
        """
        return list(_pairs(self))

    def draw(self, rng: np.random.Generator) -> Pair:
        """Return a matching pair; a path that does not fit the workspace is drawn again."""
        for attempt in range(TRIES):
            machine, task = drawn(self.machine, rng), drawn(self.task, rng)
            if self.fixed_machine is not None:
                machine, task = self.fixed_machine.machine, with_delay(task, self.fixed_machine)
            require(
                isinstance(machine, Machine),
                self,
                "machine",
                self.machine,
                "a Machine, or draw one",
            )
            require(
                isinstance(task, PathFollowing),
                self,
                "task",
                self.task,
                "a PathFollowing, or draw one",
            )
            try:
                check_machine(
                    replace(task, singularity_margin=ROOM * task.singularity_margin), machine
                )
            except ParameterError:
                if attempt == TRIES - 1:
                    raise
            else:
                return machine, task
        raise AssertionError


@lru_cache(maxsize=32)
def _pairs(randomisation: Randomisation) -> tuple[Pair, ...]:
    rng = np.random.default_rng([randomisation.seed, 0x5452])
    return tuple(randomisation.draw(rng) for _ in range(randomisation.contexts))


@dataclass(frozen=True, kw_only=True)
class Mixture:
    """Several randomisations as one, with the pairs of all: each is weighted by its own number of
    pairs.

    Attributes
    ----------
    parts
        At least one.
    """

    parts: tuple[Randomisation, ...]

    def __post_init__(self) -> None:
        """Check the parts."""
        given = cast("object", self.parts)
        parts = cast("tuple[object, ...]", given) if isinstance(given, tuple) else ()
        known = len(parts) > 0 and all(isinstance(part, Randomisation) for part in parts)
        require(known, self, "parts", self.parts, "a tuple of at least one Randomisation")

    def pairs(self) -> list[Pair]:
        """Return the pairs, the same for the same seeds; see ``Randomisation.pairs``."""
        return [pair for part in self.parts for pair in part.pairs()]
