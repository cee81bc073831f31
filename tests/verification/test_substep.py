"""The functions of one substep, each against a formula written otherwise: complex numbers,
matrices, derivatives."""

import math
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import pytest

from pter_gym._compiled.records import load as records_load, read, store, width
from pter_gym._physics import arm as arms, clutch, open_loop, step
from pter_gym._physics.arm import Linkage, Load, Motion, PerLink
from pter_gym._physics.arrangement import OptionalArrangement
from pter_gym._physics.clutch import Curve, PerClutch, Sliding, Torques
from pter_gym._physics.creep import creeping
from pter_gym._physics.friction import (
    COUPLING,
    LINES,
    lower_bound,
    resolve,
    slip_velocities,
    split_load,
    upper_bound,
)
from pter_gym._physics.model import implicit_share, model_of
from pter_gym._physics.open_loop import BODY
from pter_gym.errors import ParameterError
from pter_gym.params import BASELINE, Hand, Machine
from pter_gym.tasks.path_following._position import Vector

ARM = Linkage(
    length_a=0.4,
    length_b=0.7,
    m11=0.3,
    m22=0.5,
    coupling=0.2,
    damping=7.0,
    stiffness=30.0,
    implicit=0.6,
)
RUBBING = ARM._replace(viscous_a=0.9, viscous_b=1.7)
NONE = PerClutch(0.0, 0.0, 0.0, 0.0)
FREE = Torques(NONE, NONE)
NO_SLIDING = Sliding(stribeck=0.0, viscous=NONE, creeps=0.0)
H = 2.5e-3
UNIT = 2.0**-53
W = np.array(COUPLING)
DRAWS = range(20)


def motion(seed: int) -> Motion:
    theta_a, theta_b, omega_a, omega_b = np.random.default_rng(seed).normal(size=4).tolist()
    return at(theta_a, theta_b, omega_a, omega_b)


def at(theta_a: float, theta_b: float, omega_a: float, omega_b: float) -> Motion:
    unit = (math.cos(theta_a), math.sin(theta_a), math.cos(theta_b), math.sin(theta_b))
    return Motion(theta_a, theta_b, omega_a, omega_b, *unit)


def load(seed: int) -> Load:
    return Load(*np.random.default_rng([1, seed]).normal(size=6).tolist())


AIM, DRIFT, KICK = step.substep_on(BODY, lambda body, i: records_load(body, BODY.load, i))


def body_with(
    q: Motion, torques: Torques, on: Load, threshold: float = 1e-3, arm: Linkage = ARM
) -> Any:
    body = np.zeros((width(step.Body), 1))
    for row, value in (
        (BODY.motion, q),
        (BODY.torques, torques),
        (BODY.steady, torques),
        (BODY.machine.arm, arm),
    ):
        store(body, row, 0, value)
    store(body, BODY.load, 0, on)
    body[BODY.machine.slip_threshold] = threshold
    return body


def seen(body: Any) -> Any:
    return read(body[:, 0].tolist(), BODY, 0)


class KickPart(NamedTuple):
    """What a part of a kick begins with, leads to and lasts."""

    before: Motion
    omega: PerLink
    impact: step.Impact
    limit: PerClutch
    span: float
    energy: step.Energy

    @property
    def torque(self) -> np.ndarray:
        return np.array(step.kick_torques(self.impact, *self.omega, self.limit, self.span))


@pytest.fixture
def parts(monkeypatch: pytest.MonkeyPatch) -> list[KickPart]:
    """The parts of all kicks in this test, as they are taken."""
    taken: list[KickPart] = []

    def noted(
        q: Motion,
        omega: PerLink,
        arm: Linkage,
        impact: step.Impact,
        limit: PerClutch,
        h: float,
        arrangement: OptionalArrangement = None,
    ) -> step.Energy:
        energy = kick_energy(q, omega, arm, impact, limit, h, arrangement)
        taken.append(KickPart(q, omega, impact, limit, h, energy))
        return energy

    kick_energy = step.kick_energy
    monkeypatch.setattr(step, "kick_energy", noted)
    return taken


def jacobian(q: Motion) -> np.ndarray:
    columns = [
        1j * ARM.length_a * np.exp(1j * q.theta_a),
        1j * ARM.length_b * np.exp(1j * q.theta_b),
    ]
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
def test_the_damper_acts_against_the_tips_velocity(seed: int):
    q = motion(seed)
    against = ARM.damping * jacobian(q).T @ jacobian(q) @ speeds(q)
    assert arms.damper_torque(ARM, q) == pytest.approx(against, abs=1e-13)


@pytest.mark.parametrize("seed", DRAWS)
def test_velocity_torque_is_lagranges(seed: int):
    q, eps = motion(seed), 1e-6

    def energy(theta_a: float, theta_b: float) -> float:
        moved = at(theta_a, theta_b, q.omega_a, q.omega_b)
        assert arms.kinetic_energy(ARM, moved) == pytest.approx(
            0.5 * speeds(q) @ mass(moved) @ speeds(q)
        )
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


def test_the_arm_advances_at_the_velocity_given():
    q = arms.advance_position(at(0.3, -0.8, 9.0, 9.0), 2.0, -3.0, 0.01)
    assert q == pytest.approx(at(0.32, -0.83, 2.0, -3.0), rel=1e-13)


CURVE = Curve(slope=0.1, knee=4.0, curvature=0.05)


@pytest.mark.parametrize(
    ("volts", "torque"),
    [(0.0, 0.0), (3.0, 0.3), (4.0, 0.4), (4.5, 0.45 + 0.05 * 0.25), (6.0, 0.6 + 0.05 * 4.0)],
)
def test_torque_over_voltage(volts: float, torque: float):
    assert clutch.curve_torque(CURVE, volts) == pytest.approx(torque)


