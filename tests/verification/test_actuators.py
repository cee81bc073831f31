"""Actuators as they are: speed, lag, heat and drag of clutches, and anisotropic hands, against
closed forms."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from pter_gym._physics.arm import Linkage, Motion, damper_matrix
from pter_gym._physics.clutch import PerClutch, falling
from pter_gym._physics.open_loop import initial_state, simulate
from pter_gym.errors import ParameterError
from pter_gym.params import (
    ACTUATORS,
    BASELINE,
    Arm,
    Clutch,
    Hand,
    Machine,
    TorqueCurve,
    find_machine,
)
from pter_gym.params._actuators import _actuator

ROUND = Arm(length_a=0.5, length_b=0.5, inertia_a=1.0, inertia_b=1.0, coupling=0.0)
"""Two wheels of 1 kg·m²: no link moves the other one."""

STRENGTHS = (0.7, 1.1, 0.9, 1.4)


def wheel(**clutch: object) -> Machine:
    return replace(
        BASELINE, arm=ROUND, clutch=replace(BASELINE.clutch, **clutch), slip_threshold=1e-6
    )


@pytest.mark.parametrize("scale", [(1.0, 1.0, 1.0, 1.0), STRENGTHS])
def test_viscous_clutches_without_voltage_stop_wheels_exponentially(scale: tuple[float, ...]):
    """ω' = −viscous·Wᵀ·scale·W·ω."""
    machine = replace(wheel(viscous=0.2), substep=1e-4, clutch_scale=scale)
    run = simulate(
        machine, initial_state(machine, (0.0, 1.5), (2.0, 0.0)), [0.0] * 4, (0.0, 0.0), duration=0.5
    )
    w = np.array([[1.0, 0.0], [0.0, 1.0], [1.0, -1.0], [1.0, 1.0]])
    rate = 0.2 * w.T @ np.diag(scale) @ w
    exact = solve_ivp(lambda _, omega: -rate @ omega, (0.0, 0.5), [2.0, 0.0], rtol=1e-10)
    # first order: h·rate·ω
    np.testing.assert_allclose(run.omega[-1], exact.y[:, -1], atol=2.0 * rate.max() * 1e-4)


def test_each_clutch_has_its_own_strength():
    machine = replace(wheel(), clutch_scale=STRENGTHS)
    top = np.outer((1.12, 1.0), STRENGTHS) * machine.clutch.dynamic.torque(10.0)
    state = initial_state(machine, (0.0, 1.5), volts=[10.0] * 4)
    np.testing.assert_allclose((state.torque_breakaway, state.torque_dynamic), top)
    start = initial_state(machine, (0.0, 1.5))
    run = simulate(machine, start, [10.0] * 4, (0.0, 0.0), duration=0.1)
    risen = -np.expm1(-0.1 / machine.clutch.time_constant)
    np.testing.assert_allclose((run.torque_breakaway[-1], run.torque_dynamic[-1]), risen * top)


def test_off_state_torque_decelerates_uniformly():
    curve = replace(BASELINE.clutch.dynamic, off_state=0.3)
    machine = replace(wheel(breakaway=curve, dynamic=curve), clutch_scale=(1.0, 0.0, 0.0, 0.0))
    run = simulate(
        machine, initial_state(machine, (0.0, 1.5), (2.0, 0.0)), [0.0] * 4, (0.0, 0.0), duration=1.0
    )
    assert run.omega[-1, 0] == pytest.approx(2.0 - 0.3)
    assert curve.voltage(0.2) == 0.0
    assert curve.torque(curve.voltage(7.0)) == pytest.approx(7.0)


def test_torque_falls_with_its_own_time_constant():
    machine = wheel(fall_ratio=3.0)
    settled = initial_state(machine, (0.0, 1.5), volts=[10.0] * 4)
    tau, top = machine.clutch.time_constant, settled.torque_dynamic[0]
    rise = simulate(
        machine, initial_state(machine, (0.0, 1.5)), [10.0] * 4, (0.0, 0.0), duration=0.2
    )
    fall = simulate(machine, settled, [0.0] * 4, (0.0, 0.0), duration=0.2)
    np.testing.assert_allclose(
        rise.torque_dynamic[:, 0], top * -np.expm1(-rise.time / tau), rtol=1e-9
    )
    np.testing.assert_allclose(
        fall.torque_dynamic[:, 0], top * np.exp(-fall.time / (3.0 * tau)), rtol=1e-9
    )


