"""Distributions over machines and tasks: what varies from episode to episode.

``Vary(template, field=distribution, …)`` draws some fields of a frozen dataclass ``template``; a
field's value may itself be a ``Vary``. ``Draws`` draws a list of pairs of machine and task from one
seed; a world draws one pair at each reset. Each distribution has ``draw(rng)``, and ``extremes()``,
with which a ``Vary`` is checked when it is built.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any, Generic, Protocol, TypeGuard, TypeVar, cast

import numpy as np

from pter_gym._internal.checks import whole_number
from pter_gym._internal.fields import Checked, parameter, require, require_number
from pter_gym.errors import ParameterError
from pter_gym.params import BASELINE, Machine, MachineSpread
from pter_gym.scenarios.paces import find_pace
from pter_gym.tasks.path_following import PathFollowing, check_machine

__all__ = ["Distribution", "Draws", "LogUniform", "OneOf", "Shared", "Uniform", "Vary"]

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

Drawn = TypeVar("Drawn", bound="DataclassInstance")
Value_co = TypeVar("Value_co", covariant=True)
Pair = tuple[Machine, PathFollowing]

TRIES = 200
"""Draws of one pair until draws whose paths leave the arm's reach are refused."""

ROOM = 1.5
"""Distance of drawn paths from singular poses over the workspace's margin, so no episode ends at
its start."""


class Distribution(Protocol[Value_co]):
    """A distribution that a value is drawn from."""

    def draw(self, rng: np.random.Generator) -> Value_co:
        """Return a value drawn with a generator."""
        ...

    def extremes(self) -> Sequence[Value_co]:
        """Return the extreme values of the distribution."""
        ...


def _is_distribution(value: object) -> TypeGuard[Distribution[object]]:
    return hasattr(value, "draw")


def _is_drawn(value: object) -> bool:
    if isinstance(value, tuple):
        return any(map(_is_drawn, cast("tuple[object, ...]", value)))
    return _is_distribution(value)


def drawn(value: object, rng: np.random.Generator) -> object:
    """Return a draw from a distribution or from each entry of a tuple, or the value itself."""
    if isinstance(value, tuple):
        return tuple(drawn(item, rng) for item in cast("tuple[object, ...]", value))
    return value.draw(rng) if _is_distribution(value) else value


def extremes(value: object) -> Sequence[object]:
    """Return a distribution's extremes, tuples of all first and all last ones, or the value."""
    if isinstance(value, tuple):
        ends = [extremes(item) for item in cast("tuple[object, ...]", value)]
        return [tuple(values[place] for values in ends) for place in (0, -1)]
    return value.extremes() if _is_distribution(value) else [value]


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

    common: Distribution[float]
    individual: Distribution[float]
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
        require(len(self.options) > 0, self, "options", "at least one option")

    def draw(self, rng: np.random.Generator) -> object:
        """Return an option, or a draw from it."""
        return drawn(self.options[int(rng.integers(len(self.options)))], rng)

    def extremes(self) -> Sequence[object]:
        """Return the extremes of all options."""
        return [end for option in self.options for end in extremes(option)]


