"""Policies that ignore the observation: the two extremes, random voltages, and those of a table."""

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from pter_gym._compiled.compiler import inlined
from pter_gym._compiled.layout import Layout
from pter_gym._compiled.philox import uniform4
from pter_gym._internal.fields import Checked, parameter, require, require_whole
from pter_gym._internal.files import FilePath
from pter_gym._internal.tables import read_table
from pter_gym._physics.clutch import PerClutch
from pter_gym.controllers._gains import MEMORY, Entries
from pter_gym.controllers._policy import Policy
from pter_gym.params import SLOTS, Machine

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


@inlined
def played(obs: Entries, scales: Entries, gains: Entries, memory: Entries) -> PerClutch:  # noqa: ARG001
    """Return the voltages of the row of a table that is due.

    The gains hold the number of rows, the steps from which they hold, and their voltages by clutch.
    """
    count = int(gains[0])
    row = int(memory[MEMORY.kept])
    following = row + 1 if row + 1 < count else count - 1
    row = following if gains[following + 1] <= memory[MEMORY.steps] else row
    memory[MEMORY.kept] = row
    memory[MEMORY.steps] += 1.0
    return PerClutch(
        gains[row + 1 + count],
        gains[row + 1 + 2 * count],
        gains[row + 1 + 3 * count],
        gains[row + 1 + 4 * count],
    )


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


@dataclass(frozen=True, kw_only=True)
class Playback(Checked):
    """Voltages of a table, such as the pulses that ``pter identify --pulses`` writes.

    Each row holds from the first control step at or after its time on, the last one for ever, and
    no voltage comes before the first. Of rows that are due at once, the last counts.

    Attributes
    ----------
    times
        When the rows begin, rising from 0 or later [s].
    volts
        Their voltages of all clutches [V], four each.
    period
        Control period [s].
    """

    times: tuple[float, ...]
    volts: tuple[tuple[float, ...], ...]
    period: float = parameter("s", "chosen: the usual one", above=0.0, default=0.01)

    def __post_init__(self) -> None:
        """Check that times rise and voltages are not negative."""
        super().__post_init__()
        rise = all(a < b for a, b in pairwise((-1e-9, *self.times)))
        require(rise and len(self.times) > 0, self, "times", "rising from 0 or later")
        fits = [
            len(row) == SLOTS and all(0.0 <= each < math.inf for each in row) for row in self.volts
        ]
        accepted = f"{SLOTS} voltages ≥ 0 for each time"
        require(len(fits) == len(self.times) and all(fits), self, "volts", accepted)

    def bind(self, machine: Machine, layout: Layout) -> Policy:
        """Return the policy that gives these voltages, up to the largest of a machine."""
        due = {0: (0.0,) * SLOTS}
        for time, row in zip(self.times, self.volts, strict=True):
            due[math.ceil(time / self.period - 1e-6)] = row
        gains = {"count": [len(due)], "steps": [*due]}
        gains |= {f"volts_{k + 1}": [row[k] for row in due.values()] for k in range(SLOTS)}
        return Policy.from_law(
            played, gains, machine, layout, frame_skip=1, control_period=self.period
        )


def read_playback(file: FilePath) -> Playback:
    """Return the voltages of a file with columns t_s and V1 to V4, each row a change.

    Raises
    ------
    ParameterError
        If there is no such file, or its columns are not of this form.
    """
    names = [f"V{k + 1}" for k in range(SLOTS)]
    units = {"t_s": "s", **dict.fromkeys(names, "V")}
    columns = read_table(file, ("t_s", *names), unit=units).columns
    volts = np.stack([columns[name] for name in names], axis=1)
    return Playback(times=tuple(columns["t_s"].tolist()), volts=tuple(map(tuple, volts.tolist())))
