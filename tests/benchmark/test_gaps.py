"""Stored less fresh: the path errors of one policy on different episodes."""

import io
import json
from dataclasses import replace

import numpy as np
import pytest
from rich.console import Console

from pter_gym.benchmark.gaps import find_gaps, gap_tables
from pter_gym.benchmark.metrics import SCORES
from pter_gym.benchmark.runs import Conditions, ScenarioRun
from pter_gym.benchmark.statistics import difference_interval, interquartile_mean, unpaired_interval

COUNT = 40


def run_of(
    policy: str, error: float, fresh: int | None, seed: int = 0, pace: str = "slow", identity: str | None = "x"
) -> ScenarioRun:
    scores = {name: np.zeros(COUNT) for name in SCORES}
    scores["path_error_m"] = error * np.linspace(0.9, 1.1, COUNT)
    at = Conditions("standard", pace, policy, seed, COUNT, f"data {fresh}", identity, "0", "code", fresh)
    return ScenarioRun(at, ("a", "b") * (COUNT // 2), scores, ())


def test_a_gap_is_stored_less_fresh() -> None:
    (gap,) = find_gaps([run_of("mine", 0.02, None), run_of("mine", 0.03, 7)])
    assert (gap.scenario, gap.pace, gap.policy, gap.seed) == ("standard", "slow", "mine", 7)
    assert gap.gap.value == pytest.approx(-0.01, rel=1e-6) == gap.stored.value - gap.fresh.value
    assert gap.gap.low < gap.gap.value < gap.gap.high < 0.0
    assert json.dumps(gap.as_json(), allow_nan=False)


def test_only_the_same_policy_on_as_many_episodes_is_compared() -> None:
    stored = run_of("mine", 0.02, None)
    fewer = run_of("mine", 0.03, 7)
    fewer = replace(fewer, conditions=replace(fewer.conditions, episodes=20))
    others = [run_of("other", 0.03, 7), run_of("mine", 0.03, 7, pace="brisk"), run_of("mine", 0.03, 7, identity="y")]
    assert find_gaps([stored, fewer, *others]) == ()
    assert find_gaps([run_of("mine", 0.02, 7), run_of("mine", 0.03, 8)]) == ()


def test_what_nobody_can_tell_is_not_compared() -> None:
    known = [run_of("mine", 0.02, fresh) for fresh in (None, 7)]
    unknown = [run_of("mine", 0.02, fresh, seed=1, identity=None) for fresh in (None, 7)]
    assert len(find_gaps(known)) == 1
    assert find_gaps(unknown) == find_gaps([*known, *unknown]) == ()


def test_training_seeds_count_as_one_and_fresh_seeds_do_not() -> None:
    runs = [run_of("mine", 0.02 + 0.01 * seed, fresh, seed) for seed in (0, 1) for fresh in (None, 7, 8)]
    gaps = find_gaps(runs)
    assert [gap.seed for gap in gaps] == [7, 8]
    assert all(gap.gap.value == 0.0 and gap.stored.value == pytest.approx(0.025, rel=0.05) for gap in gaps)
    console = Console(width=80, record=True, file=io.StringIO())
    for table in gap_tables(gaps):
        console.print(table)
    shown = console.export_text()
    assert max(map(len, shown.splitlines())) <= 80
    assert "path error [mm]" in " ".join(shown.split())
    assert shown.count("mine") == 2


def test_the_interval_covers_the_difference_of_independent_episodes() -> None:
    rng = np.random.default_rng(3)
    hits = 0
    for _ in range(100):
        a, b = rng.normal(1.0, 1.0, 60), rng.normal(0.0, 1.0, 90)
        found = unpaired_interval(a, b, resamples=200)
        assert found.value == interquartile_mean(a) - interquartile_mean(b)
        hits += found.low <= 1.0 <= found.high
    assert 86 <= hits <= 100


def test_it_is_wider_than_that_of_pairs() -> None:
    values = np.random.default_rng(1).normal(size=200)
    paired, unpaired = difference_interval(values, values), unpaired_interval(values, values)
    assert (paired.low, paired.high) == (0.0, 0.0)
    assert unpaired.low < -0.1 < 0.1 < unpaired.high
