"""What many episodes say together: interquartile means, bootstrap intervals, profiles, and comparisons of two policies.

The measures are those of Agarwal, Schwarzer, Castro, Courville and Bellemare, "Deep reinforcement learning at the edge
of the statistical precipice", NeurIPS 2021. Here two policies meet the same episodes, so they are compared in pairs.

Episodes are drawn again within their stratum. Several training seeds are a further stratum: label each value
by both, as in ``strata=[(stratum, seed), …]``.
"""

from collections.abc import Callable, Hashable, Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Statistic = Callable[[Array], Array]

RESAMPLES = 2000
"""Bootstrap samples of an interval."""

LEVEL = 0.95
"""Confidence level of an interval."""

SEED = 20211206
"""Seed of the bootstrap, so the same scores give the same interval."""


class Interval(NamedTuple):
    """An estimate and its bootstrap interval of 95 %."""

    value: float
    low: float
    high: float


def interquartile_mean(values: ArrayLike) -> Array:
    """Return the mean of the middle half, over the last axis: ⌊n/4⌋ values are left out at each end."""
    values = np.asarray(values, np.float64)
    size = values.shape[-1]
    cut = size // 4
    return np.sort(values, axis=-1)[..., cut : size - cut].mean(axis=-1)


def mean(values: ArrayLike) -> Array:
    """Return the mean over the last axis."""
    return np.asarray(values, np.float64).mean(axis=-1)


def bootstrap_interval(
    values: ArrayLike,
    statistic: Statistic = interquartile_mean,
    *,
    strata: Sequence[Hashable] | None = None,
    resamples: int = RESAMPLES,
    seed: int = SEED,
) -> Interval:
    """Return a statistic of episodes with its stratified percentile bootstrap interval.

    Parameters
    ----------
    values
        One per episode, shape (N,).
    statistic
        From (…, N) to (…).
    strata
        One label per episode; all alike by default.
    resamples, seed
        Number of bootstrap samples and seed of their draws.
    """
    values = np.asarray(values, np.float64)
    samples = statistic(values[resample(len(values), strata, resamples, seed)])
    return _interval(float(statistic(values)), samples)


def difference_interval(
    a: ArrayLike,
    b: ArrayLike,
    statistic: Statistic = interquartile_mean,
    *,
    strata: Sequence[Hashable] | None = None,
    resamples: int = RESAMPLES,
    seed: int = SEED,
) -> Interval:
    """Return statistic(a) − statistic(b) of two policies on the same episodes, shape (N,) each; see above."""
    a, b = _paired(a, b)
    chosen = resample(len(a), strata, resamples, seed)
    return _interval(float(statistic(a) - statistic(b)), statistic(a[chosen]) - statistic(b[chosen]))


def unpaired_interval(
    a: ArrayLike,
    b: ArrayLike,
    statistic: Statistic = interquartile_mean,
    *,
    strata: tuple[Sequence[Hashable] | None, Sequence[Hashable] | None] = (None, None),
    resamples: int = RESAMPLES,
    seed: int = SEED,
) -> Interval:
    """Return statistic(a) − statistic(b) on different episodes, shapes (N,) and (M,): each is drawn again by itself.

    Parameters
    ----------
    a, b
        One value per episode.
    statistic
        From (…, N) to (…).
    strata
        One label per episode of a, and of b; all alike by default.
    resamples, seed
        As in ``bootstrap_interval``; b has the seed after that of a.
    """
    values = [np.asarray(each, np.float64) for each in (a, b)]
    samples = [
        statistic(each[resample(len(each), labels, resamples, seed + k)])
        for k, (each, labels) in enumerate(zip(values, strata, strict=True))
    ]
    return _interval(float(statistic(values[0]) - statistic(values[1])), samples[0] - samples[1])