def test_torques_of_each_clutch_settle_are_scaled_and_lag():
    other = Curve(0.2, 100.0, 0.0)
    steady = clutch.steady_torques(CURVE, other, PerClutch(1.0, 2.0, 3.0, 6.0))
    assert steady.breakaway == pytest.approx((0.1, 0.2, 0.3, 0.8))
    assert steady.dynamic == pytest.approx((0.2, 0.4, 0.6, 1.2))
    scaled = clutch.scaled(steady, PerClutch(1.0, 4.0, 3.0, 4.0), PerClutch(0.5, 0.5, 0.5, 0.5))
    assert scaled.breakaway == pytest.approx((0.05, 0.4, 0.45, 1.6))
    assert scaled.dynamic == pytest.approx((0.1, 0.8, 0.9, 2.4))
    half = clutch.lag_left(math.log(2.0), 1.0)
    assert half == pytest.approx(0.5)
    assert clutch.lag_left(2.0, 0.5) == pytest.approx(math.exp(-4.0))
    lagging = clutch.relax(scaled, steady, clutch.Decay(half, half))
    assert lagging.breakaway == pytest.approx((0.075, 0.3, 0.375, 1.2))
    assert lagging.dynamic == pytest.approx((0.15, 0.6, 0.75, 1.8))
    assert clutch.relax(scaled.dynamic, steady.dynamic, clutch.Decay(0.0, 0.0)) == steady.dynamic
    assert clutch.relax(0.0, 1.0, clutch.Decay(0.25, 0.5)) == 0.75
    assert clutch.relax(1.0, 0.0, clutch.Decay(0.25, 0.5)) == 0.5
    assert clutch.whole_decay(clutch.Decay(0.25, 0.5)) == (0.0625, 0.25)
    off = CURVE._replace(off_state=0.25)
    assert clutch.curve_torque(off, 0.0) == 0.25
    assert clutch.curve_torque(off, 3.0) == pytest.approx(0.55)


def test_torque_of_a_slipping_clutch_over_its_speed():
    """Half of T_s − T_k is left at the Stribeck velocity, and the viscous part grows without
    bound."""
    assert clutch.sliding(-0.5, 3.0, 2.0, 0.5, 0.4) == pytest.approx(2.7)
    part = clutch.falling(PerClutch(0.5, -0.05, 0.0, 1e6), 0.1, 0.25)
    assert part == pytest.approx((0.5, 0.25 / 0.26, 0.25 / 0.26, 0.25e-12))
    assert clutch.falling(PerClutch(0.5, -0.05, 0.0, 1e6), 0.1, 0.0) == (0.0, 0.0, 0.0, 0.0)
    torques = Torques(PerClutch(3.0, 3.0, 3.0, 3.0), PerClutch(2.0, 2.0, 2.0, 2.0))
    by = clutch.Sliding(0.25, PerClutch(0.0, 0.4, 0.0, 4.0), 1.0)
    found = clutch.capacities(PerClutch(0.5, -0.5, 0.05, 0.5), 0.1, torques, by)
    assert found == pytest.approx((2.5, 2.7, 3.0, 4.5))


def test_heat_of_a_clutch_at_constant_power_settles_and_takes_torque():
    heat, power, step_time, cooling = 0.0, -20.0, 1e-3, 0.5
    for _ in range(10_000):
        heat = clutch.heated(heat, power, step_time, cooling)
    left = math.exp(-step_time / cooling)
    assert heat == pytest.approx(20.0 * step_time * left / (1.0 - left))
    assert clutch.faded(heat, 0.1, 1.5) == pytest.approx(1.5 / (1.0 + 0.1 * heat))
    assert clutch.faded(heat, 0.0, 1.5) == 1.5


def test_karnopps_rule_at_the_border_of_its_band():
    def capacity(slip: float, breakaway: float, dynamic: float) -> float:
        return clutch.capacity(slip, 0.1, breakaway, dynamic, 0.0, 0.0)

    assert capacity(0.09, 2.0, 1.0) == capacity(-0.09, 2.0, 1.0) == 2.0
    assert capacity(0.1, 2.0, 1.0) == capacity(-0.1, 2.0, 1.0) == 1.0
    assert capacity(0.0, 1.0, 2.0) == 2.0  # T_k above T_s
    torques = Torques(PerClutch(10.0, 20.0, 30.0, 40.0), PerClutch(1.0, 2.0, 3.0, 4.0))
    assert clutch.capacities(PerClutch(0.0, 1.0, -1.0, 0.0), 0.1, torques, NO_SLIDING) == (
        10.0,
        2.0,
        3.0,
        40.0,
    )


def test_changing_clutches_are_found():
    """From outside of the band at zero, from inside at its edge if more can be held there."""
    for before, after in [(0.1, -0.001), (-0.2, 5.0), (0.2, 0.0), (-0.1, 0.0)]:
        assert clutch.switches(before, after, 0.1, 2.0, 1.0, 0.0)
        assert clutch.switches(before, after, 0.1, 1.0, 2.0, 0.0)
        assert not clutch.switches(before, after, 0.1, 1.0, 2.0, 1.0)  # one potential for both
    for before, after in [
        (0.2, 0.1),
        (-0.2, -0.1),
        (0.2, 1e-9),
        (0.09, -0.09),
        (0.0, 0.09),
        (0.0, 0.0),
    ]:
        assert not clutch.switches(before, after, 0.1, 2.0, 1.0, 0.0)
    for before, after in [(0.0, 0.1), (0.0, -0.1), (0.09, -3.0), (-0.05, -0.2)]:
        assert clutch.switches(before, after, 0.1, 2.0, 1.0, 0.0)
        assert not clutch.switches(before, after, 0.1, 1.0, 1.0, 0.0)
        assert not clutch.switches(before, after, 0.1, 1.0, 2.0, 0.0)


