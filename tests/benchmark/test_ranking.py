"""What each score counts as, and how it comes into a standing."""

import numpy as np
import pytest

from benchmark.handmade import METRE, padded, travel
from pter_gym.benchmark.metrics import METRICS, Metric, score_episodes
from pter_gym.benchmark.ranking import find_standings
from pter_gym.benchmark.runs import Conditions, ScenarioRun
from pter_gym.benchmark.statistics import interquartile_mean

MEANS = {"mean_pace_error", "segment_pace_error", "completed", "saturated", "stuck"}
SHARES = {"completed", "effort", "saturated", "stuck"}
OF_THE_RECORD = {
    *("mean_speed_m_s", "mean_acceleration_m_s2", "rms_acceleration_m_s2", "peak_acceleration_m_s2"),
    *("raw_mean_acceleration_m_s2", "raw_rms_acceleration_m_s2", "raw_peak_acceleration_m_s2"),
    *("smoothness", "path_length_m", "effort", "dissipated_j", "hand_work_j", "saturated", "stuck"),
}


def named(**wanted: object) -> set[str]:
    """Scores with these attributes."""
    return {n for n, metric in METRICS.items() if all(getattr(metric, key) == value for key, value in wanted.items())}


def test_what_each_score_is():
    assert named(mean=True) == MEANS
    assert named(from_travel=False) == OF_THE_RECORD
    assert named(high=1.0) == SHARES
    assert named(high=0.0) == {"smoothness"}
    assert named(low=None) == {"smoothness", "hand_work_j"}
    assert named(low=0.0, high=None) == METRICS.keys() - SHARES - {"smoothness", "hand_work_j"}
    assert not Metric("m", "a length", lambda _: np.zeros(1)).from_travel


def test_columns_come_in_their_order():
    columns = {metric.column.place: name for name, metric in METRICS.items() if metric.column}
    assert [columns[place] for place in sorted(columns)] == [
        *("path_error_m", "completed", "mean_pace_error", "segment_pace_error", "rms_acceleration_m_s2", "smoothness")
    ]
    assert sorted(columns) == [1, 2, 3, 4, 5, 6]


def test_a_standing_has_means_of_shares_and_interquartile_means_of_the_rest():
    rng = np.random.default_rng(0)
    steps = rng.integers(150, 260, 40)
    rides = [travel(np.linspace(0.0, 1.0, n), normal_error=rng.uniform(0.0, 0.1)) for n in steps]
    scores = score_episodes(padded(rides), [METRE] * len(rides))
    at = Conditions("standard", "brisk", "mine", 0, len(rides), "", None, "", "")
    (found,) = find_standings([ScenarioRun(at, ("line",) * len(rides), scores, ())])
    for name, values in scores.items():
        expected = values.mean() if name in MEANS else interquartile_mean(values)
        assert found.scores[name].value == pytest.approx(float(expected)), name
