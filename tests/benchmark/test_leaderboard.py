"""Ranks go to those who arrive and keep the pace; every cheat lands below the line, with the reason."""

import io
import json
from collections.abc import Sequence

import numpy as np
import pytest
from numpy.typing import NDArray
from rich.console import Console

from benchmark.handmade import METRE, padded, travel
from pter_gym.benchmark import PACES, Leaderboard, find_policy, leaderboards, run_scenario
from pter_gym.benchmark.leaderboard import FULL, rank, table
from pter_gym.benchmark.metrics import SCORES, Scores, score_episodes
from pter_gym.benchmark.ranking import COMPLETION, PACE_ERROR, Standing, reason_below
from pter_gym.benchmark.runs import Conditions, ScenarioRun
from pter_gym.benchmark.statistics import Interval
from pter_gym.controllers import Free, Impedance, Locked, PaceSchedule
from pter_gym.params import BASELINE

EPISODES = 48
PROGRESS = 7
"""Position of the progress in an observation."""


def stops_after(progress: float) -> object:
    """Release the clutches, and lock them once a part of the path is done."""

    def act(obs: NDArray[np.float32]) -> NDArray[np.float32]:
        locked = obs[:, PROGRESS] > progress
        return np.where(locked[:, None], BASELINE.clutch.voltage_max, 0.0) * np.ones(4)

    return act


CHEATS = {
    "locked": Locked(),
    "free": Free(),
    "rushing": Impedance(damping_tangential=0.0),
    "stops at the start": stops_after(0.02),
}


@pytest.fixture(scope="module")
def boards() -> dict[str, Leaderboard]:
    """The cheats and the paper's controllers at each pace."""
    honest = {name: find_policy(name) for name in ("impedance", "torque-feedback")}
    runs = run_scenario("standard", {**honest, **CHEATS}, episodes=EPISODES)
    return {board.pace: board for board in leaderboards(runs)}


def standing(board: Leaderboard, policy: str) -> Standing:
    return next(found for found in board.standings if found.policy == policy)


@pytest.mark.slow
@pytest.mark.parametrize("pace", PACES)
@pytest.mark.parametrize("cheat", CHEATS)
def test_cheats_are_below_the_line(cheat: str, pace: str, boards: dict[str, Leaderboard]) -> None:
    found = standing(boards[pace], cheat)
    assert found.rank is None
    assert found.reason
    expected = {
        "locked": "arrives in 0 %",
        "free": "too fast",
        "rushing": "too fast",
        "stops at the start": "arrives in 0 %",
    }[cheat]
    assert expected in found.reason
    if "arrives" not in expected:
        assert "segments" in found.reason


@pytest.mark.slow
def test_a_policy_that_stops_at_the_start_has_a_large_path_error(boards: dict[str, Leaderboard]) -> None:
    for name in ("locked", "stops at the start"):
        assert standing(boards["medium"], name).scores["path_error_m"].value > 0.2


@pytest.mark.slow
def test_the_papers_controllers_have_ranks_at_the_pace_that_their_damper_is_solved_for(
    boards: dict[str, Leaderboard],
) -> None:
    for name in ("impedance", "torque-feedback"):
        found = standing(boards["medium"], name)
        assert found.rank in (1, 2)
        assert found.reason is None
        assert found.scores["mean_pace_error"].value < 0.05
    for board in boards.values():
        for name in ("impedance", "torque-feedback"):
            assert standing(board, name).scores["mean_pace_error"].value < PACE_ERROR


@pytest.mark.slow
def test_the_damper_of_another_pace_is_below_the_line() -> None:
    wrong = find_policy("impedance")
    assert isinstance(wrong, PaceSchedule)
    (board,) = leaderboards(run_scenario("standard", {"wrong": wrong.at(PACES["brisk"])}, ["slow"], episodes=10))
    assert board.standings[0].reason is not None
    assert "too fast: mean pace" in board.standings[0].reason


# --- made-up episodes ---


def run_of(
    policy: str, scores: Scores, strata: Sequence[str] | None = None, pace: str = "brisk", seed: int = 0
) -> ScenarioRun:
    count = len(scores["path_error_m"])
    conditions = Conditions("standard", pace, policy, seed, count, "data", None, "0", "code")
    return ScenarioRun(conditions, tuple(strata or count * ["one"]), scores, ())


def with_error(policy: str, error: float, count: int = 40, **others: float) -> ScenarioRun:
    """A run that arrives at the pace, with path errors spread around a value [m]."""
    scores: Scores = {name: np.zeros(count) for name in SCORES}
    scores["completed"] = np.ones(count, bool)
    scores["path_error_m"] = error * np.linspace(0.9, 1.1, count)
    for name, value in others.items():
        scores[name] = np.full(count, value)
    return run_of(policy, scores)


