"""Control laws as scalar functions: one observation in, four voltages out.

A law is ``law(obs, scales, gains, memory) -> PerClutch``: ``obs`` is one float32 observation, ``obs·scales`` is in
physical units, ``gains`` belongs to the law (its first entry is its kind) and ``memory`` to one world (it is the law's
to change; its last entry holds the number of the world). The batch kernel inlines a law; plain Python may call it too.
"""

from typing import Any

import numpy as np

from pter_gym.compiled.compiler import device
from pter_gym.compiled.philox import uniform4
from pter_gym.controllers.allocation import allocate, passive_high, passive_low
from pter_gym.controllers.gains import (
    LENGTH_A,
    LENGTH_B,
    TORQUE_LIMIT,
    VOLTAGE_MAX,
    Gains,
    clutch_voltage,
    read_gains,
)
from pter_gym.controllers.steering import Tip, steered, turning_torques
from pter_gym.physics.clutch import PerClutch
from pter_gym.physics.friction import between, slip_velocities

CONSTANT = 1.0
RANDOM = 2.0
IMPEDANCE = 3.0
SINGLE_DOF = 4.0
VELOCITY_RATIO = 5.0

MEMORY = 4
"""Entries of a law's memory for each world: three that the law keeps, and the number of the world."""

KEPT = 0
"""What a law keeps besides the next: the clutch engaged last, or a counter."""

BRAKE = 1
"""The force along the path that the pace's integral has come to [N]."""

BRAKE_LIMIT = 200.0
"""Largest magnitude of that force [N]."""

GRIP = 2
"""Control steps for which all clutches stay fully engaged; less than zero from then to the end of the beginning."""

WORLD = MEMORY - 1
"""The number of the world."""

COS_A, SIN_A, COS_B, SIN_B, OMEGA_A, OMEGA_B, NORMAL_ERROR = range(7)
HEADING_COS = 8
HEADING_SIN = 9
CURVATURE = 10
PROGRESS = 7
PACE = 13
VOLTS = 14
TORQUE = 18
"""Positions in the observation; a test holds them against ``observation_layout``."""

BEGINNING = 0.02
"""Part of the path on which voltages of zero say that an episode has just begun."""

_WAITING = -1.0

_RANDOM_STREAM = np.uint64(0x52414E444F4D)


@device
def see_tip(obs: Any, scales: Any, gains: Any) -> Tip:
    """Return the tip as the observation and the nominal link lengths tell it."""
    cos_a = float(obs[COS_A])
    sin_a = float(obs[SIN_A])
    cos_b = float(obs[COS_B])
    sin_b = float(obs[SIN_B])
    omega_a = obs[OMEGA_A] * scales[OMEGA_A]
    omega_b = obs[OMEGA_B] * scales[OMEGA_B]
    length_a = gains[LENGTH_A]
    length_b = gains[LENGTH_B]
    return Tip(
        cos_a,
        sin_a,
        cos_b,
        sin_b,
        omega_a,
        omega_b,
        -length_a * omega_a * sin_a - length_b * omega_b * sin_b,
        length_a * omega_a * cos_a + length_b * omega_b * cos_b,
        float(obs[HEADING_COS]),
        float(obs[HEADING_SIN]),
        obs[NORMAL_ERROR] * scales[NORMAL_ERROR],
        obs[CURVATURE] * scales[CURVATURE],
    )


@device
def wanted_force(g: Gains, tip: Tip, pace: float, integral: float) -> tuple[float, float]:
    """Return the tip force [N] of a spring and a damper normal to the path and a brake along it.

    The brake is a damper on what the speed exceeds a fraction of the commanded pace by, and ``integral`` [N]. It never
    pushes. Backwards it is a plain damper.
    """
    speed = tip.v_x * tip.heading_cos + tip.v_y * tip.heading_sin
    brake = g.damping_tangential * (speed - g.pace_fraction * pace) + integral
    brake = brake if brake > 0.0 else 0.0
    along = -brake if speed > 0.0 else -g.damping_tangential * speed
    across = -g.stiffness * tip.error - g.damping_normal * (tip.v_y * tip.heading_cos - tip.v_x * tip.heading_sin)
    return (
        along * tip.heading_cos - across * tip.heading_sin,
        along * tip.heading_sin + across * tip.heading_cos,
    )


@device
def begins(obs: Any) -> bool:
    """Tell whether an episode has just begun, also where the policy is not told so."""
    volts = obs[VOLTS] + obs[VOLTS + 1] + obs[VOLTS + 2] + obs[VOLTS + 3]
    return (volts == 0.0) & (obs[PROGRESS] < BEGINNING)


