"""Intervals hold what they estimate as often as they say; rates have SciPy's."""

from typing import Any

import numpy as np
import pytest
from scipy import stats

from pter_gym.benchmark import intervals
from pter_gym.benchmark.intervals import (
    MIN_EPISODES,
    MIN_SEEDS,
    MIN_STRATUM,
    MIN_TAIL_EPISODES,
    Interval,
    difference_interval,
    interquartile_mean_interval,
    mean_interval,
    performance_profile,
    probability_of_improvement,
    rate_interval,
    worst_twentieth,
    worst_twentieth_interval,
)

VALUES = np.random.default_rng(3).gamma(2.0, 0.02, 200)

REPETITIONS = 1000

PROMISED = 0.9
"""Smallest share of the intervals that hold the mean, from 20 episodes on."""

ALLOWED = PROMISED - 3.0 * np.sqrt(PROMISED * (1.0 - PROMISED) / REPETITIONS)
"""As far below it as the share of so many repetitions may be by chance, three standard errors."""

MEDIAN, SPREAD, LOST, LOSSES = 3.8, 0.71, 100.0, 0.001
"""Path errors [mm] as those of ``residual`` on ``everything``: a lognormal, and rarely that of a lost policy."""

MEAN = (1.0 - LOSSES) * MEDIAN * np.exp(0.5 * SPREAD**2) + LOSSES * LOST


def drawn(rng: np.random.Generator, count: int) -> Any:
    """Return path errors [mm] of which the mean is ``MEAN``."""
    return np.where(rng.random(count) < LOSSES, LOST, MEDIAN * rng.lognormal(0.0, SPREAD, count))


