"""Pictures of the documents: who has a rank, and when each clutch sticks."""

import numpy as np
import pytest
from figures.hands import force_and_spectrum
from figures.pages import Score, clutches_over_time, error_against_commanded_pace
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

from pter_gym._physics.friction import ClutchMode
from pter_gym.benchmark.statistics import Interval
from pter_gym.hands import MEASURED_TREMORS, find_hand
from pter_gym.scenarios import PACES
from pter_gym.tasks.path_following import TELEMETRY


def front(*errors: float, ranked: bool = True) -> list[Score]:
    """Path errors [mm] at the three paces."""
    return [
        Score(pace, Interval(0.001 * error, 0.0009 * error, 0.0012 * error), ranked)
        for pace, error in zip(PACES.values(), errors, strict=True)
    ]


FRONTS = {
    "impedance": front(34.0, 33.0, 39.0, ranked=False),
    "ppo-standard": front(2.8, 4.7, 8.5),
    "torque-feedback": front(38.0, 35.0, 39.1),
    "somebody's": front(38.0, 35.0, 38.9),
}


def markers(figure: Figure) -> dict[tuple[float, float], str]:
    """The colour inside each point."""
    drawn = [line for line in figure.axes[0].get_lines() if line.get_linestyle() == "None"]
    points = [line for line in drawn if line.get_marker() != "_"]
    return {tuple(np.asarray(line.get_xydata())[0]): to_hex(line.get_markerfacecolor()) for line in points}


def test_points_stand_at_their_pace_and_are_hollow_without_a_rank() -> None:
    figure = error_against_commanded_pace(FRONTS, "title")
    axes = figure.axes[0]
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("commanded pace [m/s]", "path error [mm]")
    assert (axes.get_xscale(), axes.get_yscale()) == ("log", "log")
    found = markers(figure)
    assert len(found) == 3 * len(FRONTS)
    hollow = sorted(y for (_, y), face in found.items() if face == "#ffffff")
    assert hollow == pytest.approx([33.0, 34.0, 39.0])
    for name, scores in FRONTS.items():
        for score in scores:
            near = [x for x, y in found if y == pytest.approx(1000.0 * score.path_error.value)]
            assert any(x == pytest.approx(score.pace, rel=0.1) for x in near), name


def telemetry(modes: list[int]) -> np.ndarray:
    rows = np.zeros((len(modes), len(TELEMETRY)))
    rows[:, TELEMETRY.index("time")] = 0.01 * np.arange(len(modes))
    rows[:, TELEMETRY.index("mode")] = modes
    rows[:, TELEMETRY.index("normal_error")] = 0.003
    for clutch in range(1, 5):
        rows[:, TELEMETRY.index(f"volts_{clutch}")] = clutch
    return rows


def test_clutches_show_distance_voltages_and_sticking() -> None:
    modes = [0, 0, ClutchMode.STUCK_2, ClutchMode.STUCK_2, 0, ClutchMode.ZERO_DOF, 0]
    figure = clutches_over_time({"some": telemetry(modes), "other": telemetry([0, 0, 0])}, 24.0)
    panels = np.reshape(np.array(figure.axes), (5, 2))
    assert [axes.get_title(loc="left") for axes in panels[0]] == ["some", "other"]
    assert panels[-1, 0].get_xlabel() == "time [s]"
    assert panels[0, 0].get_xlim() == (0.0, pytest.approx(0.06))
    np.testing.assert_allclose(panels[0, 0].get_lines()[1].get_ydata(), 3.0)
    for clutch, axes in enumerate(panels[1:, 0], start=1):
        np.testing.assert_allclose(axes.get_lines()[0].get_ydata(), float(clutch))
        _, stuck = axes.collections
        spans = [(path.vertices[:, 0].min(), path.vertices[:, 0].max()) for path in stuck.get_paths()]
        both = [(0.01, 0.03), (0.04, 0.05)]
        np.testing.assert_allclose(spans, both if clutch == 2 else both[1:])
    for axes in panels[1:, 1]:
        assert not axes.collections[1].get_paths()


def test_tremors_show_their_force_and_a_peak_within_the_band() -> None:
    hands = {name: find_hand(name) for name in MEASURED_TREMORS}
    figure = force_and_spectrum(hands, MEASURED_TREMORS)
    panels = np.reshape(np.array(figure.axes), (3, 2))
    for (name, hand), (left, right) in zip(hands.items(), panels, strict=True):
        assert np.abs(left.get_lines()[0].get_ydata()).max() == pytest.approx(1.3 * hand.force, rel=0.03)
        frequencies, amplitudes = right.get_lines()[0].get_data()
        low, high = MEASURED_TREMORS[name].band
        assert low < frequencies[amplitudes.argmax()] < high
        assert amplitudes.max() == pytest.approx(hand.force, rel=0.15)
    assert [axes.get_xlabel() for axes in panels[-1]] == ["time [s]", "frequency [Hz]"]
