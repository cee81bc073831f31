"""Policies that ignore the observation: the two extremes, and random voltages."""

from dataclasses import dataclass

import numpy as np

from pter_gym._compiled.layout import Layout
from pter_gym.controllers._base import Policy
from pter_gym.controllers._laws import CONSTANT, RANDOM
from pter_gym.params import Machine, find_machine, quantity, require_whole


def largest_voltages(machine: Machine) -> list[float]:
    """Return the largest voltage of each clutch [V], 0 for a missing one."""
    machine = find_machine(machine)
    return [machine.clutch.voltage_max if scale > 0.0 else 0.0 for scale in machine.slot_scale]


@dataclass(frozen=True)
class Free:
    """All clutches released: 0 V."""

    def bind(self, machine: Machine, layout: Layout) -> Policy:  # noqa: ARG002
        """Return the policy that gives 0 V in all worlds."""
        return Policy(np.array([CONSTANT, 0.0, 0.0, 0.0, 0.0]), layout)


@dataclass(frozen=True)
class Locked:
    """All clutches at their largest voltage."""

    def bind(self, machine: Machine, layout: Layout) -> Policy:
        """Return the policy that gives all clutches a machine's largest voltage."""
        return Policy(np.array([CONSTANT, *largest_voltages(machine)]), layout)


@dataclass(frozen=True, kw_only=True)
class Random:
    """Voltages drawn uniformly from [0, voltage_max] at each control step."""

    seed: int = quantity("1", "chosen", default=0)

    def __post_init__(self) -> None:
        """Check the seed."""
        require_whole(self, "seed", at_least=0, below=2.0**53)

    def bind(self, machine: Machine, layout: Layout) -> Policy:
        """Return the policy that draws up to the largest voltage of a machine's clutches."""
        return Policy(np.array([RANDOM, self.seed, *largest_voltages(machine)]), layout)