class Vary(Generic[Drawn]):
    """A frozen dataclass some of whose fields are drawn.

    Parameters
    ----------
    template
        The dataclass that provides the other fields.
    **fields
        By the name of the field: a distribution, a tuple of distributions, or a value.

    Raises
    ------
    ParameterError
        If there is no such field, or the dataclass rejects an extreme value, of one field or of all
        fields together. The message names the field.
    """

    def __init__(self, template: Drawn, **fields: Any) -> None:
        self.template = template
        self.fields = fields
        known = getattr(template, "__dataclass_fields__", {})
        for name in fields:
            if name not in known:
                raise ParameterError(
                    f"{type(template).__name__} has no field {name!r}; it has {', '.join(known)}"
                )
        self.extremes()

    def draw(self, rng: np.random.Generator) -> Drawn:
        """Return the template with its drawn fields."""
        return replace(self.template, **{k: drawn(v, rng) for k, v in self.fields.items()})

    def extremes(self) -> Sequence[Drawn]:
        """Return draws with one field at an end, and with all at their first and last ends."""
        ends = {name: extremes(field) for name, field in self.fields.items()}
        variants = [{name: end} for name, values in ends.items() for end in values]
        variants += [{name: values[place] for name, values in ends.items()} for place in (0, -1)]
        return [replace(self.template, **change) for change in variants]

    @property
    def middle(self) -> Drawn:
        """The template, with values of fields that are not drawn and middles of those that vary."""
        known = {
            name: middle(value, getattr(self.template, name)) for name, value in self.fields.items()
        }
        return replace(self.template, **known)

    def __eq__(self, other: object) -> bool:
        """Return whether both draw the same fields of the same dataclass from the same values."""
        if not isinstance(other, Vary):
            return NotImplemented
        theirs = cast("Vary[DataclassInstance]", other)
        ours = (self.template, *self.fields.items())
        return ours == (theirs.template, *theirs.fields.items())

    def __hash__(self) -> int:
        """Return a hash of what is drawn, not of the distributions, which need not have one."""
        return hash((type(self.template), *self.fields))

    def __repr__(self) -> str:
        """Return the call that makes this object."""
        fields = "".join(f", {name}={field!r}" for name, field in self.fields.items())
        return f"Vary({self.template!r}{fields})"


def middle(value: object, usual: object) -> object:
    """Return a value or the ``middle`` of a distribution; by default the usual value."""
    if hasattr(value, "middle"):
        return cast("Vary[DataclassInstance]", value).middle
    first, *others = extremes(value)
    return usual if any(other != first for other in others) else first


