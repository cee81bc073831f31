"""Actuators as they are: speed, lag, hysteresis, heat and drag of clutches, and anisotropic hands,
against closed forms."""

import math
from dataclasses import fields, replace
from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from pter_gym._compiled.records import flat
from pter_gym._engine.batch import Batch
from pter_gym._physics.arm import Linkage, Motion, damper_matrix
from pter_gym._physics.clutch import PerClutch, falling, sought
from pter_gym._physics.open_loop import initial_state, simulate
from pter_gym.errors import ParameterError
from pter_gym.haptics import torque_limits
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
from pter_gym.tasks.path_following import PathFollowing

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


LINE = TorqueCurve(slope=0.5, knee=24.0, curvature=0.0, off_state=0.2)

HYSTERESIS, TOP = 1.0, 10.0
"""Of a clutch, and the largest voltage that it gets [V]."""


def looped(volts: NDArray[np.float64], **clutch: object) -> NDArray[np.float64]:
    """Return the dynamic torque [N·m] after each of many voltages (T,), on a line, without lag."""
    quick: dict[str, object] = {"time_constant": 1e-5, "hysteresis": HYSTERESIS, **clutch}
    machine = wheel(breakaway=LINE, dynamic=LINE, **quick)
    start = initial_state(machine, (0.0, 1.5))
    run = simulate(machine, start, np.repeat(volts[:, None], 4, axis=1), (0.0, 0.0))
    return run.torque_dynamic[:, 0]


def swung(*ends: float) -> NDArray[np.float64]:
    """Return voltages that go from end to end, in steps of 0.1 V."""
    legs = [np.linspace(a, b, round(10.0 * abs(b - a)) + 1)[1:] for a, b in pairwise(ends)]
    return np.concatenate([[ends[0]], *legs])


@pytest.mark.parametrize("lag", ["normal_force", "voltage"])
def test_a_triangle_wave_draws_a_loop_whose_area_is_hysteresis_times_torque(lag: str):
    """Its corners are (0, h), (2h, h), (A, A − h), (A − 2h, A − h), so it is 2h·(A − 2h) large."""
    volts = swung(0.0, TOP, 0.0, TOP)
    torque = (looped(volts, lag=lag) - LINE.off_state) / LINE.slope
    first, fall, rise = torque[:101], torque[100:201], torque[200:]
    h, most = HYSTERESIS, TOP - HYSTERESIS
    np.testing.assert_allclose(first, np.maximum(volts[:101] - h, 0.0), atol=1e-12)
    np.testing.assert_allclose(fall, np.minimum(volts[100:201] + h, most), atol=1e-12)
    np.testing.assert_allclose(rise, np.maximum(volts[200:] - h, h), atol=1e-12)
    area = -np.trapezoid(torque[100:], volts[100:])
    assert area == pytest.approx(2.0 * h * (TOP - 2.0 * h))


def test_minor_loops_close_and_leave_no_trace_and_small_waves_move_no_torque():
    """Where a voltage has been before the larger swing that it is on does not matter."""
    plain, looping = (0.0, 9.0, 3.0, 8.0), (0.0, 9.0, 5.0, 8.0, 3.0, 6.0, 3.0, 8.0)
    torque = looped(swung(*looping))
    np.testing.assert_allclose(torque[-51:], looped(swung(*plain))[-51:], atol=1e-12)
    once = looped(swung(0.0, 9.0, *(3.0, 6.0) * 2))
    np.testing.assert_allclose(once[-31:], once[-91:-60], atol=1e-12)
    assert np.ptp(looped(swung(0.0, 9.0, *(7.1, 9.0) * 3))[-80:]) == 0.0


def test_behind_a_lag_of_the_voltage_torque_falls_to_what_hysteresis_leaves():
    tau = 0.1
    volts = np.repeat([TOP, 0.0], [1200, 80])
    most = TOP - HYSTERESIS
    torque = (looped(volts, lag="voltage", time_constant=tau) - LINE.off_state) / LINE.slope
    h = BASELINE.substep
    fall = HYSTERESIS + (most - HYSTERESIS) * np.exp(-h * (np.arange(80) + 1.0) / tau)
    np.testing.assert_allclose(torque[-80:], fall, rtol=1e-9)


@pytest.mark.parametrize("volts", [3.0, 5.0, 7.0])
def test_without_hysteresis_a_voltage_tends_to_its_command_alone(volts: float):
    """No derivative by the voltage, and that by the command is 1, also where both are equal."""
    slopes = [
        (sought(volts + e, 5.0 + f, 0.0) - sought(volts - e, 5.0 - f, 0.0)) / 2e-6
        for e, f in ((1e-6, 0.0), (0.0, 1e-6))
    ]
    assert slopes == pytest.approx([0.0, 1.0])


LAWS: dict[str, object] = {
    "lag": "voltage",
    "stribeck": 0.5,
    "viscous": 0.1,
    "fall_ratio": 2.0,
    "fade": 0.05,
    "cooling": 1.0,
    "hysteresis": 1.0,
}
"""Each law of a clutch, in force; ``band`` is of no effect with ``stribeck``."""

COMMANDS = np.random.default_rng(0).uniform(0.0, 12.0, (12, 4)).astype(np.float32)


