"""Intervals hold the mean as often as they say, over episodes or over training seeds."""

import math
from typing import Any

import numpy as np
import pytest
from scipy import stats

from pter_gym.benchmark import intervals
from pter_gym.benchmark.boards import worst_twentieth
from pter_gym.benchmark.intervals import (
    MIN_EPISODES,
    MIN_SEEDS,
    MIN_STRATUM,
    RESAMPLES,
    SEED,
    Interval,
    difference_interval,
    mean_interval,
)
from pter_gym.errors import ParameterError

VALUES = np.random.default_rng(3).gamma(2.0, 0.02, 200)

REPETITIONS = 400

MEDIAN, SPREAD, LOST, LOSSES = 3.8, 0.71, 100.0, 0.001
"""Path errors [mm] as of ``residual`` on ``everything``: a lognormal, rarely a lost episode's."""

MEAN = (1.0 - LOSSES) * MEDIAN * np.exp(0.5 * SPREAD**2) + LOSSES * LOST


def draw(rng: np.random.Generator, count: int) -> Any:
    """Return path errors [mm] of which the mean is ``MEAN``."""
    return np.where(rng.random(count) < LOSSES, LOST, MEDIAN * rng.lognormal(0.0, SPREAD, count))


def fewest(rate: float) -> float:
    """Return the share of intervals that fewer hold than in one of 1,000 tests, at this rate."""
    return float(stats.binom.ppf(0.001, REPETITIONS, rate)) / REPETITIONS


def holds(interval: Interval, value: float) -> bool:
    assert interval.low is not None
    assert interval.high is not None
    return interval.low <= value <= interval.high


def width(interval: Interval) -> float:
    assert interval.low is not None
    assert interval.high is not None
    return interval.high - interval.low


