"""What is between an observation and a network, and between the network and the clutches.

A network sees quantities of the observation and a few derived from it, each shifted and scaled; its four outputs within
[−1, 1] are voltages relative to the middle of the range, or relative to those of a base controller (a residual policy),
or the environments' normalised actions.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pter_gym.compiled.layout import Layout
from pter_gym.errors import ParameterError, unknown_name
from pter_gym.params import Machine, require, require_flag, require_kind, require_number
from pter_gym.policies.stored_gains import gains_of, make_guided

if TYPE_CHECKING:
    from pter_gym.controllers import PaceSchedule

Array = NDArray[np.float64]
Quantities = dict[str, Array]

LIMIT = 10.0
"""Inputs of a network are limited to ±LIMIT of their scales."""

CLUTCHES = range(1, 5)

LONGEST = 64
"""How many control steps a network can look back at most."""

SLOWEST = 1000
"""Longest time constant of an average in control steps."""

BASE_INPUTS = tuple(f"base_{x}" for x in CLUTCHES)
"""Voltages of the base controller [V]."""


def _relative(q: Quantities) -> Quantities:
    """Return cosine and sine of the angle from link A to the path's heading, and likewise of link B."""
    found: Quantities = {}
    for link in ("a", "b"):
        cos, sin = q[f"cos_{link}"], q[f"sin_{link}"]
        found[f"heading_{link}_cos"] = q["heading_cos"] * cos + q["heading_sin"] * sin
        found[f"heading_{link}_sin"] = q["heading_sin"] * cos - q["heading_cos"] * sin
    return found


DERIVED: Mapping[tuple[str, ...], Callable[[Quantities], Quantities]] = MappingProxyType(
    {
        ("heading_a_cos", "heading_a_sin", "heading_b_cos", "heading_b_sin"): _relative,
    }
)
"""Quantities that are derived from those of the observation, and how."""


@dataclass(frozen=True)
class Input:
    """One input of a network: (value − center) / scale, limited to ±LIMIT.

    Attributes
    ----------
    name
        A field of the observation, one of ``DERIVED`` or one of ``BASE_INPUTS``.
    center, scale
        In the unit of the quantity; the scale is positive.
    """

    name: str
    center: float = 0.0
    scale: float = 1.0

    def __post_init__(self) -> None:
        """Check the numbers; a bound interface has checked the name."""
        require_kind(self, "name", str)
        require_number(self, "center")
        require_number(self, "scale", above=0.0)


@dataclass(frozen=True)
class Base:
    """The controller that a residual policy corrects: a schedule of gains over the commanded pace.

    Attributes
    ----------
    controller
        Its name in ``pter_gym.controllers.CONTROLLERS``, one of those with gains.
    paces
        Commanded paces [m/s], rising.
    gains
        For each pace, fields of the controller; those that are not named have their defaults.
    """

    controller: str
    paces: tuple[float, ...]
    gains: tuple[Mapping[str, Any], ...]

    def __post_init__(self) -> None:
        """Check names and numbers by making the controllers."""
        rising = all(low < high for low, high in pairwise((0.0, *self.paces, np.inf)))
        require(rising and len(self.paces) > 0, self, "paces", self.paces, "rising numbers > 0")
        require(len(self.gains) == len(self.paces), self, "gains", self.gains, "one set for each pace")
        self.schedule()

    def schedule(self) -> "PaceSchedule":
        """Return the controller: gains linear in the commanded pace between those of the paces."""
        from pter_gym.controllers import PaceSchedule

        made = [make_guided(self.controller, gains) for gains in self.gains]
        return PaceSchedule(tuple(zip(self.paces, made, strict=True)))

    def complete(self) -> "Base":
        """Return it with all gains named, which is what can be stored: defaults change."""
        made = [controller for _, controller in self.schedule().knots]
        return replace(
            self, gains=tuple({**gains_of(each), **given} for each, given in zip(made, self.gains, strict=True))
        )