def test_one_changing_clutch_counts_as_a_change():
    torques = Torques(PerClutch(2.0, 2.0, 2.0, 2.0), PerClutch(1.0, 1.0, 1.0, 1.0))
    stays = PerClutch(1.0, 1.0, 1.0, 1.0)
    assert not clutch.any_switches(stays, stays, 0.1, torques, 0.0)
    still = PerClutch(0.0, 0.0, 0.0, 0.0)
    for name in PerClutch._fields:
        assert clutch.any_switches(stays, stays._replace(**{name: -1.0}), 0.1, torques, 0.0)
        leaves = still._replace(**{name: 0.2})
        assert clutch.any_switches(still, leaves, 0.1, torques, 0.0)
        equal = torques._replace(breakaway=torques.breakaway._replace(**{name: 1.0}))
        assert not clutch.any_switches(still, leaves, 0.1, equal, 0.0)


@pytest.mark.parametrize(
    ("before", "slid", "share"),
    [
        (0.2, -0.6, 0.25),  # comes to zero on a straight line, and would have gone on
        (-0.3, 0.1, 0.75),
        (0.2, 0.1, 1.0),  # stopped by others' changes, not by its own sliding
        (0.2, 0.0, 1.0),
        (0.0, 0.4, 0.2525),  # leaves the band on a straight line
        (0.05, -0.35, 0.3775),
        (-0.05, -0.1, 1.0),  # at its edge, but not beyond
        (0.05, 0.08, 1.0),  # leaves it after another's change only
    ],
)
def test_share_of_a_kick_before_a_change(before: float, slid: float, share: float):
    found = clutch.share_before(before, slid, 0.1)
    assert found == pytest.approx(share, rel=3e-9)
    if abs(before) < 0.1 and share < 1.0:
        assert abs(before + found * (slid - before)) > 0.1, (
            "a rounding error could leave it in the band"
        )


@pytest.mark.parametrize("seed", DRAWS)
def test_velocity_problem_by_matrices(seed: int):
    q, on = motion(seed), load(seed)
    found = step.free_motion(q, RUBBING, on, H)
    tip = np.array(arms.tip_position(ARM, q))
    force = np.array([on.force_x, on.force_y]) + ARM.stiffness * (
        np.array([on.target_x, on.target_y]) - tip
    )
    damping = ARM.damping * jacobian(q).T @ jacobian(q)
    hand = jacobian(q).T @ force + [on.torque_a, on.torque_b] - 0.4 * damping @ speeds(q)
    fictitious = np.array(arms.velocity_torque(ARM, q))
    effective = mass(q) + H * (0.6 * damping + np.diag([0.9, 1.7]))
    momentum = mass(q) @ speeds(q) + H * (hand - fictitious)
    assert (found.m11, found.m12, found.m22) == pytest.approx(
        (effective[0, 0], effective[0, 1], effective[1, 1])
    )
    assert (found.p_a, found.p_b) == pytest.approx(momentum, abs=1e-14)
    assert (found.hand_a, found.hand_b) == pytest.approx(hand, abs=1e-13)
    assert (found.fictitious_a, found.fictitious_b) == pytest.approx(fictitious)
    omega = np.array([0.3, -0.4])
    assert step.clutch_load(found, *omega, H) == pytest.approx(
        (effective @ omega - momentum) / H, abs=1e-10
    )


def drawn_torques(seed: int, most: float) -> Torques:
    """Breakaway torques up to ``most``, dynamic ones a bit less or, of one clutch, more."""
    breakaway = most * np.random.default_rng([3, seed]).random(4)
    return Torques(
        PerClutch(*breakaway.tolist()), PerClutch(*(breakaway * [0.8, 0.9, 1.1, 0.7]).tolist())
    )


@pytest.mark.parametrize("limit", [0.0, 0.3, 30.0])
@pytest.mark.parametrize("seed", DRAWS)
def test_energy_terms_of_each_part_are_those_of_its_change(
    parts: list[KickPart], seed: int, limit: float
):
    q = motion(seed)
    body = body_with(q, drawn_torques(seed, limit), load(seed), arm=RUBBING)
    KICK(body, 1, H)
    implicit = ARM.implicit * ARM.damping
    for part in parts:
        omega, h, energy = np.array(part.omega), part.span, part.energy
        after = part.before._replace(omega_a=part.omega.a, omega_b=part.omega.b)
        change = arms.kinetic_energy(ARM, after) - arms.kinetic_energy(ARM, part.before)
        told = energy.hand_work - energy.dissipated - energy.numerical_loss + energy.residual
        assert told == pytest.approx(change, abs=1e-13)
        turn = omega - speeds(part.before)
        velocity = jacobian(q) @ omega
        power = omega @ [part.impact.hand_a, part.impact.hand_b] - implicit * velocity @ velocity
        assert energy.hand_work == pytest.approx(h * power, abs=1e-15)
        friction = (W @ omega) @ part.torque - [0.9, 1.7] @ omega**2
        assert energy.dissipated == pytest.approx(-h * friction, abs=1e-13)
        assert energy.numerical_loss == pytest.approx(0.5 * turn @ mass(q) @ turn, abs=1e-15)
        assert energy.residual == pytest.approx(
            -h * omega @ arms.velocity_torque(ARM, part.before), abs=1e-15
        )
    total = np.sum([part.energy for part in parts], axis=0)
    assert seen(body).energy == pytest.approx(total, abs=1e-13)
    assert sum(part.span for part in parts) == pytest.approx(H, rel=1e-15)
    assert seen(body).span == parts[-1].span


@pytest.mark.parametrize("seed", DRAWS)
def test_without_clutches_the_velocity_is_that_of_the_free_arm(seed: int):
    found = seen(body := body_with(motion(seed), FREE, load(seed), threshold=1e12))
    KICK(body, 1, H)
    impact, found = step.free_motion(motion(seed), ARM, load(seed), H), seen(body)
    effective = np.array([[impact.m11, impact.m12], [impact.m12, impact.m22]])
    assert speeds(found.motion) == pytest.approx(
        np.linalg.solve(effective, [impact.p_a, impact.p_b]), abs=1e-14
    )
    assert (found.energy.dissipated, found.span) == (0.0, H)


