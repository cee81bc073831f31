"""The mean of a score over episodes or training seeds, or a difference, with its 95 % interval."""

import math
from collections.abc import Hashable, Sequence
from statistics import NormalDist
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pter_gym.errors import ParameterError

__all__ = ["Interval", "difference_interval", "largest_rate", "mean_interval"]

RESAMPLES = 2000
"""Bootstrap samples of an interval."""

SEED = 20211206
"""Seed of the bootstrap: the same scores always have the same interval."""

MIN_EPISODES, MIN_SEEDS = 5, 3
"""Fewest episodes, and fewest training seeds of several, from which there is an interval."""

_NORMAL = NormalDist()

MIN_STRATUM = 10
"""Fewest episodes of each kind with which they are resampled within their kinds."""


class Interval(NamedTuple):
    """A mean and the ends of its 95 % interval, None if there are too few values or all agree."""

    value: float
    low: float | None = None
    high: float | None = None


def mean_interval(values: ArrayLike, strata: Sequence[Hashable] = ()) -> Interval:
    """Return the mean of values (N,) of episodes, or (S, N) of S training seeds, and its interval.

    Over episodes it is a bootstrap (BCa), as errors are skewed. Over several training seeds
    it is Student's for their S means: an interval from five resampled seeds would cover the mean in
    only 83 % of cases.

    Parameters
    ----------
    values
        A score of each episode.
    strata
        The kind of each episode. Every set of episodes has the same number of each kind, so the
        bootstrap is stratified, unless a kind has fewer than ``MIN_STRATUM`` episodes.

    Raises
    ------
    ParameterError
        If there are no values, or the strata are not as many as the episodes.
    """
    by_seed = np.atleast_2d(np.asarray(values, np.float64))
    count, episodes = by_seed.shape if by_seed.ndim == 2 else (0, 0)
    if not count * episodes or len(strata) not in (0, episodes):
        raise ParameterError(
            f"values must be (N,) or (S, N) with a stratum for each of N ≥ 1 episodes or none, "
            f"got {np.shape(values)} and {len(strata)} strata"
        )
    mean = float(by_seed.mean())
    sample: NDArray[np.float64] = by_seed[0] if count == 1 else by_seed.mean(axis=1)
    too_few = len(sample) < (MIN_EPISODES if count == 1 else MIN_SEEDS)
    if too_few or np.ptp(sample) <= 1e-12 * abs(mean):
        return Interval(mean)
    if count > 1:
        from scipy import stats  # takes half a second

        quantile: Any = stats.t.ppf(0.975, count - 1)
        margin = float(quantile) * float(np.std(sample, ddof=1)) / math.sqrt(count)
        return Interval(mean, mean - margin, mean + margin)
    return Interval(mean, *_bootstrap(sample, strata))


def difference_interval(
    values: ArrayLike, others: ArrayLike, strata: Sequence[Hashable] = ()
) -> Interval:
    """Return how much larger the mean of values is than that of others, and its interval.

    Both are scores of the same episodes, (N,), or (S, N) of S training seeds. The interval is that
    of ``mean_interval`` for the differences, over training seeds if one of the two has several, and
    Welch's for the seeds' means if both have.

    Raises
    ------
    ParameterError
        As ``mean_interval``, or if the two are not on the same episodes.
    """
    ours, theirs = (np.atleast_2d(np.asarray(each, np.float64)) for each in (values, others))
    if ours.ndim != 2 or theirs.ndim != 2 or ours.shape[1] != theirs.shape[1]:
        raise ParameterError(
            f"others must be of the same episodes as values, got {np.shape(others)} and "
            f"{np.shape(values)}"
        )
    if min(len(ours), len(theirs)) == 1:
        return mean_interval(ours - theirs, strata)
    ours, theirs = ours.mean(axis=1), theirs.mean(axis=1)
    difference = float(ours.mean() - theirs.mean())
    if min(len(ours), len(theirs)) < MIN_SEEDS or max(np.ptp(ours), np.ptp(theirs)) <= 1e-12:
        return Interval(difference)
    from scipy import stats  # takes half a second

    found: Any = stats.ttest_ind(ours, theirs, equal_var=False)
    low, high = found.confidence_interval(0.95)
    return Interval(difference, float(low), float(high))


def largest_rate(values: ArrayLike) -> float:
    """Return the upper end of the 95 % interval of the fraction of True.

    It is Wilson's (Journal of the American Statistical Association 22, 1927), since a fraction near
    1 is too skewed for the bootstrap, and a fraction of 1 has none.
    """
    arrived = np.asarray(values, np.float64)
    share, count = float(arrived.mean()), arrived.size
    z2 = _NORMAL.inv_cdf(0.975) ** 2 / count
    margin = math.sqrt(z2 * (share * (1.0 - share) + 0.25 * z2))
    return (share + 0.5 * z2 + margin) / (1.0 + z2)


def _bootstrap(sample: NDArray[np.float64], strata: Sequence[Hashable]) -> tuple[float, float]:
    """Return the bootstrap's interval (BCa) of the mean over episodes of given kinds.

    As ``scipy.stats.bootstrap`` has it, whose import would take longer than all else here (Efron
    and Tibshirani, An Introduction to the Bootstrap, Eqs. 14.10, 14.14 and 14.15).
    """
    places: dict[Hashable, list[int]] = {}
    for place, kind in enumerate(strata):
        places.setdefault(kind, []).append(place)
    kinds = [sample[chosen] for chosen in places.values()]
    if min(map(len, kinds), default=0) < MIN_STRATUM:
        kinds = [sample]
    rng = np.random.default_rng(SEED)
    drawn = [kind[rng.integers(0, len(kind), (RESAMPLES, len(kind)))] for kind in kinds]
    means, mean = np.concatenate(drawn, axis=1).mean(axis=1), np.concatenate(kinds).mean()
    below = np.count_nonzero(means < mean) + np.count_nonzero(means <= mean)
    bias = _NORMAL.inv_cdf(below / (2 * RESAMPLES))
    pulls = [(1.0 - 1.0 / len(kind)) * (kind - kind.mean()) for kind in kinds]
    skew = sum((pull**3).sum() for pull in pulls) / sum((pull**2).sum() for pull in pulls) ** 1.5
    ends = [bias + side * _NORMAL.inv_cdf(0.975) for side in (-1.0, 1.0)]
    levels = [_NORMAL.cdf(bias + end / (1.0 - skew / 6.0 * end)) for end in ends]
    low, high = np.quantile(means, levels).tolist()
    return low, high
