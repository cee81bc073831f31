"""The objective of the search: how far many candidates at once are from Table I and from the trends."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pter_gym.benchmark._standard import TIME_CONSTANTS
from pter_gym.params import TIME_CONSTANT
from pter_gym.params._preset import Preset
from pter_gym.tools.paper.experiments.calibration.readings import setup_of
from pter_gym.tools.paper.experiments.calibration.simulation import Case, RunScores, at, run_cases
from pter_gym.tools.paper.experiments.feedback import BEST_GAIN
from pter_gym.tools.paper.experiments.measures import PLATEAU_FROM, SATURATED, rank_correlation
from pter_gym.tools.paper.experiments.setup import Setup
from pter_gym.tools.paper.experiments.time_constants import PAPER_TABLE
from pter_gym.tools.paper.experiments.time_constants import TIME_CONSTANTS as SWEPT
from pter_gym.units import INCH_POUND

Array = NDArray[np.float64]

TARGET = np.array(list(PAPER_TABLE.values()))
"""The paper's Table I, (3 machines, 3 columns), in inches, in/s and in/s²."""

GAINS = (0.0, 0.015, 0.03, 0.045, 0.06, 0.1, 0.125, 0.15, 0.175, 0.2, 0.225, 0.25)
"""Gains at which the search looks at Fig. 10 [V/(in·lbf)]."""


WORST, REFINEMENT, TRENDS, FEEDBACK = 0.3, 0.3, 0.3, 0.15
"""Weights of the penalties beside Table I."""


def misfit(presets: Sequence[Preset], *, held_out: bool = False) -> Array:
    """Return the objective of presets, shape (K,): smaller is better, 0 is perfect.

    The root mean square of the logarithmic deviations from Table I, plus the part of the worst one beyond 4.5%, plus
    the fraction of runs that do not complete, plus the penalties, which are only looked at below 0.5. With ``held_out``
    the trends of Figs. 7, 8 and 10 stay out of it.
    """
    setups = [setup_of(preset) for preset in presets]
    tables, runs = tables_of(setups)
    deviation = np.abs(np.log(tables / TARGET))
    total = np.sqrt((deviation**2).mean(axis=(1, 2)))
    total += WORST * np.maximum(0.0, deviation.max(axis=(1, 2)) - 0.045)
    total += (~runs.completed).reshape(len(setups), -1).mean(axis=1)
    integrator = runs.integrator.reshape(len(setups), len(PAPER_TABLE), -1)[..., TIME_CONSTANTS.index(TIME_CONSTANT)]
    total += np.maximum(0.0, integrator.max(axis=1) / 0.002 - 0.95)
    good = np.flatnonzero(total < 0.5)
    far = np.ones(len(setups), np.bool_)
    far[good] = False
    total[far] += REFINEMENT if held_out else REFINEMENT + 2.0 * TRENDS + 3.0 * FEEDBACK
    if len(good):
        chosen = [setups[k] for k in good]
        penalties = REFINEMENT * _refinement(chosen, tables[good])
        if not held_out:
            penalties = penalties + TRENDS * _trends(chosen) + FEEDBACK * _feedback(chosen)
        total[good] += penalties
    return total


def tables_of(setups: Sequence[Setup], parts: int = 1) -> tuple[Array, RunScores]:
    """Return Table I in the paper's units, (K, 3, 3), of setups, and the runs behind it, with substeps in parts."""
    cases = [
        Case(replace(at(machine, tau), substep=machine.substep / parts), setup)
        for setup in setups
        for machine in setup.machines.values()
        for tau in TIME_CONSTANTS
    ]
    out = run_cases(cases)
    entries = np.stack([out.error, out.speed, out.acceleration], axis=-1)
    tables = entries.reshape(len(setups), len(PAPER_TABLE), len(TIME_CONSTANTS), 3).mean(axis=2)
    return np.maximum(tables, 1e-3), out


def _refinement(setups: Sequence[Setup], tables: Array) -> Array:
    """Return the penalty for a Table I that half a substep changes: chaotic sets do."""
    change = np.abs(np.log(tables_of(setups, parts=2)[0] / tables))
    return np.sqrt((change**2).mean(axis=(1, 2))) + 0.3 * change.max(axis=(1, 2))


def _trends(setups: Sequence[Setup]) -> Array:
    """Return the penalty for rank correlations below 0.97: error, path length, speed, and falling peak acceleration."""
    out = run_cases([Case(at(setup.baseline, tau), setup) for setup in setups for tau in SWEPT])
    found: list[float] = []
    for k in range(len(setups)):
        part = slice(k * len(SWEPT), (k + 1) * len(SWEPT))
        series = (out.error[part], out.path_length[part], out.speed[part], -out.peak[part])
        short = [max(0.0, 0.97 - rank_correlation(SWEPT, values)) for values in series]
        found.append(float(np.mean(short)) + float((~out.completed[part]).mean()))
    return np.array(found)


def _feedback(setups: Sequence[Setup]) -> Array:
    """Return the penalty for what Fig. 10 shows: fall up to 0.06, plateau and growing saturation above 0.1."""
    cases = [Case(at(s.baseline, TIME_CONSTANT), s, gain / INCH_POUND) for s in setups for gain in GAINS]
    out = run_cases(cases)
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
