"""The search itself: evolution strategies from several starts, of which the better half goes on, three times."""

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

BUDGET = 30_000
TRENDS = 0.3
STARTS = 8
"""Searches in the first quarter of the budget; half as many share each of the others."""

FIRST = 150
"""Random points, at most, of which a search begins at the best."""

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
        Evaluated candidates, at least 1,000. 30,000 take less than ten minutes.
    trends
        Weight of the trends over the time constant beside Table I, at least 0.
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
        searches = [Strategy(evaluate, random, min(FIRST, budget // (8 * STARTS))) for _ in range(STARTS)]
        for count in (STARTS, STARTS // 2, STARTS // 4, 1):
            searches = sorted(searches, key=lambda each: each.best)[:count]
            for search in searches:
                search.advance(budget // (4 * count))
    search = min(searches, key=lambda each: each.best)
    preset = decode(search.found)
    write_text_atomic(
        out, format_preset(preset, f"Found by pter fit --seed {seed} --budget {budget} --trends {trends:g}.")
    )
    return Calibration(preset, search.best, quality_of([setup_of(preset)]))


class Strategy:
    """CMA-ES on the unit cube (Hansen, arXiv 1604.00772), which can be continued.

    It begins at the best of some random points. Points outside of the cube count as the nearest one inside, and as far
    from good as they are from that.

    Attributes
    ----------
    best, found
        The smallest value so far, and its point.
    """

    def __init__(self, evaluate: Callable[[Array], Array], random: np.random.Generator, first_points: int) -> None:
        self.evaluate, self.random, self.generation, self.left = evaluate, random, 0, -first_points
        n = len(SPACE)
        first = random.random((first_points, n))
        values = np.concatenate([evaluate(part) for part in np.array_split(first, max(first_points // SIZE, 1))])
        self.best, self.found = float(values.min()), first[values.argmin()]
        self.mean, self.step, self.covariance = self.found, STEP, np.eye(n)
        self.path_s, self.path_c = np.zeros(n), np.zeros(n)
        weights = math.log(SIZE // 2 + 0.5) - np.log(np.arange(1, SIZE // 2 + 1))
        self.weights = weights / weights.sum()
        self.mass = mass = 1.0 / float((self.weights**2).sum())
        self.rate_s, self.rate_c = (mass + 2.0) / (n + mass + 5.0), (4.0 + mass / n) / (n + 4.0 + 2.0 * mass / n)
        self.damping = 1.0 + 2.0 * max(0.0, math.sqrt((mass - 1.0) / (n + 1.0)) - 1.0) + self.rate_s
        self.rate_one = 2.0 / ((n + 1.3) ** 2 + mass)
        self.rate_many = min(1.0 - self.rate_one, 2.0 * (mass - 2.0 + 1.0 / mass) / ((n + 2.0) ** 2 + mass))

    def advance(self, budget: int) -> None:
        """Go on until further candidates are evaluated, the first points included, or nothing changes any more."""
        self.left += budget
        while self.left >= SIZE and self.step > SMALLEST_STEP:
            self._generate()
            self.left -= SIZE

    def _generate(self) -> None:
        n = len(SPACE)
        lengths, axes = np.linalg.eigh(self.covariance)
        lengths = np.sqrt(np.maximum(lengths, 1e-20))
        moves = self.random.normal(size=(SIZE, n)) * lengths @ axes.T
        points = self.mean + self.step * moves
        inside = np.clip(points, 0.0, 1.0)
        values = self.evaluate(inside) + ((points - inside) ** 2).sum(axis=1)
        order = np.argsort(values, kind="stable")
        if values[order[0]] < self.best:
            self.best, self.found = float(values[order[0]]), inside[order[0]]
        moves = moves[order[: len(self.weights)]]
        move = self.weights @ moves
        self.mean = self.mean + self.step * move
        self.generation += 1
        keep, mass = 1.0 - self.rate_s, self.mass
        whitened = axes @ (axes.T @ move / lengths)
        self.path_s = keep * self.path_s + math.sqrt(self.rate_s * (2.0 - self.rate_s) * mass) * whitened
        usual = math.sqrt(n) * (1.0 - 1.0 / (4.0 * n) + 1.0 / (21.0 * n * n))
        far = float(np.linalg.norm(self.path_s)) / usual
        steady = far / math.sqrt(1.0 - keep ** (2 * self.generation)) < 1.4 + 2.0 / (n + 1.0)
        gain = steady * math.sqrt(self.rate_c * (2.0 - self.rate_c) * mass)
        self.path_c = (1.0 - self.rate_c) * self.path_c + gain * move
        self.covariance = (
            (1.0 - self.rate_one - self.rate_many) * self.covariance
            + self.rate_one * np.outer(self.path_c, self.path_c)
            + self.rate_many * (moves.T * self.weights) @ moves
        )
        self.step *= math.exp(self.rate_s / self.damping * (far - 1.0))
