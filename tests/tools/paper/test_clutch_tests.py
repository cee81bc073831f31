"""The tests of single clutches: Figures 3, 4, 5 and 9, step response, four that hold together."""

from dataclasses import replace

import numpy as np
import pytest

from oracle.friction import W
from pter_gym._physics.friction import ClutchMode
from pter_gym.params import TorqueCurve
from pter_gym.tools.paper.clutch_tests import (
    POSE,
    RAMP_TIME,
    RESOLUTION,
    holding_torque,
    largest_load,
    single_dof,
    step_response,
    tip,
    tip_force,
)
from pter_gym.tools.paper.experiments import Experiments
from pter_gym.tools.paper.parameters import STUDY_MACHINES
from pter_gym.units import from_inch_pounds
from tools.paper.setups import other_setup

BASELINE, DELRIN_THEORETICAL = STUDY_MACHINES["baseline"], STUDY_MACHINES["delrin_theoretical"]


# --- Figs. 3 and 4 ---


@pytest.mark.parametrize("name", STUDY_MACHINES)
def test_single_dof_tests_give_way_at_the_papers_breakaway_torque(name):
    machine, level = STUDY_MACHINES[name], from_inch_pounds(63.5)
    tests = single_dof(machine)
    assert [test.clutch for test in tests] == [1, 2, 3, 4]
    for test in tests:
        volts = machine.clutch.breakaway.voltage(level)
        increment = test.share * float(np.diff(test.input_torque).max())
        assert test.volts[test.clutch - 1] == volts
        assert abs(float(test.torque.max()) - holding_torque(machine, volts)) <= increment
        slip = np.abs(test.trajectory.slip_velocity[:-1, test.clutch - 1])
        slipping = slip >= 2.0 * machine.slip_threshold  # not at the edge of the band
        assert test.torque[1:][slipping] == pytest.approx(machine.clutch.dynamic.torque(volts))
        assert (test.trajectory.mode[: test.breakaway] == ClutchMode.ZERO_DOF).all()
        locked = np.abs(test.trajectory.slip_velocity[:, test.locked - 1])
        if name == "delrin_theoretical":  # the locked clutch may creep, too
            assert locked.max() < 1.02 * machine.slip_threshold
            assert test.deviation.max() < 2.0 * machine.slip_threshold * test.trajectory.time[-1]
        else:
            assert (test.trajectory.mode[test.breakaway :] == test.locked).all()
            assert test.deviation.max() < 1e-12


def test_the_locked_clutch_carries_what_equation_4_asks_for(experiments):
    test = experiments.single_dof[0]
    run, arm, h = test.trajectory, BASELINE.arm, RESOLUTION
    middles = run.theta[1:] - 0.5 * h * run.omega[1:]
    difference = middles[:, 0] - middles[:, 1]
    acceleration = np.diff(run.omega[:, 0]) / h
    wanted = arm.coupling * (
        np.cos(difference) * acceleration - np.sin(difference) * run.omega[:-1, 0] ** 2
    )
    # the kick that leaves it has parts
    in_band = np.abs(run.slip_velocity[:-1, 0]) < BASELINE.slip_threshold
    assert (~in_band).sum() > 300
    assert test.locked_torque[1:][~in_band] == pytest.approx(wanted[~in_band], abs=1e-9)


def test_the_line_is_the_one_that_the_locked_clutch_leaves(experiments):
    assert [test.share for test in experiments.single_dof] == pytest.approx([1.0, 1.0, 0.5, 0.5])
    for test in experiments.single_dof:
        turned = test.trajectory.theta[-1] - test.trajectory.theta[test.breakaway - 1]
        assert abs(W[test.locked - 1] @ turned) < 1e-9
        assert tip(BASELINE, test.trajectory.theta[-1]) == pytest.approx(
            test.trajectory.tip_position[-1]
        )
        gaps = np.linalg.norm(
            test.line[:, None] - test.trajectory.tip_position[None, ::50], axis=2
        ).min(axis=0)
        assert gaps.max() < 0.5 * np.linalg.norm(np.diff(test.line, axis=0), axis=1).max()


def test_tip_force_does_the_work_of_the_joint_torques():
    load, step = np.array([3.0, -2.0]), 1e-6
    force = tip_force(BASELINE, POSE, load)
    for k in range(2):
        moved = np.array(POSE) + step * np.eye(2)[k]
        assert force @ (tip(BASELINE, moved) - tip(BASELINE, POSE)) / step == pytest.approx(
            load[k], rel=1e-5
        )


# --- step response ---


@pytest.mark.parametrize("name", STUDY_MACHINES)
def test_step_response_is_first_order(name):
    response = step_response(STUDY_MACHINES[name])
    after = response.time > 0.0
    assert (response.torque[:, ~after] == 0.0).all()
    for torque in response.torque:
        rate = np.polyfit(response.time[after], np.log(1.0 - torque[after] / response.final), 1)[0]
        assert -1.0 / rate == pytest.approx(STUDY_MACHINES[name].clutch.time_constant, rel=1e-6)


def test_a_lagged_voltage_is_not_a_first_order_torque_on_a_curved_characteristic():
    bent = TorqueCurve(slope=0.4, knee=0.0, curvature=0.2)
    clutch = replace(BASELINE.clutch, breakaway=bent.scaled(1.2), dynamic=bent)
    pure, other = (
        step_response(replace(BASELINE, clutch=replace(clutch, lag=lag)))
        for lag in ("normal_force", "voltage")
    )
    assert pure.torque == pytest.approx(np.tile(pure.first_order, (4, 1)), abs=1e-9)
    assert np.abs(other.torque - other.first_order).max() > 0.1 * other.final


