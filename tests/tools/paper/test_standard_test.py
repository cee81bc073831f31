"""The standard test over time constants and gains: Figs. 7, 8, 10 and 11, and Table I."""

from dataclasses import fields, replace

import pytest

from pter_gym.benchmark.measures import column, vector
from pter_gym.controllers import Impedance
from pter_gym.errors import ParameterError
from pter_gym.params import with_friction
from pter_gym.tasks.path_following import observation_layout
from pter_gym.tools.paper.clutch_tests import holding_torque
from pter_gym.tools.paper.parameters import STUDY_MACHINES, Setup
from pter_gym.tools.paper.path_tests import (
    PAPER_TABLE,
    gain_sweep,
    table1,
    time_constant_sweep,
    with_equal_peaks,
)
from pter_gym.tools.paper.standard_test import run_standard_test
from pter_gym.units import INCH_POUND, to_inches

TAUS = [0.03, 0.105]
BASELINE, DELRIN_THEORETICAL = STUDY_MACHINES["baseline"], STUDY_MACHINES["delrin_theoretical"]
SETUP = Setup(table_error=1.0, delrin_table=1.0)
CONTROLLER = SETUP.controller
IMPEDANCE = Impedance(**{item.name: getattr(CONTROLLER, item.name) for item in fields(Impedance)})


def test_a_sweep_is_the_benchmark_on_each_machine():
    setup = replace(SETUP, own_table=True)
    sweeps = time_constant_sweep(setup, TAUS)
    table = table1(sweeps)
    assert list(sweeps) == list(table) == list(PAPER_TABLE)
    for name, machine in STUDY_MACHINES.items():
        runs = run_standard_test(
            {"": IMPEDANCE}, machine=machine, task=setup.task, time_constants=TAUS
        ).runs[""]
        scores = [run.score for run in runs]
        assert sweeps[name].position_error.tolist() == [
            score.path_average_error_m for score in scores
        ]
        assert sweeps[name].tip_speed.tolist() == [score.mean_speed_m_s for score in scores]
        assert sweeps[name].tip_acceleration.tolist() == [
            score.mean_acceleration_m_s2 for score in scores
        ]
        assert sweeps[name].peak_acceleration.tolist() == [
            score.peak_acceleration_m_s2 for score in scores
        ]
        assert sweeps[name].path_length.tolist() == [score.path_length_m for score in scores]
        means = (sweeps[name].position_error, sweeps[name].tip_speed, sweeps[name].tip_acceleration)
        assert table[name] == pytest.approx([to_inches(values.mean()) for values in means])


def test_at_least_fifteen_time_constants_and_twenty_gains(experiments):
    assert all(len(sweep.time_constant) >= 15 for sweep in experiments.sweeps.values())
    assert len(experiments.gain_sweep.gain) >= 20
    assert {0.0, 0.06, 0.1} <= set(experiments.gain_sweep.gain.tolist())
    assert all(sweep.completed.all() for sweep in experiments.sweeps.values())
    assert experiments.gain_sweep.completed.all()


def test_the_controller_of_a_delrin_machine_has_the_baselines_table():
    common, own = (time_constant_sweep(Setup(own_table=own), TAUS) for own in (False, True))
    same = [
        (common[name].position_error == own[name].position_error).all() for name in STUDY_MACHINES
    ]
    assert same == [True, False, False]


def test_a_controller_with_a_wrong_table_is_that_of_a_machine_with_those_torques():
    taus, factor = [0.105], 0.8
    clutch = with_friction(BASELINE.clutch, factor, factor)
    wrong = Setup(table_error=factor).policy(
        BASELINE, layout := observation_layout(BASELINE, "torque"), 0.0
    )
    weaker = replace(CONTROLLER, feedback=0.0).bind(replace(BASELINE, clutch=clutch), layout)
    assert (wrong.law.gains == weaker.law.gains).all()
    exact, believed = (
        time_constant_sweep(Setup(table_error=each), taus)["baseline"] for each in (1.0, factor)
    )
    # it thinks its clutches weaker than they are, and brakes too hard
    assert believed.tip_speed < exact.tip_speed


def test_equal_peaks_change_the_size_of_the_torques_alone():
    machines = with_equal_peaks(Setup()).machines
    for name, machine in machines.items():
        assert holding_torque(machine) == pytest.approx(holding_torque(BASELINE))
        clutch, original = machine.clutch, STUDY_MACHINES[name].clutch
        assert clutch.dynamic.torque(9.0) / clutch.breakaway.torque(9.0) == pytest.approx(
            original.dynamic.torque(9.0) / original.breakaway.torque(9.0)
        )
    assert machines["baseline"] == BASELINE


def test_gain_zero_is_impedance_control_and_gains_have_the_papers_unit():
    sweep = gain_sweep(SETUP, gains=[0.0, 0.06])
    controllers = {"": IMPEDANCE, "feedback": replace(CONTROLLER, feedback=0.06 / INCH_POUND)}
    runs = run_standard_test(
        controllers, machine=BASELINE, time_constants=[0.105], task=Setup().task
    ).runs
    errors = [run.score.path_average_error_m for (run,) in runs.values()]
    assert sweep.position_error.tolist() == errors


def test_saturation_counts_commands_at_the_largest_voltage():
    sweep = gain_sweep(gains=[0.0, 50.0])
    assert sweep.saturated[0] < 0.2
    assert 0.2 < sweep.saturated[1] <= 1.0


def test_the_line_is_followed_from_its_start_to_its_end(experiments):
    path = experiments.setup.task.path
    for (run,) in experiments.line_following.runs.values():
        assert run.score.completed
        assert vector(run.telemetry, "tip")[0] == pytest.approx(path.point(0.0))
        assert column(run.telemetry, "arc_length")[-1] >= path.length


def test_errors_name_their_field():
    with pytest.raises(ParameterError, match="machines"):
        Setup(machines={})
    with pytest.raises(ParameterError, match="feedback"):
        gain_sweep(gains=[-0.1])
    with pytest.raises(ParameterError, match="time_constant"):
        time_constant_sweep(time_constants=[0.0])
    for name in ("policies", "time_constants"):
        with pytest.raises(ParameterError, match=name):
            run_standard_test(**{"policies": {"": IMPEDANCE}, name: ()})


@pytest.mark.slow
def test_a_finer_substep_hardly_moves_table_1(experiments):
    """Substeps of 0.1 ms and the same control period."""
    machines = {name: replace(machine, substep=1e-4) for name, machine in STUDY_MACHINES.items()}
    refined = table1(time_constant_sweep(Setup(machines=machines)))
    for name, row in refined.items():
        assert row == pytest.approx(experiments.table1[name], rel=0.005)
