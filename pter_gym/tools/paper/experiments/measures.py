"""The measurement for each claim of the paper: functions from the experiments to one number."""

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pter_gym._physics.arm import velocity_torque
from pter_gym._physics.open_loop import Trajectory
from pter_gym.params import BREAKAWAY_SMALL_VOLTAGE
from pter_gym.tools.paper.experiments.feedback import BEST_GAIN
from pter_gym.tools.paper.experiments.pose import linkage, motion
from pter_gym.tools.paper.experiments.study import Study
from pter_gym.tools.paper.experiments.time_constants import TableRow, peak_torque
from pter_gym.units import to_inch_pounds, to_inches

Array = NDArray[np.float64]

BASELINE, EXPERIMENTAL, THEORETICAL = "baseline", "delrin_experimental", "delrin_theoretical"

PLATEAU_FROM = 0.1
"""Gain above which the error stays about constant [V/(in·lbf)] (section IV-C.3)."""

SATURATED = 0.05
"""Fraction of saturated clutch commands that counts as significant."""


def rank_correlation(x: ArrayLike, y: ArrayLike) -> float:
    """Return Spearman's rank correlation of two samples of shape (K,); 0 if one of them is constant."""
    ranks = np.array([_ranks(np.asarray(x, float)), _ranks(np.asarray(y, float))])
    ranks -= ranks.mean(axis=1, keepdims=True)
    scale = math.sqrt(float((ranks[0] ** 2).sum() * (ranks[1] ** 2).sum()))
    return float((ranks[0] * ranks[1]).sum()) / scale if scale > 0.0 else 0.0


def _ranks(values: Array) -> Array:
    """Return ranks, the mean rank for equal values."""
    _, inverse, counts = np.unique(values, return_inverse=True, return_counts=True)
    return (np.cumsum(counts) - 0.5 * (counts - 1.0))[inverse]


# --- section III: the clutch model ---


def stuck_imbalance(study: Study) -> float:
    """Largest difference of clutch torque and its share of the ramp before breakaway, relative to the breakaway."""
    tests = study.single_dof.tests
    return max(
        float(np.abs(test.torque - test.share * test.input_torque)[: test.breakaway].max()) / study.single_dof.breakaway
        for test in tests
    )


def absorbed_torque(study: Study) -> float:
    """Largest clutch torque [in·lbf], for the test in which it is farthest from the breakaway torque."""
    peaks = [float(test.torque.max()) for test in study.single_dof.tests]
    return to_inch_pounds(max(peaks, key=lambda peak: abs(peak - BREAKAWAY_SMALL_VOLTAGE)))


def sliding_ratio(study: Study) -> float:
    """Largest torque at the end of a test relative to the breakaway torque, over the four clutches."""
    return max(float(test.torque[-1]) for test in study.single_dof.tests) / study.single_dof.breakaway


def line_deviation(study: Study) -> float:
    """Largest distance of the tip from its single-DOF line [mm], over the four tests."""
    return 1e3 * max(float(test.deviation.max()) for test in study.single_dof.tests)


def locked_torque_trend(study: Study) -> float:
    """Rank correlation of tip speed and torque of the locked clutch 2 while clutch 1 slips."""
    test = study.single_dof.tests[0]
    slipping = slice(test.breakaway, None)
    speed = np.linalg.norm(test.trajectory.tip_velocity[slipping], axis=1)
    return rank_correlation(speed, np.abs(test.locked_torque[slipping]))


def velocity_share(study: Study) -> float:
    """Share of V2 in the torque of the locked clutch 2 at the end of the test of clutch 1."""
    test = study.single_dof.tests[0]
    run = test.trajectory
    _, v2 = velocity_torque(linkage(study.single_dof.machine), motion(run.theta[-1], run.omega[-1]))
    return relative(v2, float(test.locked_torque[-1]))


def first_order_deviation(study: Study) -> float:
    """Largest deviation of any clutch's step response from first order, relative to the final torque."""
    response = study.step_response
    return float(np.abs(response.torque - response.first_order).max()) / response.final


def open_loop_runs(study: Study) -> list[Trajectory]:
    """Return the single-DOF tests and the reversals."""
    tests = [test.trajectory for test in study.single_dof.tests]
    return tests + [reversal.trajectory for reversal in study.reversals.machines.values()]


def modes_seen(study: Study) -> float:
    """Number of different clutch modes in the single-DOF tests and the reversals."""
    return len(np.unique(np.concatenate([run.mode for run in open_loop_runs(study)])))


def largest_power(study: Study) -> float:
    """Largest power of a clutch on the arm [W] in the single-DOF tests and the reversals."""
    return max(0.0, *(float(run.power.max()) for run in open_loop_runs(study)))


def holding_deviation(study: Study) -> float:
    """Largest relative difference between the load that moved the arm and the largest load that can be balanced."""
    return float(np.abs(study.holding.moved_at / study.holding.limit - 1.0).max())


def weakest_slips(study: Study) -> float:
    """Fraction of the loads at which the weakest clutch slipped."""
    return float(study.holding.weakest_slips.mean())


# --- section IV-A: the standard test ---


def disturbance_deviation(study: Study) -> float:
    """Largest difference of the hand's force across the path from Eq. 5 within 10 s, relative to Fmax."""
    hand = study.setup.hand
    force_max = sum(hand.amplitudes)
    times = np.linspace(0.0, 10.0, 1001)
    wanted = sum(np.sin(2.0**n * np.pi * times) for n in range(5)) / 5.0
    forces = np.array([hand.normal_force(float(time)) for time in times])
    return float(np.abs(forces / force_max - wanted).max())


