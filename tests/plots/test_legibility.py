"""Every picture with few and with many policies and paces: all texts can be read, and no two policies look alike."""

from collections.abc import Callable

import numpy as np
import pytest
from figures.classical import arm_and_deviation, clutches_along_path
from figures.pages import Score, clutches_over_time, error_against_commanded_pace
from matplotlib.figure import Figure

from plots import handmade
from plots.legibility import drawn_texts, faults
from pter_gym.params import BASELINE
from pter_gym.plots import leaderboard
from pter_gym.plots.benchmark import error_figure, tip_path_figure
from pter_gym.scenarios import PACES

Draw = Callable[[int, int], Figure]
VOLTS = BASELINE.clutch.voltage_max
PATH = np.array([handmade.TASK.path.point(float(s)) for s in np.linspace(0.0, handmade.LENGTH, 20)])


def traces(count: int) -> list:
    return [handmade.trace(name, k) for k, name in enumerate(handmade.NAMES[:count])]


def followed(count: int) -> dict[str, np.ndarray]:
    return {name: handmade.telemetry(k) for k, name in enumerate(handmade.NAMES[:count])}


def fronts(count: int, paces: int) -> dict[str, list[Score]]:
    found: dict[str, list[Score]] = {}
    for board in handmade.boards(count, paces):
        for standing in board.standings:
            score = Score(PACES[board.pace], standing.scores["path_error_m"], standing.rank is not None)
            found.setdefault(standing.policy, []).append(score)
    return found


BY_PACE: dict[str, Draw] = {
    "profiles": lambda count, paces: leaderboard.profiles(handmade.boards(count, paces), handmade.runs(count, paces)),
    "error-against-pace": lambda count, paces: leaderboard.error_against_pace(handmade.boards(count, paces)),
    "error-against-smoothness": lambda count, paces: leaderboard.error_against_smoothness(
        handmade.boards(count, paces)
    ),
    "error-against-commanded-pace": lambda count, paces: error_against_commanded_pace(
        fronts(count, paces), "standard, 200 fresh episodes; bars: 95 % intervals"
    ),
}
OF_ONE_PACE: dict[str, Draw] = {
    "trajectories": lambda count, paces: leaderboard.trajectories(
        handmade.boards(count, paces)[0], handmade.runs(count, paces), handmade.episodes()
    ),
    "tip_paths": lambda count, _: tip_path_figure(traces(count), PATH, "line-following test, τ = 0.105 s"),
    "error_against_time": lambda count, _: error_figure(traces(count), "line-following test, τ = 0.105 s"),
    "classical-trajectories": lambda count, _: arm_and_deviation(followed(count), BASELINE.arm, handmade.TASK.path),
    "classical-clutches": lambda count, _: clutches_along_path(followed(count), handmade.TASK.path, VOLTS),
    "clutches": lambda count, _: clutches_over_time(followed(count), VOLTS),
}
PICTURES = {**BY_PACE, **OF_ONE_PACE}
CASES = [(name, count, paces) for name in BY_PACE for count in (1, 5, 12) for paces in (1, 3)] + [
    (name, count, 1) for name in OF_ONE_PACE for count in (1, 5, 12)
]


@pytest.mark.parametrize(("name", "count", "paces"), CASES)
def test_no_text_leaves_the_figure_or_overlaps_another(name: str, count: int, paces: int) -> None:
    assert not faults(PICTURES[name](count, paces))
