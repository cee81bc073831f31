"""The worst hand: the largest path error of a policy that a search finds among a scenario's draws.

Everything that a scenario draws (a hand with its phases, a path, a machine) is computed from
numbers within [0, 1) instead of a generator's. So any scenario can be searched within its bounds.
"""

from collections import Counter
from collections.abc import Callable, Sequence
from functools import lru_cache
from statistics import NormalDist
from typing import Any, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from pter_gym._internal.checks import whole_number
from pter_gym.benchmark.episodes import Episodes
from pter_gym.benchmark.rollout import evaluate
from pter_gym.benchmark.scores import WorstHand
from pter_gym.controllers import AnyPolicy
from pter_gym.errors import ParameterError
from pter_gym.scenarios import Scenario, find_scenario
from pter_gym.scenarios._evaluation_draws import with_phases
from pter_gym.scenarios.distributions import Draws, Pair
from pter_gym.scenarios.paces import find_pace
from pter_gym.tasks.path_following import PathFollowing

RANDOM, SEARCHED = 8192, 4096
"""Episodes with random hands, and then with those that the search tries."""

POPULATION = 64
"""Hands of one generation of the search; the first are the worst random ones. Half as many where
several kinds of them are searched."""

FEWEST = 16
"""Generations for a kind of hands, if several are searched."""

SPREAD = 0.999
"""Share of a normal distribution, about its middle, that is searched."""

TINY = 2.0**-54
"""In place of a random 0, whose quantile is not finite."""

SEARCH_STREAM = 20261129
"""Where the seeds of random hands and of the search begin."""


Judge = Callable[[NDArray[np.float64]], NDArray[np.float64]]
"""Returns the errors of a population, (N, D)."""

Choice = tuple[int, int]
"""Place of a number that chooses one of several options, and which one."""

Kind = tuple[Choice, ...]
"""Hands of the same choices, so that each of their other numbers has one meaning."""


class Numbers:
    """Numbers within [0, 1) in place of a generator; those that are missing are drawn with one."""

    def __init__(self, rng: np.random.Generator, numbers: Sequence[float] = ()) -> None:
        self.taken: list[float] = []
        self.choices: list[Choice] = []
        self._rng, self._given = rng, iter(numbers)
        self._spread = SPREAD if numbers else 1.0

    def _next(self) -> float:
        number = next(self._given, None)
        self.taken.append(self._rng.random() if number is None else number)
        return self.taken[-1]

    def uniform(self, low: float = 0.0, high: float = 1.0, size: int | None = None) -> Any:
        """Return what is this part of the way from low to high, or an array of such numbers."""
        if size is not None:
            return np.array([self.uniform(low, high) for _ in range(size)])
        return low + (high - low) * self._next()

    def integers(self, count: int) -> int:
        """Return a whole number below ``count``, and note it as a choice."""
        chosen = min(int(count * self._next()), count - 1)
        self.choices.append((len(self.taken) - 1, chosen))
        return chosen

    def standard_normal(self, size: int) -> NDArray[np.float64]:
        """Return quantiles of the normal distribution, for given numbers within ``SPREAD``."""
        parts = [0.5 + self._spread * (self._next() - 0.5) for _ in range(size)]
        return np.array([NormalDist().inv_cdf(part or TINY) for part in parts])

    def __getattr__(self, name: str) -> Any:
        """Raise a ParameterError for what distributions of one's own may ask a generator."""
        if name.startswith("__"):
            raise AttributeError(name)
        raise ParameterError(
            "scenario must draw by uniform, integers or standard_normal of a generator to be "
            f"searched for its worst hand, not by {name}"
        )


class Hands(NamedTuple):
    """Random hands: their episodes, kinds, and the numbers that make them, (N, D)."""

    episodes: Episodes
    kinds: tuple[Kind, ...]
    numbers: NDArray[np.float64]


