"""The standard test over the time constant (paper Figures 7, 8, Table I) and gain (10, 11)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pter_gym.benchmark.measures import per_clutch
from pter_gym.params import Machine, with_friction
from pter_gym.tasks.path_following import observation_layout
from pter_gym.tools.paper.clutch_tests import holding_torque
from pter_gym.tools.paper.parameters import SETUP, TIME_CONSTANT, Setup
from pter_gym.tools.paper.standard_test import Result, Run, run_standard_test
from pter_gym.units import INCH, INCH_POUND

__all__ = ["GainSweep", "Sweep", "gain_sweep", "line_following", "table1", "time_constant_sweep"]

Array = NDArray[np.float64]

PAPER_TABLE = {
    "baseline": (1.794, 19.69, 64.74),
    "delrin_experimental": (1.796, 33.02, 137.2),
    "delrin_theoretical": (1.498, 33.4, 144.2),
}
"""The paper's Table I: mean position error [in], tip velocity [in/s], acceleration [in/s²]."""

BEST_GAIN = 0.06
"""The paper's optimum gain [V/(in·lbf)], in our reading of its unit (section IV-C.3)."""

GAINS = tuple(round(0.01 * k, 2) for k in range(26))
"""Gains of Fig. 10 [V/(in·lbf)]. Those of the paper are lost with its figures."""

PLATEAU_FROM = 0.1
"""Gain above which the error stays about constant [V/(in·lbf)] (section IV-C.3)."""


@dataclass(frozen=True)
class Sweep:
    """Scores of runs, one per time constant, arrays of shape (T,).

    Attributes
    ----------
    time_constant
        Of the clutches [s].
    position_error, path_length
        Path average of the distance from the path, and distance travelled by the tip [m].
    tip_speed, tip_acceleration, peak_acceleration
        Mean speed [m/s]; mean and largest acceleration after the start-up interval [m/s²].
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
class GainSweep(Sweep):
    """Scores of runs, one per gain of the torque loops, arrays of shape (K,).

    The gain is Kp [V/(in·lbf)], 0 for plain impedance control; ``saturated`` is the fraction of the
    clutch commands at the largest voltage.
    """

    gain: Array
    saturated: Array


def time_constant_sweep(
    setup: Setup = SETUP, time_constants: Sequence[float] | None = None
) -> dict[str, Sweep]:
    """Run the standard test with plain impedance control on each machine of a setup.

    The time constants of the clutches [s] are those of the setup by default.
    """
    taus = setup.time_constants if time_constants is None else time_constants
    return {
        name: sweep_of(*run_with_gains(setup, machine, [0.0], taus).runs.values())
        for name, machine in setup.machines.items()
    }


def sweep_of(runs: Sequence[Run]) -> Sweep:
    """Return the scores of runs at several time constants."""
    return Sweep(
        np.array([run.time_constant for run in runs]),
        *(
            np.array([getattr(run.score, name) for run in runs])
            for name in (
                "path_average_error_m",
                "mean_speed_m_s",
                "mean_acceleration_m_s2",
                "peak_acceleration_m_s2",
                "path_length_m",
                "completed",
            )
        ),
    )


def table1(sweeps: Mapping[str, Sweep]) -> dict[str, tuple[float, ...]]:
    """Return Table I in the paper's units, averages over all runs, by the machine's name."""
    return {
        name: tuple(
            float(values.mean()) / INCH
            for values in (each.position_error, each.tip_speed, each.tip_acceleration)
        )
        for name, each in sweeps.items()
    }


def with_equal_peaks(setup: Setup) -> Setup:
    """Return a setup in which torques are scaled until every peak torque is the baseline's."""
    machines: dict[str, Machine] = {}
    for name, machine in setup.machines.items():
        factor = holding_torque(setup.baseline) / holding_torque(machine)
        machines[name] = replace(machine, clutch=with_friction(machine.clutch, factor, factor))
    return replace(setup, machines=machines)


def gain_sweep(setup: Setup = SETUP, gains: Sequence[float] = GAINS) -> GainSweep:
    """Run the standard test on the baseline machine at each gain [V/(in·lbf)]."""
    result = run_with_gains(setup, setup.baseline, gains, [TIME_CONSTANT])
    runs = [run for (run,) in result.runs.values()]
    top = (1.0 - 1e-6) * setup.baseline.clutch.voltage_max
    saturated = [float((per_clutch(run.telemetry[1:], "volts") >= top).mean()) for run in runs]
    return GainSweep(**vars(sweep_of(runs)), gain=np.array(gains), saturated=np.array(saturated))


def line_following(setup: Setup = SETUP) -> Result:
    """Follow the path on the baseline machine without torque feedback and with ``BEST_GAIN``."""
    return run_with_gains(setup, setup.baseline, [0.0, BEST_GAIN], [TIME_CONSTANT])


def run_with_gains(
    setup: Setup, machine: Machine, gains: Sequence[float], time_constants: Sequence[float]
) -> Result:
    """Run the standard test at each gain [V/(in·lbf)], by its text, and time constant [s]."""
    layout = observation_layout(machine, "torque")
    policies = {str(gain): setup.policy(machine, layout, gain / INCH_POUND) for gain in gains}
    return run_standard_test(
        policies, machine=machine, task=setup.task, time_constants=time_constants
    )