@dataclass(frozen=True)
class Interface:
    """What a network sees and how its outputs become voltages.

    Attributes
    ----------
    inputs
        What it sees, in order.
    reach
        Voltage of an output of 1, relative to the middle of the range or to the base controller [V].
    base
        What the outputs correct; None for the middle of the range.
    history
        The network sees all inputs of now; how many control steps ago it sees them too, rising. Before the start of an
        episode they are as they were at the start.
    averages
        Time constants in control steps, rising: the network sees all inputs behind a first-order low-pass as well.
    normalised
        Whether the outputs a are the environments' normalised actions, for voltage_max·((a + 1)/2)². They correct no
        base then and have no reach.
    """

    inputs: tuple[Input, ...]
    reach: float
    base: Base | None = None
    history: tuple[int, ...] = ()
    averages: tuple[int, ...] = ()
    normalised: bool = False

    def __post_init__(self) -> None:
        """Check the numbers."""
        require_flag(self, "normalised")
        require(
            not (self.normalised and self.base), self, "normalised", self.normalised, "False with a base controller"
        )
        require(len(self.inputs) > 0, self, "inputs", self.inputs, "at least one input")
        require_number(self, "reach", above=0.0)
        for name, longest in (("history", LONGEST), ("averages", SLOWEST)):
            steps: tuple[int, ...] = getattr(self, name)
            rising = all(low < high for low, high in pairwise((0, *steps, longest + 1)))
            accepted = f"rising whole numbers from 1 to {longest}"
            require(rising and all(type(step) is int for step in steps), self, name, steps, accepted)

    @property
    def size(self) -> int:
        """Number of inputs of the network, those of earlier control steps and averages included."""
        return len(self.inputs) * (1 + len(self.history) + len(self.averages))

    def bind(self, machine: Machine, layout: Layout) -> "BoundInterface":
        """Return what translates for a nominal machine and a layout of observations.

        Raises
        ------
        ParameterError
            If there is no such quantity in the observations; it tells the nearest.
        """
        return BoundInterface(self, machine, layout)


class BoundInterface:
    """An interface that is ready to translate."""

    def __init__(self, interface: Interface, machine: Machine, layout: Layout) -> None:
        self.layout = layout
        self.size = interface.size
        self.reach = interface.reach
        self.normalised = interface.normalised
        self.voltage_max = machine.clutch.voltage_max
        self.base = None if interface.base is None else interface.base.schedule().bind(machine, layout)
        names = available(layout, residual=self.base is not None)
        for each in interface.inputs:
            if each.name not in names:
                raise unknown_name("inputs", each.name, names)
        self._scales = layout.scales
        self._columns = [names.index(each.name) for each in interface.inputs]
        self._center = np.array([each.center for each in interface.inputs])
        self._scale = np.array([each.scale for each in interface.inputs])
        self._past = interface.history, interface.averages

    def begin(self, worlds: int) -> "Past":
        """Return the empty past of so many worlds."""
        blank = np.zeros((worlds, 0)) if self.base is None else self.base.empty_memory(worlds)
        return Past(blank, len(self._columns), *self._past)

    def see(self, obs: NDArray[np.float32], past: "Past", *, passing: bool = False) -> tuple[Array, Array]:
        """Return what the network sees and the voltages that it corrects.

        Parameters
        ----------
        obs
            Observations, float32 (N, entries).
        past
            What the network saw before of the same worlds; the present is added to it, unless it is only passing.
        passing
            Whether these observations are only looked at.

        Returns
        -------
        inputs, volts
            (N, size), each within ±LIMIT; (N, 4) [V].

        Raises
        ------
        ParameterError
            If the observations do not fit the layout.
        """
        rows = np.ascontiguousarray(obs, np.float32)
        if rows.ndim != 2 or rows.shape[1] != len(self.layout):
            raise ParameterError(f"observation must have {len(self.layout)} entries, got the shape {rows.shape}")
        base = self._corrected(rows, past, passing)
        values = quantities(rows * self._scales, base, self.layout, residual=self.base is not None)
        present = np.clip((values[:, self._columns] - self._center) / self._scale, -LIMIT, LIMIT)
        return past.look(present) if passing else past.add(present), base

    def _corrected(self, rows: NDArray[np.float32], past: "Past", passing: bool) -> Array:
        """Return the voltages that the outputs correct [V], (N, 4)."""
        if self.base is None:
            return np.full((len(rows), 4), 0.5 * self.voltage_max)
        memory = past.law_memory()
        volts = self.base.volts(rows, memory)
        if not passing:
            past.keep(memory)
        return volts.astype(np.float64)

    def volts(self, base: Array, outputs: NDArray[np.floating]) -> NDArray[np.float32]:
        """Return voltages [V], float32 (N, 4), for the outputs (N, 4) of a network; beyond [−1, 1] they are limited."""
        limited = np.clip(np.asarray(outputs, np.float64), -1.0, 1.0)
        if self.normalised:
            return squared((limited + 1.0) * (self.voltage_max / 2.0), self.voltage_max).astype(np.float32)
        wanted = base + self.reach * limited
        return np.clip(wanted, 0.0, self.voltage_max).astype(np.float32)


