"""The figures that ``pter benchmark`` writes beside its numbers."""

from collections.abc import Sequence
from pathlib import Path

from pter_gym.benchmark import Leaderboard, ScenarioRun
from pter_gym.tools.figures import save
from pter_gym.tools.pictures.plots import leaderboard as plots


def draw_scenario(boards: Sequence[Leaderboard], found: Sequence[ScenarioRun], folder: Path) -> list[Path]:
    """Draw the leaderboards of one scenario, and sample episodes of its runs, into a folder; return the paths."""
    runs = [run for run in found if boards[0].has_episodes_of(run)]
    seed = boards[0].seed
    name_of_set = boards[0].scenario if seed is None else f"{boards[0].scenario}-seed{seed}"
    figures = {
        "profiles": plots.profiles(boards, runs),
        "error-against-pace": plots.error_against_pace(boards),
        "error-against-smoothness": plots.error_against_smoothness(boards),
    }
    for board in boards:
        figures[f"trajectories-{board.pace}"] = plots.trajectories(board, runs)
    return [path for name, figure in figures.items() for path in save(figure, folder / f"{name_of_set}-{name}.png")]
