"""CMA-ES as a sampler of Optuna, rebuilt from the finished trials each time.

Optuna's own sampler keeps its state in the trials as a pickle, which a journal of somebody else's
could use to run code.
"""

from collections.abc import Iterator, Mapping
from typing import Any

import cmaes
import numpy as np
from numpy.typing import NDArray
from optuna import Study
from optuna.distributions import BaseDistribution, CategoricalDistribution, FloatDistribution
from optuna.samplers import BaseSampler
from optuna.trial import FrozenTrial, TrialState

from pter_gym.tools.tuning.laws import Gains, Range, Space

FINISHED = TrialState.COMPLETE, TrialState.PRUNED

SEEDS, SKIPPED = 2**16, 2**31 - 2
"""Ranges of two random numbers: the seed of a trial, and one that was once drawn before it."""


class Evolution(BaseSampler):
    """CMA-ES after random points; switches are random in all of them.

    A point depends on the seed, the trial's number and the trials that have finished, whichever
    process ran them. Random numbers come in the order in which Optuna's ``CmaEsSampler`` draws
    them, so a search finds the gains that it found with that.

    Parameters
    ----------
    space
        What is searched.
    known, random
        Trials at the beginning with known points, and with these or random ones.
    seed
        Seed of the random numbers.
    """

    def __init__(self, space: Space, *, known: int, random: int, seed: int) -> None:
        self._space, self._known, self._random, self._seed = space, known, random, seed
        self._ranges = {
            name: each for name, each in sorted(space.items()) if isinstance(each, Range)
        }
        self._distributions: dict[str, BaseDistribution] = {
            name: FloatDistribution(each.low, each.high, log=each.log)
            if isinstance(each, Range)
            else CategoricalDistribution(each)
            for name, each in space.items()
        }

    def infer_relative_search_space(
        self,
        study: Study,  # noqa: ARG002
        trial: FrozenTrial,  # noqa: ARG002
    ) -> dict[str, BaseDistribution]:
        """Return everything that is searched."""
        return self._distributions

    def sample_relative(
        self,
        study: Study,
        trial: FrozenTrial,
        search_space: dict[str, BaseDistribution],  # noqa: ARG002
    ) -> dict[str, Any]:
        """Return the point of a trial."""
        evolves = trial.number >= self._random and self._ranges
        evolved = self._evolved(study, trial.number) if evolves else {}
        return self._random_point(trial.number) | evolved

    def sample_independent(self, *args: Any, **names: Any) -> Any:
        """Refuse what is not searched."""
        raise NotImplementedError(args, names)

    def _random_point(self, number: int) -> Gains:
        switches = len(self._space) - len(self._ranges)
        width = len(self._ranges) + 2 * switches
        before = max(min(number, self._random) - self._known, 0) * width
        before += max(number - self._random, 0) * 2 * switches
        uniform = iter(np.random.RandomState(self._seed).random_sample(before + width)[before:])
        return {
            name: each.at(next(uniform))
            if isinstance(each, Range)
            else bool(next(uniform) < next(uniform))
            for name, each in self._space.items()
            if number < self._random or not isinstance(each, Range)
        }

    def _evolved(self, study: Study, number: int) -> Gains:
        """Return the point that CMA-ES proposes after the generations that have finished."""
        count = len(self._ranges)
        search = cmaes.CMA(
            np.full(count, 0.5),
            1.0 / 6.0,
            bounds=np.array([[0.0, 1.0]] * count),
            n_max_resampling=10 * count,
        )
        size = search.population_size
        solutions = [(self._shares(trial.params), trial.value) for trial in self._finished(study)]
        for end in range(size, len(solutions) + 1, size):
            search.tell(solutions[end - size : end])
        search.reseed_rng(self._seed_of(number, size))
        return {
            name: each.at(share)
            for (name, each), share in zip(self._ranges.items(), search.ask(), strict=True)
        }

    def _finished(self, study: Study) -> Iterator[Any]:
        for trial in study.get_trials(deepcopy=False, states=FINISHED):
            if trial.number >= self._random and trial.distributions == self._distributions:
                yield trial

    def _shares(self, point: Mapping[str, Any]) -> NDArray[np.float64]:
        return np.array([each.share(point[name]) for name, each in self._ranges.items()])

    def _seed_of(self, number: int, size: int) -> int:
        """Return the seed of a trial, one of two numbers in the first generation, of ``size``."""
        random, before = np.random.RandomState(self._seed), number - self._random
        seed = 0
        for _ in range(min(before, size) + 1):
            random.randint(1, SKIPPED)
            seed = random.randint(1, SEEDS)
        return int(random.randint(1, SEEDS, before - size)[-1] if before > size else seed) + number
