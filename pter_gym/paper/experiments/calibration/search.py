"""The search itself: scipy's differential evolution over the search space."""

from dataclasses import dataclass
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from pter_gym.errors import ParameterError
from pter_gym.internal.files import FilePath, check_target, find_path, write_text_atomic
from pter_gym.internal.terminal import progress_bar
from pter_gym.paper.experiments.calibration.objective import TABLE_ONLY, Weights, misfit
from pter_gym.paper.experiments.calibration.readings import table_of
from pter_gym.paper.experiments.calibration.space import SPACE, decode
from pter_gym.params.preset import Preset, format_preset

Array = NDArray[np.float64]

POPULATION = 100

CHUNK = 10
"""Candidates that are evaluated in one batch."""


@dataclass(frozen=True, kw_only=True)
class FitArguments:
    """Arguments of ``pter fit``.

    Attributes
    ----------
    seed
        Seed of the search, at least 0; the same seed and budget give the same result.
    budget
        Evaluated candidates, at least 300. 60,000 take less than half an hour.
    held_out
        Fit Table I alone and keep the trends held out.
    out
        File for the preset; its folder must exist.
    """

    seed: int = 0
    budget: int = 60_000
    held_out: bool = False
    out: FilePath = "pter-preset.toml"


@dataclass(frozen=True)
class Fit:
    """Result of a search.

    Attributes
    ----------
    preset, misfit
        The best preset and its objective.
    table
        Its Table I in the paper's units, (3, 3).
    ensemble
        Points of the last population within 1.2 times the best objective, (K, len(SPACE)), the best first.
    """

    preset: Preset
    misfit: float
    table: Array
    ensemble: Array


def fit(arguments: FitArguments | None = None, start: Array | None = None) -> Fit:
    """Search the space by scipy's differential evolution and write the best preset.

    Parameters
    ----------
    arguments
        Seed, budget and output.
    start
        Points that join the first population, (K, len(SPACE)).

    Raises
    ------
    ParameterError
        If an argument is out of its range, or the file cannot be written. Nothing has been written.
    StorageError
        If the file cannot be written when the search is done.
    """
    arguments = FitArguments() if arguments is None else arguments
    if arguments.seed < 0 or arguments.budget < 3 * POPULATION:
        raise ParameterError(
            f"fit needs seed ≥ 0 and budget ≥ {3 * POPULATION}, got seed {arguments.seed} and budget {arguments.budget}"
        )
    out = find_path("out", arguments.out)
    check_target("out", out)
    from scipy import optimize

    weights = TABLE_ONLY if arguments.held_out else Weights()
    generations = arguments.budget // POPULATION - 2
    with progress_bar() as progress:
        bar = progress.add_task("fit", total=arguments.budget)

        def evaluate(points: Array) -> Array:
            values = _misfits(points.T, weights)
            progress.advance(bar, points.shape[1])
            return values

        population = np.random.default_rng(arguments.seed).random((2 * POPULATION, len(SPACE)))
        first = population[np.argsort(evaluate(population.T), kind="stable")[:POPULATION]]
        if start is not None:
            first[-len(start) :] = start
        search = cast(Any, optimize)
        found = search.differential_evolution(
            evaluate,
            [(0.0, 1.0)] * len(SPACE),
            strategy="currenttobest1bin",
            maxiter=max(generations - 1, 0),
            init=first,
            mutation=(0.4, 0.9),
            recombination=0.8,
            tol=0.0,
            atol=0.0,
            rng=arguments.seed,
            polish=False,
            updating="deferred",
            vectorized=True,
        )
    order = np.argsort(found.population_energies, kind="stable")
    near = order[found.population_energies[order] <= 1.2 * found.fun]
    preset = decode(found.x)
    write_text_atomic(out, format_preset(preset, f"Found by pter fit, seed {arguments.seed}."))
    return Fit(preset, float(found.fun), table_of(preset), found.population[near])


def _misfits(points: Array, weights: Weights) -> Array:
    parts = [points[k : k + CHUNK] for k in range(0, len(points), CHUNK)]
    return np.concatenate([misfit([decode(point) for point in part], weights) for part in parts])
