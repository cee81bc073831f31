"""Motors in the clutches' places: against free motion, slipping clutches, closed forms and the energy balance."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from studies.motors import on_motors, simulate_motors

from pter_gym._engine.batch import Batch
from pter_gym.benchmark._measures import column, four, vector
from pter_gym.benchmark.simulation import simulate
from pter_gym.benchmark.tuned import find_tuned
from pter_gym.controllers import Impedance, PaceSchedule, SingleDof, TorqueFeedback
from pter_gym.errors import ParameterError
from pter_gym.hands import RELAXED, HumanArm, MultiSineHand
from pter_gym.params import BASELINE, Arm
from pter_gym.tasks.path_following import PathFollowing, Sensing
from pter_gym.tasks.path_following._observation import SEEN

pytestmark = pytest.mark.slow

TASK = PathFollowing(hand=MultiSineHand(random_phases=True))
SEEDS = range(300, 308)
W = np.array([[1.0, 0.0], [0.0, 1.0], [1.0, -1.0], [1.0, 1.0]])
NO_LAG = replace(BASELINE, clutch=replace(BASELINE.clutch, time_constant=1e-9))


Law = Callable[[np.ndarray], np.ndarray]


def held(*volts: float) -> Law:
    """Constant signed voltages."""
    return lambda obs: np.tile(np.float32(volts), (len(obs), 1))


def clutch_volts(*volts: float) -> Law:
    """Voltages for clutches, which find the signs of their torques themselves; none at rest."""
    return lambda obs: np.where(obs[:, [SEEN.omega_a]] != 0.0, np.float32(volts), np.float32(0.0))


def braking(*volts: float) -> Law:
    """The same for motors, with the signs of slipping clutches' torques."""
    return lambda obs: -np.sign(obs[:, [SEEN.omega_a, SEEN.omega_b]] @ np.float32(W).T) * np.float32(volts)


def batch(machine: Any = BASELINE, task: PathFollowing = TASK) -> Batch:
    return Batch(machine, task, len(SEEDS))