# --- section IV-B: materials ---


def torque_without_voltage(study: Study) -> float:
    """Largest clutch torque at 0 V [N·m]."""
    materials = study.torque_curves.materials.values()
    return max(float(torque[0]) for curves in materials for torque in (curves.breakaway, curves.dynamic))


def breakaway_ratio(study: Study, model: str) -> float:
    """Smallest ratio of breakaway to dynamic torque over the voltage."""
    curves = study.torque_curves.materials[model]
    return float((curves.breakaway[1:] / curves.dynamic[1:]).min())


def dynamic_ratio(study: Study, model: str) -> float:
    """Smallest ratio of dynamic to breakaway torque over the voltage."""
    curves = study.torque_curves.materials[model]
    return float((curves.dynamic[1:] / curves.breakaway[1:]).min())


def peak_ratio(study: Study, model: str) -> float:
    """Largest torque relative to the baseline's."""
    machines = study.setup.machines
    return peak_torque(machines[model]) / peak_torque(machines[BASELINE])


# --- section IV-C: path following ---


def trend_over_time_constant(study: Study, quantity: str) -> float:
    """Rank correlation of a quantity of the baseline runs with the time constant."""
    sweep = study.sweeps[BASELINE]
    return rank_correlation(sweep.time_constant, getattr(sweep, quantity))


def paper_units(row: TableRow) -> tuple[float, float, float]:
    """Return the entries of a row of Table I [in, in/s, in/s²]."""
    return to_inches(row.position_error), to_inches(row.tip_speed), to_inches(row.tip_acceleration)


def table_entry(study: Study, model: str, column: int) -> float:
    """Entry of Table I in the paper's units."""
    return paper_units(study.table1[model])[column]


def table_ratio(study: Study, model: str, other: str, column: int) -> float:
    """Entry of Table I relative to that of another machine."""
    return table_entry(study, model, column) / table_entry(study, other, column)


def worst_error_ratio(study: Study, model: str, other: str) -> float:
    """Largest position error over the time constants, relative to that of another machine at the same one."""
    return float((study.sweeps[model].position_error / study.sweeps[other].position_error).max())


def peak_share(study: Study, model: str, column: int) -> float:
    """Share of an entry's excess over the baseline's that disappears with the baseline's peak torque."""
    entry = table_entry(study, model, column)
    gone = entry - paper_units(study.table1_equal_peak[model])[column]
    return relative(gone, entry - table_entry(study, BASELINE, column))


def jump(study: Study, model: str) -> float:
    """Jump of clutch 1's torque above the dynamic torque at the reversal."""
    return study.reversals.machines[model].jump


def relative(value: float, other: float) -> float:
    """Return the ratio of two numbers, NaN if it is undefined."""
    return value / other if other != 0.0 else math.nan


def jump_ratio(study: Study) -> float:
    """Jump of experimental Delrin relative to the baseline's."""
    return relative(jump(study, EXPERIMENTAL), jump(study, BASELINE))


def drop_ratio(study: Study) -> float:
    """Drop of clutch 1's torque as slip resumes, theoretical Delrin relative to the baseline."""
    drops = {name: reversal.jump * reversal.dynamic for name, reversal in study.reversals.machines.items()}
    return relative(drops[THEORETICAL], drops[BASELINE])


# --- section IV-C.3: torque feedback ---


def gain_range(study: Study, low: float, high: float = math.inf) -> NDArray[np.bool_]:
    """Return which gains of Fig. 10 lie within a range [V/(in·lbf)]."""
    gain = study.gain_sweep.gain
    return (gain >= low - 1e-9) & (gain <= high + 1e-9)


def error_fall(study: Study) -> float:
    """Rank correlation of error and gain up to the best gain."""
    sweep, chosen = study.gain_sweep, gain_range(study, 0.0, BEST_GAIN)
    return rank_correlation(sweep.gain[chosen], sweep.position_error[chosen])


def plateau_width(study: Study) -> float:
    """Largest deviation of the error from its mean above the gain of saturation, relative to that mean."""
    error = study.gain_sweep.position_error[gain_range(study, PLATEAU_FROM)]
    return float(np.abs(error / error.mean() - 1.0).max())


def saturated_at_best_gain(study: Study) -> float:
    """Fraction of saturated clutch commands at the best gain."""
    return float(study.gain_sweep.saturated[gain_range(study, BEST_GAIN, BEST_GAIN)][0])


def saturation_trend(study: Study) -> float:
    """Rank correlation of saturated fraction and gain above the gain of saturation."""
    sweep, chosen = study.gain_sweep, gain_range(study, PLATEAU_FROM)
    return rank_correlation(sweep.gain[chosen], sweep.saturated[chosen])


def best_gain(study: Study) -> float:
    """Gain with the smallest error among those without significant saturation [V/(in·lbf)]; NaN if none."""
    sweep = study.gain_sweep
    free = sweep.saturated <= SATURATED
    return float(sweep.gain[free][sweep.position_error[free].argmin()]) if free.any() else math.nan


def line_following_ratio(study: Study) -> float:
    """Error of the line-following test with feedback relative to that without."""
    test = study.line_following
    return test.setup.position_error(test.with_feedback.score) / test.setup.position_error(test.without.score)
