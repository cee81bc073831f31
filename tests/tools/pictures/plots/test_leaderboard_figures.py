"""Figures of a scenario's scores: what they show, with units, and who is below the line."""

from pathlib import Path

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pter_gym.benchmark import Leaderboard, leaderboards, run_scenario
from pter_gym.benchmark._runs import ScenarioRun
from pter_gym.benchmark.episodes import load_episodes
from pter_gym.tools.pictures.plots import leaderboard as plots
from pter_gym.tools.pictures.plots import save
from pter_gym.tools.pictures.render.geometry import five_bar, path_points

POLICIES = ["impedance", "free", "locked"]
PACES = ["slow", "medium"]
COUNT = 6


@pytest.fixture(scope="module")
def runs() -> tuple[ScenarioRun, ...]:
    return run_scenario("standard", POLICIES, PACES, episodes=COUNT)


@pytest.fixture(scope="module")
def boards(runs: tuple[ScenarioRun, ...]) -> tuple[Leaderboard, ...]:
    return leaderboards(runs)


def titles(figure: Figure) -> list[str]:
    return [axes.get_title() or axes.get_title(loc="left") for axes in figure.axes]


def curves(axes: Axes) -> list[np.ndarray]:
    return [np.asarray(line.get_xydata()) for line in axes.get_lines() if len(line.get_xydata()) > 1]


def test_trajectories_show_path_arm_and_every_tip(
    runs: tuple[ScenarioRun, ...], boards: tuple[Leaderboard, ...]
) -> None:
    board = boards[1]
    episodes = load_episodes("standard", board.pace)
    figure = plots.trajectories(board, runs)
    assert titles(figure) == [f"{episodes.strata[k]}, episode {k}" for k in range(4)]
    best = next(r for r in runs if (r.conditions.policy, r.conditions.pace) == ("impedance", board.pace))
    for k, axes in enumerate(figure.axes):
        drawn = curves(axes)
        assert any(np.array_equal(curve, path_points(episodes.tasks[k].path)) for curve in drawn)
        for run in (r for r in runs if r.conditions.pace == board.pace):
            assert any(np.array_equal(curve, run.samples[k].tip) for curve in drawn)
        sample = best.samples[k]
        pivots = five_bar(episodes.machines[k].arm, *sample.theta[len(sample.theta) // 2])
        assert any(np.array_equal(curve, np.stack([pivots.base, pivots.elbow_a, pivots.tip])) for curve in drawn)
        np.testing.assert_allclose(pivots.tip, sample.tip[len(sample.theta) // 2], atol=1e-4)


def test_only_those_that_rode_the_same_episodes_are_drawn_together() -> None:
    runs = run_scenario("standard", ["locked", "free"], ["brisk"], episodes=1, fresh="derived")
    (board,) = leaderboards(runs)
    drawn = [curve for axes in plots.trajectories(board, runs).axes for curve in curves(axes)]
    tips = {run.conditions.policy: run.samples[0].tip for run in runs}
    shown = [name for name, tip in tips.items() if any(np.array_equal(curve, tip) for curve in drawn)]
    assert shown == [board.standings[0].policy]


def test_one_policy_and_one_episode(tmp_path: Path) -> None:
    runs = run_scenario("standard", ["locked"], ["brisk"], episodes=1)
    boards = leaderboards(runs)
    figures = [
        plots.profiles(boards, runs),
        plots.error_against_pace(boards),
        plots.error_against_smoothness(boards),
        plots.trajectories(boards[0], runs),
    ]
    for k, figure in enumerate(figures):
        save(figure, tmp_path / f"{k}.png")
        assert (tmp_path / f"{k}.png").read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
