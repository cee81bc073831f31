"""A device as its data sheet has it: a few numbers of a machine, and a law whose gains follow them."""

import math
from dataclasses import dataclass, fields, replace
from typing import Annotated, NamedTuple

from pter_gym._compiled.layout import Layout
from pter_gym._compiled.records import Entry, layout_of
from pter_gym.controllers._guided import Guided, PaceSchedule
from pter_gym.controllers._policy import Policy
from pter_gym.params import BASELINE, Machine, find_machine, require
from pter_gym.params._connection import PAPER_CLUTCHES

PAPER_ROWS = tuple(clutch.row for clutch in PAPER_CLUTCHES)


class Device(NamedTuple):
    """What a data sheet says of a machine; ratios are to PTER's own numbers.

    A torque T, of PTER's T₀ at the largest voltage, appears as T/(T + T₀): 0 for a clutch that is
    not there, ½ for PTER's own.
    """

    torque_1: Annotated[float, Entry("1", "T/(T + T₀) of the brake of link A")]
    torque_2: Annotated[float, Entry("1", "T/(T + T₀) of the brake of link B")]
    torque_3: Annotated[float, Entry("1", "T/(T + T₀) of the clutch that couples the links")]
    torque_4: Annotated[float, Entry("1", "T/(T + T₀) of the clutch that couples them inversely")]
    half: Annotated[float, Entry("1", "torque at half the voltage over that at all of it")]
    off_state: Annotated[float, Entry("1", "torque without voltage over that at all of it")]
    breakaway: Annotated[float, Entry("1", "breakaway torque over dynamic torque")]
    lag: Annotated[float, Entry("1", "logarithm of the ratio of time constants")]
    length_a: Annotated[float, Entry("1", "ratio of the lengths of link A")]
    length_b: Annotated[float, Entry("1", "ratio of the lengths of link B")]
    inertia_a: Annotated[float, Entry("1", "logarithm of the ratio of inertias of axis A")]
    inertia_b: Annotated[float, Entry("1", "logarithm of the ratio of inertias of axis B")]


DEVICE = layout_of(Device)
"""Names, units and meanings of a device's numbers."""


def device_of(machine: Machine) -> Device:
    """Return what a data sheet says of a machine."""
    arm, clutch, own = machine.arm, machine.clutch, BASELINE
    top = clutch.voltage_max
    torque = clutch.dynamic.torque(top)
    usual = own.clutch.dynamic.torque(own.clutch.voltage_max)
    there = {c.row: torque * s for c, s in zip(machine.clutches, machine.slot_scale, strict=False)}
    torques = [there.get(row, 0.0) for row in PAPER_ROWS]
    return Device(
        *(each / (each + usual) for each in torques),
        half=clutch.dynamic.torque(0.5 * top) / torque,
        off_state=clutch.dynamic.off_state / torque,
        breakaway=clutch.breakaway.torque(top) / torque,
        lag=math.log(clutch.time_constant / own.clutch.time_constant),
        length_a=arm.length_a / own.arm.length_a,
        length_b=arm.length_b / own.arm.length_b,
        inertia_a=math.log(arm.inertia_a / own.arm.inertia_a),
        inertia_b=math.log(arm.inertia_b / own.arm.inertia_b),
    )


@dataclass(frozen=True, kw_only=True)
class Powers:
    """How a gain follows a device: powers of its ratios to PTER.

    Attributes
    ----------
    gain
        Name of the gain.
    torque, lag, mass, size
        Exponents of the ratios of the mean torque of its clutches, of its time constant, of the
        tip's mass and of the arm's length.
    """

    gain: str
    torque: float = 0.0
    lag: float = 0.0
    mass: float = 0.0
    size: float = 0.0

    def factor(self, ratios: tuple[float, float, float, float]) -> float:
        """Return what the gain is multiplied by."""
        exponents = self.torque, self.lag, self.mass, self.size
        return math.prod(x**power for x, power in zip(ratios, exponents, strict=True))


def ratios_of(machine: Machine) -> tuple[float, float, float, float]:
    """Return mean torque of the clutches, time constant, tip mass and size over PTER's."""

    def numbers(machine: Machine) -> tuple[float, float, float, float]:
        arm, clutch = machine.arm, machine.clutch
        scales = [scale for scale in machine.slot_scale if scale > 0.0] or [1.0]
        torque = clutch.dynamic.torque(clutch.voltage_max) * math.fsum(scales) / len(scales)
        size = arm.length_a + arm.length_b
        mass = math.sqrt(arm.inertia_a * arm.inertia_b) / (arm.length_a * arm.length_b)
        return torque, clutch.time_constant, mass, size

    return tuple(a / b for a, b in zip(numbers(machine), numbers(BASELINE), strict=True))


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
        names = [item.name for item in fields(self.schedule.knots[0][1])]
        for each in self.powers:
            require(each.gain in names, self, "powers", f"of gains of the law: {names}")

    def for_machine(self, machine: Machine) -> PaceSchedule:
        """Return the law with the gains for a machine."""
        ratios = ratios_of(machine)
        knots = tuple((pace, self._scaled(law, ratios)) for pace, law in self.schedule.knots)
        return replace(self.schedule, knots=knots)

    def _scaled(self, law: Guided, ratios: tuple[float, float, float, float]) -> Guided:
        gains: dict[str, float] = {}
        for each in self.powers:
            ranges = law.ranges.get(each.gain, {})
            gain = getattr(law, each.gain) * each.factor(ratios)
            most = ranges.get("at_most", 0.99 * ranges["below"] if "below" in ranges else math.inf)
            gains[each.gain] = min(gain, most)
        return replace(law, **gains)

    def bind(self, machine: Machine, layout: Layout) -> Policy:
        """Return the policy for a nominal machine; raises like the law's own ``bind``."""
        machine = find_machine(machine)
        return self.for_machine(machine).bind(machine, layout)
