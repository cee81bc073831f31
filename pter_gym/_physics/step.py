"""The stages of a substep, where clutches, arm and friction meet: drift and kick.

Arm and lags move freely for half a substep, forces and friction of its middle change the velocity
at once, and arm and lags move freely for the other half: of second order but for the explicit
velocity term V and the implicit viscous friction. Where a clutch changes between sticking and
slipping, the kick is made in parts, each up to the next change, and Karnopp's rule (paper Eq. 2)
holds in each.
"""

from typing import Annotated, Any, NamedTuple

from pter_gym._compiled.compiler import inlined, outlined
from pter_gym._compiled.records import Entry, Records, entrywise, load, store
from pter_gym._physics.arm import (
    Linkage,
    Load,
    Motion,
    PerLink,
    advance_position,
    cos_difference,
    damper_matrix,
    damper_torque,
    directed,
    joint_torque,
    tip_position,
    velocity_torque,
)
from pter_gym._physics.arrangement import Arrangement, OptionalArrangement
from pter_gym._physics.clutch import (
    PerClutch,
    Torques,
    any_switches,
    capacities,
    product,
    relax,
    scaled,
    share_before,
    sought,
    steady_torques,
    switches,
    whole_decay,
)
from pter_gym._physics.creep import (
    creeping,
    half_width,
    held_torque,
    inner_torque,
    mean_torque,
    outer_torque,
    snapped,
)
from pter_gym._physics.friction import (
    generated_torques,
    resolve,
    sliding_torque,
    slip_velocities,
    torques_on_links,
    with_dry,
    without_dry,
)
from pter_gym._physics.model import Model
from pter_gym._physics.order import CYCLE, is_kick, is_whole, stage_count

MAX_PARTS = 4
"""Most parts of a kick; what changes in the last one waits for the next substep."""

MIN_PART = 1e-6
"""Smallest share of a kick that is worth a part: over a shorter time, torques drown in rounding."""


class Impact(NamedTuple):
    """The velocity problem of a kick, or of a part of one."""

    m11: Annotated[float, Entry("kg·m²", "effective mass matrix")]
    m12: Annotated[float, Entry("kg·m²", "effective mass matrix")]
    m22: Annotated[float, Entry("kg·m²", "effective mass matrix")]
    p_a: Annotated[float, Entry("N·m·s", "momentum of link A without clutches")]
    p_b: Annotated[float, Entry("N·m·s", "momentum of link B without clutches")]
    hand_a: Annotated[
        float, Entry("N·m", "torque of the hand on link A, less its implicit damping")
    ]
    hand_b: Annotated[
        float, Entry("N·m", "torque of the hand on link B, less its implicit damping")
    ]
    fictitious_a: Annotated[float, Entry("N·m", "velocity term V on link A")]
    fictitious_b: Annotated[float, Entry("N·m", "velocity term V on link B")]


class Energy(NamedTuple):
    """Energy terms of a substep [J]: ΔK = hand_work − dissipated − numerical_loss + residual."""

    hand_work: Annotated[float, Entry("J", "work of the hand")]
    dissipated: Annotated[float, Entry("J", "energy taken by the clutches and the axes' friction")]
    numerical_loss: Annotated[float, Entry("J", "the integrator's loss")]
    residual: Annotated[float, Entry("J", "the integrator's gain from the turning mass matrix")]


class Body(NamedTuple):
    """One machine: its constants, state and loads, and the intermediate values of a substep."""

    machine: Model
    motion: Motion
    torques: Torques
    lagged_volts: PerClutch
    command: PerClutch
    load: Load
    strength: PerClutch
    heat: PerClutch
    steady: Torques
    impact: Impact
    omega: PerLink
    capacity: PerClutch
    span: float
    switches: float
    energy: Energy
    arrangement: Arrangement


