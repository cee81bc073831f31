"""The search itself: scipy's differential evolution over the search space."""

from dataclasses import dataclass
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from pter_gym._internal.checks import whole_number
from pter_gym._internal.files import FilePath, check_target, find_path, write_text_atomic
from pter_gym._internal.terminal import progress_bar
from pter_gym.params._preset import Preset, format_preset
from pter_gym.tools.paper.experiments.calibration.objective import misfit
from pter_gym.tools.paper.experiments.calibration.readings import table_of
from pter_gym.tools.paper.experiments.calibration.space import SPACE, decode

Array = NDArray[np.float64]

POPULATION = 100
BUDGET = 60_000

CHUNK = 10
"""Candidates that are evaluated in one batch."""


@dataclass(frozen=True)
class Calibration:
    """Result of a search: the best preset, its objective, and its Table I in the paper's units, (3, 3)."""

    preset: Preset
    misfit: float
    table: Array


def fit(
    *, seed: int = 0, budget: int = BUDGET, held_out: bool = False, out: FilePath = "pter-preset.toml"
) -> Calibration:
    """Search the space by scipy's differential evolution and write the best preset.

    Parameters
    ----------
    seed
        Seed of the search, at least 0; the same seed and budget give the same result.
    budget
        Evaluated candidates, at least 300. 60,000 take less than half an hour.
    held_out
        Fit Table I alone and keep the trends held out.
    out
        File for the preset; its folder must exist.

    Raises
    ------
    ParameterError
        If an argument is out of its range, or the file cannot be written. Nothing has been written.
    StorageError
        If the file cannot be written when the search is done.
    """
    seed = whole_number("seed", seed, at_least=0)
    budget = whole_number("budget", budget, at_least=3 * POPULATION)
    out = find_path("out", out)
    check_target("out", out)
    from scipy import optimize

    with progress_bar() as progress:
        bar = progress.add_task("fit", total=budget)

        def evaluate(points: Array) -> Array:
            values = _misfits(points.T, held_out)
            progress.advance(bar, points.shape[1])
            return values

        population = np.random.default_rng(seed).random((2 * POPULATION, len(SPACE)))
        search = cast(Any, optimize)
        found = search.differential_evolution(
            evaluate,
            [(0.0, 1.0)] * len(SPACE),
            strategy="currenttobest1bin",
            maxiter=max(budget // POPULATION - 3, 0),
            init=population[np.argsort(evaluate(population.T), kind="stable")[:POPULATION]],
            mutation=(0.4, 0.9),
            recombination=0.8,
            tol=0.0,
            atol=0.0,
            rng=seed,
            polish=False,
            updating="deferred",
            vectorized=True,
        )
    preset = decode(found.x)
    write_text_atomic(out, format_preset(preset, f"Found by pter fit, seed {seed}."))
    return Calibration(preset, float(found.fun), table_of(preset))


def _misfits(points: Array, held_out: bool) -> Array:
    parts = [points[k : k + CHUNK] for k in range(0, len(points), CHUNK)]
    return np.concatenate([misfit([decode(point) for point in part], held_out=held_out) for part in parts])