class Past:
    """What a network saw of some worlds before.

    Parameters
    ----------
    blank
        What the law of the base controller keeps at the start of an episode, a row for each world; without entries if
        there is no base.
    inputs
        Number of inputs.
    history, averages
        As in ``Interface``.
    """

    def __init__(self, blank: Array, inputs: int, history: tuple[int, ...], averages: tuple[int, ...]) -> None:
        self.worlds = worlds = len(blank)
        self._blank = blank
        self._ages = np.array((0, *history))
        self._shares = 1.0 / np.array(averages)[:, None, None]
        self._rows = np.zeros((int(self._ages[-1]) + 1, worlds, inputs))
        self._means = np.zeros((len(averages), worlds, inputs))
        self._memory = blank.copy()
        self._empty = np.ones(worlds, np.bool_)

    def forget(self, worlds: NDArray[np.bool_]) -> None:
        """Forget the past of some worlds, (N,)."""
        self._empty |= worlds

    def add(self, present: Array) -> Array:
        """Return inputs (N, inputs) with earlier ones behind them, the latest first, then averages: (N, size)."""
        rows, means = self._with(present)
        self._rows[:], self._means[:], self._empty[:] = rows, means, False
        return self._shown(rows, means)

    def look(self, present: Array) -> Array:
        """Return what ``add`` would, and keep nothing."""
        return self._shown(*self._with(present))

    def law_memory(self) -> Array:
        """Return a copy of what the law of the base controller keeps, a row for each world."""
        return np.where(self._empty[:, None], self._blank, self._memory)

    def keep(self, memory: Array) -> None:
        """Keep what the law keeps from now on."""
        self._memory[:] = memory

    def get_state(self) -> dict[str, NDArray[Any]]:
        """Return copies of all that changes."""
        own = {
            "past_rows": self._rows,
            "past_means": self._means,
            "past_memory": self._memory,
            "past_empty": self._empty,
        }
        return {name: part.copy() for name, part in own.items()}

    def set_state(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Go on where ``get_state`` was called."""
        self._rows[:] = state["past_rows"]
        self._means[:] = state["past_means"]
        self._memory[:] = state["past_memory"]
        self._empty[:] = state["past_empty"]

    def _with(self, present: Array) -> tuple[Array, Array]:
        """Return rows and averages with the present; a world that begins has seen nothing else before."""
        fresh = self._empty[:, None]
        rows = np.concatenate([present[None], self._rows[:-1]])
        means = self._means + self._shares * (present - self._means)
        return np.where(fresh, present, rows), np.where(fresh, present, means)

    def _shown(self, rows: Array, means: Array) -> Array:
        return np.concatenate([rows[self._ages], means]).transpose(1, 0, 2).reshape(rows.shape[1], -1)


def squared(linear: Array, voltage_max: float) -> Array:
    """Return the voltages [V] of normalised actions, from their share of the bounds times the largest voltage [V].

    They have the bits of the kernel's ``scaled_volts``, which needs numba.
    """
    return linear * (linear / voltage_max)


def available(layout: Layout, *, residual: bool) -> list[str]:
    """Return the names of all quantities that a network can see, in the order of ``quantities``."""
    derived = [name for names in DERIVED for name in names]
    return [*layout.names, *derived, *(BASE_INPUTS if residual else ())]


def seen_without(names: Sequence[str], blind: Sequence[str]) -> list[str]:
    """Return the names of the quantities that remain to be seen.

    Parameters
    ----------
    names
        Of all quantities, as ``available`` gives them.
    blind
        Which are not to be seen: a name, or a group, which is all names that begin with it and an underscore.

    Raises
    ------
    ParameterError
        If there is no such quantity or group, which tells the nearest, or none would remain.
    """
    groups = dict.fromkeys(name.rpartition("_")[0] for name in names if "_" in name)
    known = [*names, *(group for group in groups if group not in names)]
    for each in blind:
        if each not in known:
            raise unknown_name("blind", each, known)
    left_out = {name for each in blind for name in _meant(each, names)}
    remaining = [name for name in names if name not in left_out]
    if not remaining:
        raise ParameterError(f"blind must leave something to be seen, got {list(blind)!r}")
    return remaining


def _meant(each: str, names: Sequence[str]) -> list[str]:
    """Return the quantities of a name or a group."""
    return [each] if each in names else [name for name in names if name.startswith(f"{each}_")]


def quantities(physical: Array, base: Array, layout: Layout, *, residual: bool) -> Array:
    """Return all quantities that a network can see, in their units, (N, names).

    Parameters
    ----------
    physical
        Observations in their units, (N, entries).
    base
        Voltages of the base controller [V], (N, 4).
    layout
        Of the observations.
    residual
        Whether the base's voltages are among the quantities.
    """
    known = dict(zip(layout.names, physical.T, strict=True))
    derived = {name: values for derive in DERIVED.values() for name, values in derive(known).items()}
    columns = [physical, np.stack([derived[name] for names in DERIVED for name in names], axis=1)]
    return np.concatenate([*columns, base] if residual else columns, axis=1)
