"""The adversary in training: the hands that push the policy furthest become training episodes.

Each of the mixed draws has a population at each pace, which evolves a little at every search, as
the policy changes. Hands are made as ``pter_gym.benchmark.worst_hand`` makes them.
"""

from dataclasses import replace
from typing import cast

import numpy as np
from numpy.typing import NDArray

from pter_agents.draws import training_draws
from pter_agents.settings import TrainingArguments
from pter_gym.benchmark.worst_hand import Numbers, evolve, judged, pair_of
from pter_gym.controllers import AnyPolicy
from pter_gym.scenarios.distributions import Pair
from pter_gym.tasks.path_following import AT_REST

HAND_NUMBERS = 48
"""Numbers of a hand: more than any draws ask for."""

GENERATIONS = 2
"""Of a search, the population as it is included."""

Populations = NDArray[np.float64]
"""Numbers within [0, 1) that make hands, (groups, hands, ``NUMBERS``)."""


class Adversary:
    """What searches for hands, at least five in each group."""

    def __init__(self, arguments: TrainingArguments) -> None:
        s, self._seed = arguments.settings, arguments.seed
        draws = training_draws(arguments).with_task(starts=AT_REST)
        self._groups = [
            replace(one, also=()).at_pace(pace)
            for one in (draws, *draws.also)
            for pace in arguments.paces
        ]
        self._size = max(5, round(s.adversary * s.contexts / len(self._groups)))

    def begin(self) -> Populations:
        """Return random populations."""
        rng = np.random.default_rng([self._seed, *b"hands"])
        return rng.random((len(self._groups), self._size, HAND_NUMBERS))

    def search(self, policy: AnyPolicy, populations: Populations, steps: int) -> Populations:
        """Return populations that have evolved under a policy after so many steps."""
        rng = np.random.default_rng([self._seed, steps, *b"search"])
        return np.array(
            [
                evolve(
                    lambda rows, draws=draws: judged(policy, "training", draws, rows, rng)[0],
                    population,
                    GENERATIONS,
                    rng,
                    strategy="rand1bin",
                )
                for draws, population in zip(self._groups, populations, strict=True)
            ]
        )

    def pairs(self, populations: Populations) -> list[Pair]:
        """Return the episodes of populations, without those that the arm cannot do."""
        rng = np.random.default_rng(self._seed)
        pairs = [
            pair_of(draws, Numbers(rng, cast("list[float]", row.tolist())))
            for draws, population in zip(self._groups, populations, strict=True)
            for row in population
        ]
        return [pair for pair in pairs if pair]
