"""How an observation becomes a network's inputs, and how its outputs become voltages.

The inputs are quantities in the observation or derived from it, each shifted and scaled. The four outputs within
[−1, 1] are voltages relative to the middle of the range or to a base controller's voltages (a residual policy), or they
are the environments' normalised actions.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pter_gym._compiled.layout import Layout
from pter_gym.errors import ParameterError, unknown_name
from pter_gym.params import Machine, require, require_flag, require_kind, require_number, require_whole
from pter_gym.policies._stored_gains import gains_of, make_guided

if TYPE_CHECKING:
    from pter_gym.controllers import PaceSchedule

Array = NDArray[np.float64]

LIMIT = 10.0
"""Inputs of a network are limited to ±LIMIT of their scales."""

CLUTCHES = range(1, 5)

LONGEST = 64
"""Most control steps that a network can look back."""

SLOWEST = 1000
"""Longest time constant of an average in control steps."""

BASE_INPUTS = tuple(f"base_{x}" for x in CLUTCHES)
"""Voltages of the base controller [V]."""


DERIVED = ("heading_a_cos", "heading_a_sin", "heading_b_cos", "heading_b_sin")
"""Quantities that are derived from the observation: cosine and sine of the angles from links A and B to the path."""


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
        """Check the numbers; the name is checked on binding."""
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
        For each pace, the controller's gains by name; missing ones take their defaults.
    """

    controller: str
    paces: tuple[float, ...]
    gains: tuple[Mapping[str, Any], ...]

    def __post_init__(self) -> None:
        """Check names and numbers by making the controllers, and fill in missing gains."""
        rising = all(low < high for low, high in pairwise((0.0, *self.paces, np.inf)))
        require(rising and len(self.paces) > 0, self, "paces", self.paces, "rising numbers > 0")
        require(len(self.gains) == len(self.paces), self, "gains", self.gains, "one set for each pace")
        knots = self.schedule().knots
        object.__setattr__(self, "gains", tuple(gains_of(controller) for _, controller in knots))

    def schedule(self) -> "PaceSchedule":
        """Return the controller: gains linear in the commanded pace between those of the paces."""
        from pter_gym.controllers import PaceSchedule

        made = [make_guided(self.controller, gains) for gains in self.gains]
        return PaceSchedule(tuple(zip(self.paces, made, strict=True)))


@dataclass(frozen=True)
class Interface:
    """A network's inputs, and how its outputs become voltages.

    Attributes
    ----------
    inputs
        Its inputs, in order.
    reach
        Voltage of an output of 1, relative to the middle of the range or to the base controller [V].
    base
        The controller that the outputs correct; None for the middle of the range.
    history
        Delays in control steps, rising, at which the network also sees its inputs. Before the start of an episode, they
        equal those at the start.
    averages
        Time constants in control steps, rising, of first-order low-passes of its inputs, which the network also sees.
    normalised
        Whether the outputs a are the environments' normalised actions, for voltage_max·((a + 1)/2)². Then there is no
        base, and ``reach`` is not used.
    frame_skip
        Control steps for which a decision is held; history and averages then count decisions.
    """

    inputs: tuple[Input, ...]
    reach: float
    base: Base | None = None
    history: tuple[int, ...] = ()
    averages: tuple[int, ...] = ()
    normalised: bool = False
    frame_skip: int = 1

    def __post_init__(self) -> None:
        """Check the numbers."""
        require_flag(self, "normalised")
        require(
            not (self.normalised and self.base), self, "normalised", self.normalised, "False with a base controller"
        )
        require(len(self.inputs) > 0, self, "inputs", self.inputs, "at least one input")
        require_number(self, "reach", above=0.0)
        require_whole(self, "frame_skip")
        for name, longest in (("history", LONGEST), ("averages", SLOWEST)):
            steps: tuple[int, ...] = getattr(self, name)
            rising = all(low < high for low, high in pairwise((0, *steps, longest + 1)))
            accepted = f"rising whole numbers from 1 to {longest}"
            require(rising and all(type(step) is int for step in steps), self, name, steps, accepted)

    @property
    def size(self) -> int:
        """Number of inputs of the network, including earlier control steps and averages."""
        return len(self.inputs) * (1 + len(self.history) + len(self.averages))

    def bind(self, machine: Machine, layout: Layout) -> "BoundInterface":
        """Return the interface for a nominal machine and an observation layout.

        Raises
        ------
        ParameterError
            If the observations lack an input; the message suggests the nearest.
        """
        return BoundInterface(self, machine, layout)


