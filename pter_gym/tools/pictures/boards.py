"""The figures that ``pter benchmark`` writes beside its numbers."""

from collections.abc import Sequence
from pathlib import Path

from pter_gym.benchmark import Leaderboard, Result
from pter_gym.benchmark._run_files import episodes_suffix
from pter_gym.benchmark._runs import ScenarioRun
from pter_gym.tools.figures import save
from pter_gym.tools.pictures.plots import leaderboard as plots
from pter_gym.tools.pictures.plots.benchmark import error_against_time, tip_paths


def draw_standard_test(result: Result, folder: Path) -> list[Path]:
    """Draw the result of the paper's standard test into a folder; return the paths."""
    pictures = {"tip_paths.png": tip_paths(result), "error_against_time.png": error_against_time(result)}
    return [path for name, figure in pictures.items() for path in save(figure, folder / name)]


def draw_scenario(boards: Sequence[Leaderboard], found: Sequence[ScenarioRun], folder: Path) -> list[Path]:
    """Draw the leaderboards of one scenario, and sample episodes of its runs, into a folder; return the paths."""
    runs = [run for run in found if boards[0].has_episodes_of(run)]
    name_of_set = f"{boards[0].scenario}{episodes_suffix(boards[0].fresh)}"
    figures = {
        "profiles": plots.profiles(boards, runs),
        "error-against-pace": plots.error_against_pace(boards),
        "error-against-smoothness": plots.error_against_smoothness(boards),
    }
    for board in boards:
        figures[f"trajectories-{board.pace}"] = plots.trajectories(board, runs)
    return [path for name, figure in figures.items() for path in save(figure, folder / f"{name_of_set}-{name}.png")]
