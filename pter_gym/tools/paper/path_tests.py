"""The standard test over the time constant (Figs. 7 and 8, Table I) and over the gain (Figs. 10 and 11)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pter_gym.benchmark import find_policy
from pter_gym.params import Machine, with_friction
from pter_gym.tasks.path_following import COLUMN, observation_layout
from pter_gym.tools.paper.printed_values import TIME_CONSTANT
from pter_gym.tools.paper.setup import Setup
from pter_gym.tools.paper.standard_test import Run, run_standard_test
from pter_gym.units import INCH, INCH_POUND

Array = NDArray[np.float64]

PAPER_TABLE = {
    "baseline": (1.794, 19.69, 64.74),
    "delrin_experimental": (1.796, 33.02, 137.2),
    "delrin_theoretical": (1.498, 33.4, 144.2),
}
"""The paper's Table I by machine: average position error [in], tip velocity [in/s] and tip acceleration [in/s²]."""

BEST_GAIN = 0.06
"""The paper's optimum gain [V/(in·lbf)], in our reading of its unit (section IV-C.3)."""

GAINS = tuple(round(0.01 * k, 2) for k in range(26))
"""Gains of Fig. 10 [V/(in·lbf)]. Those of the paper are lost with its figures."""

PLATEAU_FROM = 0.1
"""Gain above which the error stays about constant [V/(in·lbf)] (section IV-C.3)."""


LAWS = ("impedance", "torque-feedback")
"""Control laws that the standard test compares."""


@dataclass(frozen=True)
class Sweep:
    """Scores of runs, one per time constant, arrays of shape (T,).

    Attributes
    ----------
    time_constant
        Of the clutches [s].
    position_error
        Average distance from the path [m].
    tip_speed, tip_acceleration, peak_acceleration
        Mean speed [m/s]; mean and largest acceleration after the start-up interval [m/s²].
    path_length
        Distance travelled by the tip [m].
    completed
        Whether the end of the path was reached.
    """

    time_constant: Array
    position_error: Array
    tip_speed: Array
    tip_acceleration: Array
    peak_acceleration: Array
    path_length: Array
    completed: NDArray[np.bool_]

    @property
    def averages(self) -> tuple[float, float, float]:
        """A row of Table I: position error [in], tip speed [in/s] and tip acceleration [in/s²], over all runs."""
        error, speed, acceleration = self.position_error, self.tip_speed, self.tip_acceleration
        return float(error.mean()) / INCH, float(speed.mean()) / INCH, float(acceleration.mean()) / INCH


@dataclass(frozen=True)
class GainSweep:
    """Runs at several gains of the torque loop, arrays of shape (K,).

    Attributes
    ----------
    gain
        Kp [V/(in·lbf)]; 0 is plain impedance control.
    position_error
        Average distance from the path [m].
    saturated
        Fraction of the clutch commands at the largest voltage.
    completed
        Whether the end of the path was reached.
    """

    gain: Array
    position_error: Array
    saturated: Array
    completed: NDArray[np.bool_]


@dataclass(frozen=True)
class LineFollowing:
    """The line-following test: the length of the line [m], Kp [V/(in·lbf)], and runs without and with feedback."""

    length: float
    gain: float
    without: Run
    with_feedback: Run


def time_constant_sweep(setup: Setup | None = None, time_constants: Sequence[float] | None = None) -> dict[str, Sweep]:
    """Run the standard test with plain impedance control at each time constant, on each machine.

    Parameters
    ----------
    setup
        Machines, task and controller; those of the package by default.
    time_constants
        Of the clutches [s]; those of the setup by default.

    Returns
    -------
    sweeps
        By the machine's name.
    """
    setup = Setup() if setup is None else setup
    chosen = setup.time_constants if time_constants is None else time_constants
    return {name: sweep_of(standard_runs(setup, machine, 0.0, chosen)) for name, machine in setup.machines.items()}


def policy_sweep() -> dict[str, Sweep]:
    """Run the standard test with the built-in control laws on the scenarios' machine, by the law's name."""
    laws = {name: find_policy(name, scenario=None) for name in LAWS}
    return {name: sweep_of(runs) for name, runs in run_standard_test(laws).runs.items()}


def sweep_of(runs: Sequence[Run]) -> Sweep:
    """Return the scores of runs at several time constants."""
    return Sweep(
        time_constant=np.array([run.time_constant for run in runs]),
        position_error=np.array([run.score.mean_error_m for run in runs]),
        tip_speed=np.array([run.score.mean_speed_m_s for run in runs]),
        tip_acceleration=np.array([run.score.mean_acceleration_m_s2 for run in runs]),
        peak_acceleration=np.array([run.score.peak_acceleration_m_s2 for run in runs]),
        path_length=np.array([run.score.path_length_m for run in runs]),
        completed=np.array([run.score.completed for run in runs]),
    )


def table1(sweeps: Mapping[str, Sweep]) -> dict[str, tuple[float, float, float]]:
    """Return Table I in the paper's units [in, in/s, in/s²]: averages over all runs, by the machine's name."""
    return {name: sweep.averages for name, sweep in sweeps.items()}


def peak_torque(machine: Machine) -> float:
    """Return the largest torque that a clutch of a machine can hold [N·m]."""
    clutch = machine.clutch
    return max(clutch.breakaway.torque(clutch.voltage_max), clutch.dynamic.torque(clutch.voltage_max))


def with_equal_peaks(setup: Setup) -> Setup:
    """Return a setup in which every material's torques are scaled until its peak torque is the baseline's."""
    machines: dict[str, Machine] = {}
    for name, machine in setup.machines.items():
        factor = peak_torque(setup.baseline) / peak_torque(machine)
        machines[name] = replace(machine, clutch=with_friction(machine.clutch, factor, factor))
    return replace(setup, machines=machines)


def gain_sweep(setup: Setup | None = None, gains: Sequence[float] = GAINS) -> GainSweep:
    """Run the standard test on the baseline machine at each gain of the torque loop [V/(in·lbf)]."""
    setup = Setup() if setup is None else setup
    runs = [_run(setup, gain) for gain in gains]
    top = (1.0 - 1e-6) * setup.baseline.clutch.voltage_max
    return GainSweep(
        gain=np.array(gains),
        position_error=np.array([run.score.mean_error_m for run in runs]),
        saturated=np.array([float((_volts(run) >= top).mean()) for run in runs]),
        completed=np.array([run.score.completed for run in runs]),
    )


def line_following(setup: Setup | None = None, gain: float = BEST_GAIN) -> LineFollowing:
    """Follow the path on the baseline machine without and with torque feedback of a gain [V/(in·lbf)]."""
    setup = Setup() if setup is None else setup
    return LineFollowing(setup.task.path.length, gain, _run(setup, 0.0), _run(setup, gain))


def standard_runs(setup: Setup, machine: Machine, feedback: float, time_constants: Sequence[float]) -> tuple[Run, ...]:
    """Run the standard test with a gain of the torque loops [V/(N·m)], once per time constant [s]."""
    nominal = machine if setup.own_table else setup.baseline
    policy = setup.with_gain(feedback).bind(nominal, observation_layout(machine, "torque"))
    result = run_standard_test({"run": policy}, machine=machine, task=setup.task, time_constants=time_constants)
    return result.runs["run"]


def _run(setup: Setup, gain: float) -> Run:
    return standard_runs(setup, setup.baseline, gain / INCH_POUND, [TIME_CONSTANT])[0]


def _volts(run: Run) -> Array:
    telemetry: Any = run.telemetry
    return telemetry[1:, [*COLUMN.volts]]