def test_order_is_that_of_the_path_error_with_those_without_a_rank_last() -> None:
    cheat = with_error("cheat", 0.001, mean_pace_error=0.2, mean_pace_m_s=1.0)
    board = rank([with_error("b", 0.03), cheat, with_error("a", 0.02)])
    assert [(found.policy, found.rank) for found in board.standings] == [("a", 1), ("b", 2), ("cheat", None)]
    best, second, last = board.standings
    assert best.difference is None
    assert second.difference == pytest.approx((0.01, 0.01, 0.01), rel=0.05)
    assert second.probability == (0.0, 0.0, 0.0)
    assert last.probability == (1.0, 1.0, 1.0)


@pytest.mark.parametrize(
    ("name", "limit", "beyond"),
    [
        ("completed", COMPLETION, -1e-6),
        ("mean_pace_error", PACE_ERROR, 1e-6),
        ("segment_pace_error", PACE_ERROR, 1e-6),
    ],
)
def test_limits_are_inclusive(name: str, limit: float, beyond: float) -> None:
    fine = {"completed": 1.0, "mean_pace_error": 0.0, "segment_pace_error": 0.0, "mean_pace_m_s": 0.25}
    for value, allowed in ((limit, True), (limit + beyond, False)):
        scores = {key: Interval(x, x, x) for key, x in {**fine, name: value}.items()}
        assert (reason_below(scores, 0.25) is None) == allowed


def test_every_reason_is_given() -> None:
    board = rank([with_error("x", 0.02, completed=False, mean_pace_error=0.5, segment_pace_error=0.6)])
    reason = board.standings[0].reason
    assert reason is not None
    assert [part in reason for part in ("arrives in 0 %", "too slow", "50 % off", "60 % off")] == 4 * [True]


def test_stop_and_go_at_the_right_mean_pace_is_below_the_line() -> None:
    ends = [0.0, 0.2, *np.cumsum([0.05, 0.35] * 4 + [0.2]) + 0.2]
    rows = travel(np.interp(METRE.control_period * np.arange(201), ends, np.linspace(0.0, 1.0, 11)))
    board = rank([run_of("stop-and-go", score_episodes(padded(5 * [rows]), 5 * [METRE]))])
    reason = board.standings[0].reason
    assert reason is not None
    assert reason.startswith("uneven: segments")


def test_training_seeds_share_a_line_and_are_a_stratum() -> None:
    seeds = [run_of("agent", with_error("agent", error).scores, seed=k) for k, error in enumerate((0.02, 0.03, 0.04))]
    board = rank([*seeds, with_error("other", 0.025)])
    assert [(found.policy, found.rank) for found in board.standings] == [("other", 1), ("agent", 2)]
    agent = board.standings[1]
    error = agent.scores["path_error_m"]
    assert error.value == pytest.approx(0.03, rel=0.01)
    assert error.high - error.low < 0.002, "the spread between seeds is no spread within strata"
    assert agent.difference is not None
    assert agent.difference.value == pytest.approx(0.005, rel=0.01)
    assert agent.probability == (0.0, 0.0, 0.0)
    assert board.episodes == 40


def test_few_episodes_are_provisional() -> None:
    assert rank([with_error("a", 0.02, FULL - 1)]).provisional
    assert not rank([with_error("a", 0.02, FULL)]).provisional


def test_runs_on_different_episodes_do_not_meet() -> None:
    found = leaderboards([with_error("a", 0.02, 40), with_error("b", 0.01, 41)])
    assert [[standing.policy for standing in board.standings] for board in found] == [["a"], ["b"]]


@pytest.mark.slow
def test_table_fits_a_terminal(boards: dict[str, Leaderboard]) -> None:
    console = Console(width=80, record=True, file=io.StringIO())
    console.print(table(boards["medium"]))
    lines = console.export_text().splitlines()
    assert max(map(len, lines)) <= 80
    text = " ".join(" ".join(lines).split())
    assert "provisional, 48 episodes" in text
    for cheat in CHEATS:
        assert f"– {cheat}: " in text


@pytest.mark.slow
def test_json_is_plain_and_finite(boards: dict[str, Leaderboard]) -> None:
    content = json.loads(json.dumps([board.as_json() for board in boards.values()], allow_nan=False))
    for board in content:
        assert set(board) >= {"scenario", "pace", "pace_m_s", "version", "config_hash", "policies", "episodes"}
        for policy in board["policies"].values():
            assert (policy["rank"] is None) != (policy["reason"] is None)
            for name in SCORES:
                low, value, high = (policy[name][part] for part in ("low", "value", "high"))
                assert low - 1e-12 <= high
                assert np.isfinite([low, value, high]).all()