@pytest.mark.parametrize(("episodes", "rate"), [(20, 0.88), (50, 0.91), (200, 0.91)])
def test_the_interval_over_episodes_holds_the_mean(
    episodes: int, rate: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Not in 95 % of the cases, as lost episodes are rare; rates of 4,000 repetitions."""
    monkeypatch.setattr(intervals, "RESAMPLES", 500)
    rng = np.random.default_rng(0)
    hits = [holds(mean_interval(draw(rng, episodes)), MEAN) for _ in range(REPETITIONS)]
    assert fewest(rate) <= np.mean(hits) <= 1.0 - fewest(0.03)


@pytest.mark.parametrize("seeds", [MIN_SEEDS, 5, 10])
def test_the_interval_over_training_seeds_holds_the_mean_over_others(seeds: int) -> None:
    """Seeds differ by far more than the error of each of their means, by what all episodes say."""
    rng, hits = np.random.default_rng(1), list[bool]()
    for _ in range(REPETITIONS):
        values = rng.normal(10.0, 2.0, (seeds, 1)) + rng.normal(0.0, 1.0, (seeds, 50))
        hits.append(holds(mean_interval(values), 10.0))
    assert fewest(0.95) <= np.mean(hits) <= 1.0 - fewest(0.03)


def test_every_training_seed_counts() -> None:
    """As an average of the episodes, and as one of the values that the interval is over."""
    by_seed = np.arange(4.0)[:, None] + np.array([-0.5, 0.0, 0.5])
    assert mean_interval(by_seed) == mean_interval(np.tile([[0.0], [1.0], [2.0], [3.0]], 30))
    expected = stats.t.interval(0.95, 3, 1.5, stats.sem(np.arange(4.0)))
    assert mean_interval(by_seed) == pytest.approx((1.5, *expected))


def test_a_difference_is_over_episodes_or_over_training_seeds() -> None:
    """Seeds that are 0.2, −0.4 and 1.1 worse on average; t is Student's for two degrees."""
    seeds = VALUES + np.array([[0.2], [-0.4], [1.1]])
    paired = difference_interval(1.01 * VALUES, VALUES)
    assert paired == pytest.approx(tuple(mean_interval(0.01 * VALUES)))
    margin = 4.302652729749462 * math.sqrt(0.57 / 3.0)
    expected = (0.3, 0.3 - margin, 0.3 + margin)
    assert difference_interval(seeds, VALUES) == pytest.approx(expected)
    assert difference_interval(VALUES, seeds) == pytest.approx(
        (-0.3, *(-np.array(expected))[:0:-1])
    )
    assert difference_interval(seeds[:2], VALUES) == pytest.approx((-0.1, None, None))


def test_a_difference_of_two_sets_of_training_seeds_is_welchs() -> None:
    """Variances 1 of three and 4 of four seeds: 1/3 + 1 with ν = (4/3)²/((1/3)²/2 + 1²/3)."""
    ours = VALUES + np.array([[1.0], [2.0], [3.0]])
    theirs = VALUES + math.sqrt(2.4) * np.array([[-1.5], [-0.5], [0.5], [1.5]])
    margin = stats.t.ppf(0.975, (16 / 9) / (1 / 18 + 1 / 3)) * math.sqrt(4 / 3)
    expected = (2.0, 2.0 - margin, 2.0 + margin)
    assert difference_interval(ours, theirs) == pytest.approx(expected)
    assert difference_interval(ours, theirs[:2])[1:] == (None, None)
    same = np.tile(VALUES, (3, 1))
    assert difference_interval(same + 1.0, same) == pytest.approx((1.0, None, None))
    with pytest.raises(ParameterError, match="others"):
        difference_interval(ours, theirs[:, 1:])


@pytest.mark.parametrize("kinds", [1, 3])
@pytest.mark.parametrize("episodes", [MIN_EPISODES, 200])
def test_the_interval_over_episodes_is_scipys(episodes: int, kinds: int) -> None:
    """The same resamples, so but for rounding."""

    def mean(*resampled: Any, axis: int = -1) -> Any:
        return np.concatenate(resampled, axis=axis).mean(axis=axis)

    values, strata = VALUES[:episodes], [k % kinds for k in range(episodes)]
    stratified = episodes >= kinds * MIN_STRATUM
    samples = [values[k::kinds] for k in range(kinds)] if stratified else [values]
    expected: Any = stats.bootstrap(
        samples, mean, n_resamples=RESAMPLES, rng=np.random.default_rng(SEED)
    )
    found = mean_interval(values, strata)
    assert found[1:] == pytest.approx(tuple(expected.confidence_interval), rel=1e-12)


def test_strata_that_differ_do_not_widen_the_interval() -> None:
    """Fresh episodes have as many of each kind. Kinds with few episodes are not resampled alone."""
    kinds = ["a", "b"] * 100
    values = VALUES + np.where(np.array(kinds) == "a", 1.0, 0.0)
    assert width(mean_interval(values, kinds)) < 0.2 * width(mean_interval(values))
    few = ["a"] * (MIN_STRATUM - 1) + ["b"] * (201 - MIN_STRATUM)
    assert mean_interval(values, few) == mean_interval(values)
    assert mean_interval(VALUES, ["line"] * 200) == mean_interval(VALUES)


def test_the_same_values_have_the_same_interval_whatever_else_is_random() -> None:
    first = mean_interval(VALUES)
    np.random.default_rng().random()
    assert mean_interval(VALUES.tolist()) == first
    assert first.value == VALUES.mean()


def test_there_is_no_interval_where_nothing_is_known() -> None:
    few = [
        mean_interval([1.7]),
        mean_interval(VALUES[: MIN_EPISODES - 1]),
        mean_interval(np.full(50, 0.1)),
        mean_interval(np.tile(VALUES, (MIN_SEEDS - 1, 1))),
        mean_interval(np.tile(VALUES, (MIN_SEEDS, 1))),
    ]
    assert {(each.low, each.high) for each in few} == {(None, None)}
    assert few[0].value == 1.7


@pytest.mark.parametrize(
    ("values", "strata"), [([], ()), ([[]], ()), (np.ones((2, 2, 2)), ()), (VALUES, "ab")]
)
def test_values_without_episodes_or_their_strata_are_refused(values: Any, strata: Any) -> None:
    with pytest.raises(ParameterError, match="values"):
        mean_interval(values, strata)


@pytest.mark.parametrize(
    ("count", "expected"), [(1, 0.0), (20, 19.0), (21, 19.5), (40, 38.5), (199, 193.5)]
)
def test_worst_twentieth_is_a_mean_of_the_largest(count: int, expected: float) -> None:
    values = np.random.default_rng(0).permutation(np.arange(float(count)))
    assert worst_twentieth(values) == pytest.approx(expected)
    assert worst_twentieth([values, values]) == pytest.approx(worst_twentieth(values), abs=0.5)
