"""Which scores decide on ranks, and what the table of a scenario shows."""

import json
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from numpy.typing import NDArray
from scipy import stats

from benchmark.handmade import METRE, padded, run_of, travel, with_error
from pter_gym.benchmark.boards import (
    COMPLETION,
    PACE_ERROR,
    PACE_ERRORS,
    MissedLimit,
    boards_text,
    in_order,
    is_ranked,
    leaderboards,
    print_boards,
    rank,
    reason_unranked,
)
from pter_gym.benchmark.cells import WIDTH, shorten
from pter_gym.benchmark.intervals import largest_rate, mean_interval
from pter_gym.benchmark.results import run_scenario
from pter_gym.benchmark.scores import OPTIONAL, SCORES, ScenarioRun, score_episodes
from pter_gym.controllers import Impedance
from pter_gym.params import BASELINE
from pter_gym.scenarios import PACES
from pter_gym.tasks.path_following._observation import OBS


def ranks(runs: Sequence[ScenarioRun]) -> list[tuple[str, int | None]]:
    return [(standing.policy, standing.rank) for standing in rank(runs).standings]


def test_a_standing_has_means_and_the_mean_of_the_worst_twentieth() -> None:
    rng = np.random.default_rng(0)
    rides = [
        travel(np.linspace(0.0, 1.0, n), normal_error=rng.uniform(0.0, 0.1))
        for n in rng.integers(150, 260, 40)
    ]
    scores = score_episodes(padded(rides), [METRE] * len(rides))
    (standing,) = rank([run_of("mine", scores)]).standings
    for name, values in scores.items():
        assert standing.scores[name] == float(values.mean()), name
    worst = np.sort(scores["path_error_m"])[-2:].mean()
    assert standing.scores["worst_path_error_m"] == pytest.approx(worst)
    assert standing.error == mean_interval(scores["path_error_m"])


def test_order_is_that_of_the_path_error_whether_ranked_or_not() -> None:
    cheat = with_error("cheat", 0.0299, mean_pace_error=0.2, mean_pace_m_s=1.0)
    runs = [with_error("b", 0.03), cheat, with_error("a", 0.001), with_error("c", 0.03)]
    assert ranks(runs) == [("a", 1), ("cheat", None), ("b", 2), ("c", 3)]


@pytest.mark.parametrize(
    ("name", "limit", "beyond"),
    [
        ("completed", COMPLETION, -0.021),
        ("mean_pace_error", PACE_ERROR, 1e-6),
        ("segment_pace_error", PACE_ERROR, 1e-6),
    ],
)
def test_limits_are_inclusive(name: str, limit: float, beyond: float) -> None:
    fine = {"completed": 1.0, **dict.fromkeys(PACE_ERRORS, 0.0), "mean_pace_m_s": 0.25}
    scores = {each: np.full(200, value) for each, value in fine.items()}
    assert reason_unranked({**scores, name: np.full(200, limit)}, 0.25) is None
    reason = reason_unranked({**scores, name: np.full(200, limit + beyond)}, 0.25)
    assert reason is not None
    assert reason.score == pytest.approx(limit + beyond, abs=1e-12)
    assert is_ranked({**fine, name: limit})
    assert not is_ranked({**fine, name: limit + beyond})


@pytest.mark.parametrize(("lost", "ranked"), [(5, True), (7, True), (8, False)])
def test_completions_miss_their_limit_only_beyond_their_interval(lost: int, ranked: bool) -> None:
    """Wilson's interval of 393 of 400 ends above 99 %, of 392 below."""
    assert largest_rate(np.arange(400) >= lost) == pytest.approx(
        stats.binomtest(400 - lost, 400).proportion_ci(method="wilson").high
    )
    run = with_error("mine", 0.01, 400)
    run.scores["completed"][:lost] = False
    assert (rank([run]).standings[0].rank == 1) == ranked


@pytest.mark.parametrize(("error", "ranked"), [(0.147, True), (0.153, True), (0.2, False)])
@pytest.mark.parametrize("name", PACE_ERRORS)
def test_a_draw_near_a_limit_does_not_decide_a_rank(name: str, error: float, ranked: bool) -> None:
    """Its standard error is 0.005 or more."""
    rng = np.random.default_rng(0)
    spread = error * rng.gamma(4.0, 0.25, 200)
    run = with_error("mine", 0.01, 200)
    run.scores[name] = spread + error - spread.mean()
    (standing,) = rank([run]).standings
    assert (standing.rank == 1) == ranked
    assert standing.scores[name] == pytest.approx(error)