@inlined
def free_motion(q: Motion, arm: Linkage, on: Load, h: float) -> Impact:
    """Return the velocity problem of a kick that stands for a time h [s], without clutches.

    What is implicit adds to the mass matrix: the axes' viscous friction, and a share of the hand's
    damping, h·JᵀBJ if it is all of it; the rest and the spring are explicit.
    """
    x, y = tip_position(arm, q)
    spring = directed(arm.stiffness, arm.stiffness_by, on.target_x - x, on.target_y - y)
    hand_a, hand_b = joint_torque(arm, q, on.force_x + spring.x, on.force_y + spring.y)
    b11, b12, b22 = damper_matrix(arm, q)
    hand_a = hand_a + on.torque_a - (1.0 - arm.implicit) * (b11 * q.omega_a + b12 * q.omega_b)
    hand_b = hand_b + on.torque_b - (1.0 - arm.implicit) * (b12 * q.omega_a + b22 * q.omega_b)
    v_a, v_b = velocity_torque(arm, q)
    m12 = arm.coupling * cos_difference(q)
    implicit = h * arm.implicit
    return Impact(
        arm.m11 + implicit * b11 + h * arm.viscous_a,
        m12 + implicit * b12,
        arm.m22 + implicit * b22 + h * arm.viscous_b,
        arm.m11 * q.omega_a + m12 * q.omega_b + h * (hand_a - v_a),
        m12 * q.omega_a + arm.m22 * q.omega_b + h * (hand_b - v_b),
        hand_a,
        hand_b,
        v_a,
        v_b,
    )


@inlined
def count_nonzero(w: Records, row: float, lanes: int) -> int:
    """Return how many of the first columns of an array are not zero in a row."""
    count = 0
    for i in range(lanes):
        count += 1 if w[row, i] != 0.0 else 0
    return count


@inlined
def held_torques(
    most: PerClutch, torques: Torques, machine: Model, arrangement: OptionalArrangement = None
) -> PerClutch:
    """Return the torques [N·m] within the band, with dry friction, from those beyond it."""
    arm = machine.arm
    breakaway = with_dry(torques.breakaway, arm.dry_a, arm.dry_b, arrangement)
    dynamic = with_dry(torques.dynamic, arm.dry_a, arm.dry_b, arrangement)
    return held_torque(most, breakaway, dynamic, machine.sliding.creeps)


@entrywise
@inlined
def exerted(slip: float, torque: float, least: float) -> float:
    """Return the size of a slipping clutch's torque [N·m], and what one at rest can hold."""
    return least if slip == 0.0 else abs(torque)


@inlined
def torques_at(
    q: Motion, machine: Model, on: Load, torques: Torques, arrangement: OptionalArrangement = None
) -> PerClutch:
    """Return the torque of each clutch on the arm at an instant [N·m].

    Clutches that slip exert their capacity; those that stick or creep what keeps them so, if they
    can, by the friction problem of the accelerations.
    """
    arm, edge = machine.arm, machine.slip_threshold
    slip = slip_velocities(q.omega_a, q.omega_b, arrangement)
    capacity = capacities(slip, edge, torques, machine.sliding)
    most = with_dry(capacity, arm.dry_a, arm.dry_b, arrangement)
    least = held_torques(most, torques, machine, arrangement)
    slip = snapped(slip, edge)
    inner, outer = inner_torque(slip, edge, least, most), outer_torque(slip, edge, least, most)
    impact = free_motion(q, arm, on, 0.0)
    damper_a, damper_b = damper_torque(arm, q)
    free_a = (
        impact.hand_a - impact.fictitious_a - arm.implicit * damper_a - arm.viscous_a * q.omega_a
    )
    free_b = (
        impact.hand_b - impact.fictitious_b - arm.implicit * damper_b - arm.viscous_b * q.omega_b
    )
    slide = sliding_torque(slip, mean_torque(inner, outer))
    slide_a, slide_b = torques_on_links(slide, arrangement)
    stuck = half_width(slip, inner, outer)
    alpha_a, alpha_b = resolve(
        impact.m11, impact.m12, impact.m22, free_a + slide_a, free_b + slide_b, stuck, arrangement
    )
    load_a = impact.m11 * alpha_a + impact.m12 * alpha_b - free_a
    load_b = impact.m12 * alpha_a + impact.m22 * alpha_b - free_b
    generated = generated_torques(slip, load_a, load_b, inner, outer, 0.0, arrangement)
    return without_dry(generated, arm.dry_a, arm.dry_b, arrangement)


