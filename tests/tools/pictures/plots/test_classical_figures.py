"""Figures of one episode under several laws show the numbers of its telemetry."""

import numpy as np
import pytest
from figures.classical import FULL, INSTANTS, STUCK, arm_and_deviation, clutches_along_path
from matplotlib.colors import to_hex
from studies.clutch_use import episodes

from pter_gym.benchmark._measures import column, four, vector
from pter_gym.params import BASELINE
from pter_gym.tasks.path_following import PathFollowing

PATH = PathFollowing().path
TOP = BASELINE.clutch.voltage_max


@pytest.fixture(scope="module")
def followed() -> dict[str, np.ndarray]:
    rows = {name: episodes(name, "brisk", draws=1)[:, 0] for name in ("impedance", "single-dof-tuned")}
    return {name: each[np.isfinite(each[:, 0])] for name, each in rows.items()}


def test_tips_and_deviations_are_those_of_the_telemetry(followed: dict[str, np.ndarray]) -> None:
    figure = arm_and_deviation(followed, BASELINE.arm, PATH)
    world, deviation = figure.axes
    assert [text.get_text() for text in figure.legends[0].get_texts()] == [
        "the arm under single-dof-tuned, four times",
        "path",
        *followed,
    ]
    assert world.get_aspect() == 1.0
    tips = [line for line in world.get_lines() if len(line.get_xdata()) > 100 and line.get_alpha() is None]
    for line, telemetry in zip(tips, followed.values(), strict=True):
        np.testing.assert_array_equal(line.get_xydata(), vector(telemetry, "tip"))
    curves = [line for line in deviation.get_lines() if len(line.get_xdata()) > 2]
    for line, telemetry in zip(curves, followed.values(), strict=True):
        np.testing.assert_allclose(line.get_ydata(), 1000.0 * column(telemetry, "normal_error"))
    links = [line for line in world.get_lines() if line.get_linewidth() == 4.0 and len(line.get_xdata()) == 2]
    assert len(links) == 2 * len(INSTANTS)
    lengths = [float(np.hypot(*np.diff(line.get_xydata(), axis=0)[0])) for line in links]
    np.testing.assert_allclose(lengths, len(INSTANTS) * [BASELINE.arm.length_a, BASELINE.arm.length_b])
    last = vector(followed["single-dof-tuned"], "tip")[-1]
    np.testing.assert_allclose(links[-1].get_xydata()[1], last, atol=1e-9)


def test_clutch_panels_show_volts_and_states(followed: dict[str, np.ndarray]) -> None:
    figure = clutches_along_path(followed, PATH, TOP)
    assert len(figure.axes) == 2 * len(followed)
    for k, (name, telemetry) in enumerate(followed.items()):
        volts, states = figure.axes[2 * k], figure.axes[2 * k + 1]
        assert volts.get_title(loc="left") == name
        for line, expected in zip(volts.get_lines(), four(telemetry[1:], "volts").T, strict=True):
            np.testing.assert_array_equal(line.get_ydata(), expected)
        drawn = {
            colour: sum(
                len(collection.get_paths())
                for collection in states.collections
                if len(collection.get_facecolor()) and to_hex(collection.get_facecolor()[0]) == colour
            )
            for colour in (FULL, STUCK)
        }
        forward = np.diff(column(telemetry[1:], "reached")) > 0.0
        full = (four(telemetry[2:], "volts") >= TOP * (1.0 - 1e-6))[forward]
        assert drawn[FULL] == full.sum()
        assert drawn[STUCK] > 0
