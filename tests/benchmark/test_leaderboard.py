"""Ranks go to those who arrive and keep the pace; cheats run for real land below the line, with the reason."""

import json

import numpy as np
import pytest
from numpy.typing import NDArray

from pter_gym.benchmark import PACES, Leaderboard, find_policy, leaderboards, run_scenario
from pter_gym.benchmark.boards import PACE_ERROR, table
from pter_gym.benchmark.scores import SCORES
from pter_gym.controllers import Free, Impedance, Locked, PaceSchedule
from pter_gym.params import BASELINE
from pter_gym.tasks.path_following._observation import SEEN

EPISODES = 24
HONEST = ("impedance", "torque-feedback")


def stops_at_the_start(obs: NDArray[np.float32]) -> NDArray[np.float64]:
    """Release the clutches, and lock them once a fiftieth of the path is done."""
    locked = obs[:, SEEN.progress] > 0.02
    return np.where(locked[:, None], BASELINE.clutch.voltage_max, 0.0) * np.ones(4)


CHEATS = {
    "locked": (Locked(), "completes 0 %"),
    "free": (Free(), "too fast"),
    "rushing": (Impedance(damping_tangential=0.0), "too fast"),
    "stops at the start": (stops_at_the_start, "completes 0 %"),
}


@pytest.fixture(scope="module")
def boards() -> dict[str, Leaderboard]:
    """The cheats and the paper's controllers at each pace."""
    policies = {name: find_policy(name) for name in HONEST} | {name: policy for name, (policy, _) in CHEATS.items()}
    return {board.pace: board for board in leaderboards(run_scenario("standard", policies, episodes=EPISODES))}


@pytest.mark.slow
@pytest.mark.parametrize("pace", PACES)
def test_cheats_are_below_the_line_and_the_papers_controllers_above(pace: str, boards: dict[str, Leaderboard]) -> None:
    standings = {standing.policy: standing for standing in boards[pace].standings}
    for cheat, (_, expected) in CHEATS.items():
        reason = standings[cheat].reason or ""
        assert standings[cheat].rank is None
        assert expected in reason
        assert "segments" in reason
        assert expected == "too fast" or standings[cheat].scores["path_error_m"].value > 0.2
    for name in HONEST:
        assert standings[name].scores["mean_pace_error"].value < (0.05 if pace == "medium" else PACE_ERROR)
        assert pace != "medium" or standings[name].rank in (1, 2)


@pytest.mark.slow
def test_the_damper_of_another_pace_is_below_the_line() -> None:
    wrong = find_policy("impedance")
    assert isinstance(wrong, PaceSchedule)
    (board,) = leaderboards(run_scenario("standard", {"wrong": wrong.at(PACES["brisk"])}, ["slow"], episodes=10))
    assert "too fast: mean pace" in (board.standings[0].reason or "")


@pytest.mark.slow
def test_the_json_is_plain_and_finite_and_the_table_has_a_row_for_each_policy(boards: dict[str, Leaderboard]) -> None:
    assert table(boards["medium"]).row_count == len(CHEATS) + len(HONEST)
    for board in json.loads(json.dumps([board.as_json() for board in boards.values()], allow_nan=False)):
        assert set(board) >= {"scenario", "pace", "pace_m_s", "version", "policies", "episodes"}
        for policy in board["policies"].values():
            assert (policy["rank"] is None) != (policy["reason"] is None)
            for name in SCORES:
                low, value, high = (policy[name][part] for part in ("low", "value", "high"))
                assert np.isfinite(value)
                assert (low is None) == (high is None)
                assert low is None or low - 1e-12 <= high