@entrywise
@inlined
def passing(before: float, after: float, threshold: float) -> float:
    """Return the slip velocity of before if it passes zero from outside the stick band, else 0."""
    return before if (abs(before) >= threshold) & (before * after <= 0.0) else 0.0


@inlined
def slid_velocities(
    impact: Impact,
    before: PerClutch,
    after: PerClutch,
    capacity: PerClutch,
    threshold: float,
    h: float,
    arrangement: OptionalArrangement = None,
) -> PerClutch:
    """Return the slip velocities [rad/s] after a kick if no clutch that passes zero sticks.

    They exert their capacity against the slip of before, so the slip passes zero on a straight
    line.
    """
    slips = passing(before, after, threshold)
    slide_a, slide_b = torques_on_links(sliding_torque(slips, capacity), arrangement)
    p_a = impact.p_a + h * slide_a
    p_b = impact.p_b + h * slide_b
    stuck = product(h, half_width(slips, capacity, capacity))
    omega_a, omega_b = resolve(impact.m11, impact.m12, impact.m22, p_a, p_b, stuck, arrangement)
    return slip_velocities(omega_a, omega_b, arrangement)


@entrywise
@inlined
def share_of(
    before: float, after: float, slid: float, threshold: float, ts: float, tk: float, creeps: float
) -> float:
    """Return the share of a kick after which a clutch switches, 1 if it does not."""
    switch = switches(before, after, threshold, ts, tk, creeps)
    return share_before(before, slid, threshold) if switch else 1.0


@inlined
def share_before_switch(
    q: Motion,
    omega: PerLink,
    impact: Impact,
    torques: Torques,
    capacity: PerClutch,
    threshold: float,
    creeps: float,
    h: float,
    arrangement: OptionalArrangement = None,
) -> float:
    """Return the share of a kick after which the first clutch switches, 1 if none does."""
    w = slip_velocities(q.omega_a, q.omega_b, arrangement)
    v = slip_velocities(omega.a, omega.b, arrangement)
    slid = slid_velocities(impact, w, v, capacity, threshold, h, arrangement)
    ts, tk = torques.breakaway, torques.dynamic
    shares = share_of(w, v, slid, threshold, ts, tk, creeps)
    return min(shares.x1, shares.x2, shares.x3, shares.x4)


@inlined
def clutch_load(impact: Impact, omega_a: float, omega_b: float, h: float) -> tuple[float, float]:
    """Return Wᵀτ [N·m] that clutches and dry friction exerted on the links in a kick of h [s]."""
    return (
        (impact.m11 * omega_a + impact.m12 * omega_b - impact.p_a) / h,
        (impact.m12 * omega_a + impact.m22 * omega_b - impact.p_b) / h,
    )


@inlined
def kick_torques(
    impact: Impact,
    omega_a: float,
    omega_b: float,
    capacity: PerClutch,
    h: float,
    arrangement: OptionalArrangement = None,
) -> PerClutch:
    """Return each clutch's torque on the arm, with dry friction [N·m], over (a part of) a kick."""
    slip = slip_velocities(omega_a, omega_b, arrangement)
    return torques_between(impact, omega_a, omega_b, slip, capacity, capacity, h, arrangement)


@inlined
def torques_between(
    impact: Impact,
    omega_a: float,
    omega_b: float,
    slip: PerClutch,
    inner: PerClutch,
    outer: PerClutch,
    h: float,
    arrangement: OptionalArrangement = None,
) -> PerClutch:
    """Return what ``generated_torques`` does, over (a part of) a kick [N·m].

    What they exert together is a difference of momenta over h, so the shorter the time, the coarser
    its rounding.
    """
    load_a, load_b = clutch_load(impact, omega_a, omega_b, h)
    m11, m12, m22 = impact.m11, impact.m12, impact.m22
    momentum = abs(impact.p_a) + abs(impact.p_b) + h * (outer.x1 + outer.x2 + outer.x3 + outer.x4)
    condition = (m11 + m22) * (m11 + m22) / (m11 * m22 - m12 * m12)
    return generated_torques(
        slip, load_a, load_b, inner, outer, 1e-15 * condition * momentum / h, arrangement
    )