@device
def grips(obs: Any, g: Gains, memory: Any) -> bool:
    """Tell whether all clutches are to be fully engaged, as they are for ``grip`` control steps from the beginning.

    A law that commands no voltage while the tip has hardly moved does not begin again.
    """
    left = g.grip if begins(obs) & (memory[GRIP] == 0.0) else memory[GRIP]
    after = left - 1.0 if left > 1.0 else (_WAITING if left != 0.0 else 0.0)
    memory[GRIP] = 0.0 if (after < 0.0) & (obs[PROGRESS] >= BEGINNING) else after
    return left >= 0.5


@device
def pace_integral(obs: Any, g: Gains, tip: Tip, pace: float, memory: Any) -> float:
    """Return the integral of the pace [N] and let it go on: ``pace_integral``·(speed − pace) more at each control step.

    It begins at zero.
    """
    before = 0.0 if begins(obs) else memory[BRAKE]
    speed = tip.v_x * tip.heading_cos + tip.v_y * tip.heading_sin
    memory[BRAKE] = between(before + g.pace_integral * (speed - pace), -BRAKE_LIMIT, BRAKE_LIMIT)
    return memory[BRAKE]


@device
def guide(obs: Any, scales: Any, gains: Any, memory: Any) -> PerClutch:
    """Return the voltages of a guiding law: impedance, single-DOF lines or velocity ratio.

    All want a force at the tip (of the latter two only the brake along the path is left); Jᵀ takes it to the joints.
    The velocity-ratio law adds joint torques; the allocation then finds the closest torques that passive clutches can
    exert (paper section III-A). The single-DOF law adds a torque of one clutch to what was found. The table and, where
    it has a gain, the torque loop make voltages of them.
    """
    pace = obs[PACE] * scales[PACE]
    g = read_gains(gains, pace)
    tip = see_tip(obs, scales, gains)
    length_a = gains[LENGTH_A]
    length_b = gains[LENGTH_B]
    force_x, force_y = wanted_force(g, tip, pace, pace_integral(obs, g, tip, pace, memory))
    want_a = length_a * (tip.cos_a * force_y - tip.sin_a * force_x)
    want_b = length_b * (tip.cos_b * force_y - tip.sin_b * force_x)
    if gains[0] == VELOCITY_RATIO:
        turn_a, turn_b = turning_torques(gains, g, tip)
        want_a += turn_a
        want_b += turn_b

    slip = slip_velocities(tip.omega_a, tip.omega_b)
    threshold = g.slip_threshold
    limit = gains[TORQUE_LIMIT]
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
    tip_space = g.tip_space >= 0.5
    wanted = allocate(
        want_a,
        want_b,
        low,
        high,
        length_a * length_a if tip_space else 1.0,
        length_a * length_b * (tip.cos_a * tip.cos_b + tip.sin_a * tip.sin_b) if tip_space else 0.0,
        length_b * length_b if tip_space else 1.0,
    )
    if gains[0] == SINGLE_DOF:
        wanted = steered(gains, g, tip, wanted, memory)
    feeds_back = g.feedback != 0.0
    least = gains[VOLTAGE_MAX] if grips(obs, g, memory) else 0.0
    return PerClutch(
        max(least, clutch_voltage(gains, g, wanted.x1, slip.x1, obs[TORQUE] * scales[TORQUE] if feeds_back else 0.0)),
        max(
            least,
            clutch_voltage(gains, g, wanted.x2, slip.x2, obs[TORQUE + 1] * scales[TORQUE + 1] if feeds_back else 0.0),
        ),
        max(
            least,
            clutch_voltage(gains, g, wanted.x3, slip.x3, obs[TORQUE + 2] * scales[TORQUE + 2] if feeds_back else 0.0),
        ),
        max(
            least,
            clutch_voltage(gains, g, wanted.x4, slip.x4, obs[TORQUE + 3] * scales[TORQUE + 3] if feeds_back else 0.0),
        ),
    )


@device
def random_volts(gains: Any, memory: Any) -> PerClutch:
    """Return voltages drawn evenly from [0, voltage_max]; gains hold the seed and voltage_max."""
    draw = np.uint64(memory[KEPT])
    memory[KEPT] += 1.0
    u1, u2, u3, u4 = uniform4(np.uint64(gains[1]), _RANDOM_STREAM, draw, np.uint64(memory[WORLD]))
    return PerClutch(gains[2] * u1, gains[2] * u2, gains[2] * u3, gains[2] * u4)


@device
def no_law(obs: Any, scales: Any, gains: Any, memory: Any) -> PerClutch:  # noqa: ARG001
    """Return no voltages: the law of a kernel whose voltages are given."""
    return PerClutch(0.0, 0.0, 0.0, 0.0)


@device
def built_in(obs: Any, scales: Any, gains: Any, memory: Any) -> PerClutch:
    """Return the voltages of the built-in law that the first gain names."""
    if gains[0] >= IMPEDANCE:
        return guide(obs, scales, gains, memory)
    if gains[0] == RANDOM:
        return random_volts(gains, memory)
    return PerClutch(gains[1], gains[2], gains[3], gains[4])