# --- drifts ---


@pytest.mark.parametrize("seed", DRAWS)
def test_a_drift_gains_the_change_of_the_mass_matrix_and_equals_two_halves(seed: int):
    q, torques = motion(seed), drawn_torques(seed, 5.0)
    body = body_with(q, drawn_torques(seed + 1, 5.0), load(seed))
    store(body, BODY.steady, 0, torques)
    store(body, BODY.machine.torque_decay, 0, clutch.Decay(0.9, 0.9))
    whole = body.copy()
    DRIFT(body, 0, H, False)
    half = seen(body)
    assert half.motion == pytest.approx(
        at(*(np.array(q[:2]) + 0.5 * H * speeds(q)).tolist(), *speeds(q)), abs=1e-14
    )
    gained = arms.kinetic_energy(ARM, half.motion) - arms.kinetic_energy(ARM, q)
    assert half.energy == pytest.approx((0.0, 0.0, 0.0, gained), abs=1e-14)
    for now, start, steady in zip(half.torques, drawn_torques(seed + 1, 5.0), torques, strict=True):
        assert now == pytest.approx(0.9 * np.array(start) + 0.1 * np.array(steady))
    DRIFT(body, 0, H, False)
    DRIFT(whole, 0, H, True)
    np.testing.assert_allclose(body, whole, rtol=0.0, atol=1e-14)


def test_clutches_aim_at_what_their_lagged_voltages_and_the_drift_make():
    machine = replace(
        BASELINE, clutch=replace(BASELINE.clutch, lag="voltage"), clutch_scale=(1.0, 0.9, 0.8, 0.7)
    )
    model, command, lagged = (
        model_of(machine),
        np.array([1.0, 5.0, 9.0, 20.0]),
        np.array([3.0, 0.0, 9.0, 1.0]),
    )
    for whole, time in ((False, 0.5 * machine.substep), (True, machine.substep)):
        body: Any = np.zeros((width(step.Body), 1))
        for row, value in (
            (BODY.machine, model),
            (BODY.command, command),
            (BODY.lagged_volts, lagged),
        ):
            store(body, row, 0, value if isinstance(value, tuple) else PerClutch(*value.tolist()))
        store(body, BODY.strength, 0, PerClutch(0.9, 0.9, 0.9, 0.9))
        AIM(body, 0, whole)
        volts = command + (lagged - command) * math.exp(-time / machine.clutch.time_constant)
        assert seen(body).lagged_volts == pytest.approx(volts)
        for curve, found in zip(
            (machine.clutch.breakaway, machine.clutch.dynamic), seen(body).steady, strict=True
        ):
            expected = [
                0.9 * s * curve.torque(v) for s, v in zip(machine.clutch_scale, volts, strict=True)
            ]
            assert found == pytest.approx(expected)


# --- a kick in parts ---

SPEED = 0.02
BAND = 1e-3
SOLO = Linkage(
    length_a=0.4,
    length_b=0.7,
    m11=0.3,
    m22=0.3,
    coupling=0.0,
    damping=0.0,
    stiffness=0.0,
    implicit=0.5,
)


class Solo(NamedTuple):
    """One slip by itself: from a velocity under a torque, with its clutch's limits [rad/s, N·m]."""

    slip: float
    torque: float
    breakaway: float
    dynamic: float

    def velocities(self, inertia: float) -> list[float]:
        """Slip velocities where the phases of constant acceleration end, in continuous time, the
        kick's end last."""
        slip, left, found = self.slip, H, []
        while left > 0.0:
            inside = abs(slip) < BAND
            limit = max(self.breakaway, self.dynamic) if inside else self.dynamic
            if slip == 0.0 and abs(self.torque) <= limit:
                return [*found, 0.0]
            rate = (
                self.torque - math.copysign(limit, slip if slip != 0.0 else self.torque)
            ) / inertia
            # the edge ends a phase only where the limit jumps
            border = math.copysign(1.01 * BAND, rate) if inside else 0.0
            ends = (
                border - slip
                if not inside or self.breakaway > self.dynamic
                else math.copysign(math.inf, rate)
            )
            time = ends / rate if ends * rate > 0.0 else math.inf
            slip, left = (border, left - time) if time < left else (slip + left * rate, 0.0)
            found.append(slip)
        return found


SOLOS = {
    "slips on": Solo(2.0, 1.0, 6.0, 5.0),
    "comes to rest and sticks": Solo(SPEED, 0.0, 6.0, 5.0),
    "comes to rest under a load that T_k alone would not hold": Solo(SPEED, -5.5, 6.0, 5.0),
    "comes to rest, T_s = T_k": Solo(SPEED, -1.0, 5.0, 5.0),
    "comes to rest, T_s < T_k": Solo(SPEED, -4.5, 4.0, 5.0),
    "passes zero, T_s = T_k": Solo(SPEED, -20.0, 5.0, 5.0),
    "passes zero, T_s < T_k": Solo(SPEED, -20.0, 4.0, 5.0),
    "passes zero and leaves the band": Solo(SPEED, -20.0, 6.0, 5.0),
    "passes zero and stays in the band": Solo(SPEED, -6.01, 6.0, 5.0),
    "sticks": Solo(0.0, 5.9, 6.0, 5.0),
    "breaks away and leaves the band": Solo(0.0, 10.0, 6.0, 5.0),
    "breaks away and stays in the band": Solo(0.0, 6.01, 6.0, 5.0),
    "breaks away, T_s = T_k": Solo(0.0, 10.0, 5.0, 5.0),
    "leaves the band from within": Solo(0.5 * BAND, 9.0, 6.0, 5.0),
    "no clutch": Solo(SPEED, -20.0, 0.0, 0.0),
}
PARTS = {
    "slips on": 1,
    "sticks": 1,
    "breaks away and stays in the band": 1,
    "breaks away, T_s = T_k": 1,
    "passes zero and leaves the band": 3,
}
"""How many parts the kick has, two where nothing is said."""


