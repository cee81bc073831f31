"""95 % intervals of means, rates and the worst twentieth over episodes and training seeds;
performance profiles.

Values have the shape (N,) for N episodes, or (S, N) for S training seeds that met the same ones.
Path errors are skewed, as a lost episode costs a hundred times a good one, so a mean has a
studentised bootstrap interval (Efron and Tibshirani, "An Introduction to the Bootstrap", 1993,
section 12.5), and a rate has Wilson's. The interquartile mean and the profiles follow Agarwal et
al., "Deep reinforcement learning at the edge of the statistical precipice", NeurIPS
2021.

``strata`` holds one label per episode: episodes are resampled within their stratum, and small
strata are pooled.
"""

import math
from collections.abc import Hashable, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import stats

Array = NDArray[np.float64]
Strata = Sequence[Hashable] | None

RESAMPLES = 2000
"""Bootstrap samples of an interval."""

BLOCK = 50
"""Bootstrap samples of an interquartile mean that are drawn at once."""

TAILS = (0.025, 0.975)
"""Quantiles that bound an interval."""

SEED = 20211206
"""Seed of the bootstrap, so the same scores give the same interval."""

MIN_EPISODES, MIN_SEEDS, MIN_TAIL_EPISODES = 5, 3, 200
"""Fewest episodes and training seeds of an interval of a mean, and fewest episodes of one of the worst twentieth."""

MIN_STRATUM = 10
"""Fewest episodes of a stratum; smaller ones are pooled."""


class Interval(NamedTuple):
    """An estimate and its 95 % interval, whose ends are None where there are too few values for one."""

    value: float
    low: float | None = None
    high: float | None = None

    def holds(self, value: float) -> bool:
        """Return whether a value is within the interval; every value is where there is none."""
        return self.low is None or self.high is None or self.low <= value <= self.high


class Profile(NamedTuple):
    """A performance profile: the fraction of episodes within each of K errors, with pointwise intervals, (K,) each."""

    fraction: Array
    low: Array
    high: Array


def mean_interval(values: ArrayLike, strata: Strata = None) -> Interval:
    """Return the mean with the interval of a studentised bootstrap, which draws seeds first and then episodes."""
    seeds = _by_seed(values)
    count, episodes = seeds.shape
    groups = _groups(episodes, strata)
    value, error = float(seeds.mean()), _standard_error(seeds, groups)
    if episodes < MIN_EPISODES or 1 < count < MIN_SEEDS or error <= 1e-12 * abs(value):
        return Interval(value)
    means, errors = _moments(seeds, *_drawn(count, groups), groups)
    ratios = np.divide(means - value, errors, where=errors > 0.0, out=np.zeros_like(means))
    low, high = np.quantile(ratios, TAILS)
    return Interval(value, value - float(high) * error, value - float(low) * error)


def rate_interval(values: ArrayLike) -> Interval:
    """Return the share of true values with Wilson's interval, for as many episodes as they are worth over the seeds."""
    seeds = _by_seed(values)
    rate = float(seeds.mean())
    trials = seeds.shape[1]
    error = _standard_error(seeds, _groups(trials, None))
    if len(seeds) > 1 and error > 0.0:
        trials = min(seeds.size, max(1, round(rate * (1.0 - rate) / error**2)))
    found: Any = stats.binomtest(round(rate * trials), trials).proportion_ci(method="wilson")
    return Interval(rate, min(rate, float(found.low)), max(rate, float(found.high)))


def worst_twentieth(values: ArrayLike) -> Array:
    """Return the mean of the largest twentieth, over the last axis: of ⌈n/20⌉ values."""
    ordered = np.sort(np.asarray(values, np.float64), axis=-1)
    return ordered[..., -math.ceil(ordered.shape[-1] / 20) :].mean(axis=-1)


def worst_twentieth_interval(values: ArrayLike) -> Interval:
    """Return the mean of the worst twentieth of all episodes with its interval: that of q +
    20·max(0, x − q).

    q is the smallest value of the worst twentieth; the mean of this is the worst twentieth's to
    first order.
    """
    seeds = _by_seed(values)
    worst = math.ceil(seeds.size / 20)
    bound = np.sort(seeds, axis=None)[-worst]
    found = mean_interval(bound + np.maximum(seeds - bound, 0.0) * seeds.size / worst)
    value = float(worst_twentieth(seeds.ravel()))
    return found._replace(value=value) if seeds.shape[1] >= MIN_TAIL_EPISODES else Interval(value)


