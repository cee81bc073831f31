"""The search: evolution strategies with covariance matrix adaptation (CMA-ES), each from its own starting point."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pter_gym._internal.checks import whole_number
from pter_gym._internal.files import FilePath, check_target, find_path, write_text_atomic
from pter_gym._internal.terminal import progress_bar
from pter_gym.params._fields import check_number
from pter_gym.params._preset import Preset, format_preset
from pter_gym.tools.paper.experiments.calibration.objective import Quality, misfit, quality_of
from pter_gym.tools.paper.experiments.calibration.readings import setup_of
from pter_gym.tools.paper.experiments.calibration.space import SPACE, decode

Array = NDArray[np.float64]

BUDGET = 20_000
TRENDS = 0.3
STARTS = 3
"""Searches that share the budget."""

FIRST = 300
"""Random points of which a search begins at the best."""

SIZE = 20
"""Candidates of a generation."""

STEP, SMALLEST_STEP = 0.25, 5e-4
"""Of a search, first and last, as a part of each number's range."""


@dataclass(frozen=True)
class Calibration:
    """Result of a search: the best preset, its objective, and how close it is."""

    preset: Preset
    misfit: float
    quality: Quality


def fit(
    *, seed: int = 0, budget: int = BUDGET, trends: float = TRENDS, out: FilePath = "pter-preset.toml"
) -> Calibration:
    """Search the space and write the best preset.

    Parameters
    ----------
    seed
        Seed of the search, at least 0; the same seed and budget give the same result.
    budget
        Evaluated candidates, at least 1,000. 20,000 take less than ten minutes.
    trends
        Weight of the trends over the time constant beside Table I, at least 0.
    out
        File for the preset; its folder must exist.

    Raises
    ------
    ParameterError
        If an argument is out of its range, or the file cannot be written. Nothing has been written.
    StorageError
        If the file cannot be written after the search.
    """
    seed = whole_number("seed", seed, at_least=0)
    budget = whole_number("budget", budget, at_least=1000)
    check_number("trends", trends, at_least=0.0)
    out = find_path("out", out)
    check_target("out", out)
    with progress_bar() as progress:
        bar = progress.add_task("fit", total=budget)

        def evaluate(points: Array) -> Array:
            values = misfit([decode(point) for point in points], trends)
            progress.advance(bar, len(points))
            return values

        random = np.random.default_rng(seed)
        value, best = min(
            (adapted(evaluate, random, budget // STARTS) for _ in range(STARTS)), key=lambda each: each[0]
        )
    preset = decode(best)
    write_text_atomic(
        out, format_preset(preset, f"Found by pter fit --seed {seed} --budget {budget} --trends {trends:g}.")
    )
    return Calibration(preset, value, quality_of([setup_of(preset)]))


def adapted(evaluate: Callable[[Array], Array], random: np.random.Generator, budget: int) -> tuple[float, Array]:
    """Minimise a function of points (K, N) of the unit cube by CMA-ES (Hansen, arXiv 1604.00772).

    Points outside the cube are evaluated at the nearest point inside, plus a penalty for the distance.
    """
    n = len(SPACE)
    parents = SIZE // 2
    weights = math.log(parents + 0.5) - np.log(np.arange(1, parents + 1))
    weights /= weights.sum()
    mass = 1.0 / float((weights**2).sum())
    rate_s, rate_c = (mass + 2.0) / (n + mass + 5.0), (4.0 + mass / n) / (n + 4.0 + 2.0 * mass / n)
    damping = 1.0 + 2.0 * max(0.0, math.sqrt((mass - 1.0) / (n + 1.0)) - 1.0) + rate_s
    rate_one = 2.0 / ((n + 1.3) ** 2 + mass)
    rate_many = min(1.0 - rate_one, 2.0 * (mass - 2.0 + 1.0 / mass) / ((n + 2.0) ** 2 + mass))
    usual = math.sqrt(n) * (1.0 - 1.0 / (4.0 * n) + 1.0 / (21.0 * n * n))

    count = min(FIRST, budget // 2)
    first = random.random((count, n))
    values = np.concatenate([evaluate(part) for part in np.array_split(first, count // SIZE)])
    best, mean = float(values.min()), first[values.argmin()]
    found, step, used = mean, STEP, count
    covariance, path_s, path_c, generation = np.eye(n), np.zeros(n), np.zeros(n), 0
    while used + SIZE <= budget and step > SMALLEST_STEP:
        lengths, axes = np.linalg.eigh(covariance)
        lengths = np.sqrt(np.maximum(lengths, 1e-20))
        moves = random.normal(size=(SIZE, n)) * lengths @ axes.T
        points = mean + step * moves
        inside = np.clip(points, 0.0, 1.0)
        values = evaluate(inside) + ((points - inside) ** 2).sum(axis=1)
        order = np.argsort(values, kind="stable")
        if values[order[0]] < best:
            best, found = float(values[order[0]]), inside[order[0]]
        moves = moves[order[:parents]]
        move = weights @ moves
        mean = mean + step * move
        generation, used = generation + 1, used + SIZE
        path_s = (1.0 - rate_s) * path_s + math.sqrt(rate_s * (2.0 - rate_s) * mass) * axes @ (axes.T @ move / lengths)
        far = float(np.linalg.norm(path_s))
        steady = far / math.sqrt(1.0 - (1.0 - rate_s) ** (2 * generation)) < (1.4 + 2.0 / (n + 1.0)) * usual
        path_c = (1.0 - rate_c) * path_c + steady * math.sqrt(rate_c * (2.0 - rate_c) * mass) * move
        covariance = (
            (1.0 - rate_one - rate_many) * covariance
            + rate_one * np.outer(path_c, path_c)
            + rate_many * (moves.T * weights) @ moves
        )
        step *= math.exp(rate_s / damping * (far / usual - 1.0))
    return best, found