class BoundInterface:
    """An interface bound to a machine and an observation layout.

    Attributes
    ----------
    columns, center, scale
        For each input: its index among the quantities, its shift and its scale.
    """

    def __init__(self, interface: Interface, machine: Machine, layout: Layout) -> None:
        self.layout = layout
        self.size = interface.size
        self.reach = interface.reach
        self.normalised = interface.normalised
        self.frame_skip = interface.frame_skip
        self.voltage_max = machine.clutch.voltage_max
        self.base = None if interface.base is None else interface.base.schedule().bind(machine, layout)
        names = available(layout, residual=self.base is not None)
        for each in interface.inputs:
            if each.name not in names:
                raise unknown_name("inputs", each.name, names)
        self.columns = [names.index(each.name) for each in interface.inputs]
        self.center = np.array([each.center for each in interface.inputs])
        self.scale = np.array([each.scale for each in interface.inputs])
        self.history, self.averages = interface.history, interface.averages

    def begin(self, worlds: int) -> "Past":
        """Return the empty past of that many worlds."""
        blank = np.zeros((worlds, 0)) if self.base is None else self.base.empty_memory(worlds)
        return Past(blank, len(self.columns), self.history, self.averages)

    def see(self, obs: NDArray[np.float32], past: "Past") -> tuple[Array, Array]:
        """Return the network's inputs and the voltages that it corrects.

        Parameters
        ----------
        obs
            Observations, float32 (N, entries).
        past
            What the network has seen of the same worlds; the present is added.

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
        base = np.full((len(rows), 4), 0.5 * self.voltage_max)
        if self.base is not None:
            base = self.base.volts(rows, past.law_memory()).astype(np.float64)
        values = quantities(rows * self.layout.scales, base, self.layout, residual=self.base is not None)
        present = np.clip((values[:, self.columns] - self.center) / self.scale, -LIMIT, LIMIT)
        return past.add(present), base

    def volts(self, base: Array, outputs: NDArray[np.floating]) -> NDArray[np.float32]:
        """Return voltages [V], float32 (N, 4), for the outputs (N, 4) of a network; they are clipped to [−1, 1]."""
        limited = np.clip(np.asarray(outputs, np.float64), -1.0, 1.0)
        if self.normalised:
            return squared((limited + 1.0) * (self.voltage_max / 2.0), self.voltage_max).astype(np.float32)
        wanted = base + self.reach * limited
        return np.clip(wanted, 0.0, self.voltage_max).astype(np.float32)


class Past:
    """What a network has seen of some worlds.

    Parameters
    ----------
    blank
        Memory of the base controller's law at the start of an episode, a row for each world; rows are empty without a
        base.
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

    def law_memory(self) -> Array:
        """Return the memory of the base controller's law, a row for each world, for the law to change."""
        self._memory[:] = np.where(self._empty[:, None], self._blank, self._memory)
        return self._memory

    def add(self, present: Array) -> Array:
        """Return inputs (N, inputs) followed by earlier ones, the latest first, and averages: (N, size).

        In a world that begins, the past equals the present.
        """
        fresh = self._empty[:, None]
        self._rows[1:] = self._rows[:-1].copy()
        self._rows[0] = present
        self._rows[:] = np.where(fresh, present, self._rows)
        self._means[:] = np.where(fresh, present, self._means + self._shares * (present - self._means))
        self._empty[:] = False
        return np.concatenate([self._rows[self._ages], self._means]).transpose(1, 0, 2).reshape(self.worlds, -1)

    def get_state(self) -> dict[str, NDArray[Any]]:
        """Return the changing state."""
        return {"rows": self._rows, "means": self._means, "memory": self._memory, "empty": self._empty}

    def set_state(self, state: Mapping[str, Any]) -> None:
        """Restore the state from ``get_state``; arrays may be tensors."""
        for name, mine in self.get_state().items():
            mine[:] = state[name]


def squared(linear: Any, voltage_max: float) -> Any:
    """Return the voltages [V] of normalised actions, from their share of the bounds times the largest voltage [V].

    Bitwise identical to the kernel's ``scaled_volts``, without numba.
    """
    return linear * (linear / voltage_max)


def available(layout: Layout, *, residual: bool) -> list[str]:
    """Return the names of all quantities that a network can see, in the order of ``quantities``."""
    return [*layout.names, *DERIVED, *(BASE_INPUTS if residual else ())]


def seen_without(names: Sequence[str], blind: Sequence[str]) -> list[str]:
    """Return the names of the quantities that remain visible.

    Parameters
    ----------
    names
        All quantities, from ``available``.
    blind
        Names or groups to leave out; a group is all names that begin with it and an underscore.

    Raises
    ------
    ParameterError
        If there is no such quantity or group (the nearest is suggested), or none would remain.
    """
    groups = dict.fromkeys(name.rpartition("_")[0] for name in names if "_" in name)
    known = [*names, *(group for group in groups if group not in names)]
    for each in blind:
        if each not in known:
            raise unknown_name("blind", each, known)
    remaining = [name for name in names if not any(_covers(each, name, names) for each in blind)]
    if not remaining:
        raise ParameterError(f"blind must leave something to be seen, got {list(blind)!r}")
    return remaining


def _covers(each: str, name: str, names: Sequence[str]) -> bool:
    """Tell whether a name or a group is or contains the name of a quantity."""
    return name == each if each in names else name.startswith(f"{each}_")


def quantities(physical: Any, base: Any, layout: Layout, *, residual: bool) -> Any:
    """Return all quantities that a network can see, in their units, (N, names).

    Parameters
    ----------
    physical
        Observations in their units, (N, entries); a NumPy array or one from a library with the same interface.
    base
        Voltages of the base controller [V], (N, 4).
    layout
        Of the observations.
    residual
        Whether the base's voltages are among the quantities.
    """
    known = dict(zip(layout.names, physical.T, strict=True))
    cos, sin = known["heading_cos"], known["heading_sin"]
    derived: list[Any] = []
    for link in ("a", "b"):
        cos_link, sin_link = known[f"cos_{link}"], known[f"sin_{link}"]
        derived += [cos * cos_link + sin * sin_link, sin * cos_link - cos * sin_link]
    library = physical.__array_namespace__()
    columns = [physical, library.stack(derived, axis=1)]
    return library.concat([*columns, base] if residual else columns, axis=1)
