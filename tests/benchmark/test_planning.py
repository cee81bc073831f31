"""Policies that plan, in the benchmark: marked, resumed, and a privileged one without a rank."""

import io
import json

import numpy as np
import pytest
from rich.console import Console

from pter_gym.benchmark import Leaderboard, ResultsFolder, evaluation, find_policy, leaderboards, run_scenario
from pter_gym.benchmark.episodes import load_episodes
from pter_gym.benchmark.leaderboard import table
from pter_gym.benchmark.naming import GUIDE_TABLE
from pter_gym.benchmark.runs import Planning, ScenarioRun
from pter_gym.benchmark.tuned import find_tuned
from pter_gym.controllers import Free
from pter_gym.controllers.predictive import Honest, Privileged, Settings
from pter_gym.plots import leaderboard as plots

SETTINGS = Settings(samples=8, rounds=1, elite=1, horizon=10)
POLICIES = {"bound": Privileged(Free(), SETTINGS), "honest": Honest(Free(), SETTINGS), "free": Free()}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> ResultsFolder:
    return ResultsFolder(tmp_path_factory.mktemp("results"))


@pytest.fixture(scope="module")
def runs(folder: ResultsFolder) -> tuple[ScenarioRun, ...]:
    return run_scenario("standard", POLICIES, ["brisk"], episodes=2, results=folder)


@pytest.fixture(scope="module")
def board(runs: tuple[ScenarioRun, ...]) -> Leaderboard:
    (found,) = leaderboards(runs)
    return found


def test_a_run_keeps_how_it_was_planned_and_is_not_repeated(
    runs: tuple[ScenarioRun, ...], folder: ResultsFolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    bound, honest, free = runs
    assert free.planning is None
    for run, privileged in ((bound, True), (honest, False)):
        assert run.planning is not None
        assert (run.planning.privileged, run.planning.horizon_s, run.planning.rollouts) == (privileged, 0.1, 8)
        assert run.planning.decision_ms > 0.0
    monkeypatch.setattr(evaluation, "evaluate", lambda *_: pytest.fail("it was run again"))
    again = run_scenario("standard", POLICIES, ["brisk"], episodes=2, results=folder)
    assert [run.planning for run in again] == [run.planning for run in runs]
    for one, two in zip(again, runs, strict=True):
        np.testing.assert_array_equal(one.scores["path_error_m"], two.scores["path_error_m"])


def test_other_settings_are_another_policy() -> None:
    assert len({policy.identity for policy in (POLICIES["bound"], Privileged(Free()), Honest(Free()))}) == 3


def test_the_privileged_one_has_no_rank_and_is_marked(board: Leaderboard, folder: ResultsFolder) -> None:
    standings = {standing.policy: standing for standing in board.standings}
    bound, honest = standings["bound"], standings["honest"]
    assert bound.rank is None
    assert str(bound.reason).startswith("privileged")
    assert bound.label == "bound (privileged)"
    assert "privileged" not in str(honest.reason)
    assert honest.label == "honest"
    stored = board.as_json()["policies"]
    assert (stored["bound"]["privileged"], stored["honest"]["privileged"], stored["free"]["privileged"]) == (
        True,
        False,
        False,
    )
    assert (stored["bound"]["planning"]["rollouts"], stored["free"]["planning"]) == (8, None)
    folder.summarise()
    (summary,) = json.loads(folder.summary.read_text())["leaderboards"]
    assert summary["policies"] == json.loads(json.dumps(stored))


def test_the_table_tells_plans_and_times(board: Leaderboard) -> None:
    console = Console(file=io.StringIO(), width=80)
    console.print(table(board))
    shown = console.file.getvalue()  # type: ignore[attr-defined]
    assert "bound (privileged)" in shown
    assert "honest: 8 plans of 0.1 s, " in shown
    assert "free:" not in shown.split("plans of")[1]


def test_the_legends_are_marked(board: Leaderboard, runs: tuple[ScenarioRun, ...]) -> None:
    episodes = load_episodes("standard", "brisk").first(2)
    for figure in (
        plots.profiles([board], runs),
        plots.error_against_pace([board]),
        plots.error_against_smoothness([board]),
        plots.trajectories(board, runs, episodes),
    ):
        (legend,) = figure.legends
        assert [text.get_text() for text in legend.get_texts()] == ["bound (privileged)", "free", "honest"]


def test_they_are_found_by_name() -> None:
    bound, honest = find_policy("predictive"), find_policy("predictive-honest", seed=4, scenario="everything")
    assert isinstance(bound, Privileged)
    assert isinstance(honest, Honest)
    assert (bound.settings.seed, honest.settings.seed) == (0, 4)
    assert bound.guide == find_tuned("single-dof-tuned", "standard", path=GUIDE_TABLE)
    assert honest.guide == find_tuned("single-dof-tuned", "everything", path=GUIDE_TABLE)
    assert Planning(True, 0.3, bound.settings.rollouts, 1.0).rollouts >= 2000
