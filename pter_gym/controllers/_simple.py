"""Policies that ignore the observation: the two extremes, and random voltages."""

from dataclasses import dataclass

from pter_gym._compiled.layout import Layout
from pter_gym._internal.fields import parameter, require_whole
from pter_gym.controllers._gains import CONSTANT, RANDOM
from pter_gym.controllers._laws import built_in
from pter_gym.controllers._policy import Policy
from pter_gym.params import Machine


def largest_voltages(machine: Machine) -> list[float]:
    """Return the largest voltage of each clutch [V], 0 for a missing one."""
    return [machine.clutch.voltage_max if scale > 0.0 else 0.0 for scale in machine.slot_scale]


@dataclass(frozen=True)
class Free:
    """All clutches released: 0 V."""

    def bind(self, machine: Machine, layout: Layout) -> Policy:
        """Return the policy that gives 0 V in all worlds."""
        return Policy.from_law(built_in, [CONSTANT, 0.0, 0.0, 0.0, 0.0], machine, layout)


@dataclass(frozen=True)
class Locked:
    """All clutches at their largest voltage."""

    def bind(self, machine: Machine, layout: Layout) -> Policy:
        """Return the policy that gives all clutches a machine's largest voltage."""
        gains = [CONSTANT, *largest_voltages(machine)]
        return Policy.from_law(built_in, gains, machine, layout)


@dataclass(frozen=True, kw_only=True)
class Random:
    """Voltages drawn evenly from [0, voltage_max] at each control step, others in each episode."""

    seed: int = parameter("1", "chosen", default=0)

    def __post_init__(self) -> None:
        """Check the seed."""
        require_whole(self, "seed", at_least=0, below=2.0**53)

    def bind(self, machine: Machine, layout: Layout) -> Policy:
        """Return the policy that draws up to the largest voltage of a machine's clutches."""
        gains = [RANDOM, self.seed, *largest_voltages(machine)]
        return Policy.from_law(built_in, gains, machine, layout)