def interquartile_mean_interval(values: ArrayLike, strata: Strata = None) -> Interval:
    """Return the mean of the middle half with a percentile bootstrap interval; for many episodes of many kinds."""
    seeds = _by_seed(values)
    count, episodes = seeds.shape
    value = float(stats.trim_mean(seeds.ravel(), 0.25))
    if episodes < MIN_EPISODES or 1 < count < MIN_SEEDS:
        return Interval(value)
    generator = np.random.default_rng(SEED)
    groups = _groups(episodes, strata)
    samples: list[Array] = []
    for _ in range(RESAMPLES // (2 * BLOCK)):
        drawn = np.concatenate(
            [generator.choice(group, (BLOCK, len(group))) for group in groups], axis=1
        )
        chosen = generator.integers(count, size=(BLOCK, count))
        values = seeds[chosen[:, :, None], drawn[:, None, :]].reshape(BLOCK, -1)
        samples.append(stats.trim_mean(values, 0.25, axis=1))
    low, high = np.quantile(samples, TAILS)
    return Interval(value, float(low), float(high))


def probability_of_improvement(a: ArrayLike, b: ArrayLike) -> Interval:
    """Return the fraction of episodes where a's error is smaller than b's, means over seeds; ties count half."""
    first, second = (each.mean(axis=0) for each in _paired(a, b))
    return rate_interval(0.5 * ((first < second).astype(np.float64) + (first <= second)))


def difference_interval(a: ArrayLike, b: ArrayLike, strata: Strata = None) -> Interval:
    """Return the mean of a − b, of two policies on the same episodes, whose training seeds are paired in turn."""
    first, second = _paired(a, b)
    seeds = np.arange(max(len(first), len(second)))
    return mean_interval(first[seeds % len(first)] - second[seeds % len(second)], strata)


def performance_profile(errors: ArrayLike, thresholds: ArrayLike) -> Profile:
    """Return the fraction of errors, (N,) or (S, N), that are at most each of the thresholds (K,)."""
    seeds = _by_seed(errors)
    found = [rate_interval(seeds <= threshold) for threshold in np.asarray(thresholds, np.float64)]
    return Profile(*np.array(found, np.float64).T)


def _by_seed(values: ArrayLike) -> Array:
    """Return values as (S, N)."""
    seeds = np.atleast_2d(np.asarray(values, np.float64))
    if seeds.ndim != 2 or not seeds.size:
        raise ValueError(
            f"statistics need at least one episode, of each training seed, got the shape {seeds.shape}"
        )
    return seeds


def _paired(a: ArrayLike, b: ArrayLike) -> tuple[Array, Array]:
    first, second = _by_seed(a), _by_seed(b)
    if first.shape[1] != second.shape[1]:
        raise ValueError(
            f"two policies must have met the same episodes, got shapes {first.shape} and {second.shape}"
        )
    return first, second


def _groups(episodes: int, strata: Strata) -> tuple[tuple[int, ...], ...]:
    """Return the places of the episodes in each stratum, with small strata pooled."""
    labels = [None] * episodes if strata is None else list(strata)
    if len(labels) != episodes:
        raise ValueError(
            f"strata must hold one label for each of {episodes} episodes, got {len(labels)}"
        )
    places: dict[Hashable, list[int]] = {}
    for place, label in enumerate(labels):
        places.setdefault(label, []).append(place)
    large = [group for group in places.values() if len(group) >= MIN_STRATUM]
    rest = [place for group in places.values() if len(group) < MIN_STRATUM for place in group]
    if rest and (len(rest) >= MIN_STRATUM or not large):
        large.append(rest)
    elif rest:
        large[-1] += rest
    return tuple(map(tuple, large))


@lru_cache(16)
def _drawn(count: int, groups: tuple[tuple[int, ...], ...]) -> tuple[Array, Array]:
    """Return how often each bootstrap sample draws each seed, (RESAMPLES, S), and each episode, (RESAMPLES, N)."""
    generator = np.random.default_rng(SEED)
    seeds = generator.multinomial(count, np.full(count, 1.0 / count), size=RESAMPLES).astype(
        np.float64
    )
    episodes = np.empty((RESAMPLES, sum(map(len, groups))))
    for group in groups:
        episodes[:, list(group)] = generator.multinomial(
            len(group), np.full(len(group), 1 / len(group)), RESAMPLES
        )
    return seeds, episodes


def _standard_error(seeds: Array, groups: Sequence[Sequence[int]]) -> float:
    """Return the standard error of the mean of values (S, N)."""
    of_seeds, of_episodes = (np.ones((1, size)) for size in seeds.shape)
    return float(_moments(seeds, of_seeds, of_episodes, groups)[1][0])


def _moments(
    seeds: Array, of_seeds: Array, of_episodes: Array, groups: Sequence[Sequence[int]]
) -> tuple[Array, Array]:
    """Return the mean and its standard error, (B,) each, of B samples that hold seeds and episodes
    so many times.

    The error has a part from the means of the seeds, and one from the means of the episodes within
    their strata.
    """
    count, episodes = seeds.shape
    by_episode = of_seeds @ seeds / count
    means, variances = np.zeros(len(of_seeds)), np.zeros(len(of_seeds))
    for group in map(list, groups):
        size, times, centre = len(group), of_episodes[:, group], seeds[:, group].mean()
        mine = by_episode[:, group] - centre
        mean = np.einsum("be,be->b", times, mine) / size
        spread = np.maximum(
            np.einsum("be,be,be->b", times, mine, mine) - size * mean**2, 0.0
        ) / max(size - 1, 1)
        means += (centre + mean) * size / episodes
        variances += spread * size / episodes**2
    if count > 1:
        by_seed = of_episodes @ seeds.T / episodes
        variances += (of_seeds * (by_seed - means[:, None]) ** 2).sum(axis=1) / (count - 1) / count
    return means, np.sqrt(variances)
