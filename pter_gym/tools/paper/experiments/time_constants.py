"""The standard test over the clutch time constant (paper sections IV-C.1 and IV-C.2: Figs. 7 and 8, Table I)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pter_gym.controllers import Policy
from pter_gym.params import Machine, with_friction
from pter_gym.tasks.path_following import observation_layout
from pter_gym.tools.paper.experiments.setup import Setup
from pter_gym.tools.paper.standard_test import Run, run_standard_test

Array = NDArray[np.float64]

PAPER_TABLE = {
    "baseline": (1.794, 19.69, 64.74),
    "delrin_experimental": (1.796, 33.02, 137.2),
    "delrin_theoretical": (1.498, 33.4, 144.2),
}
"""The paper's Table I by machine: average position error [in], tip velocity [in/s] and tip acceleration [in/s²]."""


@dataclass(frozen=True)
class Sweep:
    """Scores of one machine's runs, one per time constant, arrays of shape (T,).

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


@dataclass(frozen=True)
class TableRow:
    """One row of Table I: averages over time constants [m, m/s, m/s²]."""

    position_error: float
    tip_speed: float
    tip_acceleration: float


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
    return {name: _sweep(setup, machine, chosen) for name, machine in setup.machines.items()}


def table1(sweeps: Mapping[str, Sweep]) -> dict[str, TableRow]:
    """Return Table I: averages over all runs of each machine, by the machine's name."""
    return {
        name: TableRow(
            float(sweep.position_error.mean()), float(sweep.tip_speed.mean()), float(sweep.tip_acceleration.mean())
        )
        for name, sweep in sweeps.items()
    }


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


def bound_controller(setup: Setup, machine: Machine, feedback: float) -> Policy:
    """Return the controller for a machine with a gain of its torque loops [V/(N·m)] and the right torque table."""
    nominal = machine if setup.own_table else setup.baseline
    return setup.with_gain(feedback).bind(nominal, observation_layout(machine, "torque"))


def standard_runs(setup: Setup, machine: Machine, feedback: float, time_constants: Sequence[float]) -> tuple[Run, ...]:
    """Run the standard test with a gain of the torque loops [V/(N·m)], once per time constant [s]."""
    policy = bound_controller(setup, machine, feedback)
    result = run_standard_test({"run": policy}, machine=machine, task=setup.task, time_constants=time_constants)
    return result.runs["run"]


def _sweep(setup: Setup, machine: Machine, time_constants: Sequence[float]) -> Sweep:
    scores = [run.score for run in standard_runs(setup, machine, 0.0, time_constants)]
    return Sweep(
        time_constant=np.array(time_constants),
        position_error=np.array([setup.position_error(score) for score in scores]),
        tip_speed=np.array([score.mean_speed_m_s for score in scores]),
        tip_acceleration=np.array([score.mean_acceleration_m_s2 for score in scores]),
        peak_acceleration=np.array([score.peak_acceleration_m_s2 for score in scores]),
        path_length=np.array([score.path_length_m for score in scores]),
        completed=np.array([score.completed for score in scores]),
    )
