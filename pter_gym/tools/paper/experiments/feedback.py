"""Torque feedback (paper section IV-C.3): the gain Kp (Fig. 10) and the line-following test (Fig. 11)."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pter_gym.params import TIME_CONSTANT
from pter_gym.tasks.path_following import COLUMN
from pter_gym.tools.paper.experiments.setup import Setup
from pter_gym.tools.paper.experiments.time_constants import standard_runs
from pter_gym.tools.paper.standard_test import Run
from pter_gym.units import INCH_POUND

Array = NDArray[np.float64]

BEST_GAIN = 0.06
"""The paper's optimum gain [V/(in·lbf)], in our reading of its unit (section IV-C.3)."""

GAINS = tuple(round(0.01 * k, 2) for k in range(26))
"""Gains of Fig. 10 [V/(in·lbf)]. Those of the paper are lost with its figures."""


@dataclass(frozen=True)
class GainSweep:
    """Runs at several gains of the torque loop, arrays of shape (K,).

    Attributes
    ----------
    time_constant
        Of the clutches [s].
    gain
        Kp [V/(in·lbf)]; 0 is plain impedance control.
    position_error
        Average distance from the path [m].
    saturated
        Fraction of the clutch commands at the largest voltage.
    completed
        Whether the end of the path was reached.
    """

    time_constant: float
    gain: Array
    position_error: Array
    saturated: Array
    completed: NDArray[np.bool_]


@dataclass(frozen=True)
class LineFollowing:
    """The line-following test without and with torque feedback.

    Attributes
    ----------
    setup
        The task with its path, and the kind of error average.
    gain
        Kp with feedback [V/(in·lbf)].
    without, with_feedback
        The two runs.
    """

    setup: Setup
    gain: float
    without: Run
    with_feedback: Run


def gain_sweep(
    setup: Setup | None = None, gains: Sequence[float] = GAINS, time_constant: float = TIME_CONSTANT
) -> GainSweep:
    """Run the standard test on the baseline machine at each gain of the torque loop.

    Parameters
    ----------
    setup
        Machines, task and controller; those of the package by default.
    gains
        Kp [V/(in·lbf)].
    time_constant
        Of the clutches [s].
    """
    setup = Setup() if setup is None else setup
    runs = [_run(setup, gain, time_constant) for gain in gains]
    return GainSweep(
        time_constant=time_constant,
        gain=np.array(gains),
        position_error=np.array([setup.position_error(run.score) for run in runs]),
        saturated=np.array([saturated_fraction(run, setup.baseline.clutch.voltage_max) for run in runs]),
        completed=np.array([run.score.completed for run in runs]),
    )


def line_following(
    setup: Setup | None = None, gain: float = BEST_GAIN, time_constant: float = TIME_CONSTANT
) -> LineFollowing:
    """Follow the path on the baseline machine without and with torque feedback.

    Parameters
    ----------
    setup
        Machines, task and controller; those of the package by default.
    gain
        Kp with feedback [V/(in·lbf)].
    time_constant
        Of the clutches [s].
    """
    setup = Setup() if setup is None else setup
    without, with_feedback = (_run(setup, kp, time_constant) for kp in (0.0, gain))
    return LineFollowing(setup, gain, without, with_feedback)


def saturated_fraction(run: Run, voltage_max: float) -> float:
    """Return the fraction of the clutch commands of a run that are at the largest voltage [V]."""
    telemetry: Any = run.telemetry
    volts = telemetry[1:, [*COLUMN.volts]]
    return float((volts >= (1.0 - 1e-6) * voltage_max).mean())


def _run(setup: Setup, gain: float, time_constant: float) -> Run:
    return standard_runs(setup, setup.baseline, gain / INCH_POUND, [time_constant])[0]