@dataclass(frozen=True, kw_only=True)
class Draws(Checked):
    """What episodes are drawn from: pairs of machine and task.

    Attributes
    ----------
    machine, task
        Distributions or fixed values.
    instead
        A machine, a ``MachineSpread`` or a distribution of machines that replaces ``machine``;
        everything else is drawn as before.
    also
        Further draws to mix in.
    weight
        Number of pairs relative to that of the others in such a mixture.
    """

    machine: Machine | MachineSpread | Vary[Machine] = BASELINE
    task: PathFollowing | Vary[PathFollowing]
    instead: Machine | MachineSpread | Distribution[Machine] | None = None
    also: "tuple[Draws, ...]" = ()
    weight: int = parameter("1", "chosen", at_least=1, default=1)

    def __post_init__(self) -> None:
        """Check the draws that are mixed in."""
        super().__post_init__()
        also, instead = cast("object", self.also), cast("object", self.instead)
        components = cast("tuple[object, ...]", also)
        mixed = isinstance(also, tuple) and all(isinstance(draws, Draws) for draws in components)
        require(mixed, self, "also", "a tuple of Draws")
        fits = instead is None or isinstance(instead, Machine) or _is_distribution(instead)
        require(fits, self, "instead", "a Machine, a distribution of machines or None")

    @property
    def varied_task(self) -> Vary[PathFollowing]:
        """The task, also where none of its fields is drawn."""
        return self.task if isinstance(self.task, Vary) else Vary(self.task)

    @property
    def middle(self) -> Machine:
        """The machine that laws know in all episodes: the only one, or the middle of several.

        For a ``MachineSpread`` that is its machine, for a ``Vary`` its template, for a ``OneOf``
        that of the first option, for mixed draws that of the first part. Your own distributions
        define it by an attribute ``middle``.

        Raises
        ------
        ParameterError
            If such a distribution has none.
        """
        source: object = self.machine if self.instead is None else self.instead
        while isinstance(source, OneOf):
            source = source.options[0]
        known = middle(source, None)
        accepted = "which draws them, with an attribute middle: the machine that laws know"
        field = "machine" if self.instead is None else "instead"
        require(isinstance(known, Machine), self, field, f"a machine, or {accepted}")
        return cast("Machine", known)

    def map_components(self, change: "Callable[[Draws], Draws]") -> "Draws":
        """Return these draws and those mixed in, each changed by a function."""
        return replace(change(self), also=tuple(map(change, self.also)))

    def with_task(self, **values: object) -> "Draws":
        """Return draws whose tasks have other values, or draw them, in fields that are not drawn.

        Raises
        ------
        ParameterError
            If a task has no such field or draws it, or a value is out of range.
        """

        def changed(draws: Draws) -> Draws:
            template, varied = draws.varied_task.template, draws.varied_task.fields
            shared = [item.name for item in fields(template) if item.name not in (*varied, "pace")]
            for name in values:
                if name not in shared:
                    raise ParameterError(
                        f"{name} must be one of what all episodes share: {', '.join(shared)}"
                    )
            more = {name: value for name, value in values.items() if _is_drawn(value)}
            fixed = {name: value for name, value in values.items() if name not in more}
            return replace(draws, task=Vary(replace(template, **fixed), **varied, **more))

        return self.map_components(changed) if values else self

    def at_pace(self, pace: "float | str | Distribution[object] | None") -> "Draws":
        """Return draws at a commanded pace [m/s], its name or its distribution; None: as drawn.

        Raises
        ------
        ParameterError
            If there is no such pace.
        """
        if pace is None:
            return self
        commanded = pace if _is_distribution(pace) else find_pace(cast("float | str", pace))

        def changed(draws: Draws) -> Draws:
            varied = draws.varied_task
            task = Vary(varied.template, **{**varied.fields, "pace": commanded})
            return replace(draws, task=task)

        return self.map_components(changed)

    def pairs(
        self, n: int = 512, seed: int = 0, pace: "float | str | Distribution[object] | None" = None
    ) -> list[Pair]:
        """Return ``n`` pairs, the same for the same seed.

        Parameters
        ----------
        n, seed
            Number of pairs, in a mixture rounded up to the weights of its components; their seed.
        pace
            As in ``at_pace``.

        Raises
        ------
        ParameterError
            If a number is out of range, or too few of the drawn tasks suit their machines.
        """
        n, seed = whole_number("n", n), whole_number("seed", seed, at_least=0)
        draws = self.at_pace(pace)
        components = (draws, *draws.also)
        share = -(-n // sum(one.weight for one in components))
        return [pair for one in components for pair in _pairs(one, share * one.weight, seed)]

    def draw(self, rng: np.random.Generator) -> Pair:
        """Return a matching pair; paths that do not fit the workspace are drawn again."""
        one = self._component(rng)
        for attempt in range(TRIES):
            machine, task = one._parts(rng)
            try:
                check_pair(machine, task)
            except ParameterError:
                if attempt == TRIES - 1:
                    raise
            else:
                return machine, task
        raise AssertionError

    def draw_once(self, rng: np.random.Generator) -> Pair | None:
        """Return a pair, or None if the first draw does not match.

        The distributions here call ``uniform`` and ``integers`` of ``rng``, a ``MachineSpread``
        calls ``standard_normal``.
        """
        machine, task = self._component(rng)._parts(rng)
        try:
            check_pair(machine, task)
        except ParameterError:
            return None
        return machine, task

    def _component(self, rng: np.random.Generator) -> "Draws":
        """Return one of the draws of a mixture, alone."""
        if not self.also:
            return self
        weighted = [draws for draws in (self, *self.also) for _ in range(draws.weight)]
        return replace(weighted[int(rng.integers(len(weighted)))], also=())

    def _parts(self, rng: np.random.Generator) -> Pair:
        """Return a machine and a task, which need not match."""
        parts = {"machine": drawn(self.machine, rng), "task": drawn(self.task, rng)}
        if self.instead is not None:
            parts["machine"] = drawn(self.instead, rng)
        for name, kind in (("machine", Machine), ("task", PathFollowing)):
            accepted = f"a {kind.__name__}, or draw one"
            require(isinstance(parts[name], kind), self, name, accepted)
        return cast("Pair", (*parts.values(),))


def check_pair(machine: Machine, task: PathFollowing) -> None:
    """Raise a ParameterError if the path is too near to singular poses of the machine."""
    check_machine(task, machine, ROOM)


@lru_cache(maxsize=32)
def _pairs(draws: Draws, n: int, seed: int) -> tuple[Pair, ...]:
    """Return the pairs of one part; they are drawn once and shared."""
    rng, alone = np.random.default_rng([seed, 0x5452]), replace(draws, also=())
    return tuple(alone.draw(rng) for _ in range(n))