@inlined
def kick_energy(
    q: Motion,
    omega: PerLink,
    arm: Linkage,
    impact: Impact,
    capacity: PerClutch,
    h: float,
    arrangement: OptionalArrangement = None,
) -> Energy:
    """Return the energy terms [J] of a kick; the hand's damping counts as the hand's work."""
    omega_a = omega.a
    omega_b = omega.b
    change_a = omega_a - q.omega_a
    change_b = omega_b - q.omega_b
    m12 = arm.coupling * cos_difference(q)
    b11, b22 = impact.m11 - arm.m11 - h * arm.viscous_a, impact.m22 - arm.m22 - h * arm.viscous_b
    damped = (
        b11 * omega_a * omega_a
        + 2.0 * (impact.m12 - m12) * omega_a * omega_b
        + b22 * omega_b * omega_b
    )
    w = slip_velocities(omega_a, omega_b, arrangement)
    return Energy(
        h * (omega_a * impact.hand_a + omega_b * impact.hand_b) - damped,
        h
        * (
            capacity.x1 * abs(w.x1)
            + capacity.x2 * abs(w.x2)
            + capacity.x3 * abs(w.x3)
            + capacity.x4 * abs(w.x4)
        )
        + h * (arm.viscous_a * omega_a * omega_a + arm.viscous_b * omega_b * omega_b),
        0.5 * (arm.m11 * change_a * change_a + arm.m22 * change_b * change_b)
        + m12 * change_a * change_b,
        -h * (omega_a * impact.fictitious_a + omega_b * impact.fictitious_b),
    )


@inlined
def turning_energy(before: Motion, after: Motion, arm: Linkage) -> float:
    """Return the kinetic energy [J] that the arm gains in a drift as its mass matrix turns."""
    return (
        arm.coupling
        * (cos_difference(after) - cos_difference(before))
        * before.omega_a
        * before.omega_b
    )


@inlined
def paper_clutches(w: Records, i: int) -> None:
    """Return None, the arrangement of the paper's clutches: its branches compile to nothing."""


def arrangement_from(at: Any) -> Any:
    """Return a function of an array and a column that returns a machine's ``Arrangement``."""

    @inlined
    def declared(w: Records, i: int) -> Arrangement:
        return load(w, at.arrangement, i)

    return declared


def substep_on(at: Any, load_on: Any, arrangement_at: Any = paper_clutches) -> tuple[Any, Any, Any]:
    """Return the stages of a substep for machines in the columns of an array.

    There are two kinds of such arrays: the worlds of the engine, many or one, and the machine of an
    open-loop simulation. Each stage is for a loop over all machines, so LLVM vectorises it.

    Parameters
    ----------
    at
        Rows of a record with the entries of ``Body``, alone or among others.
    load_on
        ``load_on(w, i)`` returns the ``Load`` on the arm of machine ``i``.
    arrangement_at
        ``paper_clutches``, or ``arrangement_from(at)`` for machines with other clutches than the
        paper's.

    Returns
    -------
    aim
        ``aim(w, i, whole)`` finds the torques that clutches tend to, half a substep after the last
        ones or a whole one; needed before a drift where commands have changed or voltages lag.
    drift
        ``drift(w, i, h, whole)`` lets arm and lags move freely for half a substep or a whole one, h
        in all [s].
    kick
        ``kick(w, lanes, h)`` changes the velocities of the first ``lanes`` machines by the forces
        and the friction of the present instant over a time h [s].
    """

    @inlined
    def aim(w: Records, i: int, whole: bool) -> None:
        machine = load(w, at.machine, i)
        decay = whole_decay(machine.voltage_decay) if whole else machine.voltage_decay
        lagged = load(w, at.lagged_volts, i)
        target = sought(lagged, load(w, at.command, i), machine.hysteresis)
        lagged = relax(lagged, target, decay)
        store(w, at.lagged_volts, i, lagged)
        steady = steady_torques(machine.breakaway, machine.dynamic, lagged)
        store(w, at.steady, i, scaled(steady, machine.scale, load(w, at.strength, i)))

    @inlined
    def drift(w: Records, i: int, h: float, whole: bool) -> None:
        half = load(w, at.machine.torque_decay, i)
        decay = whole_decay(half) if whole else half
        store(w, at.torques, i, relax(load(w, at.torques, i), load(w, at.steady, i), decay))
        before = load(w, at.motion, i)
        after = advance_position(before, before.omega_a, before.omega_b, h if whole else 0.5 * h)
        store(w, at.motion, i, after)
        w[at.energy.residual, i] += turning_energy(before, after, load(w, at.machine.arm, i))

    find, take, divide = kick_stages_on(at, load_on, arrangement_at)

    @inlined
    def kick(w: Records, lanes: int, h: float) -> None:
        # a vectorised loop over all machines; the few that need parts go through them one by one
        for i in range(lanes):
            find(w, i, h)
        if count_nonzero(w, at.switches, lanes) > 0:
            for i in range(lanes):
                if w[at.switches, i] != 0.0:
                    divide(w, i)
        for i in range(lanes):
            take(w, i)

    return aim, drift, kick


