"""The objective of the search: how far many candidates at once are from Table I and from the trends."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pter_gym.errors import ParameterError
from pter_gym.params import TIME_CONSTANT
from pter_gym.params._preset import Preset
from pter_gym.tasks.path_following import check_machine
from pter_gym.tools.paper.experiments.calibration.readings import setup_of
from pter_gym.tools.paper.experiments.calibration.simulation import Case, RunScores, run_cases
from pter_gym.tools.paper.experiments.feedback import BEST_GAIN
from pter_gym.tools.paper.experiments.measures import PLATEAU_FROM, SATURATED, rank_correlation
from pter_gym.tools.paper.experiments.setup import TIME_CONSTANTS, Setup
from pter_gym.tools.paper.experiments.time_constants import PAPER_TABLE
from pter_gym.units import INCH_POUND

Array = NDArray[np.float64]

TARGET = np.array(list(PAPER_TABLE.values()))
"""The paper's Table I, (3 machines, 3 columns), in inches, in/s and in/s²."""

GAINS = (0.0, 0.015, 0.03, 0.045, 0.06, 0.1, 0.125, 0.15, 0.175, 0.2, 0.225, 0.25)
"""Gains at which the search looks at Fig. 10 [V/(in·lbf)]."""

AIM = 0.045
"""Deviation of an entry of Table I from which on the worst one counts by itself."""

FEEDBACK = 0.15
"""Weight of the penalty for Fig. 10, beside Table I."""

SCREEN = TIME_CONSTANTS[1::4]
"""The time constants of a first look at a candidate [s]."""

HOPELESS, POOR = 1.5, 1.0
"""What is added for a candidate that is not looked at further after the first look, and after the runs."""


@dataclass(frozen=True)
class Quality:
    """How close K candidates are, as arrays.

    Attributes
    ----------
    table
        Table I in the paper's units, (K, 3, 3).
    trends
        Rank correlations with the time constant, (K, 4): error, path length, speed, peak acceleration. The first three
        should be 1, the last −1.
    incomplete
        Fraction of the runs that do not reach the end of the path, (K,).
    """

    table: Array
    trends: Array
    incomplete: Array

    @property
    def deviation(self) -> Array:
        """Logarithmic deviation of each entry from the paper's, (K, 3, 3)."""
        return np.log(self.table / TARGET)

    @property
    def spread(self) -> Array:
        """Root mean square of the deviations and the fraction of incomplete runs, (K,)."""
        return np.sqrt((self.deviation**2).mean(axis=(1, 2))) + self.incomplete


def misfit(presets: Sequence[Preset], trends: float) -> Array:
    """Return the objective of presets, shape (K,): smaller is better, 0 is perfect.

    The root mean square of the logarithmic deviations from Table I, plus the excess of the worst one over ``AIM``, plus
    the fraction of incomplete runs, plus the penalties for Figs. 7 and 8, with the weight ``trends``, and Fig. 10.
    Poor candidates are evaluated in less detail, and those that the environment rejects not at all.
    """
    setups = [setup_of(preset) for preset in presets]
    total = np.full(len(setups), 2.0 * HOPELESS)
    able = [k for k, setup in enumerate(setups) if is_accepted(setup)]
    if able:
        total[able] = quality_of([setups[k] for k in able], SCREEN).spread + HOPELESS
    near = np.flatnonzero(total < HOPELESS + 0.35)
    if not len(near):
        return total
    found = quality_of([setups[k] for k in near])
    worst = np.abs(found.deviation).max(axis=(1, 2))
    short = np.maximum(0.0, 0.97 - found.trends * (1.0, 1.0, 1.0, -1.0)).mean(axis=1)
    total[near] = found.spread + np.maximum(0.0, worst - AIM) + trends * short + POOR
    good: list[int] = near[total[near] < POOR + 0.6].tolist()
    if good:
        total[good] += FEEDBACK * _feedback([setups[k] for k in good]) - POOR
    return total


def is_accepted(setup: Setup) -> bool:
    """Tell whether the arm can do the task with its substep, which does not depend on the clutches."""
    try:
        check_machine(setup.task, setup.baseline)
    except ParameterError:
        return False
    return True


def quality_of(setups: Sequence[Setup], time_constants: Sequence[float] = TIME_CONSTANTS) -> Quality:
    """Return Table I and the trends of setups, over the runs at some time constants [s]."""
    out = runs_of(setups, time_constants)
    shape = len(setups), len(PAPER_TABLE), len(time_constants)
    entries = np.stack([out.error, out.speed, out.acceleration], axis=-1).reshape(*shape, 3)
    series = [
        values.reshape(shape)[:, 0] for values in (out.error, out.path_length, out.speed, out.peak)
    ]  # of the present clutches
    return Quality(
        table=np.maximum(entries.mean(axis=2), 1e-3),
        trends=np.array([[rank_correlation(time_constants, each[k]) for each in series] for k in range(len(setups))]),
        incomplete=(~out.completed).reshape(len(setups), -1).mean(axis=1),
    )


def runs_of(setups: Sequence[Setup], time_constants: Sequence[float]) -> RunScores:
    """Return the runs of setups, by machine and time constant."""
    machines = [(machine, setup) for setup in setups for machine in setup.machines.values()]
    return run_cases([Case(machine, tau, setup) for machine, setup in machines for tau in time_constants])


def _feedback(setups: Sequence[Setup]) -> Array:
    """Return the penalty for deviations from Fig. 10: fall up to 0.06, plateau and growing saturation above 0.1."""
    out = run_cases([Case(s.baseline, TIME_CONSTANT, s, gain / INCH_POUND) for s in setups for gain in GAINS])
    gains = np.array(GAINS)
    low, high, best = gains <= BEST_GAIN, gains >= PLATEAU_FROM, GAINS.index(BEST_GAIN)
    found: list[float] = []
    for error, saturated, completed in zip(
        *(values.reshape(len(setups), -1) for values in (out.error, out.saturated, out.completed)), strict=True
    ):
        mean = error[high].mean()
        found.append(
            0.5 * max(0.0, 0.97 + rank_correlation(gains[low], error[low]))
            + 2.0 * max(0.0, float(np.abs(error[high] / mean - 1.0).max()) - 0.06)
            + 0.3 * max(0.0, 0.97 - rank_correlation(gains[high], saturated[high]))
            + 3.0 * max(0.0, float(saturated[best]) - SATURATED)
            + float((~completed.astype(np.bool_)).mean())
        )
    return np.array(found)
