"""Statistics against SciPy and closed forms."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from pter_gym.benchmark.statistics import (
    Statistic,
    bootstrap_interval,
    difference_interval,
    mean,
    performance_profile,
    probability_of_improvement,
    resample,
    worst_twentieth,
)

VALUES = np.random.default_rng(3).gamma(2.0, 0.02, 200)
STRATA = ["line", "circle", "spline", "sine"] * 50
BETWEEN = np.where(np.array(STRATA) == "line", 100.0, 0.0)
"""Values that differ between strata only."""


@pytest.mark.parametrize(("count", "expected"), [(1, 0.0), (20, 19.0), (21, 19.5), (40, 38.5), (199, 193.5)])
def test_worst_twentieth_is_a_mean_of_the_largest(count: int, expected: float) -> None:
    values = np.random.default_rng(0).permutation(float(count) * np.arange(count)) / count
    assert worst_twentieth([values, 2.0 * values]) == pytest.approx([expected, 2.0 * expected])


@pytest.mark.parametrize("statistic", [mean, worst_twentieth])
def test_interval_is_scipys(statistic: Statistic) -> None:
    ours = bootstrap_interval(VALUES, statistic)
    theirs = stats.bootstrap(
        (VALUES,), statistic, n_resamples=20_000, method="percentile", rng=np.random.default_rng(1)
    ).confidence_interval
    width = theirs.high - theirs.low
    assert ours.value == statistic(VALUES)
    assert (ours.low, ours.high) == pytest.approx((theirs.low, theirs.high), abs=0.05 * width)


def test_intervals_are_percentiles_of_seeded_samples() -> None:
    means = VALUES[resample(200, STRATA)].mean(axis=-1)
    assert len(means) == 2000
    found = bootstrap_interval(VALUES, strata=STRATA)
    assert (found.low, found.high) == pytest.approx(tuple(np.percentile(means, (2.5, 97.5))), rel=1e-12)


def test_intervals_cover_as_often_as_they_say() -> None:
    generator = np.random.default_rng(0)
    hits = 0
    for _ in range(200):
        _, low, high = bootstrap_interval(generator.normal(1.0, 1.0, 60))
        hits += low <= 1.0 <= high
    assert 0.90 * 200 <= hits <= 0.99 * 200


def test_strata_are_drawn_among_themselves() -> None:
    chosen, labels = resample(200, STRATA), np.array(STRATA)
    assert (labels[chosen] == labels).all()
    assert bootstrap_interval(BETWEEN, strata=STRATA) == (25.0, 25.0, 25.0)
    assert bootstrap_interval(BETWEEN).high > 25.0
    seeds = [seed for seed in range(5) for _ in range(40)]
    assert bootstrap_interval(seeds, strata=list(zip(STRATA, seeds, strict=True))) == (2.0, 2.0, 2.0)
    assert difference_interval(VALUES + 0.01, VALUES) == pytest.approx((0.01, 0.01, 0.01))


def test_probability_of_improvement() -> None:
    assert probability_of_improvement(VALUES, VALUES + 0.001) == (1.0, 1.0, 1.0)
    assert probability_of_improvement(VALUES, VALUES) == (0.5, 0.5, 0.5)
    found = probability_of_improvement(VALUES, VALUES + np.where(np.arange(200) % 4 == 0, -0.001, 0.001))
    assert found.value == 0.75
    spread = 1.96 * np.sqrt(0.75 * 0.25 / 200)
    assert found.high - found.low == pytest.approx(2.0 * spread, rel=0.1)


def test_profile() -> None:
    errors = np.arange(1, 101) / 100.0
    thresholds = [0.0, 0.25, 0.5, 1.0]
    found = performance_profile(errors, thresholds)
    for k, threshold in enumerate(thresholds):
        expected = bootstrap_interval(errors <= threshold)
        assert (found.fraction[k], found.low[k], found.high[k]) == pytest.approx(expected, abs=1e-12)


@settings(max_examples=15, deadline=None)
@given(st.lists(st.floats(0.0, 1.0), min_size=1, max_size=30))
def test_properties(values: list[float]) -> None:
    found = bootstrap_interval(values)
    assert min(values) - 1e-12 <= found.low <= found.high <= max(values) + 1e-12
    assert (np.diff(performance_profile(values, np.linspace(0.0, 1.0, 11)).fraction) >= 0.0).all()
    there, back = (probability_of_improvement(*pair).value for pair in ((values, values[::-1]), (values[::-1], values)))
    assert there + back == pytest.approx(1.0)


def test_wrong_shapes_are_refused() -> None:
    with pytest.raises(ValueError, match="at least one"):
        bootstrap_interval([])
    with pytest.raises(ValueError, match="one label for each of 200"):
        bootstrap_interval(VALUES, strata=["line"])
    with pytest.raises(ValueError, match="same episodes"):
        difference_interval(VALUES, VALUES[1:])
