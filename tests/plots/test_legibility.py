"""Every picture with few and with many policies and paces: all texts can be read, and no two policies look alike."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from figures.classical import arm_and_deviation, clutches_along_path
from figures.pages import Score, clutches_over_time, error_against_commanded_pace
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.figure import Figure
from mpl_toolkits.axes_grid1.anchored_artists import AnchoredSizeBar

from plots import handmade
from plots.legibility import drawn_texts, faults
from pter_gym.internal.looks import looks
from pter_gym.params import BASELINE
from pter_gym.plots import leaderboard
from pter_gym.plots.benchmark import error_figure, tip_path_figure
from pter_gym.plots.legends import scale_bar, shown
from pter_gym.plots.ticks import round_numbers
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
def test_all_texts_can_be_read_and_policies_told_apart(name: str, count: int, paces: int) -> None:
    figure = PICTURES[name](count, paces)
    texts = drawn_texts(figure)
    assert not faults(figure, texts)
    assert not figure.get_suptitle(), "captions say what a picture shows"
    names = {text for text, _ in texts}
    assert all(shown(policy) in names or shown(policy, 30) in names for policy in handmade.NAMES[:count])
    if name.startswith("error-against") and name.endswith("pace"):
        assert {f"{PACES[pace]:g}\n{pace}" for pace in list(PACES)[-paces:]} <= names
    if name not in ("clutches", "classical-clutches"):  # panels of their own
        wanted = {look[:2] for look in looks(handmade.NAMES[:count]).values()}
        assert wanted <= {(line.get_color(), line.get_marker()) for axes in figure.axes for line in axes.get_lines()}
        assert len({colour for colour, _ in wanted}) == len({marker for _, marker in wanted}) == count


@given(st.floats(1e-4, 1e4), st.floats(1.6, 1e5))
def test_a_logarithmic_axis_has_two_ticks_or_more(low: float, ratio: float) -> None:
    ticks = round_numbers(low, low * ratio)
    assert 2 <= len(ticks) <= 8
    assert all(low <= tick <= low * ratio for tick in ticks)
    assert len(set(ticks)) == len(ticks)


def test_long_names_lose_their_middle_and_dollars_are_dollars() -> None:
    assert shown("x" * 60) == "x" * 60
    assert len(shown("x" * 180)) <= 60
    assert shown("abcdefghijklmnop", 10) == "abcd…lmnop"
    boards = [
        replace(board, standings=(replace(board.standings[0], policy=r"$\frac$"),)) for board in handmade.boards(1, 1)
    ]
    assert r"$\frac$" in [text.replace(r"\$", "$") for text, _ in drawn_texts(leaderboard.error_against_pace(boards))]


def test_faults_are_found() -> None:
    figure = Figure(figsize=(4.0, 3.0))
    figure.text(0.5, 0.5, "one")
    assert not faults(figure)
    figure.text(0.52, 0.5, "two")
    figure.text(0.99, 0.9, "three")
    figure.text(0.1, 0.1, "four", fontsize=5.0)
    assert [fault.split(":")[0] for fault in faults(figure)] == [
        "'three' leaves the figure",
        "'one' overlaps 'two'",
        "'four' is small",
    ]


@pytest.mark.parametrize("length", [0.013, 0.4, 7.0])
def test_a_scale_bar_is_as_long_as_it_says(length: float) -> None:
    figure = Figure(figsize=(4.0, 4.0))
    axes = figure.add_subplot()
    axes.set(xlim=(0.0, length), ylim=(0.0, length))
    scale_bar(axes)
    (bar,) = axes.findobj(AnchoredSizeBar)
    said = float(bar.txt_label.get_text().split(" m ")[0])
    assert bar.size_bar.get_children()[0].get_width() == pytest.approx(said)
    assert 0.1 * length <= said <= 0.3 * length
