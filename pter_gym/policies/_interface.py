"""How an observation becomes a network's inputs, and how its outputs become voltages.

The inputs are quantities in the observation or derived from it, each shifted and scaled. The
outputs, one for each clutch and within [−1, 1], are voltages relative to the middle of the range or
to a base law's voltages (a residual policy), or they are the environments' normalised
actions.
"""

from dataclasses import dataclass, field
from typing import Any

from pter_gym._compiled.layout import Layout
from pter_gym._compiled.records import layout_of
from pter_gym._internal.checks import are_rising
from pter_gym._internal.fields import (
    require,
    require_flag,
    require_kind,
    require_number,
    require_whole,
)
from pter_gym._physics.arm import UnitVector, Vector, components
from pter_gym.controllers import PaceSchedule, Scaled
from pter_gym.controllers._network import BASE_INPUTS, DERIVED, INPUT_LIMIT
from pter_gym.controllers._policy import Rows, clutch_rows
from pter_gym.controllers._scaled import Traits, traits_of
from pter_gym.params import BASELINE, Machine
from pter_gym.tasks.path_following import PathFollowing
from pter_gym.tasks.path_following._actions import volts_of

MAX_DELAY = 64
"""Largest delay of an input, in steps of the policy."""

MAX_AVERAGE = 1000
"""Largest time constant of an average, in steps of the policy."""

MAX_INPUTS = 256
"""Largest number of inputs, without earlier ones and averages."""


@dataclass(frozen=True)
class Input:
    """One input of a network: (value − center) / scale, limited to ±10.

    Attributes
    ----------
    name
        An entry of the observation, a heading relative to a link such as ``heading_a_cos``, or
        ``base_1`` to ``base_4``, the voltages of the base controller.
    center, scale
        In the unit of the quantity; the scale is positive.
    """

    name: str
    center: float = 0.0
    scale: float = 1.0

    def scaled(self, value: float) -> float:
        """Return the network's input for a value in the input's unit."""
        return min(max((value - self.center) / self.scale, -INPUT_LIMIT), INPUT_LIMIT)

    def on(self, machine: Machine, interface: "Interface") -> "Input | None":
        """Return the input on another machine than the training's; None for a missing clutch."""
        kind, _, number = self.name.rpartition("_")
        clutches = [str(1 + k) for k in range(len(interface.clutches))]
        if kind not in ("volts", "base", "torque") or number not in clutches:
            return self
        rows, row = clutch_rows(machine), interface.clutches[int(number) - 1]
        if row not in rows:
            return None
        ratio = machine.clutch.voltage_max / interface.voltage_max if kind != "torque" else 1.0
        name = f"{kind}_{1 + rows.index(row)}"
        return Input(name, self.center * ratio, self.scale * ratio)

    def __post_init__(self) -> None:
        """Check the numbers; the name is checked on binding."""
        require_kind(self, "name", str)
        require_number(self, "center")
        require_number(self, "scale", above=0.0)


@dataclass(frozen=True)
class Interval:
    """The range of a trait of the machines in training.

    Attributes
    ----------
    trait
        Its name: one of ``pter_gym.controllers._scaled.Traits``.
    low, high
        Its ends, in SI.
    """

    trait: str
    low: float
    high: float

    def __post_init__(self) -> None:
        """Check that there is such a trait, and that the ends are in order."""
        require(self.trait in Traits._fields, self, "trait", f"one of {', '.join(Traits._fields)}")
        require_number(self, "low")
        require_number(self, "high", at_least=self.low)


