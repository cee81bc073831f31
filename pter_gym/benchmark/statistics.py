"""Statistics over many episodes: means, bootstrap intervals, profiles, and comparisons of two policies.

Intervals, profiles and comparisons follow Agarwal, Schwarzer, Castro, Courville and Bellemare, "Deep
reinforcement learning at the edge of the statistical precipice", NeurIPS 2021. Two policies on the same
episodes are compared in pairs.

All intervals are stratified percentile bootstraps: ``strata`` holds one label per episode, and episodes are resampled
within their stratum; by default there is one. Training seeds are a further stratum: label each value by both, as in
``strata=[(stratum, seed), …]``. A ``Statistic`` maps values (…, N) to (…).
"""

import math
from collections.abc import Callable, Hashable, Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Statistic = Callable[[Array], Array]
Strata = Sequence[Hashable] | None

RESAMPLES = 2000
"""Bootstrap samples of an interval."""

LEVEL = 0.95
"""Confidence level of an interval."""

SEED = 20211206
"""Seed of the bootstrap, so the same scores give the same interval."""


class Interval(NamedTuple):
    """An estimate and its 95 % bootstrap interval."""

    value: float
    low: float
    high: float


def mean(values: ArrayLike) -> Array:
    """Return the mean over the last axis."""
    return np.asarray(values, np.float64).mean(axis=-1)


def worst_twentieth(values: ArrayLike) -> Array:
    """Return the mean of the largest twentieth, over the last axis: of ⌈n/20⌉ values."""
    ordered = np.sort(np.asarray(values, np.float64), axis=-1)
    return ordered[..., -math.ceil(ordered.shape[-1] / 20) :].mean(axis=-1)


def bootstrap_interval(values: ArrayLike, statistic: Statistic = mean, *, strata: Strata = None) -> Interval:
    """Return a statistic of episodes, shape (N,), with its interval."""
    values = np.asarray(values, np.float64)
    chosen = resample(len(values), strata)
    return _interval(statistic(values), statistic(values[chosen]))


def difference_interval(a: ArrayLike, b: ArrayLike, statistic: Statistic = mean, *, strata: Strata = None) -> Interval:
    """Return statistic(a) − statistic(b) of two policies on the same episodes, shape (N,) each."""
    a, b = _paired(a, b)
    chosen = resample(len(a), strata)
    return _interval(statistic(a) - statistic(b), statistic(a[chosen]) - statistic(b[chosen]))


def probability_of_improvement(a: ArrayLike, b: ArrayLike, *, strata: Strata = None) -> Interval:
    """Return the fraction of episodes where a's error is smaller than b's, shape (N,) each; ties count half."""
    a, b = _paired(a, b)
    return bootstrap_interval(0.5 * ((a < b).astype(np.float64) + (a <= b)), strata=strata)


class Profile(NamedTuple):
    """A performance profile: the fraction of episodes within each of K errors, with pointwise intervals."""

    fraction: Array
    low: Array
    high: Array


def performance_profile(errors: ArrayLike, thresholds: ArrayLike, *, strata: Strata = None) -> Profile:
    """Return the fraction of errors (N,) that are at most each of the thresholds (K,)."""
    errors = np.asarray(errors, np.float64)
    within = (errors <= np.asarray(thresholds, np.float64)[:, None]).astype(np.float64)
    times_drawn = np.array([np.bincount(sample, minlength=len(errors)) for sample in resample(len(errors), strata)])
    return Profile(within.mean(axis=-1), *_percentiles(within @ times_drawn.T / len(errors)))


def resample(size: int, strata: Strata) -> NDArray[np.intp]:
    """Return bootstrap samples of episode numbers, shape (RESAMPLES, size), each drawn within its stratum."""
    if size < 1:
        raise ValueError("statistics need at least one episode")
    labels = [None] * size if strata is None else list(strata)
    if len(labels) != size:
        raise ValueError(f"strata must hold one label for each of {size} episodes, got {len(labels)}")
    places: dict[Hashable, list[int]] = {}
    for place, name in enumerate(labels):
        places.setdefault(name, []).append(place)
    return _drawn(tuple(tuple(members) for members in places.values()))


@lru_cache(8)
def _drawn(groups: tuple[tuple[int, ...], ...]) -> NDArray[np.intp]:
    """Return the samples of ``resample`` from the places in each stratum; all scores of a run share them."""
    generator = np.random.default_rng(SEED)
    chosen = np.empty((RESAMPLES, sum(map(len, groups))), np.intp)
    for members in groups:
        own = np.array(members)
        chosen[:, own] = own[generator.integers(len(own), size=(RESAMPLES, len(own)))]
    chosen.flags.writeable = False
    return chosen


def _paired(a: ArrayLike, b: ArrayLike) -> tuple[Array, Array]:
    first, second = np.asarray(a, np.float64), np.asarray(b, np.float64)
    if first.ndim != 1 or first.shape != second.shape:
        raise ValueError(f"two policies must have met the same episodes, got shapes {first.shape} and {second.shape}")
    return first, second


def _percentiles(samples: Array) -> tuple[Array, Array]:
    tail = 50.0 * (1.0 - LEVEL)
    low, high = np.percentile(samples, (tail, 100.0 - tail), axis=-1)
    return low, high


def _interval(value: Array, samples: Array) -> Interval:
    low, high = _percentiles(samples)
    return Interval(float(value), float(low), float(high))
