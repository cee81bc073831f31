"""From a Machine to the rows of the (PARAMS, N) array that the kernels read, and back to named tuples."""

import math
from typing import Any, NamedTuple

from pter_gym.compiled.compiler import device
from pter_gym.params import Machine
from pter_gym.physics.arm import Linkage, Motion
from pter_gym.physics.clutch import Curve, PerClutch, Torques


class Model(NamedTuple):
    """Constants of one world as the kernels see them: one row of the parameter array each, in this order."""

    length_a: float
    length_b: float
    m11: float
    m22: float
    coupling: float
    damping: float
    stiffness: float
    breakaway_slope: float
    breakaway_knee: float
    breakaway_curvature: float
    dynamic_slope: float
    dynamic_knee: float
    dynamic_curvature: float
    voltage_decay: float
    torque_decay: float
    voltage_max: float
    slip_threshold: float
    scale_1: float
    scale_2: float
    scale_3: float
    scale_4: float


MODEL_ROWS = len(Model._fields)


def model_of(machine: Machine) -> Model:
    """Return the constants of a machine; the mass of the hand goes into the arm exactly."""
    arm = machine.arm
    hand = machine.hand
    clutch = machine.clutch
    decay = math.exp(-machine.substep / clutch.time_constant)
    lags_voltage = clutch.lag == "voltage"
    return Model(
        arm.length_a,
        arm.length_b,
        arm.inertia_a + hand.mass * arm.length_a**2,
        arm.inertia_b + hand.mass * arm.length_b**2,
        arm.coupling + hand.mass * arm.length_a * arm.length_b,
        hand.damping,
        hand.stiffness,
        clutch.breakaway.slope,
        clutch.breakaway.knee,
        clutch.breakaway.curvature,
        clutch.dynamic.slope,
        clutch.dynamic.knee,
        clutch.dynamic.curvature,
        decay if lags_voltage else 0.0,
        0.0 if lags_voltage else decay,
        clutch.voltage_max,
        machine.slip_threshold,
        *machine.clutch_scale,
    )


@device
def linkage(p: Any, row: int, i: int) -> Linkage:
    """Read the arm of world i; its parameters begin at ``row``."""
    return Linkage(p[row, i], p[row + 1, i], p[row + 2, i], p[row + 3, i], p[row + 4, i], p[row + 5, i], p[row + 6, i])


@device
def breakaway_curve(p: Any, row: int, i: int) -> Curve:
    """Read the breakaway curve of world i; its parameters begin at ``row``."""
    return Curve(p[row + 7, i], p[row + 8, i], p[row + 9, i])


@device
def dynamic_curve(p: Any, row: int, i: int) -> Curve:
    """Read the dynamic curve of world i; its parameters begin at ``row``."""
    return Curve(p[row + 10, i], p[row + 11, i], p[row + 12, i])


VOLTAGE_DECAY = Model._fields.index("voltage_decay")
TORQUE_DECAY = Model._fields.index("torque_decay")
VOLTAGE_MAX = Model._fields.index("voltage_max")
SLIP_THRESHOLD = Model._fields.index("slip_threshold")
SCALE = Model._fields.index("scale_1")
DAMPING = Model._fields.index("damping")
STIFFNESS = Model._fields.index("stiffness")

BREAKAWAY = len(Motion._fields)
"""First row of the breakaway torques in the state array; the rows of Motion come before."""

DYNAMIC = BREAKAWAY + 4
"""First row of the dynamic torques in the state array."""

LAGGED_VOLTS = DYNAMIC + 4
"""First row of the lagged voltages in the state array."""

STATE_ROWS = LAGGED_VOLTS + 4
"""Number of rows of the physical state: Motion, breakaway torques, dynamic torques, lagged voltages."""


@device
def load_motion(s: Any, i: int) -> Motion:
    """Read the motion of world i."""
    return Motion(s[0, i], s[1, i], s[2, i], s[3, i], s[4, i], s[5, i], s[6, i], s[7, i])


@device
def store_motion(s: Any, i: int, q: Motion) -> None:
    """Write the motion of world i."""
    s[0, i] = q.theta_a
    s[1, i] = q.theta_b
    s[2, i] = q.omega_a
    s[3, i] = q.omega_b
    s[4, i] = q.cos_a
    s[5, i] = q.sin_a
    s[6, i] = q.cos_b
    s[7, i] = q.sin_b


@device
def load_four(s: Any, row: int, i: int) -> PerClutch:
    """Read one number for each clutch of world i, from ``row`` on."""
    return PerClutch(s[row, i], s[row + 1, i], s[row + 2, i], s[row + 3, i])


@device
def store_four(s: Any, row: int, i: int, value: PerClutch) -> None:
    """Write one number for each clutch of world i, from ``row`` on."""
    s[row, i] = value.x1
    s[row + 1, i] = value.x2
    s[row + 2, i] = value.x3
    s[row + 3, i] = value.x4


@device
def load_torques(s: Any, row: int, i: int) -> Torques:
    """Read the breakaway and dynamic torques of world i, from ``row`` on."""
    return Torques(load_four(s, row, i), load_four(s, row + 4, i))


@device
def store_torques(s: Any, row: int, i: int, value: Torques) -> None:
    """Write the breakaway and dynamic torques of world i, from ``row`` on."""
    store_four(s, row, i, value.breakaway)
    store_four(s, row + 4, i, value.dynamic)
