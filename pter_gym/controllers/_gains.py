"""What laws read and remember: the array of gains, and a world's memory.

A law is ``law(obs, scales, gains, memory) -> PerClutch``: ``obs`` is one float32 observation,
``obs·scales`` is in physical units, ``gains`` belongs to the law and ``memory`` to one world. What
the memory holds is a record: ``Memory`` for the built-in laws, any other for a law that needs one
(``Policy`` takes it).

Gains of guiding laws are, in this order: ``Nominal``; the voltages, then the torques of the table;
the paces of the rows; the rows, each a ``Gains``. Between two paces the gains are interpolated;
beyond them the nearest row applies. If the nominal machine has clutches other than the paper's, its
``Arrangement`` comes last.
"""

from collections.abc import Sequence
from typing import Annotated, NamedTuple, Protocol, overload

import numpy as np
from numpy.typing import NDArray

from pter_gym._compiled.compiler import inlined
from pter_gym._compiled.records import Entry, flat, lerp, read, rows, width
from pter_gym._physics.arm import Linkage
from pter_gym._physics.arrangement import Arrangement
from pter_gym._physics.clutch import PerClutch
from pter_gym._physics.model import optional_arrangement
from pter_gym._physics.scalars import clamp
from pter_gym.params import Machine

CONSTANT, RANDOM, IMPEDANCE, SINGLE_DOF, VELOCITY_RATIO, NETWORK = map(float, range(1, 7))
"""Numbers of the laws that share one compiled function: the first entry of their gains."""


class Entries(Protocol):
    """An array (entries,) in compiled code, which reads it by the rows of a record."""

    @property
    def shape(self) -> tuple[int, ...]: ...

    def __len__(self) -> int: ...

    @overload
    def __getitem__(self, at: slice) -> "Entries": ...

    @overload
    def __getitem__(self, at: float) -> float: ...

    def __setitem__(self, at: float, value: float) -> None: ...


class Memory(NamedTuple):
    """What the built-in laws remember of one world."""

    kept: Annotated[float, Entry("1", "the clutch engaged last, or a counter")]
    brake: Annotated[float, Entry("N", "force along the path that the pace's integral has come to")]
    steps: Annotated[float, Entry("1", "control steps of the episode that went before")]
    episode: Annotated[float, Entry("1", "number of the episode")]


MEMORY = rows(Memory)


class Nominal(NamedTuple):
    """Which law it is, the number of knots of the torque table, and the nominal machine."""

    kind: Annotated[float, Entry("1", "number of the law")]
    knots: Annotated[float, Entry("1", "knots of the torque table")]
    arm: Linkage
    torque_limit: Annotated[float, Entry("N·m", "torque at the largest voltage")]
    voltage_max: Annotated[float, Entry("V", "largest voltage")]
    scale: Annotated[
        PerClutch, Entry("1", "torque over that of the table, 0 for a clutch that is not there")
    ]


class Gains(NamedTuple):
    """Gains of all guiding laws; a law leaves those of other laws at zero.

    The laws' classes declare units and meanings; see ``Guided`` and its subclasses.
    """

    stiffness: float = 0.0
    damping_normal: float = 0.0
    damping_tangential: float = 0.0
    pace_fraction: float = 0.0
    pace_integral: float = 0.0
    grip: float = 0.0
    feedback: float = 0.0
    hold_when_stuck: float = 0.0
    tip_space: float = 0.0
    slip_threshold: float = 0.0
    approach: float = 0.0
    lead: float = 0.0
    strength: float = 0.0
    slow: float = 0.0
    reluctance: float = 0.0


NOMINAL = rows(Nominal)
"""Places of what a law knows of the machine, in the array of gains."""

ARRANGEMENT = rows(Arrangement, -width(Arrangement))
"""Places of the ``Arrangement``, from the end of the array of gains."""

GAIN = rows(Gains)
"""Places of the gains in a row."""

TABLE = width(Nominal)
"""Where the torque table begins."""

WIDTH = width(Gains)
"""Entries of a row."""


def gains_array(
    kind: float,
    machine: Machine,
    table_volts: Sequence[float],
    rows_by_pace: Sequence[tuple[float, Gains]],
) -> NDArray[np.float64]:
    """Return the array of gains.

    Parameters
    ----------
    kind
        Number of the law.
    machine
        The nominal machine.
    table_volts
        Knots of the torque table [V], from 0 to the machine's largest voltage; the torques are
        those of its curve.
    rows_by_pace
        Commanded pace [m/s] and gains, in order of rising pace.
    """
    arm, clutch = machine.arm, machine.clutch
    torques = [clutch.dynamic.torque(volts) for volts in table_volts]
    without_hand = 0.0, 0.0, 0.5
    linkage = Linkage(
        arm.length_a, arm.length_b, arm.inertia_a, arm.inertia_b, arm.coupling, *without_hand
    )
    scale = PerClutch(*machine.slot_scale)
    nominal = Nominal(kind, len(table_volts), linkage, torques[-1], clutch.voltage_max, scale)
    paces = [pace for pace, _ in rows_by_pace]
    table = (*table_volts, *torques)
    gains = (gain for _, row in rows_by_pace for gain in row)
    return np.array(
        [*flat(nominal), *table, *paces, *gains, *flat(optional_arrangement(machine) or ())]
    )


@inlined
def read_gains(gains: Entries, pace: float) -> Gains:
    """Return the gains at a commanded pace [m/s]."""
    paces = TABLE + 2 * int(gains[NOMINAL.knots])
    count = (gains.shape[0] - paces) // (WIDTH + 1)  # an arrangement takes less than a row
    low = 0
    part = 0.0
    for k in range(count - 1):
        if pace > gains[paces + k]:
            low = k
            part = clamp(
                (pace - gains[paces + k]) / (gains[paces + k + 1] - gains[paces + k]), 0.0, 1.0
            )
    here = paces + count + low * WIDTH
    there = here + (WIDTH if count > 1 else 0)
    return lerp(read(gains, GAIN, here), read(gains, GAIN, there), part)


@inlined
def table_voltage(gains: Entries, torque: float) -> float:
    """Return the voltage [V] at which the table reaches a torque [N·m], at most its last knot."""
    count = int(gains[NOMINAL.knots])
    last = TABLE + count - 1
    volts = gains[last]
    for k in range(last - 1, TABLE - 1, -1):
        low = gains[k + count]
        high = gains[k + 1 + count]
        if torque < high:
            volts = gains[k] + (gains[k + 1] - gains[k]) * (torque - low) / (high - low)
    return volts


@inlined
def clutch_voltage(
    gains: Entries, g: Gains, scale: float, wanted: float, slip: float, generated: float
) -> float:
    """Return the voltage [V] for a desired clutch torque, by the table and the loop of Fig. 6.

    Torques are magnitudes, since a voltage cannot choose a sign. A clutch with scale 0 is missing
    and gets 0 V. ``hold_when_stuck`` disables the loop while the clutch is stuck and carries less
    than desired, where a higher voltage has no effect.
    """
    error = abs(wanted) - abs(generated)
    idle = (g.hold_when_stuck >= 0.5) & (abs(slip) <= g.slip_threshold) & (error > 0.0)
    volts = table_voltage(gains, abs(wanted) / scale) + (0.0 if idle else g.feedback * error)
    return clamp(volts, 0.0, gains[NOMINAL.voltage_max]) if scale > 0.0 else 0.0