def test_a_clutch_fades_with_the_heat_that_it_has_taken_up():
    """Without cooling the heat is the energy that the only clutch has dissipated."""
    machine = replace(wheel(fade=0.05, cooling=1e9), clutch_scale=(1.0, 0.0, 0.0, 0.0))
    start = initial_state(machine, (0.0, 1.5), (8.0, 0.0), volts=[3.0] * 4)
    run = simulate(machine, start, [3.0] * 4, (0.0, 0.0), duration=1.0)
    assert run.final.heat[0] == pytest.approx(run.dissipated.sum(), rel=1e-6)
    steady = simulate(
        machine, replace(run.final, omega=np.zeros(2)), [3.0] * 4, (0.0, 0.0), duration=3.0
    )
    expected = machine.clutch.dynamic.torque(3.0) / (1.0 + 0.05 * run.final.heat[0])
    assert steady.torque_dynamic[-1, 0] == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("seed", range(20))
def test_damping_at_the_links_is_that_of_the_matrix_at_the_tip(seed: int):
    rng = np.random.default_rng(seed)
    theta, (mean, stretch, shear) = rng.uniform(-3.0, 3.0, 2), rng.uniform(1.0, 2.0, 3)
    base = Linkage(0.4, 0.7, 0.3, 0.5, 0.2, damping=mean, stiffness=0.0, implicit=0.5)
    arm = base._replace(damping_by=base.damping_by._replace(stretch=stretch, shear=shear))
    units = (math.cos(theta[0]), math.sin(theta[0]), math.cos(theta[1]), math.sin(theta[1]))
    jacobian = np.array([[-0.4 * units[1], -0.7 * units[3]], [0.4 * units[0], 0.7 * units[2]]])
    matrix = jacobian.T @ np.array([[mean + stretch, shear], [shear, mean - stretch]]) @ jacobian
    found = damper_matrix(arm, Motion(*theta, 0.0, 0.0, *units))
    assert found == pytest.approx((matrix[0, 0], matrix[0, 1], matrix[1, 1]))


def test_an_anisotropic_hand_moves_the_arm_as_its_matrices_say():
    """The tip's motion against an integration of M·α + V = Jᵀ(K·(target − x) − B·v), to the order
    of the substep."""
    hand = Hand(
        mass=0.5,
        damping=12.0,
        stiffness=90.0,
        damping_anisotropy=(0.5, 0.4),
        stiffness_anisotropy=(-0.3, 0.6),
    )
    machine = replace(BASELINE, hand=hand, substep=2.5e-4, clutch_scale=(0.0,) * 4)
    arm, target = machine.arm, np.array([0.1, 0.75])
    damping = 12.0 * np.array([[1.5, 0.4], [0.4, 0.5]])
    stiffness = 90.0 * np.array([[0.7, 0.6], [0.6, 1.3]])
    lengths = np.array([arm.length_a, arm.length_b])

    def rates(_: float, y: np.ndarray) -> np.ndarray:
        theta, omega = y[:2], y[2:]
        jacobian = lengths * np.array([-np.sin(theta), np.cos(theta)])
        tip = lengths @ np.column_stack([np.cos(theta), np.sin(theta)])
        coupling = arm.coupling + hand.mass * lengths.prod()
        m12, v = coupling * np.cos(theta[0] - theta[1]), coupling * np.sin(theta[0] - theta[1])
        mass = np.diag([arm.inertia_a, arm.inertia_b] + hand.mass * lengths**2) + m12 * np.array(
            [[0, 1], [1, 0]]
        )
        force = stiffness @ (target - tip) - damping @ (jacobian @ omega)
        return np.concatenate(
            [omega, np.linalg.solve(mass, jacobian.T @ force - v * omega[::-1] ** 2 * [1, -1])]
        )

    start = np.array([0.6, 2.1, 0.0, 0.0])
    exact = solve_ivp(rates, (0.0, 0.5), start, rtol=1e-10, atol=1e-12).y[:, -1]
    run = simulate(
        machine,
        initial_state(machine, start[:2]),
        [0.0] * 4,
        (0.0, 0.0),
        hand_target=target,
        duration=0.5,
    )
    found = np.concatenate([run.theta[-1], run.omega[-1]])
    assert found == pytest.approx(exact, abs=2e-3)
    coarse = simulate(
        replace(machine, substep=1e-3),
        initial_state(machine, start[:2]), [0.0] * 4, (0.0, 0.0), hand_target=target, duration=0.5,
    )  # fmt: skip
    errors = [
        np.abs(np.concatenate([each.theta[-1], each.omega[-1]]) - exact).max()
        for each in (run, coarse)
    ]
    assert errors[0] < 0.4 * errors[1]