# --- Fig. 5 ---


def test_the_bench_test_finds_the_curves_again(experiments):
    for name, material in experiments.torque_curves.items():
        clutch = STUDY_MACHINES[name].clutch
        measured = np.flatnonzero(np.isfinite(material.bench_dynamic))
        assert material.volts[measured] == pytest.approx(np.linspace(4.0, 24.0, 6))
        for k, volts in zip(measured, material.volts[measured], strict=True):
            increment = holding_torque(STUDY_MACHINES[name], float(volts)) * RESOLUTION / RAMP_TIME
            assert abs(material.bench_breakaway[k] - clutch.breakaway.torque(volts)) <= increment
            assert material.bench_dynamic[k] == pytest.approx(
                clutch.dynamic.torque(float(volts)), rel=1e-9
            )


# --- Fig. 9 ---


def test_the_torque_jumps_by_the_excess_of_the_breakaway_torque(experiments):
    for name, reversal in experiments.reversals.items():
        held = holding_torque(STUDY_MACHINES[name], reversal.volts)
        assert reversal.jump == pytest.approx(held / reversal.dynamic - 1.0, abs=1e-12)
        slip = reversal.trajectory.slip_velocity[:, 0]
        assert slip[reversal.index] < 0.0
        assert slip[-1] > 0.0
        assert reversal.torque[0] == pytest.approx(reversal.dynamic)
        assert reversal.torque[-1] == pytest.approx(-reversal.dynamic)


# --- four clutches together ---


def test_the_largest_load_is_that_of_a_linear_program():
    from scipy.optimize import linprog

    random = np.random.default_rng(1)
    for _ in range(50):
        capacity = random.uniform(0.0, 10.0, 4)
        angle = random.uniform(0.0, 2.0 * np.pi)
        direction = np.array([np.cos(angle), np.sin(angle)])
        equal = np.column_stack([np.array(W).T, -direction])
        best = linprog(
            [0, 0, 0, 0, -1],
            A_eq=equal,
            b_eq=[0, 0],
            bounds=[*((-c, c) for c in capacity), (0, None)],
        )
        assert largest_load(capacity, direction) == pytest.approx(best.x[-1], rel=1e-6, abs=1e-9)


# --- what every machine of the model meets: it follows from the equations, and is no evidence ---


@pytest.fixture(scope="module", params=["shipped", 0, 1], ids=str)
def any_experiments(request, experiments) -> Experiments:
    """Those with the shipped parameters, and with others."""
    return experiments if request.param == "shipped" else Experiments(other_setup(request.param))


def test_clutches_only_take_energy_and_all_six_modes_occur(any_experiments):
    runs = [test.trajectory for test in any_experiments.single_dof]
    runs += [reversal.trajectory for reversal in any_experiments.reversals.values()]
    assert max(run.power.max() for run in runs) <= 0.0
    assert len(np.unique(np.concatenate([run.mode for run in runs]))) == 6


def test_a_clutch_absorbs_the_ramp_and_falls_back_to_its_dynamic_torque(any_experiments):
    for test in any_experiments.single_dof:
        level, stuck = from_inch_pounds(63.5), slice(0, test.breakaway)
        assert test.torque[stuck] == pytest.approx(
            test.share * test.input_torque[stuck], abs=1e-9 * level
        )
        assert test.torque.max() == pytest.approx(level, abs=from_inch_pounds(0.2))
        assert test.torque[-1] < 0.99 * level


def test_materials_stick_and_slip_as_the_paper_says(any_experiments):
    baseline, experimental, theoretical = any_experiments.torque_curves.values()
    for curves in (baseline, experimental):
        assert curves.breakaway[0] == curves.dynamic[0] == 0.0
        assert (curves.breakaway[1:] >= 1.119999999 * curves.dynamic[1:]).all()
    assert (theoretical.dynamic[1:] >= 1.05 * theoretical.breakaway[1:]).all()
    assert theoretical.dynamic[-1] < 0.95 * baseline.breakaway[-1]


def test_torque_jumps_at_a_reversal_where_clutches_stick_and_slip(any_experiments):
    baseline, experimental, theoretical = (
        reversal.jump for reversal in any_experiments.reversals.values()
    )
    assert min(baseline, experimental) > 0.1
    assert 0.6 < experimental / baseline < 1.7
    assert theoretical < 0.01


def test_steps_are_first_order_loads_are_held_and_the_hand_is_eq_5(any_experiments):
    response, held, hand = (
        any_experiments.step_response,
        any_experiments.holding,
        any_experiments.setup.task.hand,
    )
    assert np.abs(response.torque - response.first_order).max() < 0.01 * response.final
    assert (held.moved_at > held.limit * (1.0 - 1e-12)).all()
    assert (held.moved_at < held.limit * 1.001).all()
    times = np.linspace(0.0, 10.0, 1001)
    wanted = sum(np.sin(2.0**n * np.pi * times) for n in range(5)) / 5.0
    forces = np.array([hand.normal_force(float(time)) for time in times])
    assert forces / sum(hand.amplitudes) == pytest.approx(wanted, abs=1e-9)
