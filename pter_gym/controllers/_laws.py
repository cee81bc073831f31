"""Control laws as scalar functions: one observation in, four voltages out.

A law is ``law(obs, scales, gains, memory) -> PerClutch``: ``obs`` is one float32 observation,
``obs·scales`` is in physical units, ``gains`` belongs to the law (its first entry is its kind) and
``memory`` to one world (see ``Memory``). ``_law_kernel`` runs a law in many worlds.
"""

import numpy as np

from pter_gym._compiled.compiler import inlined, outlined
from pter_gym._compiled.philox import uniform4
from pter_gym._compiled.records import entrywise, read
from pter_gym._physics.arm import (
    Motion,
    UnitVector,
    Vector,
    cos_difference,
    joint_torque,
    tip_velocity,
)
from pter_gym._physics.arrangement import OptionalArrangement
from pter_gym._physics.clutch import PerClutch
from pter_gym._physics.friction import slip_velocities
from pter_gym._physics.scalars import clamp
from pter_gym.controllers._allocation import allocate, largest_torque, least_torque
from pter_gym.controllers._gains import (
    ARRANGEMENT,
    IMPEDANCE,
    MEMORY,
    NETWORK,
    NOMINAL,
    RANDOM,
    SINGLE_DOF,
    VELOCITY_RATIO,
    Entries,
    Gains,
    Nominal,
    clutch_voltage,
    read_gains,
)
from pter_gym.controllers._network import HEADER, HEADER_WIDTH, decide
from pter_gym.controllers._steering import Tip, speed_along, steered, turning_torques
from pter_gym.tasks.path_following._observation import OBS

BRAKE_LIMIT = 200.0
"""Largest magnitude of the force along the path that the pace's integral comes to [N]."""

START_PROGRESS = 0.02
"""Part of the path within which an episode begins."""

JOINED_MIDWAY = 1e6
"""Control steps that no episode has."""

_RANDOM_STREAM = np.uint64(0x52414E444F4D)


@inlined
def physical(obs: Entries, scales: Entries, at: float) -> float:
    """Return an entry of an observation in its unit."""
    return obs[at] * scales[at]


@inlined
def observed_tip(obs: Entries, scales: Entries, nominal: Nominal) -> Tip:
    """Return the tip as estimated from the observation and the nominal machine."""
    q = Motion(
        0.0,  # no law asks for the angles themselves
        0.0,
        physical(obs, scales, OBS.omega_a),
        physical(obs, scales, OBS.omega_b),
        float(obs[OBS.cos_a]),
        float(obs[OBS.sin_a]),
        float(obs[OBS.cos_b]),
        float(obs[OBS.sin_b]),
    )
    v_x, v_y = tip_velocity(nominal.arm, q)
    return Tip(
        nominal.arm,
        q,
        Vector(v_x, v_y),
        UnitVector(float(obs[OBS.heading.cos]), float(obs[OBS.heading.sin])),
        physical(obs, scales, OBS.normal_error),
        physical(obs, scales, OBS.curvature),
    )


@inlined
def wanted_force(g: Gains, tip: Tip, pace: float, integral: float) -> tuple[float, float]:
    """Return the tip force [N] of a spring and a damper normal to the path and a brake along it.

    The brake is a damper on the excess of the speed over a fraction of the commanded pace, plus
    ``integral`` [N]. It never pushes. Backwards it is a plain damper.
    """
    speed = speed_along(tip)
    brake = g.damping_tangential * (speed - g.pace_fraction * pace) + integral
    brake = brake if brake > 0.0 else 0.0
    along = -brake if speed > 0.0 else -g.damping_tangential * speed
    across = -g.stiffness * tip.error - g.damping_normal * (
        tip.velocity.y * tip.heading.cos - tip.velocity.x * tip.heading.sin
    )
    return (
        along * tip.heading.cos - across * tip.heading.sin,
        along * tip.heading.sin + across * tip.heading.cos,
    )


@inlined
def steps_before(obs: Entries, memory: Entries) -> float:
    """Return the number of earlier control steps in the episode, and count this one.

    An episode that the law joins midway has had ``JOINED_MIDWAY`` steps.
    """
    steps = memory[MEMORY.steps]
    joins = (steps == 0.0) & (float(obs[OBS.progress]) >= START_PROGRESS)
    before = JOINED_MIDWAY if joins else steps
    memory[MEMORY.steps] = before + 1.0
    return before


@inlined
def pace_integral(g: Gains, tip: Tip, pace: float, memory: Entries) -> float:
    """Return the pace's integral [N] after a control step, which adds gain·(speed − pace)."""
    more = g.pace_integral * (speed_along(tip) - pace)
    memory[MEMORY.brake] = clamp(memory[MEMORY.brake] + more, -BRAKE_LIMIT, BRAKE_LIMIT)
    return memory[MEMORY.brake]


@inlined
def demanded_force(
    g: Gains, tip: Tip, pace: float, before: float, memory: Entries
) -> tuple[bool, float, float]:
    """Return whether a law still grips after so many control steps, and the tip force [N]."""
    gripping = g.grip - before >= 0.5
    integral = 0.0 if gripping else pace_integral(g, tip, pace, memory)
    force_x, force_y = wanted_force(g, tip, pace, integral)
    return gripping, force_x, force_y


@inlined
def guide(obs: Entries, scales: Entries, gains: Entries, memory: Entries) -> PerClutch:
    """Return the voltages of a guiding law for the paper's clutches."""
    return guide_by(obs, scales, gains, memory, None)