def find_worst(
    policy: AnyPolicy,
    scenario: str | Scenario | Draws | PathFollowing,
    pace: str | float = "medium",
    *,
    seed: int = 0,
    num_threads: int = 2,
) -> WorstHand:
    """Search for the hand, path and machine of a scenario that make a policy's path error largest.

    The same random hands for every policy come first; then differential evolution goes on from the
    worst of them. Each kind of hands, paths and machines among these (a ``OneOf`` chooses it) has
    a population of its own, and a share of the budget as large as its share of them. The budget is
    the same for all, and the same policy gets the same answer.

    Parameters
    ----------
    policy, scenario, pace
        As in ``run_scenario``; the policy knows the nominal machine.
    seed
        Selects the random hands; the closer two searches agree, the more you can trust either.
    num_threads
        Threads that share the episodes of a compiled law; the result does not depend on it.

    Raises
    ------
    ParameterError
        If there is no such scenario or pace, the seed is out of range, or a distribution of yours
        calls other methods of the generator than ``uniform``, ``integers`` and ``standard_normal``.
    """
    scenario, speed = find_scenario(scenario), find_pace(pace)
    seed = whole_number("seed", seed, at_least=0)
    hands = random_hands(scenario, speed, seed)
    errors = path_errors(policy, hands.episodes, num_threads)
    largest = int(errors.argmax())
    worst = float(errors[largest]), hands.episodes.machines[largest], hands.episodes.tasks[largest]
    count, width = hands.numbers.shape
    draws, rng = scenario.draws.at_pace(speed), _generator(scenario, speed, 2 * seed + 1)
    searched = 0

    def judge(rows: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the path errors of hands, and keep the worst."""
        nonlocal worst, searched
        errors, pairs = judged(policy, scenario.name, draws, rows, rng, num_threads)
        k = int(errors.argmax())
        if errors[k] > worst[0]:
            worst = (float(errors[k]), *cast("Pair", pairs[k]))
        searched += len(rows)
        return errors

    if width:
        order: list[int] = np.argsort(-errors, kind="stable").tolist()
        kinds = [hands.kinds[k] for k in order]
        size = POPULATION if len({*kinds[:POPULATION]}) == 1 else POPULATION // 2
        for kind, generations in shares(kinds[:POPULATION], SEARCHED // size).items():
            begin = hands.numbers[[k for k, own in zip(order, kinds, strict=True) if own == kind]]
            search_kind(judge, kind, begin[:size], size, generations, rng)
    error, machine, task = worst
    return WorstHand(error, float(errors[largest]), count, count + searched, machine, task)


def shares(kinds: Sequence[Kind], generations: int) -> dict[Kind, int]:
    """Return how many generations are for each kind of the worst hands, the frequent ones first."""
    counted = Counter(kinds).most_common(max(1, generations // FEWEST))
    whole = sum(count for _, count in counted)
    while len(counted) > 1 and generations * counted[-1][1] < FEWEST * whole:
        whole -= counted.pop()[1]
    found = {kind: generations * count // whole for kind, count in counted}
    found[counted[0][0]] += generations - sum(found.values())
    return found


def search_kind(
    judge: Judge,
    kind: Kind,
    hands: NDArray[np.float64],
    size: int,
    generations: int,
    rng: np.random.Generator,
) -> None:
    """Let hands of a kind evolve, filled up to ``size`` at random; its choices stay as they are."""
    free = np.ones(hands.shape[1], bool)
    free[[place for place, _ in kind]] = False
    more = rng.random((size - len(hands), int(free.sum()))) if len(hands) < size else ()

    def judge_free(rows: NDArray[np.float64]) -> NDArray[np.float64]:
        whole = np.repeat(hands[:1], len(rows), axis=0)
        whole[:, free] = rows
        return judge(whole)

    evolve(judge_free, np.array([*hands[:, free], *more]), generations, rng)


def judged(
    policy: AnyPolicy,
    name: str,
    draws: Draws,
    rows: NDArray[np.float64],
    rng: np.random.Generator,
    num_threads: int = 2,
) -> tuple[NDArray[np.float64], list[Pair | None]]:
    """Return path errors [m] and episodes that rows of numbers make; 0 and None if it cannot be."""
    pairs = [pair_of(draws, Numbers(rng, row.tolist())) for row in rows]
    there = [k for k, pair in enumerate(pairs) if pair]
    errors = np.zeros(len(pairs))
    if there:
        episodes = _episodes(name, draws, [pair for pair in pairs if pair])
        errors[there] = path_errors(policy, episodes, num_threads)
    return errors, pairs


def evolve(
    judge: Judge,
    population: NDArray[np.float64],
    generations: int,
    rng: np.random.Generator,
    strategy: str = "best1bin",
) -> NDArray[np.float64]:
    """Return a population, (N, D), after differential evolution towards large errors.

    The first generation is the population itself; ``judge`` gets each, and returns its errors.
    ``strategy`` is SciPy's.
    """
    from scipy import optimize  # takes half a second

    scipy: Any = optimize

    def objective(columns: NDArray[np.float64]) -> NDArray[np.float64]:
        return -judge(columns.T)

    found = scipy.differential_evolution(
        objective,
        [(0.0, 1.0)] * population.shape[1],
        strategy=strategy,
        init=population,
        maxiter=generations - 1,
        tol=0.0,
        polish=False,
        vectorized=True,
        updating="deferred",
        rng=rng,
    )
    return found.population


def path_errors(policy: AnyPolicy, episodes: Episodes, num_threads: int = 2) -> NDArray[np.float64]:
    """Return the path errors of a policy [m]."""
    return evaluate(policy, episodes, num_threads, ranking=True)["path_error_m"]


@lru_cache(2)
def random_hands(scenario: Scenario, speed: float, seed: int = 0) -> Hands:
    """Return ``RANDOM`` random hands of a scenario at a pace [m/s]; one if it draws nothing."""
    draws, rng = scenario.draws.at_pace(speed), _generator(scenario, speed, 2 * seed)
    drawn: list[tuple[Pair, Numbers]] = []
    while len(drawn) < RANDOM:
        numbers = Numbers(rng)
        if pair := pair_of(draws, numbers):
            drawn.append((pair, numbers))
        if not numbers.taken:
            break
    width = max(len(numbers.taken) for _, numbers in drawn)
    filled = [[*each.taken, *rng.random(width - len(each.taken))] for _, each in drawn]
    episodes = _episodes(scenario.name, scenario.draws, [pair for pair, _ in drawn])
    return Hands(episodes, tuple(tuple(each.choices) for _, each in drawn), np.array(filled))


def pair_of(draws: Draws, numbers: Numbers) -> Pair | None:
    """Return the machine and the task that numbers make, None if the arm cannot do the task."""
    generator = cast("np.random.Generator", numbers)
    pair = draws.draw_once(generator)
    return pair and with_phases(pair, generator)


def _episodes(name: str, draws: Draws, pairs: list[Pair]) -> Episodes:
    return Episodes.from_pairs(name, draws, pairs, [0] * len(pairs))


def _generator(scenario: Scenario, speed: float, part: int) -> np.random.Generator:
    name = f"{scenario.name}-v{scenario.version} {speed}"
    return np.random.default_rng([SEARCH_STREAM, part, *name.encode()])
