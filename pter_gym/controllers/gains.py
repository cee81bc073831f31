"""The array of gains that guiding laws read: what they know of the machine, a torque table, and rows of gains by pace.

In this order: ``Nominal``; the voltages, then the torques of the table; the paces of the rows; the rows, each a
``Gains``. Between two paces the gains are interpolated, beyond them the nearest row counts.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pter_gym.compiled.compiler import device
from pter_gym.params import Machine
from pter_gym.physics.friction import between


class Nominal(NamedTuple):
    """Which law it is, the number of knots of the torque table, and the nominal machine in SI."""

    kind: float
    knots: float
    length_a: float
    length_b: float
    inertia_a: float
    inertia_b: float
    coupling: float
    torque_limit: float
    voltage_max: float


class Gains(NamedTuple):
    """Gains of all guiding laws in SI; a law leaves those of others at zero. Switches are on from a half."""

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


KNOTS = Nominal._fields.index("knots")
LENGTH_A = Nominal._fields.index("length_a")
LENGTH_B = Nominal._fields.index("length_b")
INERTIA_A = Nominal._fields.index("inertia_a")
INERTIA_B = Nominal._fields.index("inertia_b")
COUPLING = Nominal._fields.index("coupling")
TORQUE_LIMIT = Nominal._fields.index("torque_limit")
VOLTAGE_MAX = Nominal._fields.index("voltage_max")

TABLE = len(Nominal._fields)
"""Where the torque table begins."""

WIDTH = len(Gains._fields)
"""Entries of a row."""


def gains_array(
    kind: float, machine: Machine, table_volts: Sequence[float], rows: Sequence[tuple[float, Gains]]
) -> NDArray[np.float64]:
    """Return the array of gains.

    Parameters
    ----------
    kind
        Number of the law.
    machine
        The nominal machine.
    table_volts
        Knots of the torque table [V], from 0 to the machine's largest voltage; the torques are those of its curve.
    rows
        Commanded pace [m/s] and gains, by rising pace.
    """
    arm, clutch = machine.arm, machine.clutch
    torques = [clutch.dynamic.torque(volts) for volts in table_volts]
    nominal = Nominal(
        kind=kind,
        knots=len(table_volts),
        length_a=arm.length_a,
        length_b=arm.length_b,
        inertia_a=arm.inertia_a,
        inertia_b=arm.inertia_b,
        coupling=arm.coupling,
        torque_limit=torques[-1],
        voltage_max=clutch.voltage_max,
    )
    paces = [pace for pace, _ in rows]
    return np.array([*nominal, *table_volts, *torques, *paces, *(gain for _, row in rows for gain in row)])


@device
def read_gains(gains: Any, pace: float) -> Gains:
    """Return the gains at a commanded pace [m/s]."""
    paces = TABLE + 2 * int(gains[KNOTS])
    count = (gains.shape[0] - paces) // (WIDTH + 1)
    low = 0
    part = 0.0
    for k in range(count - 1):
        if pace > gains[paces + k]:
            low = k
            part = between((pace - gains[paces + k]) / (gains[paces + k + 1] - gains[paces + k]), 0.0, 1.0)
    here = paces + count + low * WIDTH
    there = here + (WIDTH if count > 1 else 0)
    return Gains(
        blend(gains, here, there, part),
        blend(gains, here + 1, there + 1, part),
        blend(gains, here + 2, there + 2, part),
        blend(gains, here + 3, there + 3, part),
        blend(gains, here + 4, there + 4, part),
        blend(gains, here + 5, there + 5, part),
        blend(gains, here + 6, there + 6, part),
        blend(gains, here + 7, there + 7, part),
        blend(gains, here + 8, there + 8, part),
        blend(gains, here + 9, there + 9, part),
        blend(gains, here + 10, there + 10, part),
        blend(gains, here + 11, there + 11, part),
        blend(gains, here + 12, there + 12, part),
        blend(gains, here + 13, there + 13, part),
        blend(gains, here + 14, there + 14, part),
    )


@device
def blend(gains: Any, here: int, there: int, part: float) -> float:
    """Return the gain that lies a part of the way from one entry to another."""
    return gains[here] + part * (gains[there] - gains[here])


@device
def table_voltage(gains: Any, torque: float) -> float:
    """Return the voltage [V] at which the piecewise-linear table reaches a torque ≥ 0 [N·m], at most its last knot."""
    count = int(gains[KNOTS])
    last = TABLE + count - 1
    volts = gains[last]
    for k in range(last - 1, TABLE - 1, -1):
        low = gains[k + count]
        high = gains[k + 1 + count]
        if torque < high:
            volts = gains[k] + (gains[k + 1] - gains[k]) * (torque - low) / (high - low)
    return volts


@device
def clutch_voltage(gains: Any, g: Gains, wanted: float, slip: float, generated: float) -> float:
    """Return the voltage [V] for a wanted clutch torque: the table, and the loop of Fig. 6 where it has a gain.

    Magnitudes, since a voltage cannot choose a sign. ``hold_when_stuck`` leaves the loop out while the clutch is stuck
    and carries less than is wanted, where a higher voltage has no effect.
    """
    error = abs(wanted) - abs(generated)
    idle = (g.hold_when_stuck >= 0.5) & (abs(slip) <= g.slip_threshold) & (error > 0.0)
    volts = table_voltage(gains, abs(wanted)) + (0.0 if idle else g.feedback * error)
    return between(volts, 0.0, gains[VOLTAGE_MAX])
