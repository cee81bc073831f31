"""Stored less fresh: the path errors of one policy on different episodes."""

import json
from dataclasses import replace

import numpy as np
import pytest

from pter_gym.benchmark._gaps import find_gaps, gap_tables
from pter_gym.benchmark._runs import Conditions, ScenarioRun
from pter_gym.benchmark.metrics import SCORES
from pter_gym.benchmark.statistics import bootstrap_interval, unpaired_interval

COUNT = 40
STRATA = ("a", "b") * (COUNT // 2)


def run_of(
    policy: str, error: float, fresh: int | str | None, seed: int = 0, pace: str = "slow", identity: str | None = "x"
) -> ScenarioRun:
    scores = {name: np.zeros(COUNT) for name in SCORES}
    scores["path_error_m"] = error * np.linspace(0.9, 1.1, COUNT)
    at = Conditions("standard", pace, policy, seed, COUNT, f"data {fresh}", identity, "0", "code", fresh)
    return ScenarioRun(at, STRATA, scores, ())


def test_a_gap_is_stored_less_fresh() -> None:
    stored, fresh = run_of("mine", 0.02, None), run_of("mine", 0.03, 7)
    (gap,) = find_gaps([stored, fresh])
    assert gap[:4] == ("standard", "slow", "mine", 7)
    old, new = (run.scores["path_error_m"] for run in (stored, fresh))
    expected = (bootstrap_interval(old, strata=STRATA), bootstrap_interval(new, strata=STRATA))
    assert gap[4:] == (*expected, unpaired_interval(old, new, strata=(STRATA, STRATA)))
    assert gap.gap_m.value == pytest.approx(-0.01, rel=1e-6)
    content = json.loads(json.dumps(gap.as_json(), allow_nan=False))
    assert content["fresh"] == 7
    assert content["gap_m"] == gap.gap_m._asdict()


def test_only_the_same_policy_on_as_many_episodes_is_compared() -> None:
    stored = run_of("mine", 0.02, None)
    fewer = run_of("mine", 0.03, 7)
    fewer = replace(fewer, conditions=replace(fewer.conditions, episodes=20))
    others = [run_of("other", 0.03, 7), run_of("mine", 0.03, 7, pace="brisk"), run_of("mine", 0.03, 7, identity="y")]
    assert find_gaps([stored, fewer, *others]) == ()
    assert find_gaps([run_of("mine", 0.02, 7), run_of("mine", 0.03, 8)]) == ()
    unknown = [run_of("mine", 0.02, fresh, seed=1, identity=None) for fresh in (None, 7)]
    assert find_gaps(unknown) == find_gaps([stored, run_of("mine", 0.02, 7), *unknown]) == ()


def test_training_seeds_count_as_one_and_fresh_seeds_do_not() -> None:
    sets = (8, "derived", None, 7)
    gaps = find_gaps([run_of("mine", 0.02 + 0.01 * k, fresh, k) for k in (0, 1) for fresh in sets])
    assert [gap.fresh for gap in gaps] == [7, 8, "derived"]
    assert all(gap.gap_m.value == 0.0 and gap.stored_m.value == pytest.approx(0.025, rel=0.05) for gap in gaps)
    assert [table.row_count for table in gap_tables(gaps)] == [1, 1, 1]
