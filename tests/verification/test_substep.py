"""The functions of one substep, each against a formula written otherwise: complex numbers, matrices, derivatives."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pter_gym._compiled.records import load as records_load
from pter_gym._compiled.records import read, store, width
from pter_gym._physics import arm as arms
from pter_gym._physics import clutch, open_loop, step
from pter_gym._physics.arm import Linkage, Load, Motion
from pter_gym._physics.clutch import Curve, PerClutch, Torques
from pter_gym._physics.friction import COUPLING, LINES, lower_bound, resolve, share, slip_velocities, upper_bound
from pter_gym._physics.model import model_of
from pter_gym._physics.open_loop import BODY
from pter_gym.errors import ParameterError
from pter_gym.params import BASELINE, Hand
from pter_gym.tasks.path_following._situation import Vector

ARM = Linkage(length_a=0.4, length_b=0.7, m11=0.3, m22=0.5, coupling=0.2, damping=7.0, stiffness=30.0)
FREE = Torques(PerClutch(0.0, 0.0, 0.0, 0.0), PerClutch(0.0, 0.0, 0.0, 0.0))
H = 1e-3
DRAWS = range(20)


def motion(seed: int) -> Motion:
    theta_a, theta_b, omega_a, omega_b = np.random.default_rng(seed).normal(size=4).tolist()
    return at(theta_a, theta_b, omega_a, omega_b)


def at(theta_a: float, theta_b: float, omega_a: float, omega_b: float) -> Motion:
    unit = (math.cos(theta_a), math.sin(theta_a), math.cos(theta_b), math.sin(theta_b))
    return Motion(theta_a, theta_b, omega_a, omega_b, *unit)


def load(seed: int) -> Load:
    return Load(*np.random.default_rng([1, seed]).normal(size=6).tolist())


def substep(q: Motion, torques: Torques, on: Load, threshold: float = 1e-3) -> Any:
    """Advance ``ARM`` by ``H``; return its motion, the velocity problem, the torque limits and the energy terms."""
    body = np.zeros((width(step.Body), 1))
    for row, value in ((BODY.motion, q), (BODY.torques, torques), (BODY.steady, torques), (BODY.machine.arm, ARM)):
        store(body, row, 0, value)
    store(body, BODY.load, 0, on)
    body[BODY.machine.slip_threshold] = threshold
    _, advance = step.substep_on(BODY, lambda body, i: records_load(body, BODY.load, i))
    advance(body, 1, H)
    numbers: Any = body[:, 0].tolist()
    return tuple(read(numbers, row, 0) for row in (BODY.motion, BODY.impact, BODY.limit, BODY.energy))


def jacobian(q: Motion) -> np.ndarray:
    columns = [1j * ARM.length_a * np.exp(1j * q.theta_a), 1j * ARM.length_b * np.exp(1j * q.theta_b)]
    return np.array([[column.real for column in columns], [column.imag for column in columns]])


def mass(q: Motion) -> np.ndarray:
    m12 = ARM.coupling * math.cos(q.theta_a - q.theta_b)
    return np.array([[ARM.m11, m12], [m12, ARM.m22]])


def speeds(q: Motion) -> np.ndarray:
    return np.array([q.omega_a, q.omega_b])


@pytest.mark.parametrize("seed", DRAWS)
def test_tip_by_complex_numbers(seed: int):
    q = motion(seed)
    tip = ARM.length_a * np.exp(1j * q.theta_a) + ARM.length_b * np.exp(1j * q.theta_b)
    assert arms.tip_position(ARM, q) == pytest.approx((tip.real, tip.imag), abs=1e-14)
    velocity = arms.tip_velocity(ARM, q)
    assert velocity == pytest.approx(jacobian(q) @ speeds(q), abs=1e-13)
    assert arms.moving(ARM, q, Vector(*velocity)) == pytest.approx(q, rel=1e-9)
    assert arms.cos_difference(q) == pytest.approx(math.cos(q.theta_a - q.theta_b))
    assert arms.sin_difference(q) == pytest.approx(math.sin(q.theta_a - q.theta_b))


@pytest.mark.parametrize("seed", DRAWS)
def test_power_of_a_force_is_that_of_its_torques(seed: int):
    q, force = motion(seed), np.random.default_rng([2, seed]).normal(size=2)
    assert arms.joint_torque(ARM, q, *force) == pytest.approx(jacobian(q).T @ force, abs=1e-13)
    assert np.dot(arms.joint_torque(ARM, q, *force), speeds(q)) == pytest.approx(
        np.dot(force, arms.tip_velocity(ARM, q))
    )


@pytest.mark.parametrize("seed", DRAWS)
def test_velocity_torque_is_lagranges(seed: int):
    q, eps = motion(seed), 1e-6

    def energy(theta_a: float, theta_b: float) -> float:
        moved = at(theta_a, theta_b, q.omega_a, q.omega_b)
        assert arms.kinetic_energy(ARM, moved) == pytest.approx(0.5 * speeds(q) @ mass(moved) @ speeds(q))
        return arms.kinetic_energy(ARM, moved)

    by_a = (energy(q.theta_a + eps, q.theta_b) - energy(q.theta_a - eps, q.theta_b)) / (2 * eps)
    by_b = (energy(q.theta_a, q.theta_b + eps) - energy(q.theta_a, q.theta_b - eps)) / (2 * eps)
    later = at(q.theta_a + eps * q.omega_a, q.theta_b + eps * q.omega_b, q.omega_a, q.omega_b)
    earlier = at(q.theta_a - eps * q.omega_a, q.theta_b - eps * q.omega_b, q.omega_a, q.omega_b)
    momentum_rate = (mass(later) - mass(earlier)) @ speeds(q) / (2 * eps)
    assert arms.velocity_torque(ARM, q) == pytest.approx(momentum_rate - [by_a, by_b], abs=1e-8)


@pytest.mark.parametrize("angle", [-1.0, -0.01, 0.0, 0.3, 1.0])
def test_turning_is_the_series_and_one_renormalisation(angle: float):
    cos = sum((-1) ** (k // 2) * angle**k / math.factorial(k) for k in (0, 2, 4, 6))
    sin = sum((-1) ** (k // 2) * angle**k / math.factorial(k) for k in (1, 3, 5, 7))
    turned = complex(0.8, 0.6) * complex(cos, sin)
    turned *= 1.5 - 0.5 * abs(turned) ** 2
    assert arms.rotated(0.8, 0.6, angle) == pytest.approx((turned.real, turned.imag), rel=1e-14)


def test_the_arm_advances_at_its_new_velocity():
    q = arms.advance_position(at(0.3, -0.8, 9.0, 9.0), 2.0, -3.0, 0.01)
    assert q == pytest.approx(at(0.32, -0.83, 2.0, -3.0), rel=1e-13)


CURVE = Curve(slope=0.1, knee=4.0, curvature=0.05)


@pytest.mark.parametrize(
    ("volts", "torque"), [(0.0, 0.0), (3.0, 0.3), (4.0, 0.4), (4.5, 0.45 + 0.05 * 0.25), (6.0, 0.6 + 0.05 * 4.0)]
)
def test_torque_over_voltage(volts: float, torque: float):
    assert clutch.curve_torque(CURVE, volts) == pytest.approx(torque)


def test_torques_of_each_clutch_settle_are_scaled_and_lag():
    other = Curve(0.2, 100.0, 0.0)
    steady = clutch.steady_torques(CURVE, other, PerClutch(1.0, 2.0, 3.0, 6.0))
    assert steady.breakaway == pytest.approx((0.1, 0.2, 0.3, 0.8))
    assert steady.dynamic == pytest.approx((0.2, 0.4, 0.6, 1.2))
    scaled = clutch.scaled(steady, PerClutch(1.0, 4.0, 3.0, 4.0), 0.5)
    assert scaled.breakaway == pytest.approx((0.05, 0.4, 0.45, 1.6))
    assert scaled.dynamic == pytest.approx((0.1, 0.8, 0.9, 2.4))
    half = clutch.lag_left(math.log(2.0), 1.0)
    assert half == pytest.approx(0.5)
    assert clutch.lag_left(2.0, 0.5) == pytest.approx(math.exp(-4.0))
    lagging = clutch.relax_torques(scaled, steady, half)
    assert lagging.breakaway == pytest.approx((0.075, 0.3, 0.375, 1.2))
    assert lagging.dynamic == pytest.approx((0.15, 0.6, 0.75, 1.8))
    assert clutch.relax(scaled.dynamic, steady.dynamic, 0.0) == steady.dynamic


def test_karnopps_rule_at_the_border_of_its_band():
    assert clutch.capacity(0.09, 0.1, 2.0, 1.0) == clutch.capacity(-0.09, 0.1, 2.0, 1.0) == 2.0
    assert clutch.capacity(0.1, 0.1, 2.0, 1.0) == clutch.capacity(-0.1, 0.1, 2.0, 1.0) == 1.0
    assert clutch.capacity(0.0, 0.1, 1.0, 2.0) == 2.0  # T_k above T_s
    torques = Torques(PerClutch(10.0, 20.0, 30.0, 40.0), PerClutch(1.0, 2.0, 3.0, 4.0))
    assert clutch.capacities(PerClutch(0.0, 1.0, -1.0, 0.0), 0.1, torques) == (10.0, 2.0, 3.0, 40.0)


def test_who_has_jumped_over_the_band():
    assert clutch.crossed(0.1, -0.001, 0.1)
    assert clutch.crossed(-0.2, 5.0, 0.1)
    for before, after in [(0.09, -1.0), (0.2, 0.1), (-0.2, -0.1), (0.2, 0.0), (0.2, 0.05)]:
        assert not clutch.crossed(before, after, 0.1)
    torques = Torques(PerClutch(10.0, 20.0, 30.0, 40.0), PerClutch(1.0, 2.0, 3.0, 4.0))
    stays = PerClutch(1.0, 1.0, 1.0, 1.0)
    assert not clutch.any_crossed(stays, stays, 0.1)
    for k, name in enumerate(PerClutch._fields):
        jumped = stays._replace(**{name: -1.0})
        assert clutch.any_crossed(stays, jumped, 0.1)
        expected = [10.0 * (k + 1) if place == k else 0.5 for place in range(4)]
        assert clutch.caught_capacities(PerClutch(0.5, 0.5, 0.5, 0.5), stays, jumped, 0.1, torques) == tuple(expected)


@pytest.mark.parametrize("seed", DRAWS)
def test_velocity_problem_by_matrices(seed: int):
    q, on = motion(seed), load(seed)
    found = step.free_motion(q, ARM, on, H)
    tip = np.array(arms.tip_position(ARM, q))
    force = np.array([on.force_x, on.force_y]) + ARM.stiffness * (np.array([on.target_x, on.target_y]) - tip)
    hand = jacobian(q).T @ force + [on.torque_a, on.torque_b]
    fictitious = np.array(arms.velocity_torque(ARM, q))
    effective = mass(q) + H * ARM.damping * jacobian(q).T @ jacobian(q)
    momentum = mass(q) @ speeds(q) + H * (hand - fictitious)
    assert (found.m11, found.m12, found.m22) == pytest.approx((effective[0, 0], effective[0, 1], effective[1, 1]))
    assert (found.p_a, found.p_b) == pytest.approx(momentum, abs=1e-14)
    assert (found.hand_a, found.hand_b) == pytest.approx(hand, abs=1e-13)
    assert (found.fictitious_a, found.fictitious_b) == pytest.approx(fictitious)
    omega = np.array([0.3, -0.4])
    assert step.clutch_load(found, *omega, H) == pytest.approx((effective @ omega - momentum) / H, abs=1e-10)


@pytest.mark.parametrize("limit", [0.0, 0.3, 30.0])
@pytest.mark.parametrize("seed", DRAWS)
def test_energy_terms_are_those_of_the_change(seed: int, limit: float):
    q, on = motion(seed), load(seed)
    torques = Torques(*(PerClutch(*(limit * np.random.default_rng([3, seed]).random(4)).tolist()),) * 2)
    after, impact, limits, energy = substep(q, torques, on)
    change = arms.kinetic_energy(ARM, after) - arms.kinetic_energy(ARM, q)
    told = energy.hand_work - energy.dissipated - energy.numerical_loss + energy.residual
    assert told == pytest.approx(change, abs=1e-13)
    slips = np.array(slip_velocities(after.omega_a, after.omega_b))
    assert energy.dissipated == pytest.approx(H * np.abs(slips) @ np.array(limits), abs=1e-16)
    turn = speeds(after) - speeds(q)
    assert energy.numerical_loss == pytest.approx(0.5 * turn @ mass(q) @ turn, abs=1e-16)
    velocity = jacobian(q) @ speeds(after)
    power = speeds(after) @ [impact.hand_a, impact.hand_b] - ARM.damping * velocity @ velocity
    assert energy.hand_work == pytest.approx(H * power, abs=1e-15)
    assert step.impulses(limits, H) == pytest.approx(H * np.array(limits))


def test_without_clutches_the_velocity_is_that_of_the_free_arm():
    q, on = motion(0), load(0)
    after, impact, _, energy = substep(q, FREE, on)
    effective = np.array([[impact.m11, impact.m12], [impact.m12, impact.m22]])
    assert speeds(after) == pytest.approx(np.linalg.solve(effective, [impact.p_a, impact.p_b]))
    assert energy.dissipated == 0.0


@pytest.mark.parametrize(("breakaway", "sticks"), [(0.5, False), (50.0, True)])
def test_who_jumps_over_the_band_is_caught_if_its_clutch_holds(breakaway: float, sticks: bool):
    """Clutch 1 slips just outside of its band and a torque pushes it to the other side within one substep."""
    q = at(0.2, 1.1, 0.02, 0.5)
    torques = Torques(PerClutch(breakaway, 0.0, 0.0, 0.0), PerClutch(0.5, 0.0, 0.0, 0.0))
    push = Load(0.0, 0.0, -20.0, 0.0, *arms.tip_position(ARM, q))
    after, _, limits, _ = substep(q, torques, push, 0.01)
    assert (after.omega_a == 0.0) is sticks
    assert (after.omega_a < 0.0) is not sticks
    assert limits.x1 == (50.0 if sticks else 0.5)


@pytest.mark.parametrize("lag", ["normal_force", "voltage"])
def test_constants_of_a_machine(lag: str):
    hand = Hand(mass=2.0, damping=3.0, stiffness=4.0)
    machine = replace(BASELINE, hand=hand, clutch=replace(BASELINE.clutch, lag=lag), clutch_scale=(1.0, 0.9, 0.8, 0.7))
    found, plain = model_of(machine), model_of(replace(machine, hand=Hand()))
    decay = math.exp(-machine.substep / machine.clutch.time_constant)
    assert (found.voltage_decay, found.torque_decay) == ((decay, 0.0) if lag == "voltage" else (0.0, decay))
    assert (found.arm.damping, found.arm.stiffness) == (3.0, 4.0)
    assert found.scale == (1.0, 0.9, 0.8, 0.7)
    assert (found.voltage_max, found.slip_threshold) == (machine.clutch.voltage_max, machine.slip_threshold)
    assert (plain.arm.m11, plain.arm.m22) == (machine.arm.inertia_a, machine.arm.inertia_b)
    q = motion(1)
    gained = arms.kinetic_energy(found.arm, q) - arms.kinetic_energy(plain.arm, q)
    assert gained == pytest.approx(0.5 * hand.mass * np.square(arms.tip_velocity(found.arm, q)).sum())


@pytest.mark.parametrize("field", ["torque_breakaway", "torque_dynamic", "lagged_volts"])
def test_one_negative_number_of_a_start_is_refused(field: str):
    start = open_loop.initial_state(BASELINE, (0.5, 2.0), volts=np.full(4, 3.0))
    wrong = np.array(getattr(start, field))
    wrong[2] = -1e-9
    with pytest.raises(ParameterError, match="torques and lagged voltages must be ≥ 0"):
        open_loop.simulate(BASELINE, replace(start, **{field: wrong}), np.zeros(4), np.zeros(2), duration=0.01)


@pytest.mark.parametrize("seed", range(4))
def test_friction_finds_the_velocity_that_a_momentum_was_made_for(seed: int):
    """Backwards: a velocity, and impulses that may go with it, make the momentum; off ties its answer is unique."""
    rng = np.random.default_rng([3, seed])
    for number in range(400):
        m11, m22 = np.exp(rng.uniform(-2.0, 2.0, 2))
        m12 = rng.uniform(-0.99, 0.99) * math.sqrt(m11 * m22)
        capacity = rng.exponential(1.0, 4) * rng.integers(0, 2 if number % 2 else 5, 4).clip(max=1)
        line = np.array(LINES[rng.integers(4)])
        omega = (np.zeros(2), line * rng.normal(), rng.normal(size=2), line + 0.1 * rng.normal(size=2))[number % 4]
        slips = np.array(slip_velocities(*omega.tolist()))
        held = rng.uniform(-1.0, 1.0, 4) * rng.choice([0.5, 0.99])
        impulse = capacity * np.where(slips == 0.0, held, np.sign(slips))
        p = np.array([[m11, m12], [m12, m22]]) @ omega + np.array(COUPLING).T @ impulse
        found = resolve(m11, m12, m22, *p.tolist(), PerClutch(*capacity.tolist()))
        rounding = 8 * 2.0**-53 * (m11 + m22) / (m11 * m22 - m12**2) * (np.abs(p).sum() + capacity.sum())
        rounding += 8 * 2.0**-53 * (m11 + m22) ** 2 / (m11 * m22 - m12**2) * np.hypot(*omega)
        assert found == pytest.approx(omega, abs=rounding), (m11, m12, m22, p, capacity)


@pytest.mark.parametrize("seed", range(4))
def test_a_load_is_shared_as_the_multipliers_say_that_it_was_made_from(seed: int):
    """Backwards: the least torques are multipliers on the two axes, limited; they make the load, and are unique."""
    rng = np.random.default_rng([4, seed])
    w = np.array(COUPLING)
    for number in range(400):
        high = rng.exponential(1.0, 4) * rng.integers(0, 4, 4).clip(max=1)
        low = -high if number % 2 else np.minimum(rng.normal(size=4), high)
        slipping = rng.random(4) < 0.3 * (number % 3)
        low, high = np.where(slipping, high, low) * 10.0 ** (number % 19 - 9), high * 10.0 ** (number % 19 - 9)
        multipliers = rng.normal(scale=np.abs(high).sum() * rng.choice([0.2, 1.0, 5.0]), size=2)
        torque = np.clip(w @ multipliers, low, high)
        found = share(*(w.T @ torque).tolist(), PerClutch(*low.tolist()), PerClutch(*high.tolist()))
        # share() keeps off an edge by up to 1e-12 of loads and ranges, together at most five of these sums
        assert found == pytest.approx(torque, abs=1e-11 * (np.abs(low) + np.abs(high)).sum()), (low, high, torque)


def test_a_load_is_shared_where_two_limits_meet():
    """Beyond three limits at once, where the nearest corner is not that of the middle one."""
    high, (a, b) = PerClutch(0.0, 0.335, 0.006, 0.961), (-0.244, -0.218)
    torque = PerClutch(0.0, b, -0.006, a + b)
    load = (torque.x1 + torque.x3 + torque.x4, torque.x2 - torque.x3 + torque.x4)
    assert share(*load, PerClutch(*(-each for each in high)), high) == pytest.approx(torque, abs=1e-11)


@pytest.mark.parametrize(("slip", "low", "high"), [(-0.5, 2.0, 2.0), (0.0, -2.0, 2.0), (0.5, -2.0, -2.0)])
def test_a_slipping_clutch_has_no_choice(slip: float, low: float, high: float):
    assert (lower_bound(slip, 2.0), upper_bound(slip, 2.0)) == (low, high)
