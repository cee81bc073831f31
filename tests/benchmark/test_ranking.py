"""Which scores decide on ranks, and how the scores of many episodes come into a standing."""

import json
import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from rich.console import Console

from benchmark.handmade import METRE, padded, travel
from pter_gym.benchmark.boards import (
    COMPLETION,
    FULL,
    LOST,
    PACE_ERROR,
    UNRANKED,
    leaderboards,
    print_boards,
    rank,
    reason_below,
    suite_scores,
    suite_table,
    suites,
    table,
    tempo,
)
from pter_gym.benchmark.intervals import Interval
from pter_gym.benchmark.runs import run_scenario
from pter_gym.benchmark.scores import OPTIONAL, SCORES, ScenarioRun, Scores, score_episodes
from pter_gym.controllers import Impedance
from pter_gym.params import BASELINE
from pter_gym.tasks.path_following._observation import OBS


def run_of(policy: str, scores: Scores, seed: int = 0) -> ScenarioRun:
    count = len(scores["path_error_m"])
    return ScenarioRun("standard", "brisk", policy, seed, None, count * ("one",), scores)


def with_error(policy: str, error: float, count: int = 40, **others: float) -> ScenarioRun:
    """A run that arrives at the pace, with path errors spread around a value [m]."""
    scores: Scores = {name: np.zeros(count) for name in SCORES}
    scores["completed"] = np.ones(count, np.bool_)
    scores["path_error_m"] = error * np.linspace(0.9, 1.1, count)
    scores |= {name: np.full(count, value) for name, value in others.items()}
    return run_of(policy, scores)


def ranks(runs: Sequence[ScenarioRun]) -> list[tuple[str, int | None]]:
    return [(standing.policy, standing.rank) for standing in rank(runs).standings]


def test_a_standing_has_means_and_the_mean_of_the_worst_twentieth() -> None:
    rng = np.random.default_rng(0)
    rides = [
        travel(np.linspace(0.0, 1.0, n), normal_error=rng.uniform(0.0, 0.1))
        for n in rng.integers(150, 260, 40)
    ]
    scores = score_episodes(padded(rides), [METRE] * len(rides))
    (found,) = rank([run_of("mine", scores)]).standings
    for name, values in scores.items():
        assert found.scores[name].value == pytest.approx(float(values.mean())), name
    worst = found.scores["worst_path_error_m"]
    assert worst.value == pytest.approx(np.sort(scores["path_error_m"])[-2:].mean())
    assert worst.low is None, "of 40 episodes"


def test_order_is_that_of_the_path_error_with_those_without_a_rank_last() -> None:
    cheat = with_error("cheat", 0.001, mean_pace_error=0.2, mean_pace_m_s=1.0)
    runs = [with_error("b", 0.03), cheat, with_error("a", 0.02)]
    assert ranks(runs) == [("a", 1), ("b", 2), ("cheat", None)]
    best, second, last = rank(runs).standings
    assert best.difference is None
    assert second.difference == pytest.approx((0.01, 0.01, 0.01), rel=0.05)
    assert second.probability
    assert last.probability
    assert second.probability.value == 0.0
    assert last.probability.value == 1.0
    assert rank([cheat]).standings[0].difference is None


def shuffled(policy: str, error: float) -> ScenarioRun:
    """Path errors about a value [m] in an order of the policy's own."""
    run = with_error(policy, error)
    rng = np.random.default_rng(list(policy.encode()))
    scores = {**run.scores, "path_error_m": rng.permutation(run.scores["path_error_m"])}
    return replace(run, scores=scores)


def test_policies_share_a_rank_where_an_interval_holds_zero() -> None:
    near = [
        shuffled(name, error)
        for name, error in (("d", 0.02), ("c", 0.0201), ("b", 0.0202), ("a", 0.03))
    ]
    cheat = with_error("cheat", 0.02, completed=False)
    assert ranks([*near, cheat]) == [("d", 1), ("c", 1), ("b", 1), ("a", 4), ("cheat", None)]
    assert ranks([with_error("b", 0.02), with_error("a", 0.02)]) == [("a", 1), ("b", 1)]
    in_pairs = [with_error(name, error) for name, error in (("b", 0.02), ("a", 0.0201))]
    assert ranks(in_pairs) == [("b", 1), ("a", 2)], "on each episode one is better by the same"


@pytest.mark.parametrize(
    ("name", "limit", "beyond"),
    [
        ("completed", COMPLETION, -1e-6),
        ("mean_pace_error", PACE_ERROR, 1e-6),
        ("segment_pace_error", PACE_ERROR, 1e-6),
    ],
)
def test_limits_are_inclusive(name: str, limit: float, beyond: float) -> None:
    fine = {
        "completed": 1.0,
        "mean_pace_error": 0.0,
        "segment_pace_error": 0.0,
        "mean_pace_m_s": 0.25,
    }
    for value, allowed in ((limit, True), (limit + beyond, False)):
        scores = {key: Interval(x, x, x) for key, x in {**fine, name: value}.items()}
        assert (reason_below(scores, 0.25) is None) == allowed


@settings(max_examples=50, deadline=None)
@given(st.data())
def test_one_lost_episode_in_twenty_ranks_below_none(data: st.DataObject) -> None:
    """However small its mean is, and though they may not differ clearly; lost is off by ``LOST`` or more."""
    count = data.draw(st.integers(1, 60))
    lost = data.draw(st.integers(math.ceil(count / 20), count))
    never, often = np.full(count, np.nextafter(LOST, 0.0)), np.zeros(count)
    often[:lost] = LOST
    runs = [with_error(name, 0.0, count) for name in ("often", "never")]
    for run, errors in zip(runs, (often, never), strict=True):
        run.scores["path_error_m"] = errors
    assert ranks(runs) == [("never", 1), ("often", 2)]


