"""The only place where clutches, arm and friction meet: one substep of semi-implicit Euler."""

from typing import Annotated, Any, NamedTuple

from pter_gym._compiled.compiler import device, outlined
from pter_gym._compiled.records import Entry, load, store
from pter_gym._physics.arm import (
    Linkage,
    Load,
    Motion,
    PerLink,
    advance_position,
    cos_difference,
    joint_torque,
    tip_position,
    velocity_torque,
)
from pter_gym._physics.clutch import (
    PerClutch,
    Torques,
    any_crossed,
    capacities,
    caught_capacities,
    relax,
    relax_torques,
    scaled,
    steady_torques,
)
from pter_gym._physics.friction import resolve, slip_velocities
from pter_gym._physics.model import Model


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


class Body(NamedTuple):
    """One machine: its constants, its state, what acts on it, and what a substep works with."""

    machine: Model
    motion: Motion
    torques: Torques
    lagged_volts: PerClutch
    command: PerClutch
    load: Load
    drift: float
    steady: Torques
    impact: Impact
    omega: PerLink
    limit: PerClutch
    crossing: float
    energy: Energy


@device
def free_motion(q: Motion, arm: Linkage, on: Load, h: float) -> Impact:
    """Return the velocity problem of the next substep, without clutches.

    The hand's damping is implicit: it adds h·b·JᵀJ to the mass matrix. Its spring is explicit.
    """
    x, y = tip_position(arm, q)
    hand_a, hand_b = joint_torque(
        arm, q, on.force_x + arm.stiffness * (on.target_x - x), on.force_y + arm.stiffness * (on.target_y - y)
    )
    hand_a = hand_a + on.torque_a
    hand_b = hand_b + on.torque_b
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
def count_nonzero(w: Any, row: float, lanes: int) -> int:
    """Return how many of the first columns of an array are not zero in a row."""
    count = 0
    for i in range(lanes):
        count += 1 if w[row, i] != 0.0 else 0
    return count


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


def _stages_on(at: Any, load_on: Any) -> tuple[Any, ...]:
    """Return the stages of a substep, each for the machine in column ``i`` of an array; see ``substep_on``."""

    @device
    def aim_torques(w: Any, i: int) -> None:
        """Find the torques that the clutches tend to, behind a lag of the voltage if there is one."""
        machine = load(w, at.machine, i)
        lagged = relax(load(w, at.lagged_volts, i), load(w, at.command, i), machine.voltage_decay)
        store(w, at.lagged_volts, i, lagged)
        steady = steady_torques(machine.breakaway, machine.dynamic, lagged)
        store(w, at.steady, i, scaled(steady, machine.scale, w[at.drift, i]))

    @device
    def find_velocity(w: Any, i: int, h: float) -> None:
        """Advance the torques' lag and find the velocities after friction."""
        torques = relax_torques(load(w, at.torques, i), load(w, at.steady, i), w[at.machine.torque_decay, i])
        store(w, at.torques, i, torques)
        q = load(w, at.motion, i)
        impact = free_motion(q, load(w, at.machine.arm, i), load_on(w, i), h)
        omega_a, omega_b, limit, crossing = first_velocity(q, impact, torques, w[at.machine.slip_threshold, i], h)
        store(w, at.impact, i, impact)
        store(w, at.omega, i, PerLink(omega_a, omega_b))
        store(w, at.limit, i, limit)
        w[at.crossing, i] = 1.0 if crossing else 0.0

    @outlined
    def catch_crossing(w: Any, i: int, h: float) -> None:
        """Apply the crossing rule."""
        omega_a, omega_b, limit = second_velocity(
            load(w, at.motion, i),
            load(w, at.impact, i),
            load(w, at.torques, i),
            w[at.machine.slip_threshold, i],
            h,
            w[at.omega.a, i],
            w[at.omega.b, i],
            load(w, at.limit, i),
        )
        store(w, at.omega, i, PerLink(omega_a, omega_b))
        store(w, at.limit, i, limit)

    @device
    def move_arm(w: Any, i: int, h: float) -> None:
        """Advance the position and add up the energies."""
        before = load(w, at.motion, i)
        after = advance_position(before, w[at.omega.a, i], w[at.omega.b, i], h)
        store(w, at.motion, i, after)
        energy = energy_terms(before, after, load(w, at.machine.arm, i), load(w, at.impact, i), load(w, at.limit, i), h)
        w[at.energy.hand_work, i] += energy.hand_work
        w[at.energy.dissipated, i] += energy.dissipated
        w[at.energy.numerical_loss, i] += energy.numerical_loss
        w[at.energy.residual, i] += energy.residual

    return aim_torques, find_velocity, catch_crossing, move_arm


def substep_on(at: Any, load_on: Any) -> tuple[Any, Any]:
    """Return ``aim(w, lanes)`` and ``substep(w, lanes, h)`` for machines in the first ``lanes`` columns of an array.

    ``aim`` finds the steady torques, where commands or lagged voltages may have changed; ``substep`` advances the
    machines by h [s]. There are two kinds of such arrays: the worlds of the engine, many or one, and the machine of an
    open-loop simulation. Each stage is a loop over all machines, so LLVM vectorises it.

    Parameters
    ----------
    at
        Rows of a record with the entries of ``Body``, alone or among others.
    load_on
        ``load_on(w, i)`` returns the ``Load`` on the arm of machine ``i``.
    """
    aim_torques, find_velocity, catch_crossing, move_arm = _stages_on(at, load_on)

    @device
    def aim(w: Any, lanes: int) -> None:
        """Find the torques that the clutches of all machines tend to."""
        for i in range(lanes):
            aim_torques(w, i)

    @device
    def substep(w: Any, lanes: int, h: float) -> None:
        """Advance all machines by a substep."""
        for i in range(lanes):
            find_velocity(w, i, h)
        if count_nonzero(w, at.crossing, lanes) > 0:  # rare: in a few blocks out of a hundred
            for i in range(lanes):
                if w[at.crossing, i] != 0.0:
                    catch_crossing(w, i, h)
        for i in range(lanes):
            move_arm(w, i, h)

    return aim, substep