@pytest.mark.parametrize(
    ("ratio", "word"),
    [(17.0, "too fast"), (1.21, "too fast"), (0.3, "too slow"), (0.0, "too slow"), (1.02, "off")],
)
def test_a_pace_is_told_by_its_error_and_the_direction_of_the_mean(ratio: float, word: str) -> None:
    """Beside the error of the table, not by a second number."""
    scores = {"completed": [1.0], "mean_pace_error": [0.173], "mean_pace_m_s": [0.25 * ratio]}
    reason = reason_unranked({**scores, "segment_pace_error": [0.9]}, 0.25)
    assert reason is not None
    assert reason.word.startswith(word)
    assert "17.3 %" in str(reason)


CHEATS = {"locked": False, "free": True, "rushing": True, "stops": False}
"""Policies that have no rank, and whether they are too fast, too."""


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
    for cheat, fast in CHEATS.items():
        scores, reason = standings[cheat].scores, standings[cheat].reason
        assert reason is not None
        assert reason.word == "incomplete"
        assert scores["mean_pace_m_s"] > 0.5 if fast else scores["path_error_m"] > 0.2
    assert {standings[name].rank for name in names[:2]} == {1, 2}
    plain = json.loads(json.dumps(board.as_json(), allow_nan=False))
    assert set(plain["policies"]["free"]) >= {"rank", "reason", *SCORES} - OPTIONAL


def test_training_seeds_share_a_line_whose_interval_is_that_of_other_seeds() -> None:
    seeds = [
        run_of("agent", with_error("agent", error).scores, k)
        for k, error in enumerate((0.02, 0.03, 0.06))
    ]
    runs = [*seeds, with_error("other", 0.03)]
    assert ranks(runs) == [("other", 1), ("agent", 2)], "all seeds count"
    agent = rank(runs).standings[1]
    assert agent.error.value == pytest.approx(0.11 / 3)
    assert agent.error.low is not None
    assert agent.error.low < 0.0, "three seeds do not tell"
    assert agent.errors.shape == (3, 40)
    assert rank([seeds[2], *seeds[:2]]).standings[0].error.value == pytest.approx(0.11 / 3)
    assert "training seeds" in boards_text(leaderboards(runs))


def test_boards_hold_runs_on_the_same_episodes() -> None:
    runs = [with_error("a", 0.02, 39), with_error("b", 0.01, 40)]
    others = [{"seed": 3}, {"version": "0"}, {"digest": "mine"}, {"scenario": "paths"}]
    boards = leaderboards([*runs, *(replace(runs[0], **other) for other in others)])
    assert len(boards) == len(runs) + len(others)
    assert all(len(board.standings) == 1 for board in boards)


def test_episodes_are_resampled_within_their_strata() -> None:
    run = with_error("mine", 0.01)
    errors = np.where(np.arange(40) < 20, 1.0, 3.0) * run.scores["path_error_m"]
    strata = (*20 * ["near"], *20 * ["far"])
    run = replace(run, scores={**run.scores, "path_error_m": errors}, strata=strata)
    (standing,) = rank([run]).standings
    assert standing.error == mean_interval(errors, strata) != mean_interval(errors)


# --- the table ---


def at_paces(policy: str, errors: Sequence[float], **others: float) -> list[ScenarioRun]:
    return [
        with_error(policy, error, pace=pace, **others)
        for pace, error in zip(PACES, errors, strict=True)
    ]


OFF = {"mean_pace_error": 0.173, "mean_pace_m_s": 9.0}


