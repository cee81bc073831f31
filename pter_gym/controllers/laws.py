"""Control laws as scalar functions: one observation in, four voltages out.

A law is ``law(obs, scales, gains, memory) -> PerClutch``: ``obs`` is one float32 observation, ``obs·scales`` is in
physical units, ``gains`` belongs to the law (its first entry is its kind) and ``memory`` to one world (it is the law's
to change; its last entry holds the number of the world). The batch kernel inlines a law; plain Python may call it too.
"""

from typing import Any, NamedTuple

import numpy as np

from pter_gym._jit import device
from pter_gym._philox import uniform4
from pter_gym.controllers.allocation import allocate, passive_high, passive_low
from pter_gym.physics.clutch import PerClutch
from pter_gym.physics.friction import between, slip_velocities

CONSTANT = 1.0
RANDOM = 2.0
IMPEDANCE = 3.0

MEMORY = 2
"""Entries of a law's memory for each world: a counter of its calls and the number of the world."""

COS_A, SIN_A, COS_B, SIN_B, OMEGA_A, OMEGA_B, NORMAL_ERROR = range(7)
HEADING_COS = 8
HEADING_SIN = 9
TORQUE = 18
"""Positions in the observation; a test holds them against ``observation_layout``."""

_RANDOM_STREAM = np.uint64(0x52414E444F4D)


class ImpedanceGains(NamedTuple):
    """Gains of the paper's two controllers, in the order in which the law reads them."""

    kind: float
    stiffness: float
    damping_normal: float
    damping_tangential: float
    feedback: float
    hold_when_stuck: float
    tip_space: float
    length_a: float
    length_b: float
    slip_threshold: float
    torque_limit: float
    voltage_max: float


KNOTS = len(ImpedanceGains._fields)
"""Where the torque table begins in the gains: its voltages, then its torques."""


@device
def table_voltage(gains: Any, torque: float) -> float:
    """Return the voltage [V] at which the piecewise-linear table reaches a torque ≥ 0 [N·m], at most its last knot."""
    count = (gains.shape[0] - KNOTS) // 2
    last = KNOTS + count - 1
    volts = gains[last]
    for k in range(last - 1, KNOTS - 1, -1):
        low = gains[k + count]
        high = gains[k + 1 + count]
        if torque < high:
            volts = gains[k] + (gains[k + 1] - gains[k]) * (torque - low) / (high - low)
    return volts


@device
def clutch_voltage(gains: Any, wanted: float, slip: float, generated: float) -> float:
    """Return the voltage [V] for a wanted clutch torque: the table, and the loop of Fig. 6 where it has a gain.

    Magnitudes, since a voltage cannot choose a sign. ``hold_when_stuck`` leaves the loop out while the clutch is stuck
    and carries less than is wanted, where a higher voltage has no effect.
    """
    error = abs(wanted) - abs(generated)
    idle = (gains[5] != 0.0) & (abs(slip) <= gains[9]) & (error > 0.0)
    volts = table_voltage(gains, abs(wanted)) + (0.0 if idle else gains[4] * error)
    return between(volts, 0.0, gains[11])


@device
def impedance(obs: Any, scales: Any, gains: Any) -> PerClutch:
    """Return the voltages of the paper's impedance controller, with torque feedback if its gain is not zero.

    A spring and a damper normal to the path and a damper along it give the wanted tip force; Jᵀ takes it to the
    joints; the allocation finds the closest torques that passive clutches can exert (paper section III-A).
    """
    cos_a = float(obs[COS_A])
    sin_a = float(obs[SIN_A])
    cos_b = float(obs[COS_B])
    sin_b = float(obs[SIN_B])
    omega_a = obs[OMEGA_A] * scales[OMEGA_A]
    omega_b = obs[OMEGA_B] * scales[OMEGA_B]
    heading_cos = float(obs[HEADING_COS])
    heading_sin = float(obs[HEADING_SIN])
    length_a = gains[7]
    length_b = gains[8]
    v_x = -length_a * omega_a * sin_a - length_b * omega_b * sin_b
    v_y = length_a * omega_a * cos_a + length_b * omega_b * cos_b
    along = -gains[3] * (v_x * heading_cos + v_y * heading_sin)
    across = -gains[1] * (obs[NORMAL_ERROR] * scales[NORMAL_ERROR]) - gains[2] * (v_y * heading_cos - v_x * heading_sin)
    force_x = along * heading_cos - across * heading_sin
    force_y = along * heading_sin + across * heading_cos
    want_a = length_a * (cos_a * force_y - sin_a * force_x)
    want_b = length_b * (cos_b * force_y - sin_b * force_x)

    slip = slip_velocities(omega_a, omega_b)
    threshold = gains[9]
    limit = gains[10]
    low = PerClutch(
        passive_low(slip.x1, threshold, limit),
        passive_low(slip.x2, threshold, limit),
        passive_low(slip.x3, threshold, limit),
        passive_low(slip.x4, threshold, limit),
    )
    high = PerClutch(
        passive_high(slip.x1, threshold, limit),
        passive_high(slip.x2, threshold, limit),
        passive_high(slip.x3, threshold, limit),
        passive_high(slip.x4, threshold, limit),
    )
    tip_space = gains[6] != 0.0
    wanted = allocate(
        want_a,
        want_b,
        low,
        high,
        length_a * length_a if tip_space else 1.0,
        length_a * length_b * (cos_a * cos_b + sin_a * sin_b) if tip_space else 0.0,
        length_b * length_b if tip_space else 1.0,
    )
    feeds_back = gains[4] != 0.0
    return PerClutch(
        clutch_voltage(gains, wanted.x1, slip.x1, obs[TORQUE] * scales[TORQUE] if feeds_back else 0.0),
        clutch_voltage(gains, wanted.x2, slip.x2, obs[TORQUE + 1] * scales[TORQUE + 1] if feeds_back else 0.0),
        clutch_voltage(gains, wanted.x3, slip.x3, obs[TORQUE + 2] * scales[TORQUE + 2] if feeds_back else 0.0),
        clutch_voltage(gains, wanted.x4, slip.x4, obs[TORQUE + 3] * scales[TORQUE + 3] if feeds_back else 0.0),
    )


@device
def random_volts(gains: Any, memory: Any) -> PerClutch:
    """Return voltages drawn evenly from [0, voltage_max]; gains hold the seed and voltage_max."""
    draw = np.uint64(memory[0])
    memory[0] += 1.0
    u1, u2, u3, u4 = uniform4(np.uint64(gains[1]), _RANDOM_STREAM, draw, np.uint64(memory[1]))
    return PerClutch(gains[2] * u1, gains[2] * u2, gains[2] * u3, gains[2] * u4)


@device
def built_in(obs: Any, scales: Any, gains: Any, memory: Any) -> PerClutch:
    """Return the voltages of the built-in law that the first gain names."""
    if gains[0] == IMPEDANCE:
        return impedance(obs, scales, gains)
    if gains[0] == RANDOM:
        return random_volts(gains, memory)
    return PerClutch(gains[1], gains[2], gains[3], gains[4])