@inlined
def no_hands(w: Records, lanes: int, h: float, whole: bool, guides: bool) -> None:
    """Leave the loads as they are."""


def control_step_on(
    at: Any, load_on: Any, arrangement_at: Any = paper_clutches, move_hands: Any = no_hands
) -> Any:
    """Return what moves machines through a control step, in substeps.

    Parameters
    ----------
    at, load_on, arrangement_at
        As ``substep_on`` takes them.
    move_hands
        ``move_hands(w, lanes, h, whole, guides)`` changes the loads with a drift.

    Returns
    -------
    Callable
        ``control_step(w, lanes, h, count, aims, guides)`` makes ``count`` substeps of h [s] for the
        first ``lanes`` machines. ``aims`` says that steady torques change within the step, as with
        voltages that lag.
    """
    aim, drift, kick = substep_on(at, load_on, arrangement_at)

    @inlined
    def control_step(
        w: Records, lanes: int, h: float, count: int, aims: bool, guides: bool
    ) -> None:
        for stage in range(stage_count(count)):
            if is_kick(stage):
                kick(w, lanes, h)
            else:
                whole = is_whole(stage, count)
                # at constant voltages, torques tend to what the first drift has found
                if aims | (stage < CYCLE):
                    for i in range(lanes):
                        aim(w, i, whole)
                for i in range(lanes):
                    drift(w, i, h, whole)
                move_hands(w, lanes, h, whole, guides)

    return control_step


def kick_finder(at: Any, load_on: Any, arrangement_at: Any) -> Any:
    """Return what finds a kick of the machine in column ``i`` of an array; see ``substep_on``."""

    @inlined
    def find(w: Records, i: int, h: float) -> None:
        """Find the velocities after a kick of a time h, and whether a clutch switches in it."""
        torques = load(w, at.torques, i)
        threshold = w[at.machine.slip_threshold, i]
        q = load(w, at.motion, i)
        arm = load(w, at.machine.arm, i)
        # what the arm would do without friction
        impact = free_motion(q, arm, load_on(w, i), h)
        arrangement = arrangement_at(w, i)
        # Karnopp's rule: torque limits by the slip before
        before = slip_velocities(q.omega_a, q.omega_b, arrangement)
        sliding = load(w, at.machine.sliding, i)
        capacity = capacities(before, threshold, torques, sliding)
        capacity = with_dry(capacity, arm.dry_a, arm.dry_b, arrangement)
        # all clutches' friction at once
        most = product(h, capacity)
        omega_a, omega_b = resolve(
            impact.m11, impact.m12, impact.m22, impact.p_a, impact.p_b, most, arrangement
        )
        after = slip_velocities(omega_a, omega_b, arrangement)
        store(w, at.impact, i, impact)
        store(w, at.omega, i, PerLink(omega_a, omega_b))
        store(w, at.capacity, i, capacity)
        w[at.span, i] = h
        switch = any_switches(before, after, threshold, torques, sliding.creeps)
        w[at.switches, i] = 1.0 if switch else 0.0

    return find


