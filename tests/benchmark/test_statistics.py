"""Statistics against SciPy and closed forms."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from pter_gym.benchmark.statistics import (
    bootstrap_interval,
    difference_interval,
    interquartile_mean,
    mean,
    performance_profile,
    probability_of_improvement,
    resample,
    unpaired_interval,
)

VALUES = np.random.default_rng(3).gamma(2.0, 0.02, 200)
STRATA = ["line", "circle", "spline", "sine"] * 50


@given(st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=50))
def test_interquartile_mean_is_scipys_trimmed_mean(values: list[float]) -> None:
    assert interquartile_mean(values) == pytest.approx(stats.trim_mean(values, 0.25), rel=1e-12, abs=1e-9)


def test_interval_is_scipys() -> None:
    ours = bootstrap_interval(VALUES, resamples=20_000)
    theirs = stats.bootstrap(
        (VALUES,), interquartile_mean, n_resamples=20_000, method="percentile", rng=np.random.default_rng(1)
    ).confidence_interval
    width = theirs.high - theirs.low
    assert ours.value == interquartile_mean(VALUES)
    assert ours.low == pytest.approx(theirs.low, abs=0.03 * width)
    assert ours.high == pytest.approx(theirs.high, abs=0.03 * width)


def test_interval_leaves_out_a_fortieth_at_each_end() -> None:
    means = VALUES[resample(200, STRATA)].mean(axis=-1)
    assert len(means) == 2000
    found = bootstrap_interval(VALUES, mean, strata=STRATA)
    assert (found.low, found.high) == pytest.approx(tuple(np.percentile(means, (2.5, 97.5))), rel=1e-12)


def test_interval_of_a_mean_is_the_normal_one() -> None:
    ours = bootstrap_interval(VALUES, mean, resamples=20_000)
    half = 1.96 * VALUES.std() / np.sqrt(len(VALUES))
    assert ours.high - ours.low == pytest.approx(2.0 * half, rel=0.05)


def test_intervals_cover_as_often_as_they_say() -> None:
    generator = np.random.default_rng(0)
    hits = sum(
        low <= 0.5 <= high
        for _, low, high in (bootstrap_interval(generator.uniform(size=60), resamples=500, seed=k) for k in range(300))
    )
    assert 0.90 <= hits / 300 <= 0.98


def test_strata_are_drawn_among_themselves() -> None:
    chosen = resample(200, STRATA, resamples=50)
    labels = np.array(STRATA)
    assert (labels[chosen] == labels).all()
    between = np.where(labels == "line", 100.0, 0.0)
    assert bootstrap_interval(between, mean, strata=STRATA) == (25.0, 25.0, 25.0)
    assert bootstrap_interval(between, mean).high > 25.0


def test_seeds_are_a_further_stratum() -> None:
    seeds = [seed for seed in range(5) for _ in range(40)]
    values = np.array(seeds, float)
    assert bootstrap_interval(values, mean, strata=list(zip(STRATA, seeds, strict=True))) == (2.0, 2.0, 2.0)


def test_the_same_scores_give_the_same_interval() -> None:
    assert bootstrap_interval(VALUES, strata=STRATA) == bootstrap_interval(VALUES, strata=STRATA)
    assert bootstrap_interval(VALUES, seed=1) != bootstrap_interval(VALUES, seed=2)


def test_a_constant_difference_is_certain_in_pairs() -> None:
    found = difference_interval(VALUES + 0.01, VALUES)
    assert found == pytest.approx((0.01, 0.01, 0.01))
    alone = bootstrap_interval(VALUES)
    assert alone.high - alone.low > 0.001


def test_two_sets_of_episodes_are_drawn_apart() -> None:
    other = 3.0 * VALUES[:80] + 1.0
    found = unpaired_interval(VALUES, other, mean, resamples=20_000)
    assert found.value == VALUES.mean() - other.mean()
    half = 1.96 * np.sqrt(VALUES.var() / len(VALUES) + other.var() / len(other))
    assert found.high - found.low == pytest.approx(2.0 * half, rel=0.05)
    assert found.low < found.value < found.high
    alike = unpaired_interval(VALUES, VALUES)
    assert alike.low < 0.0 < alike.high


def test_two_sets_are_drawn_with_seeds_one_after_the_other() -> None:
    a, b = np.arange(7.0), np.arange(9.0) ** 2
    samples = mean(a[resample(7, None, 50, 4)]) - mean(b[resample(9, None, 50, 5)])
    found = unpaired_interval(a, b, mean, resamples=50, seed=4)
    assert found == pytest.approx((a.mean() - b.mean(), *np.percentile(samples, (2.5, 97.5))))


def test_each_set_of_episodes_has_its_own_strata() -> None:
    between = np.where(np.array(STRATA) == "line", 100.0, 0.0)
    assert unpaired_interval(between, between[:100], mean, strata=(STRATA, STRATA[:100])) == (0.0, 0.0, 0.0)
    loose = unpaired_interval(between, between[:100], mean, strata=(STRATA, None))
    assert loose.low < 0.0 < loose.high


def test_drawn_episodes_are_shared_and_cannot_be_changed() -> None:
    chosen = resample(200, STRATA, resamples=50)
    assert chosen is resample(200, STRATA, resamples=50)
    with pytest.raises(ValueError, match="read-only"):
        chosen[0, 0] = 1


def test_probability_of_improvement() -> None:
    assert probability_of_improvement(VALUES, VALUES + 0.001) == (1.0, 1.0, 1.0)
    assert probability_of_improvement(VALUES, VALUES) == (0.5, 0.5, 0.5)
    half = VALUES + np.where(np.arange(200) % 4 == 0, -0.001, 0.001)
    found = probability_of_improvement(VALUES, half)
    assert found.value == 0.75
    spread = 1.96 * np.sqrt(0.75 * 0.25 / 200)
    assert found.high - found.low == pytest.approx(2.0 * spread, rel=0.1)


def test_profile() -> None:
    errors = np.arange(1, 101) / 100.0
    found = performance_profile(errors, [0.0, 0.25, 0.5, 1.0])
    np.testing.assert_allclose(found.fraction, [0.0, 0.25, 0.5, 1.0])
    assert (found.low <= found.fraction).all()
    assert (found.fraction <= found.high).all()
    assert found.low[-1] == found.high[-1] == 1.0
    assert found.high[1] - found.low[1] == pytest.approx(2 * 1.96 * np.sqrt(0.25 * 0.75 / 100), rel=0.15)


@settings(max_examples=25, deadline=None)
@given(st.lists(st.floats(0.0, 1.0), min_size=1, max_size=30), st.integers(0, 1000))
def test_properties(values: list[float], seed: int) -> None:
    low = bootstrap_interval(values, seed=seed, resamples=200)
    assert min(values) - 1e-12 <= low.low <= low.high <= max(values) + 1e-12
    fraction = performance_profile(values, np.linspace(0.0, 1.0, 11), resamples=50).fraction
    assert (np.diff(fraction) >= 0.0).all()
    other = values[::-1]
    there = probability_of_improvement(values, other, resamples=50).value
    back = probability_of_improvement(other, values, resamples=50).value
    assert there + back == pytest.approx(1.0)


def test_wrong_shapes_are_refused() -> None:
    with pytest.raises(ValueError, match="at least one"):
        bootstrap_interval([])
    with pytest.raises(ValueError, match="one label for each of 200"):
        bootstrap_interval(VALUES, strata=["line"])
    with pytest.raises(ValueError, match="same episodes"):
        difference_interval(VALUES, VALUES[1:])