@pytest.fixture
def few_resamples(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Take fewer samples, and forget those of others."""
    monkeypatch.setattr(intervals, "RESAMPLES", 500)
    intervals._drawn.cache_clear()
    yield
    intervals._drawn.cache_clear()


@pytest.mark.usefixtures("few_resamples")
@pytest.mark.parametrize("episodes", [20, 50, 200])
def test_an_interval_holds_the_mean_of_errors_as_often_as_promised(episodes: int) -> None:
    rng = np.random.default_rng(0)
    kinds = np.arange(episodes) % 12
    hits = sum(
        mean_interval(drawn(rng, episodes), kinds.tolist()).holds(MEAN) for _ in range(REPETITIONS)
    )
    assert hits / REPETITIONS >= ALLOWED


@pytest.mark.usefixtures("few_resamples")
def test_an_interval_holds_the_interquartile_mean_as_often() -> None:
    rng = np.random.default_rng(4)
    truth = float(stats.trim_mean(drawn(rng, 400_000), 0.25))
    hits = sum(interquartile_mean_interval(drawn(rng, 20)).holds(truth) for _ in range(REPETITIONS))
    assert hits / REPETITIONS >= ALLOWED


@pytest.mark.usefixtures("few_resamples")
def test_an_interval_holds_the_mean_over_other_seeds_too() -> None:
    """Seeds differ by far more than the error of each of their means."""
    rng = np.random.default_rng(1)
    hits = 0
    for _ in range(REPETITIONS):
        values = (
            rng.normal(10.0, 2.0, (5, 1))
            + rng.normal(0.0, 1.0, (1, 20))
            + rng.normal(0.0, 1.0, (5, 20))
        )
        hits += mean_interval(values).holds(10.0)
    assert hits / REPETITIONS >= ALLOWED


@pytest.mark.usefixtures("few_resamples")
def test_the_interval_of_the_worst_twentieth_holds_it() -> None:
    rng = np.random.default_rng(2)
    truth = worst_twentieth(drawn(rng, 400_000))
    found = [
        worst_twentieth_interval(drawn(rng, MIN_TAIL_EPISODES)).holds(float(truth))
        for _ in range(REPETITIONS)
    ]
    assert np.mean(found) >= ALLOWED


def test_there_is_no_interval_where_nothing_is_known() -> None:
    few = [
        mean_interval([1.7]),
        mean_interval(VALUES[: MIN_EPISODES - 1]),
        mean_interval(np.ones(50)),
        mean_interval(np.tile(VALUES, (MIN_SEEDS - 1, 1))),
        worst_twentieth_interval(VALUES[: MIN_TAIL_EPISODES - 1]),
        interquartile_mean_interval(VALUES[: MIN_EPISODES - 1]),
    ]
    assert {(each.low, each.high) for each in few} == {(None, None)}
    assert few[0].value == 1.7
    assert few[0].holds(0.0)


def test_an_interval_is_near_students_for_normal_values() -> None:
    values = np.random.default_rng(0).normal(1.0, 1.0, 200)
    expected = stats.t.interval(0.95, 199, values.mean(), stats.sem(values))
    found = mean_interval(values)
    assert found.value == pytest.approx(values.mean())
    assert (found.low, found.high) == pytest.approx(expected, abs=0.1 * (expected[1] - expected[0]))


def test_small_strata_are_pooled_and_large_ones_reduce_the_interval() -> None:
    labels = ["a", "b"] * 100
    values = VALUES + np.where(np.array(labels) == "a", 1.0, 0.0)
    assert width(mean_interval(values, labels)) < 0.2 * width(mean_interval(values))
    alone = list(range(200))
    assert mean_interval(values, alone) == mean_interval(values)
    assert {len(group) for group in intervals._groups(3, ["a", "b", "a"])} == {3}
    assert (
        min(map(len, intervals._groups(32, [*"abc", *(MIN_STRATUM * "d"), *(19 * "e")])))
        >= MIN_STRATUM
    )
    with pytest.raises(ValueError, match="strata"):
        mean_interval(VALUES, strata=["line"])


def width(interval: Interval) -> float:
    assert interval.low is not None
    assert interval.high is not None
    return interval.high - interval.low


@pytest.mark.parametrize(("hits", "count"), [(2755, 2755), (0, 20), (9, 10), (1, 1)])
def test_a_rate_has_wilsons_interval(hits: int, count: int) -> None:
    expected: Any = stats.binomtest(hits, count).proportion_ci(method="wilson")
    found = rate_interval(np.arange(count) < hits)
    assert found == pytest.approx((hits / count, expected.low, expected.high))


def test_a_rate_that_differs_between_seeds_is_less_certain() -> None:
    differ = np.arange(100) < np.array([100, 60, 100, 80, 100])[:, None]
    same = np.tile(np.arange(100) < 88, (5, 1))
    assert width(rate_interval(differ)) > 1.2 * width(rate_interval(same))
    assert width(rate_interval(np.ones((5, 100)))) > 0.03, "the same episodes are no further ones"


@pytest.mark.parametrize(
    ("count", "expected"), [(1, 0.0), (20, 19.0), (21, 19.5), (40, 38.5), (199, 193.5)]
)
def test_worst_twentieth_is_a_mean_of_the_largest(count: int, expected: float) -> None:
    values = np.random.default_rng(0).permutation(float(count) * np.arange(count)) / count
    assert worst_twentieth([values, 2.0 * values]) == pytest.approx([expected, 2.0 * expected])
    assert worst_twentieth_interval(values).value == pytest.approx(expected)


def test_two_policies_are_compared_on_each_episode() -> None:
    difference = difference_interval(VALUES + 0.01 * VALUES, VALUES)
    assert difference.value == pytest.approx(0.01 * VALUES.mean())
    assert not difference.holds(0.0)
    assert difference_interval(np.stack([VALUES, 2.0 * VALUES]), VALUES).value == pytest.approx(
        0.5 * VALUES.mean()
    )
    assert probability_of_improvement(VALUES, VALUES + 0.001).value == 1.0
    assert probability_of_improvement(VALUES, VALUES).value == 0.5
    with pytest.raises(ValueError, match="episodes"):
        difference_interval(VALUES, VALUES[1:])
    with pytest.raises(ValueError, match="episode"):
        mean_interval([])


def test_the_interquartile_mean_is_that_of_the_middle_half() -> None:
    found = interquartile_mean_interval(
        [*np.arange(100.0, 200.0), *np.full(50, 1e6), *np.zeros(50)]
    )
    assert found.value == pytest.approx(149.5)
    assert found.low is not None
    assert found.low < found.value


def test_profile() -> None:
    errors = np.arange(1, 101) / 100.0
    found = performance_profile(errors, [0.0, 0.25, 0.5, 1.0])
    assert found.fraction == pytest.approx([0.0, 0.25, 0.5, 1.0])
    assert (found.low[1], found.high[1]) == pytest.approx(rate_interval(errors <= 0.25)[1:])