@pytest.mark.parametrize("sign", [-1.0, 1.0])
@pytest.mark.parametrize("number", range(4))
@pytest.mark.parametrize("name", SOLOS)
def test_one_slip_moves_as_in_continuous_time(
    parts: list[KickPart], name: str, number: int, sign: float
):
    """M = m·1, so clutch x alone moves the arm along W_x, with the inertia m/|W_x|².

    A part has at most twelve roundings of numbers up to the momentum there is, its time four of the
    kick's, and there are at most ``MAX_PARTS``. The edge of the band counts as reached 1 % beyond
    it."""
    solo, row = SOLOS[name], W[number]
    square = float(row @ row)
    inertia = SOLO.m11 / square
    omega, torque = sign * solo.slip * row / square, sign * solo.torque * row
    torques = Torques(
        NONE._replace(**{PerClutch._fields[number]: solo.breakaway}),
        NONE._replace(**{PerClutch._fields[number]: solo.dynamic}),
    )
    body = body_with(
        at(0.3, 1.2, *omega.tolist()),
        torques,
        Load(0.0, 0.0, *torque.tolist(), 0.0, 0.0),
        BAND,
        SOLO,
    )
    KICK(body, 1, H)
    expected = sign * np.array(solo.velocities(inertia))
    rounding = (
        step.MAX_PARTS
        * 16
        * UNIT
        * (abs(solo.slip) + H * (abs(solo.torque) + solo.dynamic) / inertia)
    )
    found = np.array([row @ np.array(part.omega) for part in parts])
    assert len(parts) == PARTS.get(name, 2)
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=rounding)
    assert (seen(body).motion.omega_a == seen(body).motion.omega_b == 0.0) == (expected[-1] == 0.0)
    slips = np.array(slip_velocities(seen(body).motion.omega_a, seen(body).motion.omega_b))
    across = [other for other in range(4) if abs(W[other] @ row) == 0.0]
    assert np.all(slips[across] == 0.0)


@pytest.mark.parametrize("name", SOLOS)
def test_a_stopped_clutch_tells_what_it_holds_in_the_last_part(name: str):
    solo = SOLOS[name]
    torques = Torques(NONE._replace(x1=solo.breakaway), NONE._replace(x1=solo.dynamic))
    body = body_with(
        at(0.3, 1.2, solo.slip, 0.0),
        torques,
        Load(0.0, 0.0, solo.torque, 0.0, 0.0, 0.0),
        BAND,
        SOLO,
    )
    KICK(body, 1, H)
    after = seen(body)
    torque = step.kick_torques(
        after.impact, after.motion.omega_a, after.motion.omega_b, after.capacity, after.span
    )
    if after.motion.omega_a == 0.0:
        assert torque.x1 == pytest.approx(
            -solo.torque, abs=16 * UNIT * SOLO.m11 * SPEED / after.span
        )
    else:
        assert torque.x1 == -math.copysign(after.capacity.x1, after.motion.omega_a)


def test_the_first_of_several_changes_divides_a_kick(parts: list[KickPart]):
    """Link A would stop after a fifth of a millisecond, link B after two fifths; each stops at its
    own time."""
    limit = PerClutch(3.0, 3.0, 0.0, 0.0)
    before = at(0.3, 1.2, 0.2e-3 * 3.0 / SOLO.m11, -0.4e-3 * 3.0 / SOLO.m22)
    body = body_with(before, Torques(limit, limit), Load(0.0, 0.0, 0.0, 0.0, 0.0, 0.0), BAND, SOLO)
    KICK(body, 1, H)
    assert [part.span for part in parts] == pytest.approx([0.2e-3, 0.2e-3, H - 0.4e-3])
    assert [part.omega for part in parts] == [
        (pytest.approx(0.0, abs=1e-17), pytest.approx(-0.2e-3 * 3.0 / SOLO.m22)),
        (0.0, pytest.approx(0.0, abs=1e-17)),
        (0.0, 0.0),
    ]


@pytest.mark.parametrize(("share", "count"), [(0.5, 2), (1.0 - 1e-9, 1), (1.0, 1)])
def test_a_clutch_that_stops_as_the_kick_ends_does_not_divide_it(
    parts: list[KickPart], share: float, count: int
):
    limit = NONE._replace(x1=SOLO.m11 * SPEED / (share * H))
    body = body_with(at(0.3, 1.2, SPEED, 0.0), Torques(limit, limit), Load(*(0.0,) * 6), BAND, SOLO)
    KICK(body, 1, H)
    assert len(parts) == count
    assert seen(body).motion.omega_a == pytest.approx(0.0, abs=1e-17)


def test_a_clutch_that_slips_throughout():
    """Those that pass zero exert all they have against the slip of before; the others are solved
    for as ever."""
    for seed in range(200):
        rng = np.random.default_rng([8, seed])
        q, on = motion(seed), load(seed)
        q = q._replace(omega_a=0.1 * q.omega_a, omega_b=0.1 * q.omega_b)
        limit = PerClutch(*(20.0 * rng.random(4)).tolist())
        impact = step.free_motion(q, ARM, on, H)
        before = np.array(slip_velocities(q.omega_a, q.omega_b))
        after = np.array(
            slip_velocities(*resolve(*impact[:3], impact.p_a, impact.p_b, clutch.product(H, limit)))
        ) * rng.choice([1.0, 1.0, 0.0], 4)  # some are stuck
        found = step.slid_velocities(
            impact, PerClutch(*before.tolist()), PerClutch(*after.tolist()), limit, 0.01, H
        )
        passes = (np.abs(before) >= 0.01) & (np.sign(before) != np.sign(after))
        momentum = np.array([impact.p_a, impact.p_b]) - H * W.T @ (np.sign(before) * limit * passes)
        held = PerClutch(*(H * np.array(limit) * ~passes).tolist())
        expected = slip_velocities(*resolve(*impact[:3], *momentum.tolist(), held))
        assert found == pytest.approx(expected, abs=1e-13)
        for x in np.flatnonzero(passes):
            assert step.passing(before[x], after[x], 0.01) == before[x]