def both(clutches: np.ndarray, motors: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    steps = min(len(clutches), len(motors))
    return clutches[:steps], motors[:steps]


def test_motors_without_voltage_are_released_clutches_bit_for_bit():
    worlds = batch()
    free, motors = both(
        simulate(worlds, clutch_volts(0.0, 0.0, 0.0, 0.0), SEEDS, 60),
        simulate_motors(worlds, held(0.0, 0.0, 0.0, 0.0), SEEDS, 60),
    )
    np.testing.assert_array_equal(motors, free)
    assert np.nanmax(column(free, "terminated")) == 1.0


@pytest.mark.parametrize("machine", [BASELINE, replace(BASELINE, clutch_scale=(0.8, 1.1, 1.3, 0.9))])
def test_with_the_signs_of_slipping_clutches_motors_move_the_arm_as_these_do(machine: Any):
    """Both then solve the same two equations; what differs is the order of the sums, some 1e-16 a substep."""
    volts = (3.0, 2.0, 1.0, 2.5)
    worlds = batch(machine)
    clutches, motors = both(
        simulate(worlds, clutch_volts(*volts), SEEDS, 60),
        simulate_motors(worlds, braking(*volts), SEEDS, 60),
    )
    compared = 0
    for world in range(len(SEEDS)):
        a, b = clutches[:, world], motors[:, world]
        torque, slips = four(a, "torque"), np.abs(four(a, "power"))
        turns = np.flatnonzero(
            (np.diff(np.sign(torque[2:]), axis=0) != 0.0).any(axis=1) | (slips[3:] < 1e-3).any(axis=1)
        )
        end = 2 + int(turns[0]) if len(turns) else np.isfinite(a[:, 0]).sum()
        for name in ("theta_a", "theta_b", "tip_velocity_x", "torque_4", "kinetic_energy", "dissipated", "hand_work"):
            np.testing.assert_allclose(column(b[:end], name), column(a[:end], name), rtol=1e-11, atol=1e-11)
        compared += end
    assert compared > 10 * len(SEEDS)


@pytest.mark.parametrize("lags", [False, True])
def test_one_motor_on_one_axis_has_the_closed_form(lags: bool):
    """Link A alone, without coupling and hand: after n substeps ω = h/M11·Σ T·(1 − dᵏ), and the angle is h·Σ ω."""
    machine = replace(BASELINE if lags else NO_LAG, arm=Arm(coupling=0.0))
    task = replace(TASK, hand=MultiSineHand(push=0.0, amplitudes=(0.0,) * 5))
    steps, volts = 12, -7.0
    rows = simulate_motors(batch(machine, task), held(volts, 0.0, 0.0, 0.0), SEEDS, steps)[:, 0]
    h, decay = machine.substep, np.exp(-machine.substep / machine.clutch.time_constant)
    torque = -machine.clutch.dynamic.torque(7.0) * (1.0 - decay ** np.arange(1, 10 * steps + 1))
    omega = h / machine.arm.inertia_a * np.cumsum(torque)
    turned = h * np.cumsum(omega)
    np.testing.assert_allclose(column(rows, "theta_a")[1:] - column(rows, "theta_a")[0], turned[9::10], rtol=1e-11)
    np.testing.assert_allclose(column(rows, "torque_1")[1:], torque[9::10], rtol=1e-12)
    np.testing.assert_array_equal(column(rows, "theta_b"), column(rows, "theta_b")[0])
    work = h * (torque * omega).reshape(steps, 10).sum(axis=1)
    np.testing.assert_allclose(column(rows, "dissipated")[1:], -work, rtol=1e-11)


@pytest.mark.parametrize("machine", [BASELINE, NO_LAG])
def test_energy_balance_closes_and_motors_push_within_their_torque(machine: Any):
    worlds = batch(machine)
    law = on_motors(find_tuned("impedance-tuned", "standard"), machine, worlds.layout)
    rows = simulate_motors(worlds, law, SEEDS, 300)
    terms = (column(rows, name)[1:] for name in ("hand_work", "dissipated", "numerical_loss", "residual"))
    work, taken, loss, residual = terms
    change = np.diff(column(rows, "kinetic_energy"), axis=0)
    alive = np.isfinite(change)
    np.testing.assert_allclose(change[alive], (work - taken - loss + residual)[alive], rtol=0.0, atol=1e-12)
    assert np.nanmax(np.abs(four(rows, "torque"))) <= machine.clutch.dynamic.torque(machine.clutch.voltage_max)
    power = four(rows, "power")
    assert np.nanmax(power) > 1.0
    assert np.nanmin(power) < -1.0


def test_motors_can_turn_the_tip_back_where_clutches_cannot():
    """A spring alone, no push: clutches cannot move an arm at rest, motors bring it to the path."""
    task = PathFollowing(hand=MultiSineHand(push=0.0, amplitudes=(0.0,) * 5), start_offset=0.02)
    law = Impedance(stiffness=300.0, damping_normal=60.0, damping_tangential=20.0)
    worlds = batch(NO_LAG, task)
    clutches = simulate(worlds, law.bind(NO_LAG, worlds.layout), SEEDS, 100)
    motors = simulate_motors(worlds, on_motors(law, NO_LAG, worlds.layout), SEEDS, 100)
    start = column(clutches, "normal_error")[0]
    assert (np.abs(start) > 1e-3).all()
    np.testing.assert_array_equal(column(clutches, "normal_error")[-1], start)
    assert (np.abs(column(motors, "normal_error")[-1]) < 0.1 * np.abs(start)).all()
    assert np.abs(vector(clutches, "tip_velocity")).max() == 0.0


def test_motors_refuse_what_they_cannot_do():
    layout = batch().layout
    for law in (TorqueFeedback(), SingleDof(), PaceSchedule(((0.1, TorqueFeedback()),))):
        with pytest.raises(ParameterError, match="controller must be Impedance"):
            on_motors(law, BASELINE, layout)  # type: ignore[arg-type]
    ready = on_motors(Impedance(), BASELINE, layout)
    voltage = replace(BASELINE, clutch=replace(BASELINE.clutch, lag="voltage"))
    hand = replace(BASELINE, hand=replace(RELAXED, stiffness=0.0))
    with pytest.raises(ParameterError, match=r"lag must be normal_force"):
        simulate_motors(batch(voltage), ready, SEEDS, 5)
    with pytest.raises(ParameterError, match=r"hand must be a force alone"):
        simulate_motors(batch(hand), ready, SEEDS, 5)
    for change, message in (
        ({"hand": HumanArm()}, "hand must be of type MultiSineHand"),
        ({"friction_drift": 0.01}, "friction_drift must be 0"),
        ({"sensing": Sensing(delay=1)}, "sensing must be ideal"),
    ):
        with pytest.raises(ParameterError, match=message):
            simulate_motors(batch(task=replace(TASK, **change)), ready, SEEDS, 5)
