"""Laws whose gains follow what a data sheet says of a device."""

import math
from dataclasses import dataclass, fields, replace
from typing import Annotated, Any, NamedTuple

from pter_gym._compiled.layout import Layout
from pter_gym._compiled.records import Entry
from pter_gym._internal.fields import require, require_kind, require_number
from pter_gym.controllers._guided import Guided, PaceSchedule
from pter_gym.controllers._policy import Policy
from pter_gym.params import BASELINE, Machine, find_machine

DIGITS = 6
"""Significant digits of a scaled gain, so that a computer's own powers do not show."""


class Traits(NamedTuple):
    """What a law or a policy for any device may know of a machine."""

    torque: Annotated[float, Entry("N·m", "mean torque of the clutches at the largest voltage")]
    lag: Annotated[float, Entry("s", "time constant of the clutches")]
    mass: Annotated[float, Entry("kg", "mass at the tip")]
    size: Annotated[float, Entry("m", "length of both links")]
    breakaway: Annotated[float, Entry("1", "breakaway torque over the dynamic torque")]
    brakes: Annotated[float, Entry("1", "axes with a brake")]
    hysteresis: Annotated[float, Entry("1", "hysteresis over the largest voltage")]


class Ratios(NamedTuple):
    """A machine's ``Traits`` over PTER's."""

    torque: float
    lag: float
    mass: float
    size: float


def traits_of(machine: Machine) -> Traits:
    """Return what a law for any device may know of a machine.

    Raises
    ------
    ParameterError
        If it has no clutch.
    """
    arm, largest = machine.arm, machine.clutch.largest
    scales = [scale for scale in machine.slot_scale if scale > 0.0]
    require(len(scales) > 0, machine, "clutch_scale", "above 0 for at least one clutch")
    there = zip(machine.clutches, machine.slot_scale, strict=False)
    axes = {each.row for each, scale in there if scale > 0.0 and 0.0 in each.row}
    return Traits(
        largest.dynamic * math.fsum(scales) / len(scales),
        machine.clutch.time_constant,
        math.sqrt(arm.inertia_a * arm.inertia_b) / (arm.length_a * arm.length_b),
        arm.length_a + arm.length_b,
        largest.breakaway / largest.dynamic,
        len(axes),
        machine.clutch.hysteresis / machine.clutch.voltage_max,
    )


def ratios_of(machine: Machine) -> Ratios:
    """Return a machine's traits over PTER's; raises as ``traits_of``."""
    own, usual = traits_of(machine), traits_of(BASELINE)
    return Ratios(*(getattr(own, name) / getattr(usual, name) for name in Ratios._fields))


@dataclass(frozen=True, kw_only=True)
class Powers:
    """How a gain follows a device: the exponents of its ``Ratios``.

    Attributes
    ----------
    gain
        Name of the gain.
    torque, lag, mass, size
        Exponents of these ratios.
    """

    gain: str
    torque: float = 0.0
    lag: float = 0.0
    mass: float = 0.0
    size: float = 0.0

    def __post_init__(self) -> None:
        """Check the exponents."""
        for name in Ratios._fields:
            require_number(self, name, at_least=-10.0, at_most=10.0)

    def factor(self, ratios: Ratios) -> float:
        """Return what the gain is multiplied by."""
        return math.prod(ratio ** getattr(self, name) for name, ratio in ratios._asdict().items())


@dataclass(frozen=True, kw_only=True)
class Scaled:
    """A law for any device: gains for PTER, each multiplied by powers of a device's ratios.

    Attributes
    ----------
    schedule
        The law with its gains for PTER.
    powers
        How gains follow the device; those that are not named are PTER's.
    """

    schedule: PaceSchedule
    powers: tuple[Powers, ...] = ()

    def __post_init__(self) -> None:
        """Check that the powers are of gains of the law."""
        require_kind(self, "schedule", PaceSchedule)
        names = [item.name for item in fields(self.schedule.knots[0][1])]
        for each in self.powers:
            require(each.gain in names, self, "powers", f"of gains of the law: {names}")

    def for_machine(self, machine: Machine) -> PaceSchedule:
        """Return the law with the gains for a machine; raises as ``traits_of``."""
        knots = tuple((pace, self._scaled(law, machine)) for pace, law in self.schedule.knots)
        return replace(self.schedule, knots=knots)

    def _scaled(self, law: Guided, machine: Machine) -> Guided:
        ratios, gains = ratios_of(machine), dict[str, Any]()
        for each in self.powers:
            ranges = law.ranges.get(each.gain, {})
            gain = getattr(law, each.gain) * each.factor(ratios)
            most = ranges.get("at_most", 0.99 * ranges["below"] if "below" in ranges else math.inf)
            gains[each.gain] = float(f"{min(gain, most):.{DIGITS}g}")
        return replace(law, **gains)

    def bind(self, machine: Machine, layout: Layout) -> Policy:
        """Return the policy for a nominal machine; raises like the law's own ``bind``."""
        machine = find_machine(machine)
        return self.for_machine(machine).bind(machine, layout)