def probability_of_improvement(
    a: ArrayLike,
    b: ArrayLike,
    *,
    strata: Sequence[Hashable] | None = None,
    resamples: int = RESAMPLES,
    seed: int = SEED,
) -> Interval:
    """Return the fraction of episodes in which a's error is smaller than b's, ties counted half, with its interval.

    Parameters
    ----------
    a, b
        Errors of two policies on the same episodes, shape (N,) each.
    strata, resamples, seed
        As in ``bootstrap_interval``.
    """
    a, b = _paired(a, b)
    wins = 0.5 * ((a < b).astype(np.float64) + (a <= b))
    return bootstrap_interval(wins, mean, strata=strata, resamples=resamples, seed=seed)


class Profile(NamedTuple):
    """A performance profile: which fraction of the episodes has an error of at most each threshold.

    Attributes
    ----------
    thresholds
        Errors, shape (K,).
    fraction, low, high
        Fraction of the episodes, and its interval point by point, shape (K,).
    """

    thresholds: Array
    fraction: Array
    low: Array
    high: Array


def performance_profile(
    errors: ArrayLike,
    thresholds: ArrayLike,
    *,
    strata: Sequence[Hashable] | None = None,
    resamples: int = RESAMPLES,
    seed: int = SEED,
) -> Profile:
    """Return the performance profile of errors (N,) at thresholds (K,)."""
    errors, thresholds = np.asarray(errors, np.float64), np.asarray(thresholds, np.float64)
    within = (errors <= thresholds[:, None]).astype(np.float64)
    times_drawn = _times_drawn(resample(len(errors), strata, resamples, seed))
    low, high = _percentiles(within @ times_drawn.T / len(errors))
    return Profile(thresholds, within.sum(axis=-1) / len(errors), low, high)


def resample(
    size: int, strata: Sequence[Hashable] | None, resamples: int = RESAMPLES, seed: int = SEED
) -> NDArray[np.intp]:
    """Return bootstrap samples of episode numbers, shape (resamples, size): each within the stratum of its place."""
    if size < 1:
        raise ValueError("statistics need at least one episode")
    labels = [None] * size if strata is None else list(strata)
    if len(labels) != size:
        raise ValueError(f"strata must hold one label for each of {size} episodes, got {len(labels)}")
    places: dict[Hashable, list[int]] = {}
    for place, name in enumerate(labels):
        places.setdefault(name, []).append(place)
    return _drawn(tuple(tuple(members) for members in places.values()), resamples, seed)


@lru_cache(8)
def _drawn(groups: tuple[tuple[int, ...], ...], resamples: int, seed: int) -> NDArray[np.intp]:
    """Return the samples of ``resample`` from the places in each stratum; all scores of a run share them."""
    generator = np.random.default_rng(seed)
    chosen = np.empty((resamples, sum(map(len, groups))), np.intp)
    for members in groups:
        own = np.array(members)
        chosen[:, own] = own[generator.integers(len(own), size=(resamples, len(own)))]
    chosen.flags.writeable = False
    return chosen


def _times_drawn(chosen: NDArray[np.intp]) -> Array:
    """Return how often each episode is in each bootstrap sample, shape (resamples, size)."""
    samples, size = len(chosen), chosen[0].size
    places: NDArray[np.intp] = np.add(chosen, size * np.arange(samples)[:, None])
    return np.bincount(places.ravel(), minlength=chosen.size).reshape(samples, size).astype(np.float64)


def _paired(a: ArrayLike, b: ArrayLike) -> tuple[Array, Array]:
    first, second = np.asarray(a, np.float64), np.asarray(b, np.float64)
    if first.ndim != 1 or first.shape != second.shape:
        raise ValueError(f"two policies must have met the same episodes, got shapes {first.shape} and {second.shape}")
    return first, second


def _percentiles(samples: Array) -> tuple[Array, Array]:
    tail = 50.0 * (1.0 - LEVEL)
    low, high = np.percentile(samples, (tail, 100.0 - tail), axis=-1)
    return low, high


def _interval(value: float, samples: Array) -> Interval:
    low, high = _percentiles(samples)
    return Interval(value, float(low), float(high))