@pytest.mark.parametrize(
    "make",
    [
        lambda: TorqueCurve(slope=1.0, knee=0.0, curvature=0.0, off_state=-0.1),
        lambda: replace(BASELINE.clutch, stribeck=-1.0),
        lambda: replace(BASELINE.clutch, fall_ratio=0.0),
        lambda: replace(BASELINE.clutch, fade=math.nan),
        lambda: replace(BASELINE.clutch, band="both"),
        lambda: replace(BASELINE.clutch, band="printed", stribeck=0.1),
        lambda: Hand(damping=1.0, damping_anisotropy=(0.8, 0.8)),
        lambda: Hand(stiffness=1.0, stiffness_anisotropy=(0.1,)),
    ],
)
def test_invalid_actuators_and_hands_are_refused(make: object):
    with pytest.raises(
        ParameterError, match=r"off_state|stribeck|fall_ratio|fade|band|_anisotropy"
    ):
        make()  # type: ignore[operator]


@pytest.mark.parametrize("substep", [2.5e-3, 1e-3, 1e-4])
def test_eq2_as_printed_lets_a_clutch_creep_at_the_edge_of_its_band(substep: float):
    """Under a load between T_s and T_k, where in the limit of a vanishing band it holds."""
    curve, volts, band = BASELINE.clutch.dynamic, (8.0, 24.0, 0.0, 0.0), 0.01
    turned = {}
    for load in (0.9, 1.5):
        for reading in ("printed", "vanishing"):
            clutch = replace(
                BASELINE.clutch, breakaway=curve, dynamic=curve.scaled(2.0), band=reading
            )
            machine = replace(BASELINE, clutch=clutch, slip_threshold=band, substep=substep)
            start = initial_state(machine, (0.5, 2.0), volts=volts)
            torque = (load * curve.torque(8.0), 0.0)
            run = simulate(machine, start, volts, (0.0, 0.0), torque, duration=0.2)
            turned[load, reading] = run.theta[-1, 0] - 0.5
    creep = turned.pop((1.5, "printed"))
    assert {*turned.values()} == {0.0}
    speeding_up = band**2 * BASELINE.arm.inertia_a / curve.torque(8.0)  # what the arm lags behind
    assert band * (0.2 - 0.5 * substep) - speeding_up <= creep <= band * 0.2


def test_each_clutch_falls_with_its_own_slip() -> None:
    slip, threshold, speed = np.array([0.5, -1.0, 2.0, 0.01]), 0.1, 1.5
    faster = np.maximum(np.abs(slip), threshold)
    found = falling(PerClutch(*slip.tolist()), threshold, speed**2)
    np.testing.assert_allclose(found, speed**2 / (speed**2 + faster**2), rtol=1e-14)


NEUTRAL = {"stribeck": 0.0, "viscous": 0.0, "fall_ratio": 1.0, "fade": 0.0}


def test_a_breakaway_ratio_is_breakaway_over_dynamic_torque() -> None:
    table = {"grade": "measured", "provenance": "", "source": "", "unknown": ()}
    numbers = {"slope": 0.5, "off_state": 0.2, "breakaway_ratio": 1.4, "voltage_max": 12.0}
    clutch = _actuator("brake", {**table, **numbers}, None).clutch
    assert clutch.breakaway.torque(9.0) == pytest.approx(1.4 * (0.2 + 0.5 * 9.0))


@pytest.mark.parametrize("name", ACTUATORS)
def test_the_library_of_actuators_says_what_it_does_not_know(name: str):
    found = ACTUATORS[name]
    assert isinstance(found.clutch, Clutch)
    for each in set(found.unknown) & set(NEUTRAL):
        assert getattr(found.clutch, each) == NEUTRAL[each]
    assert {
        each for each, value in NEUTRAL.items() if getattr(found.clutch, each) != value
    }.isdisjoint(found.unknown)
    assert found.grade != "order of magnitude" or name.startswith("rough-")
    assert find_machine(name).clutch == found.clutch