def drawn_kick(seed: int) -> tuple[Any, Torques, float]:
    """A body about to be kicked so that clutches change often: slow, with a wide range of torques,
    loads and bands."""
    rng = np.random.default_rng([9, seed])
    threshold = float(10.0 ** rng.uniform(-4.0, -1.0))
    omega = rng.normal(size=2) * 10.0 ** rng.uniform(-3.0, 0.0)
    omega = (omega, omega[0] * np.array(LINES[rng.integers(4)]), np.zeros(2))[seed % 3]
    q = at(*rng.uniform(-3.0, 3.0, 2).tolist(), *omega.tolist())
    breakaway = rng.exponential(5.0, 4) * rng.integers(0, 4, 4).clip(max=1)
    dynamic = breakaway * rng.choice([0.6, 0.9, 1.0, 1.2], 4)
    torques = Torques(PerClutch(*breakaway.tolist()), PerClutch(*dynamic.tolist()))
    on = Load(
        0.0,
        0.0,
        *rng.normal(scale=10.0 ** rng.uniform(0.0, 2.0), size=2).tolist(),
        *arms.tip_position(ARM, q),
    )
    return body_with(q, torques, on, threshold), torques, threshold


def test_each_part_of_any_kick_is_passive_and_solves_its_friction_problem(parts: list[KickPart]):
    """Whatever changes: at most ``MAX_PARTS``, each against the slip at its end, together the
    kick."""
    counts = []
    for seed in range(2_000):
        body, torques, threshold = drawn_kick(seed)
        parts.clear()
        before = seen(body).motion
        KICK(body, 1, H)
        counts.append(len(parts))
        spans = [part.span for part in parts]
        assert min(spans) > 0.0
        assert sum(spans) == pytest.approx(H, rel=1e-15)
        for part in parts:
            assert part.before == before, (
                "one part begins where another ended, in the pose of the first"
            )
            before = before._replace(omega_a=part.omega.a, omega_b=part.omega.b)
            slips = slip_velocities(part.before.omega_a, part.before.omega_b)
            assert part.limit == clutch.capacities(slips, threshold, torques, NO_SLIDING)
            impact = step.free_motion(part.before, ARM, seen(body).load, part.span)
            capacities = clutch.product(part.span, part.limit)
            assert part.impact == impact
            assert part.omega == resolve(*impact[:3], impact.p_a, impact.p_b, capacities)
            assert np.all(part.torque * np.array(slip_velocities(*part.omega)) <= 0.0)
            assert np.all(np.abs(part.torque) <= part.limit)
        assert seen(body).motion == before
        assert seen(body).energy.dissipated >= 0.0
        if 1 < len(parts) < step.MAX_PARTS:
            last = parts[-1]
            changes = (
                last.before,
                last.omega,
                last.impact,
                torques,
                last.limit,
                threshold,
                1.0,
                last.span,
            )
            slips = [slip_velocities(*omega) for omega in (last.before[2:4], last.omega)]
            assert (
                not clutch.any_switches(*slips, threshold, torques, 1.0)
                or step.share_before_switch(*changes) > 0.99999
            )
    assert np.bincount(counts, minlength=step.MAX_PARTS + 1)[1:].min() >= 10, (
        "not every number of parts occurs"
    )
    assert max(counts) == step.MAX_PARTS


# --- torques at an instant ---


@pytest.mark.parametrize("seed", range(60))
def test_torques_at_an_instant_make_the_accelerations_that_they_go_with(seed: int):
    """A slipping clutch has its limit against the slip, a stuck one what keeps it so, or its limit
    against the start.

    M·α = load − V − b·JᵀJ·ω + Wᵀτ, all of the damping by the present velocity.
    """
    body, torques, threshold = drawn_kick(seed)
    q, on = seen(body).motion, seen(body).load
    machine = model_of(BASELINE)._replace(arm=ARM, slip_threshold=threshold)
    torque = np.array(step.torques_at(q, machine, on, torques))
    slips = np.array(slip_velocities(q.omega_a, q.omega_b))
    limit = np.array(clutch.capacities(PerClutch(*slips.tolist()), threshold, torques, NO_SLIDING))
    load = (
        np.array([on.torque_a, on.torque_b])
        - arms.velocity_torque(ARM, q)
        - arms.damper_torque(ARM, q)
    )
    alpha = W @ np.linalg.solve(mass(q), load + W.T @ torque)
    rounding = 1e-12 * (np.abs(load).sum() + limit.sum()) * np.linalg.norm(np.linalg.inv(mass(q)))
    slipping = slips != 0.0
    assert np.all(torque[slipping] == -(np.sign(slips) * limit)[slipping])
    assert np.all(np.abs(torque) <= limit)
    starts = ~slipping & (np.abs(alpha) > rounding)
    assert np.allclose(torque[starts], -(np.sign(alpha) * limit)[starts], rtol=1e-9, atol=rounding)
    assert torque == pytest.approx(
        shortest_kick(q, torques, on, threshold), abs=1e-4 * (1.0 + np.abs(load).sum())
    )