@inlined
def guide_declared(obs: Entries, scales: Entries, gains: Entries, memory: Entries) -> PerClutch:
    """Return the voltages of a guiding law for the ``Arrangement`` at the end of the gains."""
    return guide_by(obs, scales, gains, memory, read(gains, ARRANGEMENT, gains.shape[0]))


@inlined
def guide_by(
    obs: Entries, scales: Entries, gains: Entries, memory: Entries, arrangement: OptionalArrangement
) -> PerClutch:
    """Return the voltages of a guiding law: impedance, single-DOF lines or velocity ratio.

    Each law has a desired tip force (for the latter two, only the brake along the path), which Jᵀ
    maps to the joints. The velocity-ratio law adds joint torques; the allocation then finds the
    closest torques that passive clutches can exert (paper section III-A). The single-DOF law then
    adds a torque of one clutch. The table and, if it has a gain, the torque loop convert them to
    voltages.
    """
    pace = physical(obs, scales, OBS.pace)
    nominal = read(gains, NOMINAL, 0)
    g = read_gains(gains, pace)
    tip = observed_tip(obs, scales, nominal)
    gripping, force_x, force_y = demanded_force(g, tip, pace, steps_before(obs, memory), memory)
    want_a, want_b = joint_torque(tip.arm, tip.q, force_x, force_y)
    if nominal.kind == VELOCITY_RATIO:
        turn_a, turn_b = turning_torques(g, tip)
        want_a += turn_a
        want_b += turn_b
    slip = slip_velocities(tip.q.omega_a, tip.q.omega_b, arrangement)
    wanted = passive_torques(g, tip, slip, nominal, want_a, want_b, arrangement)
    if nominal.kind == SINGLE_DOF:
        wanted, memory[MEMORY.kept] = steered(
            g, tip, nominal.scale, wanted, memory[MEMORY.kept], arrangement
        )
    least = nominal.voltage_max if gripping else 0.0
    return looped_voltage(obs, scales, gains, g, least, nominal.scale, wanted, slip, OBS.torque)


@inlined
def passive_torques(
    g: Gains,
    tip: Tip,
    slip: PerClutch,
    nominal: Nominal,
    want_a: float,
    want_b: float,
    arrangement: OptionalArrangement = None,
) -> PerClutch:
    """Return the torques [N·m] of braking clutches that come closest, at the joints or the tip."""
    low = least_torque(slip, g.slip_threshold, nominal.torque_limit, nominal.scale)
    high = largest_torque(slip, g.slip_threshold, nominal.torque_limit, nominal.scale)
    m11, m12, m22 = 1.0, 0.0, 1.0
    if g.tip_space >= 0.5:
        length_a, length_b = tip.arm.length_a, tip.arm.length_b
        m11, m12, m22 = (
            length_a * length_a,
            length_a * length_b * cos_difference(tip.q),
            length_b * length_b,
        )
    return allocate(want_a, want_b, low, high, m11, m12, m22, arrangement)


@entrywise
@inlined
def looped_voltage(
    obs: Entries,
    scales: Entries,
    gains: Entries,
    g: Gains,
    least: float,
    scale: float,
    wanted: float,
    slip: float,
    sensor: float,
) -> float:
    """Return the voltage [V] of a clutch, after the torque loop if it has a gain.

    It is at least ``least``, except for a missing clutch.
    """
    generated = physical(obs, scales, sensor) if g.feedback != 0.0 else 0.0
    return max(
        least if scale > 0.0 else 0.0, clutch_voltage(gains, g, scale, wanted, slip, generated)
    )


@inlined
def random_volts(gains: Entries, memory: Entries) -> PerClutch:
    """Return voltages from 0 to each clutch's largest, other draws in each episode.

    The gains hold the seed and the largest voltages.
    """
    draw = np.uint64(memory[MEMORY.kept])
    memory[MEMORY.kept] += 1.0
    u1, u2, u3, u4 = uniform4(
        np.uint64(gains[1]), _RANDOM_STREAM, draw, np.uint64(memory[MEMORY.episode])
    )
    return PerClutch(gains[2] * u1, gains[3] * u2, gains[4] * u3, gains[5] * u4)


@outlined
def network(obs: Entries, scales: Entries, gains: Entries, memory: Entries) -> PerClutch:
    """Return the voltages of a trained network, which may correct a guiding law."""
    law = gains[HEADER_WIDTH : HEADER_WIDTH + int(gains[HEADER.base])]
    base = guide(obs, scales, law, memory) if len(law) > 0 else middle(gains)
    return decide(obs, scales, gains, memory, base)


@inlined
def middle(gains: Entries) -> PerClutch:
    """Return the voltages [V] that a network corrects without a base: the middle of the range."""
    half = 0.5 * gains[HEADER.voltage_max]
    return PerClutch(half, half, half, half)


@inlined
def built_in(obs: Entries, scales: Entries, gains: Entries, memory: Entries) -> PerClutch:
    """Return the voltages of the built-in law that the first gain names."""
    if gains[0] == NETWORK:
        return network(obs, scales, gains, memory)
    if gains[0] >= IMPEDANCE:
        return guide(obs, scales, gains, memory)
    if gains[0] == RANDOM:
        return random_volts(gains, memory)
    return PerClutch(gains[1], gains[2], gains[3], gains[4])


@inlined
def built_in_declared(obs: Entries, scales: Entries, gains: Entries, memory: Entries) -> PerClutch:
    """Return the voltages of the law that the first gain names, for declared clutches."""
    corrects = gains[0] == NETWORK
    law = gains[HEADER_WIDTH : HEADER_WIDTH + int(gains[HEADER.base])] if corrects else gains
    base = guide_declared(obs, scales, law, memory) if len(law) > 0 else middle(gains)
    return decide(obs, scales, gains, memory, base) if corrects else base
