"""Policies that ignore the observation: the two extremes, and random voltages."""

from dataclasses import dataclass

import numpy as np

from pter_gym._compiled.compiler import inlined
from pter_gym._compiled.layout import Layout
from pter_gym._compiled.philox import uniform4
from pter_gym._internal.fields import parameter, require_whole
from pter_gym._physics.clutch import PerClutch
from pter_gym.controllers._gains import MEMORY, Entries
from pter_gym.controllers._policy import Policy
from pter_gym.params import Machine

_RANDOM_STREAM = np.uint64(0x52414E444F4D)


@inlined
def constant(obs: Entries, scales: Entries, gains: Entries, memory: Entries) -> PerClutch:  # noqa: ARG001
    """Return the voltages that the gains are."""
    return PerClutch(gains[0], gains[1], gains[2], gains[3])


@inlined
def drawn(obs: Entries, scales: Entries, gains: Entries, memory: Entries) -> PerClutch:  # noqa: ARG001
    """Return voltages from 0 to each clutch's largest, other draws in each episode.

    The gains hold the seed and the largest voltages.
    """
    draw = np.uint64(memory[MEMORY.kept])
    memory[MEMORY.kept] += 1.0
    u1, u2, u3, u4 = uniform4(
        np.uint64(gains[0]), _RANDOM_STREAM, draw, np.uint64(memory[MEMORY.episode])
    )
    return PerClutch(gains[1] * u1, gains[2] * u2, gains[3] * u3, gains[4] * u4)


def largest_voltages(machine: Machine) -> list[float]:
    """Return the largest voltage of each clutch [V], 0 for a missing one."""
    return [machine.clutch.voltage_max if scale > 0.0 else 0.0 for scale in machine.slot_scale]


@dataclass(frozen=True)
class Free:
    """All clutches released: 0 V."""

    def bind(self, machine: Machine, layout: Layout) -> Policy:
        """Return the policy that gives 0 V in all worlds."""
        return Policy.from_law(constant, [0.0, 0.0, 0.0, 0.0], machine, layout)


@dataclass(frozen=True)
class Locked:
    """All clutches at their largest voltage."""

    def bind(self, machine: Machine, layout: Layout) -> Policy:
        """Return the policy that gives all clutches a machine's largest voltage."""
        return Policy.from_law(constant, largest_voltages(machine), machine, layout)


@dataclass(frozen=True, kw_only=True)
class Random:
    """Voltages drawn evenly from [0, voltage_max] at each control step, others in each episode."""

    seed: int = parameter("1", "chosen", default=0)

    def __post_init__(self) -> None:
        """Check the seed."""
        require_whole(self, "seed", at_least=0, below=2.0**53)

    def bind(self, machine: Machine, layout: Layout) -> Policy:
        """Return the policy that draws up to the largest voltage of a machine's clutches."""
        gains = [self.seed, *largest_voltages(machine)]
        return Policy.from_law(drawn, gains, machine, layout)
