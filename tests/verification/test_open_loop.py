"""What `simulate` makes of its inputs."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pter_gym import BASELINE, Hand, initial_state, simulate
from pter_gym.errors import DivergenceError, ParameterError

START = initial_state(BASELINE, (0.4, 2.0))


def test_rows_and_constants_mean_the_same() -> None:
    constant = simulate(
        BASELINE, START, (5.0, 2.0, 0.0, 1.0), (20.0, 5.0), (0.5, -0.5), duration=0.05
    )
    count = round(0.05 / BASELINE.substep)
    rows = simulate(
        BASELINE,
        START,
        np.tile((5.0, 2.0, 0.0, 1.0), (count, 1)),
        np.tile((20.0, 5.0), (count, 1)),
        np.tile((0.5, -0.5), (count, 1)),
    )
    assert constant.theta.tobytes() == rows.theta.tobytes()
    assert constant.time[-1] == pytest.approx(0.05)
    assert constant.mode.dtype == np.int8
    np.testing.assert_array_equal(constant.power, constant.torque * constant.slip_velocity)


def test_a_diverging_motion_raises() -> None:
    coarse = replace(BASELINE, substep=0.01)
    with pytest.raises(DivergenceError, match="substep"):
        simulate(
            coarse,
            initial_state(coarse, (0.0, 0.3), (1000.0, -1000.0)),
            (0.0,) * 4,
            (0.0, 0.0),
            duration=5.0,
        )


def test_an_overflowing_motion_raises_at_once() -> None:
    with pytest.raises(DivergenceError, match="substep"):
        simulate(
            BASELINE,
            initial_state(BASELINE, (0.0, 0.3), (1e160, -1e160)),
            (0.0,) * 4,
            (0.0, 0.0),
            duration=0.01,
        )


BAD: dict[str, tuple[tuple[Any, ...], dict[str, Any], str]] = {
    "volts out of range": (((0.0, 0.0, 0.0, 25.0), (0.0, 0.0)), {"duration": 0.1}, "volts"),
    "volts not finite": (((0.0, np.nan, 0.0, 0.0), (0.0, 0.0)), {"duration": 0.1}, "volts"),
    "three volts": (((0.0,) * 3, (0.0, 0.0)), {"duration": 0.1}, "volts"),
    "force in three dimensions": (((0.0,) * 4, (0.0,) * 3), {"duration": 0.1}, "hand_force"),
    "force as text": (((0.0,) * 4, ("a", "b")), {"duration": 0.1}, "hand_force"),
    "no duration": (((0.0,) * 4, (0.0, 0.0)), {}, "duration"),
    "two durations": ((np.zeros((16, 4)), np.zeros((9, 2))), {}, "9, 16"),
    "negative duration": (((0.0,) * 4, (0.0, 0.0)), {"duration": -1.0}, "duration"),
    "joint torque": (((0.0,) * 4, (0.0, 0.0), (np.inf, 0.0)), {"duration": 0.1}, "joint_torque"),
}


@pytest.mark.parametrize(("inputs", "keywords", "named"), BAD.values(), ids=BAD)
def test_bad_inputs_are_named(
    inputs: tuple[Any, ...], keywords: dict[str, Any], named: str
) -> None:
    with pytest.raises(ParameterError, match=named):
        simulate(BASELINE, START, *inputs, **keywords)


HELD = replace(BASELINE, hand=Hand(mass=1.0, damping=10.0, stiffness=300.0))


@pytest.mark.parametrize("stiffness", [0.5, 300.0])
def test_a_spring_needs_a_target(stiffness: float) -> None:
    held = replace(HELD, hand=replace(HELD.hand, stiffness=stiffness))
    with pytest.raises(ParameterError, match="hand_target"):
        simulate(held, START, (0.0,) * 4, (0.0, 0.0), duration=0.1)


def test_links_have_no_torque_of_their_own_unless_it_is_given() -> None:
    short, at = simulate(BASELINE, START, (0.0,) * 4, (3.0, 4.0), duration=0.01), (0.0, 0.0)
    given = simulate(BASELINE, START, (0.0,) * 4, (3.0, 4.0), at, hand_target=at, duration=0.01)
    assert short.theta.tobytes() == given.theta.tobytes()


def test_a_spring_brings_the_tip_to_its_target() -> None:
    target = (0.1, 0.5)
    motion = simulate(HELD, START, (0.0,) * 4, (0.0, 0.0), hand_target=target, duration=20.0)
    np.testing.assert_allclose(motion.tip_position[-1], target, atol=1e-3)


FORCES = np.array([[20.0, 5.0], [-3.0, 8.0], [0.0, -30.0], [12.0, 0.0]])


def test_a_force_works_along_its_own_direction() -> None:
    moving = initial_state(BASELINE, (0.4, 2.0), (1.0, 2.0))
    motion = simulate(BASELINE, moving, np.zeros((4, 4)), FORCES)
    power = np.sum(FORCES * motion.tip_velocity, axis=1)  # half a drift after the work
    turned = 0.5 * BASELINE.substep * np.abs(motion.omega).sum(axis=1)
    most = np.linalg.norm(FORCES, axis=1) * np.linalg.norm(motion.tip_velocity, axis=1)
    assert np.all(np.abs(motion.hand_work / BASELINE.substep - power) <= 2.0 * turned * most)


def test_energies_add_up() -> None:
    motion = simulate(BASELINE, START, np.tile((1.0, 0.0, 2.0, 0.0), (4, 1)), FORCES)
    lost = motion.dissipated + motion.numerical_loss - motion.residual
    gained = np.diff(motion.kinetic_energy, prepend=0.0)
    assert gained == pytest.approx(motion.hand_work - lost, abs=1e-14)


def test_voltages_lag_in_closed_form() -> None:
    machine = replace(BASELINE, clutch=replace(BASELINE.clutch, lag="voltage"))
    start = initial_state(machine, (0.4, 2.0))
    end = simulate(machine, start, (10.0, 0.0, 5.0, 24.0), (0.0, 0.0), duration=0.02).final
    risen = 1.0 - np.exp(-0.02 / machine.clutch.time_constant)
    assert end.lagged_volts == pytest.approx(risen * np.array([10.0, 0.0, 5.0, 24.0]), rel=1e-12)


@pytest.mark.parametrize(("speed", "sticks"), [(0.005, True), (3.0, False)])
def test_heat_is_what_clutches_dissipate(speed: float, sticks: bool) -> None:
    """A kick in which a clutch comes to rest is divided; the power is that of its last part."""
    machine = replace(BASELINE, clutch=replace(BASELINE.clutch, fade=1e-3, cooling=0.5))
    volts = (12.0, 4.0, 0.0, 0.0)
    start = initial_state(machine, (0.4, 2.0), (speed, 2.0), volts)
    motion = simulate(machine, start, np.tile(volts, (3, 1)), (0.0, 0.0))
    assert (motion.slip_velocity[0, 0] == 0.0) == sticks
    heat = np.zeros(4)
    for power in motion.power:
        heat = (heat + np.abs(power) * machine.substep) * np.exp(-machine.substep / 0.5)
    np.testing.assert_allclose(motion.final.heat, heat, rtol=1e-12)


@pytest.mark.parametrize(
    "part", ["theta", "omega", "torque_breakaway", "torque_dynamic", "lagged_volts"]
)
def test_a_bad_state_is_named(part: str) -> None:
    broken = replace(START, **{part: np.full(7, 1.0)})
    with pytest.raises(ParameterError, match=rf"state\.{part}"):
        simulate(BASELINE, broken, (0.0,) * 4, (0.0, 0.0), duration=0.1)
