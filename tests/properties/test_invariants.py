"""What holds for every machine, voltage, load and start, as Hypothesis properties.

The search is deterministic. Tolerances are roundings, far below anything a wrong equation would do:
1e-12 of the largest number that entered."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from hypothesis import HealthCheck, assume, example, given, settings, strategies as st

from oracle.substep import MAX_PARTS, Substeps, again, inertia
from pter_gym._physics.friction import ClutchMode
from pter_gym._physics.open_loop import State, Trajectory, initial_state, simulate
from pter_gym.params import BASELINE, MACHINES, Arm, Hand, Machine

DETERMINISTIC = settings(
    derandomize=True,
    deadline=None,
    database=None,
    max_examples=75,
    suppress_health_check=[HealthCheck.too_slow],
)
PAPERS = [machine for machine in MACHINES.values() if machine.has_paper_clutches]
STEPS = 150
UNIT = 2.0**-53
W = np.array([[1.0, 0.0], [0.0, 1.0], [1.0, -1.0], [1.0, 1.0]])


@dataclass(frozen=True)
class DrivenArm:
    """A machine, its start, and inputs for STEPS substeps."""

    machine: Machine
    start: State
    volts: np.ndarray
    force: np.ndarray
    torque: np.ndarray
    target: np.ndarray

    def run(self) -> Trajectory:
        return simulate(
            self.machine, self.start, self.volts, self.force, self.torque, hand_target=self.target
        )

    def again(self, run: Trajectory) -> Substeps:
        return again(self.machine, run, self.volts, self.force, self.torque, self.target)


def between(low: float, high: float) -> st.SearchStrategy[float]:
    return st.floats(low, high, allow_nan=False)


def pair(low: float, high: float) -> st.SearchStrategy[np.ndarray]:
    return st.tuples(between(low, high), between(low, high)).map(np.array)


@st.composite
def arms(draw) -> Arm:
    inertia_a, inertia_b = draw(between(0.2, 3.0)), draw(between(0.2, 3.0))
    coupling = draw(between(-0.95, 0.95)) * np.sqrt(inertia_a * inertia_b)
    return Arm(
        length_a=draw(between(0.2, 0.7)),
        length_b=draw(between(0.2, 0.7)),
        inertia_a=inertia_a,
        inertia_b=inertia_b,
        coupling=float(coupling),
    )


@st.composite
def machines(draw) -> Machine:
    base = draw(st.sampled_from(PAPERS))
    lag = draw(st.sampled_from(["normal_force", "voltage"]))
    return replace(
        base,
        arm=draw(arms()),
        clutch=replace(base.clutch, time_constant=draw(between(0.005, 0.3)), lag=lag),
        hand=draw(st.sampled_from([Hand(), Hand(mass=1.5, damping=20.0, stiffness=80.0)])),
        slip_threshold=draw(st.sampled_from([1e-4, 1e-3, 1e-2])),
    )


@st.composite
def inputs(draw) -> tuple[np.ndarray, np.ndarray]:
    """Voltages that change every 50 substeps, some zero; a force of two sines and a constant."""
    levels = draw(st.lists(st.one_of(st.just(0.0), between(0.0, 20.0)), min_size=12, max_size=12))
    volts = np.repeat(np.reshape(levels, (3, 4)), STEPS // 3, axis=0)
    time = (np.arange(STEPS)[:, None] + 0.5) * BASELINE.substep
    waves = [
        draw(pair(-40.0, 40.0)) * np.sin(2.0 * np.pi * draw(between(0.5, 20.0)) * time)
        for _ in range(2)
    ]
    return volts, draw(pair(-30.0, 30.0)) + sum(waves)


@st.composite
def worlds(draw) -> DrivenArm:
    machine = draw(machines())
    volts, force = draw(inputs())
    omega = draw(st.one_of(st.just(np.zeros(2)), pair(-4.0, 4.0)))
    start = initial_state(
        machine, draw(pair(-3.0, 3.0)), omega, draw(st.sampled_from([volts[0], np.zeros(4)]))
    )
    return DrivenArm(
        machine,
        start,
        volts,
        force,
        np.broadcast_to(draw(pair(-10.0, 10.0)), (STEPS, 2)),
        draw(pair(-1.0, 1.0)),
    )


@st.composite
def actuated(draw) -> DrivenArm:
    """A world whose clutches depend on speed, lag otherwise as they fall, have hysteresis, drag
    without voltage and fade."""
    world = draw(worlds())
    clutch, off_state = world.machine.clutch, draw(between(0.0, 2.0))
    stribeck = draw(st.one_of(st.just(0.0), between(1e-3, 2.0)))
    clutch = replace(
        clutch,
        dynamic=replace(clutch.dynamic, off_state=off_state),
        breakaway=replace(clutch.breakaway, off_state=draw(between(0.5, 1.5)) * off_state),
        stribeck=stribeck,
        viscous=draw(between(0.0, 2.0)),
        fall_ratio=draw(between(0.1, 10.0)),
        fade=draw(st.one_of(st.just(0.0), between(1e-3, 1.0))),
        cooling=draw(between(0.01, 100.0)),
        hysteresis=draw(st.one_of(st.just(0.0), between(0.1, 11.0))),
        band="vanishing" if stribeck else draw(st.sampled_from(("vanishing", "printed"))),
    )
    hand = Hand(
        mass=1.5,
        damping=20.0,
        stiffness=80.0,
        damping_anisotropy=(0.6, -0.3),
        stiffness_anisotropy=(-0.5, 0.8),
    )
    machine = replace(world.machine, clutch=clutch, hand=draw(st.sampled_from([Hand(), hand])))
    start = initial_state(machine, world.start.theta, world.start.omega, world.volts[0])
    return replace(world, machine=machine, start=start)


@DETERMINISTIC
@given(actuated())
def test_no_actuator_adds_energy_and_its_ledger_closes(world):
    run = world.run()
    assert run.power.max() <= 0.0
    assert np.all(run.dissipated >= 0.0)
    before = np.concatenate([[np.nan], run.kinetic_energy[:-1]])
    change = run.hand_work - run.dissipated - run.numerical_loss + run.residual
    size = (
        run.kinetic_energy
        + np.abs(run.hand_work)
        + run.dissipated
        + run.numerical_loss
        + np.abs(run.residual)
    )
    assert np.all(np.abs(run.kinetic_energy - before - change)[1:] <= 1e-12 * (1.0 + size[1:]))
    torques = np.concatenate([run.torque_breakaway, run.torque_dynamic])
    assert torques.min() >= 0.0
    lagged = run.final.lagged_volts
    assert lagged.min() >= 0.0
    assert np.all(lagged <= np.maximum(world.start.lagged_volts, world.volts.max(axis=0)))
    assert run.final.heat.min() >= 0.0
    assert np.all(run.final.heat == 0.0) or world.machine.clutch.fade > 0.0


@DETERMINISTIC
@given(worlds())
def test_no_clutch_adds_energy(world):
    run = world.run()
    assert run.power.max() <= 0.0
    assert np.all(run.dissipated >= 0.0)
    assert np.all(run.numerical_loss >= 0.0)


@DETERMINISTIC
@given(worlds())
def test_energy_of_each_substep_closes(world):
    assert_energy_closes(world, world.run())


def assert_energy_closes(world: DrivenArm, run: Trajectory) -> None:
    """ΔK = W − D − N + R to 1e-12 of the largest term."""
    start = inertia(world.machine, run.initial.theta[None])[0]
    energy = np.concatenate(
        [[0.5 * run.initial.omega @ start @ run.initial.omega], run.kinetic_energy]
    )
    told = run.hand_work - run.dissipated - run.numerical_loss + run.residual
    sizes = [energy[:-1], energy[1:], *(np.abs(getattr(run, name)) for name in ENERGIES)]
    assert np.all(np.abs(np.diff(energy) - told) <= 1e-12 * np.max(sizes, axis=0))


ENERGIES = ("hand_work", "dissipated", "numerical_loss", "residual")
ROUNDINGS = 8
"""Of a friction problem in units of u·(‖M⁻¹‖·P + κ·|ω|), as in
tests/verification/test_friction.py."""


@settings(DETERMINISTIC, max_examples=50)
@given(worlds())
def test_each_substep_is_what_the_equations_make_of_the_row_before(world):
    run = world.run()
    assert_made_again(world, run, world.again(run))


def assert_made_again(world: DrivenArm, run: Trajectory, found: Substeps) -> None:
    """Motion, energies and torques, each within its rounding.

    A part of a kick is a friction problem; its time is rounded, too, and moves the velocity by as
    much again. Energies get the error of a velocity times a momentum, and their terms have at most
    ten roundings of their own. A lagged voltage has at most four roundings a substep, which scale
    the torque limits."""
    lag = 4.0 * UNIT * len(run.time) * found.limit.max() + np.finfo(float).tiny
    mass = inertia(world.machine, run.theta)
    compliance = 1.0 / np.linalg.eigvalsh(mass)[:, 0]
    speed = np.maximum(np.linalg.norm(run.omega, axis=1), np.linalg.norm(found.omega, axis=1))
    velocity = (
        2.0 * MAX_PARTS * ROUNDINGS * UNIT * (compliance * found.momentum + found.condition * speed)
    )
    velocity += compliance * world.machine.substep * 4.0 * lag
    assert np.all(np.abs(run.omega - found.omega) <= velocity[:, None])
    assert np.all(
        np.abs(run.theta - found.theta) <= velocity[:, None] + 4.0 * UNIT * np.abs(run.theta)
    )
    momentum = found.momentum + np.linalg.norm(mass, axis=(1, 2)) * speed
    sizes = [found.before, found.after, *(np.abs(getattr(found, name)) for name in ENERGIES)]
    tolerance = 10.0 * UNIT * np.sum(sizes, axis=0) + 4.0 * velocity * momentum
    assert np.all(np.abs(run.kinetic_energy - found.after) <= tolerance)
    for name in ENERGIES:
        assert np.all(np.abs(getattr(run, name) - getattr(found, name)) <= tolerance), name

    torque = (
        1e-12 * np.abs(run.torque).sum(axis=1)
        + 4.0 * found.condition * velocity / compliance / found.span
    )
    assert np.all(np.abs(run.torque @ W - found.clutch_load) <= torque[:, None])
    assert np.all(np.abs(run.torque) <= found.limit + lag)


def storm(seed: int) -> DrivenArm:
    """A machine whose loads and voltages jump at every substep, so slips pass zero and leave the
    band all the time."""
    rng = np.random.default_rng([21, seed])
    base = PAPERS[seed % len(PAPERS)]
    clutch = replace(
        base.clutch,
        time_constant=float(rng.uniform(0.005, 0.1)),
        lag=("normal_force", "voltage")[seed % 2],
    )
    hand = (Hand(), Hand(mass=1.5, damping=20.0, stiffness=80.0))[seed // 2 % 2]
    machine = replace(
        base, clutch=clutch, hand=hand, slip_threshold=float(10.0 ** rng.uniform(-4.0, -2.0))
    )
    volts = rng.uniform(0.0, 10.0, (STEPS, 4)) * rng.integers(0, 3, (STEPS, 4)).clip(max=1)
    start = initial_state(machine, rng.uniform(-3.0, 3.0, 2), rng.normal(0.0, 0.1, 2), volts[0])
    force, torque = rng.normal(0.0, 40.0, (STEPS, 2)), rng.normal(0.0, 15.0, (STEPS, 2))
    return DrivenArm(machine, start, volts, force, torque, rng.normal(0.0, 0.5, 2))


def test_many_changes_in_a_kick_are_bounded_and_passive():
    counts = np.zeros(MAX_PARTS + 1, int)
    for seed in range(24):
        world = storm(seed)
        run = world.run()
        found = world.again(run)
        counts += np.bincount(found.parts.astype(int), minlength=MAX_PARTS + 1)
        assert_made_again(world, run, found)
        assert_energy_closes(world, run)
        assert run.power.max() <= 0.0
        assert run.dissipated.min() >= 0.0
    assert counts[2:].min() >= 0.02 * counts.sum(), "not much of a storm"


@DETERMINISTIC
@given(between(3.0, 10.0), between(3.0, 10.0), st.sampled_from([-1.0, 1.0]))
def test_torques_of_a_stuck_clutch_at_its_limit(volts_1, volts_3, sign):
    """From rest, links at right angles: both turn together; clutch 1 slows A, and clutch 3 drives B
    with all it has.

    The band is so wide that clutch 1 does not leave it.
    """
    machine = replace(BASELINE, slip_threshold=1.0)
    volts = np.array([volts_1, 0.0, volts_3, 0.0])
    start = initial_state(BASELINE, (0.5 * np.pi, 0.0), volts=volts)
    arm, limit = BASELINE.arm, start.torque_breakaway
    load = limit[0] + (arm.inertia_a + arm.inertia_b) * limit[2] / arm.inertia_b
    run = simulate(machine, start, volts, (0.0, 0.0), (sign * load, 0.0), duration=machine.substep)
    assert np.allclose(
        run.torque[0], [-sign * limit[0], 0.0, -sign * limit[2], 0.0], rtol=1e-9, atol=0.0
    )
    assert run.power.max() <= 0.0


@DETERMINISTIC
@given(worlds())
def test_the_mode_says_exactly_which_slips_are_zero(world):
    run = world.run()
    assert set(np.unique(run.mode)) <= set(ClutchMode)
    stuck = run.slip_velocity == 0.0
    expected = np.where(stuck.sum(axis=1) == 1, 1 + np.argmax(stuck, axis=1), ClutchMode.TWO_DOF)
    expected = np.where(stuck.all(axis=1), ClutchMode.ZERO_DOF, expected)
    assert np.array_equal(run.mode, expected)
    assert np.all(np.isin(stuck.sum(axis=1), (0, 1, 4)))
    assert np.array_equal(run.slip_velocity, run.omega @ W.T)


@DETERMINISTIC
@given(worlds(), st.integers(1, 15))
def test_a_released_clutch_carries_nothing(world, mask):
    released = np.array([(mask >> x) & 1 for x in range(4)], bool)
    volts = np.where(released, 0.0, world.volts)
    start = initial_state(world.machine, world.start.theta, world.start.omega, volts[0])
    run = replace(world, volts=volts, start=start).run()
    assert np.all(run.torque[:, released] == 0.0)
    assert np.all(run.power[:, released] == 0.0)


# --- symmetries ---


def mirrored(world: DrivenArm) -> DrivenArm:
    """The world in a mirror along the x axis: angles, velocities, torques and y components change
    their sign."""
    flip = np.array([1.0, -1.0])
    start = replace(world.start, theta=-world.start.theta, omega=-world.start.omega)
    return replace(
        world,
        start=start,
        force=world.force * flip,
        torque=-world.torque,
        target=world.target * flip,
    )


@DETERMINISTIC
@given(worlds())
def test_the_mirror_image_of_a_motion_is_a_motion(world):
    """Changing a sign rounds nothing, so the two agree in every bit except the choice of a shared
    torque.

    What clutches share is a difference of momenta over a substep, to the rounding that
    ``kick_torques`` states."""
    run, image = world.run(), mirrored(world).run()
    assert np.array_equal(image.theta, -run.theta)
    assert np.array_equal(image.omega, -run.omega)
    assert np.array_equal(image.tip_position, run.tip_position * [1.0, -1.0])
    assert np.array_equal(image.mode, run.mode)
    limit = np.maximum(run.torque_breakaway, run.torque_dynamic).sum(axis=1, keepdims=True)
    arm, mass = world.machine.arm, world.machine.hand.mass
    m11, m22 = arm.inertia_a + mass * arm.length_a**2, arm.inertia_b + mass * arm.length_b**2
    m12 = arm.coupling + mass * arm.length_a * arm.length_b
    condition = (m11 + m22) ** 2 / (m11 * m22 - m12**2)
    fastest = max(np.abs(world.start.omega).max(), np.abs(run.omega).max())
    reach = arm.length_a + arm.length_b
    hand = world.machine.hand
    pulls = hand.stiffness * (reach + np.abs(world.target).max()) + hand.damping * reach * fastest
    load = np.abs(world.torque).max() + reach * (np.abs(world.force).max() + pulls)
    momentum = (m11 + m22) * fastest / world.machine.substep
    rounding = 1e-15 * condition * (momentum + load)
    assert np.all(np.abs(image.torque + run.torque) <= 1e-12 * limit + rounding)


def part(world: DrivenArm, rows: slice) -> DrivenArm:
    return replace(
        world, volts=world.volts[rows], force=world.force[rows], torque=world.torque[rows]
    )


@DETERMINISTIC
@given(worlds(), st.integers(1, STEPS - 1))
def test_a_motion_does_not_depend_on_the_absolute_time(world, cut):
    """The second part, started from the end of the first, is the rest of the whole.

    A state holds angles, not the unit vectors that the substep turns, so a restart rounds them
    again."""
    whole = world.run()
    first = part(world, slice(0, cut)).run()
    second = replace(part(world, slice(cut, None)), start=first.final).run()
    assert np.array_equal(first.theta, whole.theta[:cut])
    assert np.allclose(second.theta, whole.theta[cut:], rtol=0.0, atol=1e-9)
    assert np.allclose(second.torque_breakaway, whole.torque_breakaway[cut:], rtol=1e-14)


# --- stuck, and free ---


@settings(DETERMINISTIC, max_examples=25)
@given(
    arms(),
    pair(-3.0, 3.0),
    st.lists(between(4.0, 20.0), min_size=4, max_size=4),
    pair(-1.0, 1.0),
    between(0.0, 0.99),
)
@example(BASELINE.arm, np.zeros(2), [10.0] * 4, np.array([1.0, 1.0]), 0.999)
def test_a_stuck_arm_does_not_drift(arm, theta, volts, direction, share):
    """Ten seconds under any load that the clutches can hold."""
    machine = replace(BASELINE, arm=arm)
    start = initial_state(machine, theta, volts=volts)
    load = share * largest_held(start.torque_breakaway, direction) * direction
    run = simulate(machine, start, volts, (0.0, 0.0), load, duration=10.0)
    assert np.all(run.mode == ClutchMode.ZERO_DOF)
    assert np.all(run.slip_velocity == 0.0)
    assert np.all(run.theta == theta)


def largest_held(torque: np.ndarray, direction: np.ndarray) -> float:
    """How many times a load the clutches can hold: it must stay inside four pairs of sides."""
    normals = np.stack([W[:, 1], -W[:, 0]], axis=1)
    reach, facing = np.abs(normals @ W.T) @ torque, np.abs(normals @ direction)
    return float(min((r / f for r, f in zip(reach, facing, strict=True) if f > 1e-6), default=0.0))


def energy_drift(machine: Machine, theta, omega, duration: float) -> float:
    start = initial_state(machine, theta, omega)
    run = simulate(machine, start, np.zeros(4), (0.0, 0.0), duration=duration)
    first = 0.5 * omega @ inertia(machine, np.array([theta]))[0] @ omega
    return abs(run.kinetic_energy - first).max() / first


@settings(DETERMINISTIC, max_examples=60)
@given(arms(), pair(-3.0, 3.0), pair(-2.0, 2.0).filter(lambda w: np.abs(w).max() > 0.3))
def test_a_free_arm_keeps_its_energy_to_first_order(arm, theta, omega):
    """Without hand and clutches |ΔK| of a substep is |R − N|, of order h².

    With Ω the largest |ω|, μ the smallest eigenvalue of M and |V| ≤ |c|Ω², |Δω| ≤ h|c|Ω²/μ:
    N ≤ h²c²Ω⁴/2μ. With f = ωA·ωB·(ωA − ωB), both drifts gain −½h·c·sin(θA − θB)·(f + f⁺), and the
    kick h·c·sin(θA − θB)·(ωA²ωB⁺ − ωB²ωA⁺). In the sum the first-order parts cancel. Left are
    h|c|·|(−ωB², ωA²)·Δω − ½(f⁺ − f)| ≤ (1 + 3/√8)·h|c|Ω²|Δω|, since |∇f| ≤ 3Ω²/√2, and the
    curvature of cos(θA − θB) over half a turn, at most ⅛h²|c|Ω⁴ in each drift, a tenth of that more
    for the third order. Over a time T there are T/h substeps. While the sum is below K/10,
    Ω² ≤ 2.2 K/μ.
    """
    machine, duration = replace(BASELINE, arm=arm), 0.5
    c, smallest = abs(arm.coupling), smallest_inertia(arm)
    energy = 0.5 * omega @ inertia(machine, np.array([theta]))[0] @ omega
    speed = np.sqrt(2.0 * 1.1 * energy / smallest)
    bound = (
        machine.substep
        * duration
        * speed**4
        * ((1.5 + 3.0 / 8.0**0.5) * c**2 / smallest + 0.28 * c)
        / energy
    )
    assume(bound <= 0.1)
    rounding = 16 * 2.0**-53 * duration / machine.substep
    assert energy_drift(machine, theta, omega, duration) <= bound + rounding


def smallest_inertia(arm: Arm) -> float:
    """Smallest eigenvalue of M over all poses."""
    return float(
        np.linalg.eigvalsh([[arm.inertia_a, arm.coupling], [arm.coupling, arm.inertia_b]])[0]
    )


@pytest.mark.parametrize("seed", range(20))
def test_the_energy_error_of_a_free_arm_halves_with_the_step(seed):
    rng = np.random.default_rng(seed)
    theta, omega = rng.uniform(-3.0, 3.0, 2), rng.uniform(1.0, 3.0, 2) * [1.0, -1.0]
    drifts = [
        energy_drift(replace(BASELINE, substep=1e-3 / 2**k), theta, omega, 1.0) for k in range(4)
    ]
    assert np.all(np.abs(np.divide(drifts[:-1], drifts[1:]) - 2.0) < 0.1)


def test_links_keep_their_length_and_direction_over_long_turns():
    """2,000 turns of 0.2 rad, two in each substep, links aligned and uncoupled: the series to order
    7, renormalised.

    The series leaves out φ⁸/8! along and φ⁹/9! across. The length is corrected; the direction may
    run off by φ·φ⁸/8! + φ⁹/9! a turn."""
    arm = replace(BASELINE.arm, coupling=0.0)
    machine, turns, angle = replace(BASELINE, arm=arm, substep=5e-3), 2_000, 0.2
    start = initial_state(machine, (0.7, 0.7), np.full(2, 2.0 * angle / machine.substep))
    run = simulate(machine, start, np.zeros(4), (0.0, 0.0), duration=turns / 2 * machine.substep)
    reach = arm.length_a + arm.length_b
    assert np.abs(np.hypot(*run.tip_position.T) - reach).max() <= 1e-13
    expected = reach * np.stack([np.cos(run.theta[:, 0]), np.sin(run.theta[:, 0])], axis=-1)
    runaway = turns * angle**9 * (1.0 / 40320 + 1.0 / 362880)
    assert np.abs(run.tip_position - expected).max() <= reach * runaway + 1e-12