def test_the_table_is_in_the_order_of_the_mean_over_the_paces() -> None:
    """One without any rank has no place; those that lack a pace come last."""
    cheat = at_paces("cheat", (0.02, 0.02, 0.035), **OFF)
    often = at_paces("often", (0.001, 0.001, 0.001))[:2]
    runs = [*cheat, *often, *at_paces("b", (0.01, 0.02, 0.05)), *at_paces("a", (0.02, 0.02, 0.03))]
    boards = leaderboards(runs)
    assert [board.pace for board in boards] == list(PACES)
    assert list(in_order(boards)) == ["a", "cheat", "b", "often"]
    lines = boards_text(boards).splitlines()[3:7]
    assert [line.split()[:2] for line in lines] == [
        ["1", "a"],
        ["–", "cheat"],
        ["2", "b"],
        ["3", "often"],
    ]


def test_there_is_a_sentence_on_completion_and_one_for_each_footnote() -> None:
    runs = [
        *at_paces("mine", (0.0015, 0.002, 0.0031)),
        *at_paces("hasty", (0.01, 0.03, 0.3), **OFF),
        *at_paces("lost", (0.25, 0.25, 0.25), completed=0.0, **OFF),
    ]
    text = boards_text(leaderboards(runs))
    assert text.splitlines()[0].startswith("standard, 40 test episodes")
    below = " ".join(text.split("\n\n")[2].split())
    assert below == (
        "Completed episodes: lost 0 %, all others 100 %; a rank needs 99 % within the 95 % "
        "interval. ¹ hasty is too fast: "
        "17.3 % (slow), 17.3 % (medium), 17.3 % (brisk) off the pace; 15 % allowed."
    )
    assert text.count("too fast ¹") == 3
    assert text.count("–  incomplete") == 3, "an error means nothing where none arrives"
    assert "All policies complete all episodes." in boards_text(leaderboards(runs[:3]))
    runs[0].scores["completed"][:1] = False
    assert "Completed episodes: mine 97.5 to 100 %; a rank" in boards_text(leaderboards(runs[:3]))


@settings(max_examples=30, deadline=None)
@given(
    st.dictionaries(
        st.text("abc-", min_size=1, max_size=100),
        st.tuples(*[st.floats(1e-5, 0.3)] * 3, st.sampled_from([{}, OFF, {"completed": 0.5}])),
        min_size=1,
        max_size=12,
    )
)
def test_the_table_has_80_columns_and_all_numbers(policies: dict[str, tuple[object, ...]]) -> None:
    """A long name loses its middle, a number never a digit."""
    runs = [
        run
        for name, (*errors, others) in policies.items()
        for run in at_paces(name, errors, **others)
    ]
    boards = leaderboards(runs)
    text = boards_text(boards)
    assert max(map(len, text.splitlines())) <= WIDTH
    rows = text.splitlines()[3 : 3 + len(policies)]
    for line, standings in zip(rows, in_order(boards).values(), strict=True):
        for standing in standings:
            assert standing is not None
            value = 1e3 * standing.error.value
            shown = f"{value:.{int(value < 19.95)}f}"
            assert f" {shown} " in line
            assert line.count("(") == sum(
                each is not None and each.rank is not None for each in standings
            )


def test_names_of_policies_here_are_whole_beside_the_widest_numbers() -> None:
    name = "torque-feedback-tuned"
    text = boards_text(leaderboards([*at_paces(name, (0.009, 0.0176, 0.0176))]))
    assert f" 1 {name} " in text
    assert "17.6 (17.3 – 17.9)" in text
    assert f" 1 {name}  " in boards_text(leaderboards(at_paces(name, (0.001, 0.001, 0.03))))


def test_details_have_the_papers_other_criterion(capsys: pytest.CaptureFixture[str]) -> None:
    print_boards([with_error("mine", 0.02, peak_acceleration_m_s2=12.34)], details=True)
    shown = capsys.readouterr().out
    assert "peak acc." in shown
    assert "12.3" in shown
    assert max(map(len, shown.splitlines())) <= WIDTH


def test_a_reason_is_a_predicate() -> None:
    few, uneven = MissedLimit("incomplete", 0.98955), MissedLimit("uneven", 0.2371)
    assert str(few) == "completes 98.95 % of the episodes (99 % needed)"
    assert str(uneven) == "is uneven: segments 23.7 % off the pace (15 % allowed)"


@pytest.mark.parametrize(("width", "expected"), [(9, "abcdefghi"), (8, "abcd…ghi"), (3, "a…i")])
def test_a_long_name_loses_its_middle(width: int, expected: str) -> None:
    assert shorten("abcdefghi", width) == expected