@dataclass(frozen=True)
class Interface:
    """A network's inputs, and how its outputs become voltages.

    Attributes
    ----------
    inputs
        Its inputs, in order.
    reach
        Voltage of an output of 1, relative to the middle of the range or to the base law
        [V].
    base
        The law that the outputs correct; None for the middle of the range. One that is ``Scaled``
        has the gains for each machine.
    history
        Delays in steps, rising, at which the network also sees its inputs. Before the start of
        an episode, they equal those at the start.
    averages
        Time constants in steps, rising, of first-order low-passes of its inputs, which the
        network also sees.
    normalised
        Whether the outputs a are the environments' normalised actions, for
        voltage_max·((a + 1)/2)². Then there is no base, and ``reach`` is not used.
    frame_skip
        Control steps for which an action is held: a step of the policy.
    voltage_max
        Largest voltage of the clutches that it was trained with [V].
    clutches
        Rows of W of these clutches.
    control_period
        Control period of its training [s].
    trained
        Ranges of the machines in training, if they differed.
    """

    inputs: tuple[Input, ...]
    reach: float
    base: PaceSchedule | Scaled | None = None
    history: tuple[int, ...] = ()
    averages: tuple[int, ...] = ()
    normalised: bool = False
    frame_skip: int = 1
    voltage_max: float = BASELINE.clutch.voltage_max
    clutches: Rows = clutch_rows(BASELINE)
    control_period: float = field(default=PathFollowing.control_period, metadata={"later": True})
    trained: tuple[Interval, ...] = field(default=(), metadata={"later": True})

    def __post_init__(self) -> None:
        """Check each field by itself."""
        known = {type(each) for each in self.inputs} == {Input} and len(self.inputs) <= MAX_INPUTS
        require(known, self, "inputs", f"1 to {MAX_INPUTS} inputs")
        for name in ("reach", "voltage_max", "control_period"):
            require_number(self, name, above=0.0)
        require_kind(self, "base", PaceSchedule, Scaled, type(None))
        require_flag(self, "normalised")
        absolute = not (self.normalised and self.base)
        require(absolute, self, "normalised", "False with a base controller")
        require_whole(self, "frame_skip")
        for name, largest in (("history", MAX_DELAY), ("averages", MAX_AVERAGE)):
            steps, accepted = getattr(self, name), f"rising whole numbers from 1 to {largest}"
            require(are_rising(steps, largest), self, name, accepted, got=steps)
        are_intervals = {type(each) for each in self.trained} <= {Interval}
        require(are_intervals, self, "trained", "a tuple of Interval")
        require_kind(self, "clutches", tuple)
        for row in self.clutches:
            require(
                type(row) is tuple and len(row) == 2, self, "clutches", "pairs of numbers", got=row
            )

    @property
    def size(self) -> int:
        """Number of inputs of the network, including earlier ones and averages."""
        return len(self.inputs) * (1 + len(self.history) + len(self.averages))

    @property
    def for_any_machine(self) -> bool:
        """Whether the policy is made for machines with other drives, clutches and arms."""
        return isinstance(self.base, Scaled)

    def beyond_training(self, machine: Machine) -> list[str]:
        """Return in words which traits of a machine are outside the training's ranges."""
        traits, entries = traits_of(machine), layout_of(Traits).fields
        known = {each.name: (value, each) for each, value in zip(entries, traits, strict=True)}
        beyond: list[str] = []
        for interval in self.trained:
            value, entry = known[interval.trait]
            if not interval.low <= value <= interval.high:
                unit = f" {entry.unit}" * (entry.unit != "1")
                ends = dict.fromkeys(f"{end:.3g}" for end in (interval.low, interval.high))
                beyond.append(f"{entry.meaning} {value:.3g}{unit}, not {' to '.join(ends)}{unit}")
        return beyond


def input_names(layout: Layout, *, residual: bool) -> list[str]:
    """Return the names of what a network can see, in the order of ``input_values``.

    With ``residual``, a base's voltages are among them although the observations lack them.
    """
    return [*layout.names, *DERIVED, *(BASE_INPUTS if residual else ())]


def input_values(physical: Any, layout: Layout, base: Any = None) -> Any:
    """Return what a network can see, in its units, (N, names).

    Parameters
    ----------
    physical
        Observations in their units, (N, entries); a NumPy array or one from a library with the same
        interface.
    layout
        Of the observations.
    base
        Voltages of the base law [V], (N, 4), where they are not in the observations; None without
        one. Those below 0, of released clutches, are seen as 0.
    """
    known = dict(zip(layout.names, physical.T, strict=True))
    heading = Vector(known["heading_cos"], known["heading_sin"])
    derived: list[Any] = []
    for link in ("a", "b"):
        derived += components(heading, UnitVector(known[f"cos_{link}"], known[f"sin_{link}"]))
    library = physical.__array_namespace__()
    columns = [physical, library.stack(derived, axis=1)]
    base = () if base is None else (library.maximum(base, 0.0),)
    return library.concat([*columns, *base], axis=1)


def to_volts(outputs: Any, base: Any, interface: Interface) -> Any:
    """Return voltages [V] for a network's outputs, both (N, clutches), clipped to [−1, 1]."""
    library, top = outputs.__array_namespace__(), interface.voltage_max
    limited = library.clip(outputs, -1.0, 1.0)
    if interface.normalised:
        return volts_of(limited, -1.0, 1.0, top)
    return corrected(outputs, base[:, : len(interface.clutches)], interface.reach, top)


def corrected(outputs: Any, base: Any, reach: float, voltage_max: float) -> Any:
    """Return voltages [V] within the range, corrected by up to ``reach``; all (N, clutches).

    Clipping comes between product and sum, so no compiler joins the two in one rounding.
    """
    library = outputs.__array_namespace__()
    return library.clip(base + library.clip(reach * outputs, -reach, reach), 0.0, voltage_max)