CHEATS = {
    "locked": "completes 0 %",
    "free": "too fast",
    "rushing": "too fast",
    "stops": "completes 0 %",
}


def stops_at_the_start(obs: NDArray[np.float32]) -> NDArray[np.float64]:
    """Release the clutches, and lock them once a fiftieth of the path is done."""
    locked = obs[:, OBS.progress] > 0.02
    return np.where(locked[:, None], BASELINE.clutch.voltage_max, 0.0) * np.ones(4)


@pytest.mark.slow
def test_attacks_are_unranked_with_a_reason_and_the_papers_laws_ranked() -> None:
    own = {"rushing": Impedance(damping_tangential=0.0), "stops": stops_at_the_start}
    names = ("impedance", "torque-feedback", "free", "locked")
    (board,) = leaderboards(
        run_scenario("standard", {name: name for name in names} | own, "medium", episodes=24)
    )
    standings = {standing.policy: standing for standing in board.standings}
    for cheat, expected in CHEATS.items():
        assert standings[cheat].rank is None
        assert expected in (standings[cheat].reason or "")
        assert expected == "too fast" or standings[cheat].scores["path_error_m"].value > 0.2
    assert {standings[name].rank for name in names[:2]} <= {1, 2}
    plain = json.loads(json.dumps(board.as_json(), allow_nan=False))
    assert set(plain["policies"]["free"]) >= {"rank", "reason", *SCORES} - OPTIONAL
    assert table(board).row_count == 6


@pytest.mark.parametrize(
    ("ratio", "begins"), [(17.3, "17 ×"), (1 / 3.14, "3.1 ×"), (1.2, "20 %"), (0.8, "25 %")]
)
def test_a_pace_far_off_is_told_as_a_multiple(ratio: float, begins: str) -> None:
    assert tempo(ratio).startswith(begins)


def test_a_board_fits_a_terminal() -> None:
    """With names and numbers as wide as those of the shipped policies."""
    fast = {"mean_pace_error": 0.94, "mean_pace_m_s": 8.6}
    runs = [
        with_error("torque-feedback-tuned", 0.03, 20),
        with_error("free", 0.25, 20, completed=0.0, **fast),
    ]
    shown = table(rank(runs))
    width = Console().measure(shown).maximum
    assert 60 < width <= 80
    assert list(shown.columns[0].cells) == ["1?", UNRANKED]


def test_training_seeds_share_a_line_whose_interval_is_that_of_other_seeds() -> None:
    seeds = [
        run_of("agent", with_error("agent", error).scores, k)
        for k, error in enumerate((0.02, 0.03, 0.04))
    ]
    runs = [*seeds, with_error("other", 0.025)]
    assert ranks(runs) == [("other", 1), ("agent", 1)], "three seeds do not tell"
    agent = rank(runs).standings[1]
    error = agent.scores["path_error_m"]
    assert error.value == pytest.approx(0.03, rel=0.01)
    assert error.low is not None
    assert error.low < 0.024, "seeds are drawn too"
    assert agent.difference is not None
    assert agent.difference.value == pytest.approx(0.005, rel=0.01)


@pytest.mark.parametrize(
    ("completed", "count", "expected"),
    [
        (1000, 1000, (1, False)),
        (985, 1000, (1, True)),
        (200, 200, (1, True)),
        (980, 1000, (None, False)),
    ],
)
def test_completion_is_undecided_where_its_interval_holds_the_limit(
    completed: int, count: int, expected: tuple[int | None, bool]
) -> None:
    run = with_error("mine", 0.02, count)
    run.scores["completed"] = np.arange(count) < completed
    board = rank([run])
    (standing,) = board.standings
    assert (standing.rank, standing.undecided) == expected
    assert table(board).row_count == 1


def test_the_suite_is_the_interquartile_mean_of_errors_over_those_of_the_best_tuned_law(
    capsys: pytest.CaptureFixture[str],
) -> None:
    def at(pace: str, *runs: ScenarioRun) -> list[ScenarioRun]:
        return [replace(run, pace=pace, seed=3) for run in runs]

    laws = with_error("impedance-tuned", 0.04), with_error("single-dof-tuned", 0.02)
    runs = at("slow", *laws, with_error("mine", 0.015), with_error("other", 0.01))
    runs += at(
        "brisk",
        *laws,
        with_error("mine", 0.03),
        with_error("other", 0.05),
        with_error("seldom", 0.01),
    )
    (boards,) = suites(
        leaderboards([*runs, *at("medium", with_error("mine", 0.01)), with_error("mine", 0.01)])
    )
    found = suite_scores(boards)
    assert list(found) == ["single-dof-tuned", "mine", "other", "impedance-tuned"]
    assert found["mine"].ratios.shape == (1, 80)
    assert found["single-dof-tuned"].ratio.value == pytest.approx(1.0)
    low, high = found["impedance-tuned"].ratio[1:]
    assert low is not None
    assert high is not None
    assert low < 2.0 < high
    shown = suite_table(boards)
    assert shown.row_count == 4
    assert [[*column.cells][1] for column in shown.columns[2:]] == ["0", "50", "100"], (
        "mine has ¾ and 3/2"
    )
    print_boards(runs)
    assert "suite, fresh episodes, seed 3" in capsys.readouterr().out
    print_boards(runs[:4])
    assert "suite" not in capsys.readouterr().out


def test_boards_hold_runs_on_the_same_episodes() -> None:
    found = leaderboards([with_error("a", 0.02, FULL - 1), with_error("b", 0.01, FULL)])
    assert [[standing.policy for standing in board.standings] for board in found] == [["a"], ["b"]]
    assert [board.provisional for board in found] == [True, False]