def shortest_kick(q: Motion, torques: Torques, on: Load, threshold: float) -> np.ndarray:
    """The torques over a kick of a time so short that no slip changes its sign."""
    body = body_with(q, torques, on, threshold)
    KICK(body, 1, 1e-9)
    after = seen(body)
    return np.array(step.kick_torques(after.impact, *after.motion[2:4], after.capacity, after.span))


@pytest.mark.parametrize("lag", ["normal_force", "voltage"])
def test_constants_of_a_machine(lag: str):
    hand = Hand(mass=2.0, damping=3.0, stiffness=4.0)
    machine = replace(
        BASELINE,
        hand=hand,
        clutch=replace(BASELINE.clutch, lag=lag),
        clutch_scale=(1.0, 0.9, 0.8, 0.7),
    )
    found, plain = model_of(machine), model_of(replace(machine, hand=Hand()))
    decay, none = (math.exp(-0.5 * machine.substep / machine.clutch.time_constant),) * 2, (0.0, 0.0)
    assert (found.voltage_decay, found.torque_decay) == (
        (decay, none) if lag == "voltage" else (none, decay)
    )
    assert (found.arm.damping, found.arm.stiffness) == (3.0, 4.0)
    assert found.arm.implicit == plain.arm.implicit == 0.5
    assert found.scale == (1.0, 0.9, 0.8, 0.7)
    assert (found.voltage_max, found.slip_threshold) == (
        machine.clutch.voltage_max,
        machine.slip_threshold,
    )
    assert (plain.arm.m11, plain.arm.m22) == (machine.arm.inertia_a, machine.arm.inertia_b)
    q = motion(1)
    gained = arms.kinetic_energy(found.arm, q) - arms.kinetic_energy(plain.arm, q)
    assert gained == pytest.approx(
        0.5 * hand.mass * np.square(arms.tip_velocity(found.arm, q)).sum()
    )


def smallest_inertia(machine: Machine) -> float:
    arm = machine.arm
    return float(
        np.linalg.eigvalsh([[arm.inertia_a, arm.coupling], [arm.coupling, arm.inertia_b]])[0]
    )


@pytest.mark.parametrize("light", [1.0, 0.01])
@pytest.mark.parametrize("damping", [0.0, 1.0, 30.0, 1e3, 1e5, 1e7])
def test_implicit_damping_prevents_alternating_motion(damping: float, light: float):
    """The share before a kick takes at most the momentum along the slowest motion: h·(1 − s)·b·(lA²
    + lB²) ≤ μ."""
    inertias = {
        name: light * getattr(BASELINE.arm, name) for name in ("inertia_a", "inertia_b", "coupling")
    }
    machine = replace(BASELINE, hand=Hand(damping=damping), arm=replace(BASELINE.arm, **inertias))
    before = (1.0 - implicit_share(machine)) * machine.substep * damping
    before *= machine.arm.length_a**2 + machine.arm.length_b**2
    smallest = smallest_inertia(machine)
    if implicit_share(machine) == 0.5:
        assert before <= smallest
    else:
        assert 0.5 < implicit_share(machine) < 1.0
        assert before == pytest.approx(smallest, rel=1e-6)


@pytest.mark.parametrize("field", ["torque_breakaway", "torque_dynamic", "lagged_volts", "heat"])
def test_one_negative_number_of_a_start_is_refused(field: str):
    start = open_loop.initial_state(BASELINE, (0.5, 2.0), volts=np.full(4, 3.0))
    wrong = np.array(getattr(start, field))
    wrong[2] = -1e-9
    with pytest.raises(ParameterError, match=field):
        open_loop.simulate(
            BASELINE, replace(start, **{field: wrong}), np.zeros(4), np.zeros(2), duration=0.01
        )


@pytest.mark.parametrize("seed", range(4))
def test_friction_inverts_constructed_momenta(seed: int):
    """Backwards: a velocity, and impulses that may go with it, make the momentum; off ties its
    answer is unique."""
    rng = np.random.default_rng([3, seed])
    for number in range(400):
        m11, m22 = np.exp(rng.uniform(-2.0, 2.0, 2))
        m12 = rng.uniform(-0.99, 0.99) * math.sqrt(m11 * m22)
        capacity = rng.exponential(1.0, 4) * rng.integers(0, 2 if number % 2 else 5, 4).clip(max=1)
        line = np.array(LINES[rng.integers(4)])
        omega = (
            np.zeros(2),
            line * rng.normal(),
            rng.normal(size=2),
            line + 0.1 * rng.normal(size=2),
        )[number % 4]
        slips = np.array(slip_velocities(*omega.tolist()))
        held = rng.uniform(-1.0, 1.0, 4) * rng.choice([0.5, 0.99])
        impulse = capacity * np.where(slips == 0.0, held, np.sign(slips))
        p = np.array([[m11, m12], [m12, m22]]) @ omega + np.array(COUPLING).T @ impulse
        found = resolve(m11, m12, m22, *p.tolist(), PerClutch(*capacity.tolist()))
        rounding = (
            8 * 2.0**-53 * (m11 + m22) / (m11 * m22 - m12**2) * (np.abs(p).sum() + capacity.sum())
        )
        rounding += 8 * 2.0**-53 * (m11 + m22) ** 2 / (m11 * m22 - m12**2) * np.hypot(*omega)
        assert found == pytest.approx(omega, abs=rounding), (m11, m12, m22, p, capacity)