def test_each_law_of_a_clutch_acts_in_a_world_whose_state_is_whole():
    """A new law has to be in this list. A world with any other goes on from a state, bit for bit;
    one without a law moves otherwise."""
    of_torque = {"breakaway", "dynamic", "time_constant", "voltage_max", "band"}
    assert {*LAWS} | of_torque == {each.name for each in fields(Clutch)}
    usual = {each: getattr(BASELINE.clutch, each) for each in LAWS}
    clutches = [LAWS, *({**LAWS, each: usual[each]} for each in LAWS)]
    machines = [replace(BASELINE, clutch=replace(BASELINE.clutch, **law)) for law in clutches]
    batch, other = (Batch(machines, [PathFollowing()] * len(machines)) for _ in range(2))
    for each in (batch, other):
        each.reset([0] * len(machines))
    for k, command in enumerate(COMMANDS):
        if k == 6:
            other.set_worlds(batch.get_worlds())
        batch.step([command] * len(machines))
        if k >= 6:
            other.step([command] * len(machines))
    worlds = batch.get_worlds()
    for mine, its in zip(flat(worlds), flat(other.get_worlds()), strict=True):
        np.testing.assert_array_equal(mine, its)
    assert len({*np.asarray(worlds.motion.theta_a).tolist()}) == len(machines)


def test_a_simulation_goes_on_from_a_state_with_each_law_of_a_clutch():
    machine = replace(BASELINE, clutch=replace(BASELINE.clutch, **LAWS))
    start = initial_state(machine, (0.5, 2.0), (2.0, -1.0))
    volts = np.repeat(COMMANDS, 10, axis=0)
    whole = simulate(machine, start, volts, (30.0, 0.0))
    first = simulate(machine, start, volts[:50], (30.0, 0.0))
    rest = simulate(machine, first.final, volts[50:], (30.0, 0.0))
    np.testing.assert_allclose(rest.torque_dynamic, whole.torque_dynamic[50:], rtol=1e-9)
    np.testing.assert_allclose(rest.theta, whole.theta[50:], atol=1e-9)


def test_hysteresis_of_a_world_is_that_of_its_commands_until_a_reset():
    machine = replace(BASELINE, clutch=replace(BASELINE.clutch, hysteresis=HYSTERESIS))
    batch, held = Batch(machine, PathFollowing()), np.zeros(4)
    batch.reset([0])
    for command in COMMANDS:
        batch.step(command[None])
        held = np.clip(held, command - HYSTERESIS, command + HYSTERESIS)
        np.testing.assert_allclose(np.ravel(batch.get_worlds().lagged_volts), held, rtol=1e-6)
    batch.reset([1])
    assert not np.any(batch.get_worlds().lagged_volts)


def test_a_clutch_makes_at_least_what_a_fall_to_0_volts_leaves():
    for hysteresis in (0.0, HYSTERESIS):
        machine = wheel(breakaway=LINE.scaled(1.2), dynamic=LINE, hysteresis=hysteresis)
        least, largest = torque_limits(machine, np.ones(4))
        np.testing.assert_allclose(least, LINE.torque(hysteresis))
        np.testing.assert_allclose(largest, LINE.torque(24.0 - hysteresis))
        assert machine.clutch.least.breakaway == pytest.approx(1.2 * LINE.torque(hysteresis))


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
        lambda: replace(BASELINE.clutch, hysteresis=-0.1),
        lambda: replace(BASELINE.clutch, hysteresis=12.0),
        lambda: replace(BASELINE.clutch, band="both"),
        lambda: replace(BASELINE.clutch, band="printed", stribeck=0.1),
        lambda: Hand(damping=1.0, damping_anisotropy=(0.8, 0.8)),
        lambda: Hand(stiffness=1.0, stiffness_anisotropy=(0.1,)),
    ],
)
def test_invalid_actuators_and_hands_are_refused(make: object):
    with pytest.raises(
        ParameterError, match=r"off_state|stribeck|fall_ratio|fade|hysteresis|band|_anisotropy"
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


NEUTRAL = {"stribeck": 0.0, "viscous": 0.0, "fall_ratio": 1.0, "fade": 0.0, "hysteresis": 0.0}


def test_a_breakaway_ratio_is_breakaway_over_dynamic_torque() -> None:
    table = {"grade": "measured", "provenance": "", "source": "", "unknown": ()}
    numbers = {"slope": 0.5, "off_state": 0.2, "breakaway_ratio": 1.4, "voltage_max": 12.0}
    clutch = _actuator("brake", {**table, **numbers}, None).clutch
    assert clutch.breakaway.torque(9.0) == pytest.approx(1.4 * (0.2 + 0.5 * 9.0))


@pytest.mark.parametrize("name", ACTUATORS)
def test_the_library_of_actuators_says_what_it_does_not_know(name: str):
    found = ACTUATORS[name]
    assert isinstance(found.clutch, Clutch)
    neutral = {each for each, value in NEUTRAL.items() if getattr(found.clutch, each) == value}
    assert neutral == set(found.unknown) & set(NEUTRAL)
    assert found.grade != "order of magnitude" or name.startswith("rough-")
    assert find_machine(name).clutch == found.clutch
