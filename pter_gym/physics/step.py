"""The only place where clutches, arm and friction meet: one substep of semi-implicit Euler."""

from typing import Annotated, NamedTuple

from pter_gym.compiled.compiler import device
from pter_gym.compiled.records import Entry
from pter_gym.physics.arm import (
    Linkage,
    Load,
    Motion,
    advance_position,
    cos_difference,
    joint_torque,
    tip_position,
    velocity_torque,
)
from pter_gym.physics.clutch import (
    PerClutch,
    Torques,
    any_crossed,
    capacities,
    caught_capacities,
)
from pter_gym.physics.friction import resolve, slip_velocities


class Impact(NamedTuple):
    """The velocity problem of one substep."""

    m11: Annotated[float, Entry("kg·m²", "effective mass matrix")]
    m12: Annotated[float, Entry("kg·m²", "effective mass matrix")]
    m22: Annotated[float, Entry("kg·m²", "effective mass matrix")]
    p_a: Annotated[float, Entry("N·m·s", "momentum of link A without clutches")]
    p_b: Annotated[float, Entry("N·m·s", "momentum of link B without clutches")]
    hand_a: Annotated[float, Entry("N·m", "torque of the hand on link A")]
    hand_b: Annotated[float, Entry("N·m", "torque of the hand on link B")]
    fictitious_a: Annotated[float, Entry("N·m", "velocity term V on link A")]
    fictitious_b: Annotated[float, Entry("N·m", "velocity term V on link B")]


class Energy(NamedTuple):
    """Energy terms of a substep [J]: ΔK = hand_work − dissipated − numerical_loss + residual."""

    hand_work: Annotated[float, Entry("J", "work of the hand")]
    dissipated: Annotated[float, Entry("J", "energy taken by the clutches")]
    numerical_loss: Annotated[float, Entry("J", "the integrator's loss")]
    residual: Annotated[float, Entry("J", "the integrator's gain from the turning mass matrix")]


@device
def free_motion(q: Motion, arm: Linkage, load: Load, h: float) -> Impact:
    """Return the velocity problem of the next substep, without clutches.

    The hand's damping is implicit: it adds h·b·JᵀJ to the mass matrix. Its spring is explicit.
    """
    x, y = tip_position(arm, q)
    hand_a, hand_b = joint_torque(
        arm, q, load.force_x + arm.stiffness * (load.target_x - x), load.force_y + arm.stiffness * (load.target_y - y)
    )
    hand_a = hand_a + load.torque_a
    hand_b = hand_b + load.torque_b
    v_a, v_b = velocity_torque(arm, q)
    cos = cos_difference(q)
    m12 = arm.coupling * cos
    implicit = h * arm.damping
    return Impact(
        arm.m11 + implicit * arm.length_a * arm.length_a,
        m12 + implicit * arm.length_a * arm.length_b * cos,
        arm.m22 + implicit * arm.length_b * arm.length_b,
        arm.m11 * q.omega_a + m12 * q.omega_b + h * (hand_a - v_a),
        m12 * q.omega_a + arm.m22 * q.omega_b + h * (hand_b - v_b),
        hand_a,
        hand_b,
        v_a,
        v_b,
    )


@device
def impulses(limit: PerClutch, h: float) -> PerClutch:
    """Return the largest impulse [N·m·s] of each clutch over a substep."""
    return PerClutch(h * limit.x1, h * limit.x2, h * limit.x3, h * limit.x4)


@device
def first_velocity(
    q: Motion, impact: Impact, torques: Torques, threshold: float, h: float
) -> tuple[float, float, PerClutch, bool]:
    """Return the velocities after friction, the limits used, and whether a slip velocity jumped over the band."""
    before = slip_velocities(q.omega_a, q.omega_b)
    limit = capacities(before, threshold, torques)
    omega_a, omega_b = resolve(impact.m11, impact.m12, impact.m22, impact.p_a, impact.p_b, impulses(limit, h))
    return omega_a, omega_b, limit, any_crossed(before, slip_velocities(omega_a, omega_b), threshold)


@device
def second_velocity(
    q: Motion,
    impact: Impact,
    torques: Torques,
    threshold: float,
    h: float,
    omega_a: float,
    omega_b: float,
    limit: PerClutch,
) -> tuple[float, float, PerClutch]:
    """Resolve once more with the holding torque for those clutches whose slip velocity jumped over the band."""
    before = slip_velocities(q.omega_a, q.omega_b)
    caught = caught_capacities(limit, before, slip_velocities(omega_a, omega_b), threshold, torques)
    omega_a, omega_b = resolve(impact.m11, impact.m12, impact.m22, impact.p_a, impact.p_b, impulses(caught, h))
    return omega_a, omega_b, caught


@device
def clutch_load(impact: Impact, omega_a: float, omega_b: float, h: float) -> tuple[float, float]:
    """Return Wᵀτ [N·m], what the four clutches together exerted on the links over the substep."""
    return (
        (impact.m11 * omega_a + impact.m12 * omega_b - impact.p_a) / h,
        (impact.m12 * omega_a + impact.m22 * omega_b - impact.p_b) / h,
    )


@device
def energy_terms(before: Motion, after: Motion, arm: Linkage, impact: Impact, limit: PerClutch, h: float) -> Energy:
    """Return the substep's energy terms [J]; the damping of the hand counts as the hand's work."""
    omega_a = after.omega_a
    omega_b = after.omega_b
    change_a = omega_a - before.omega_a
    change_b = omega_b - before.omega_b
    cos_before = cos_difference(before)
    cos_after = cos_difference(after)
    speed_a = arm.length_a * omega_a
    speed_b = arm.length_b * omega_b
    tip_speed_squared = speed_a * speed_a + speed_b * speed_b + 2.0 * cos_before * speed_a * speed_b
    w = slip_velocities(omega_a, omega_b)
    m12 = arm.coupling * cos_before
    return Energy(
        h * (omega_a * impact.hand_a + omega_b * impact.hand_b - arm.damping * tip_speed_squared),
        h * (limit.x1 * abs(w.x1) + limit.x2 * abs(w.x2) + limit.x3 * abs(w.x3) + limit.x4 * abs(w.x4)),
        0.5 * (arm.m11 * change_a * change_a + arm.m22 * change_b * change_b) + m12 * change_a * change_b,
        arm.coupling * (cos_after - cos_before) * omega_a * omega_b
        - h * (omega_a * impact.fictitious_a + omega_b * impact.fictitious_b),
    )


@device
def substep(
    q: Motion, torques: Torques, arm: Linkage, load: Load, threshold: float, h: float
) -> tuple[Motion, Impact, PerClutch, Energy]:
    """Advance one world by h [s] and return its motion, the velocity problem, the torque limits and the energy terms.

    Parameters
    ----------
    q, torques
        Motion at the start, and torque limits of the clutches during the substep (their lag already advanced).
    arm, load
        Constants of the arm; what acts on it.
    threshold
        The stick band δω of Karnopp's model [rad/s] (paper Eq. 2).
    """
    impact = free_motion(q, arm, load, h)
    omega_a, omega_b, limit, crossing = first_velocity(q, impact, torques, threshold, h)
    if crossing:
        omega_a, omega_b, limit = second_velocity(q, impact, torques, threshold, h, omega_a, omega_b, limit)
    after = advance_position(q, omega_a, omega_b, h)
    return after, impact, limit, energy_terms(q, after, arm, impact, limit, h)