@pytest.mark.parametrize("seed", range(4))
def test_a_load_is_shared_by_the_multipliers_that_made_it(seed: int):
    """Backwards: the least torques are multipliers on the two axes, limited; they make the load,
    and are unique."""
    rng = np.random.default_rng([4, seed])
    w = np.array(COUPLING)
    for number in range(400):
        high = rng.exponential(1.0, 4) * rng.integers(0, 4, 4).clip(max=1)
        low = -high if number % 2 else np.minimum(rng.normal(size=4), high)
        slipping, exerted = rng.random(4) < 0.3 * (number % 3), rng.choice([-1.0, 1.0], 4) * high
        low, high = np.where(slipping, exerted, (low, high)) * 10.0 ** (number % 19 - 9)
        multipliers = rng.normal(scale=np.abs(high).sum() * rng.choice([0.2, 1.0, 5.0]), size=2)
        torque = np.clip(w @ multipliers, low, high)
        found = split_load(
            *(w.T @ torque).tolist(), PerClutch(*low.tolist()), PerClutch(*high.tolist())
        )
        # edges are kept off by up to 1e-12 of loads and ranges, together at most five of these
        assert found == pytest.approx(torque, abs=1e-11 * (np.abs(low) + np.abs(high)).sum()), (
            low,
            high,
            torque,
        )


def test_a_load_is_shared_where_two_limits_meet():
    """Beyond three limits at once, where the nearest corner is not that of the middle one."""
    high, (a, b) = PerClutch(0.0, 0.335, 0.006, 0.961), (-0.244, -0.218)
    torque = PerClutch(0.0, b, -0.006, a + b)
    load = (torque.x1 + torque.x3 + torque.x4, torque.x2 - torque.x3 + torque.x4)
    assert split_load(*load, PerClutch(*(-each for each in high)), high) == pytest.approx(
        torque, abs=1e-11
    )


def test_loads_of_whole_numbers_are_shared():
    for multipliers, low, high in (
        ((-2.0 / 3.0, 0.0), (-1.0, 2.0, -1.0, -1.0), (1.0, 2.0, 1.0, 1.0)),
        ((3.0, -2.0), (-1.0, -2.0, 0.0, -1.0), (1.0, 2.0, 0.0, 1.0)),
    ):
        torque = np.clip(W @ multipliers, low, high)
        load = np.round(W.T @ torque)
        assert split_load(*load.tolist(), PerClutch(*low), PerClutch(*high)) == pytest.approx(
            torque, abs=1e-11
        )


@pytest.mark.parametrize("condition", [1e2, 1e5])
def test_the_torques_of_a_kick_make_its_load_whatever_the_rounding(condition: float):
    """The load is known to the rounding of momenta over a short time, and is not lost between
    limits all the same."""
    rng = np.random.default_rng([6, int(condition)])
    for _ in range(500):
        m11, m22 = np.exp(rng.uniform(-1.0, 1.0, 2)).tolist()
        m12 = float(rng.choice([-1.0, 1.0])) * math.sqrt(m11 * m22 * (1.0 - 1.0 / condition))
        h, capacity = (
            10.0 ** rng.uniform(-6.0, -2.0),
            rng.exponential(5.0, 4) * rng.integers(0, 4, 4).clip(max=1),
        )
        made_for = (
            np.array(LINES[rng.integers(4)])
            * rng.choice([0.0, 1.0])
            * 10.0 ** rng.uniform(-3.0, 1.0)
        )
        slips, held = W @ made_for, rng.uniform(-1.0, 1.0, 4) * rng.choice([0.0, 0.9])
        torque = capacity * np.where(slips == 0.0, held, np.sign(slips))
        p = np.array([[m11, m12], [m12, m22]]) @ made_for + h * W.T @ torque
        impact, limit = (
            step.Impact(m11, m12, m22, *p.tolist(), 0.0, 0.0, 0.0, 0.0),
            PerClutch(*capacity.tolist()),
        )
        omega = resolve(m11, m12, m22, *p.tolist(), clutch.product(h, limit))
        rounding = (
            8
            * UNIT
            * (m11 + m22) ** 2
            / (m11 * m22 - m12**2)
            * (np.abs(p).sum() / h + capacity.sum())
        )
        found = W.T @ step.kick_torques(impact, *omega, limit, h)
        assert found == pytest.approx(np.array(step.clutch_load(impact, *omega, h)), abs=rounding)


@pytest.mark.parametrize(
    ("slip", "low", "high"), [(-0.5, 2.0, 2.0), (0.0, -2.0, 2.0), (0.5, -2.0, -2.0)]
)
def test_a_slipping_clutch_has_no_choice(slip: float, low: float, high: float):
    assert (lower_bound(slip, 2.0, 2.0), upper_bound(slip, 2.0, 2.0)) == (low, high)


# --- creep ---


@pytest.mark.parametrize("seed", DRAWS)
def test_clutches_that_creep_have_the_least_potential(seed: int):
    """Of a convex function, a point that no near one is below; with several kinks in one point."""
    rng = np.random.default_rng([9, seed])
    directions = np.array([(math.cos(x), math.sin(x)) for x in np.linspace(0.0, 2 * math.pi, 361)])
    for _ in range(20):
        m11, m22 = rng.uniform(0.1, 2.0, 2)
        m12 = rng.uniform(-0.9, 0.9) * math.sqrt(m11 * m22)
        m = np.array([[m11, m12], [m12, m22]])
        edge, least = 0.01, rng.uniform(0.0, 1.0, 4)
        most = least * rng.choice([1.0, 1.5, 3.0], 4)
        p = m @ (edge * rng.integers(-2, 3, 2)) + W.T @ (rng.uniform(-1.0, 1.0, 4) * most)
        limits = PerClutch(*least.tolist()), PerClutch(*most.tolist())
        omega_a, omega_b, slip = creeping(m11, m12, m22, *p.tolist(), edge, *limits)
        near = np.array([omega_a, omega_b]) + 1e-4 * edge * np.vstack([directions, [0.0, 0.0]])
        slips = np.abs(near @ W.T)
        friction = slips @ least + np.maximum(slips - edge, 0.0) @ (most - least)
        potential = 0.5 * np.einsum("ki,ij,kj->k", near, m, near) - near @ p + friction
        assert potential[-1] <= potential[:-1].min() + 20.0 * UNIT
        assert slip == pytest.approx(W @ [omega_a, omega_b], abs=1e-15)