def kick_taker(at: Any, arrangement_at: Any) -> Any:
    """Return what takes the kick that was found for the machine in column ``i`` of an array."""

    @inlined
    def take(w: Records, i: int) -> None:
        """Move on at the velocities that were found, and add up the energies."""
        omega = load(w, at.omega, i)
        q = load(w, at.motion, i)
        arm = load(w, at.machine.arm, i)
        impact, capacity = load(w, at.impact, i), load(w, at.capacity, i)
        energy = kick_energy(q, omega, arm, impact, capacity, w[at.span, i], arrangement_at(w, i))
        w[at.motion.omega_a, i] = omega.a
        w[at.motion.omega_b, i] = omega.b
        w[at.energy.hand_work, i] += energy.hand_work
        w[at.energy.dissipated, i] += energy.dissipated
        w[at.energy.numerical_loss, i] += energy.numerical_loss
        w[at.energy.residual, i] += energy.residual

    return take


def creep_finder(at: Any, arrangement_at: Any) -> Any:
    """Return what finds a kick again for the machine in column ``i``, if its clutches may creep."""

    @outlined
    def creep(w: Records, i: int) -> None:
        """Find a kick again where clutches may creep, by the torques that keep them at the edge.

        With these as their capacities, the solution is that of the usual friction problem.
        """
        if w[at.machine.sliding.creeps, i] == 0.0:
            return
        machine, arrangement = load(w, at.machine, i), arrangement_at(w, i)
        impact, most, h = load(w, at.impact, i), load(w, at.capacity, i), w[at.span, i]
        edge = machine.slip_threshold
        least = held_torques(most, load(w, at.torques, i), machine, arrangement)
        m11, m12, m22, p_a, p_b = impact.m11, impact.m12, impact.m22, impact.p_a, impact.p_b
        # where the clutches' potential is least, and the torques that balance there
        omega_a, omega_b, slip = creeping(
            m11, m12, m22, p_a, p_b, edge, product(h, least), product(h, most), arrangement
        )
        inner, outer = inner_torque(slip, edge, least, most), outer_torque(slip, edge, least, most)
        torque = torques_between(impact, omega_a, omega_b, slip, inner, outer, h, arrangement)
        capacity = exerted(slip, torque, least)
        omega_a, omega_b = resolve(m11, m12, m22, p_a, p_b, product(h, capacity), arrangement)
        store(w, at.capacity, i, capacity)
        store(w, at.omega, i, PerLink(omega_a, omega_b))

    return creep


def kick_stages_on(at: Any, load_on: Any, arrangement_at: Any) -> tuple[Any, Any, Any]:
    """Return what makes a kick of the machine in column ``i`` of an array; see ``substep_on``."""
    find, take = kick_finder(at, load_on, arrangement_at), kick_taker(at, arrangement_at)
    creep = creep_finder(at, arrangement_at)

    @outlined
    def divide(w: Records, i: int) -> None:
        """Take a kick in parts, each up to the next switch of a clutch, but for the last."""
        creep(w, i)
        for _ in range(MAX_PARTS - 1):
            span = w[at.span, i]
            share = share_before_switch(
                load(w, at.motion, i),
                load(w, at.omega, i),
                load(w, at.impact, i),
                load(w, at.torques, i),
                load(w, at.capacity, i),
                w[at.machine.slip_threshold, i],
                w[at.machine.sliding.creeps, i],
                span,
                arrangement_at(w, i),
            )
            if not share < 1.0 - MIN_PART:
                break
            find(w, i, share * span)
            creep(w, i)
            take(w, i)
            find(w, i, span - share * span)
            creep(w, i)
            if w[at.switches, i] == 0.0:
                break

    return find, take, divide
