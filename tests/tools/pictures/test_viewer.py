"""Pictures of telemetry, the same each time without a display; windows; geometry."""

import math
import os
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from pter_gym._physics.friction import ClutchMode
from pter_gym.errors import ParameterError
from pter_gym.params import BASELINE, Arm, find_machine
from pter_gym.paths import Line
from pter_gym.tasks.path_following import TELEMETRY, PathFollowing
from pter_gym.tools.pictures import drawing
from pter_gym.tools.pictures.drawing import Picture, Subject, band, clutch_states, five_bar
from pter_gym.tools.pictures.viewer import Viewer

TASK = PathFollowing()
THETA = (0.4, 2.2)
TIP = five_bar(BASELINE.arm, *THETA).tip
TRAIL = TIP + np.linspace((-0.1, 0.1), (0.0, 0.0), 30)


def row(**values: float) -> np.ndarray:
    telemetry = np.zeros(len(TELEMETRY))
    for name, value in {"theta_a": THETA[0], "theta_b": THETA[1], **values}.items():
        telemetry[TELEMETRY.index(name)] = value
    return telemetry


def draw(viewer: Viewer, **values: float) -> np.ndarray:
    picture = viewer.draw(row(**values), TRAIL)
    assert picture is not None
    return picture


@pytest.fixture(scope="module")
def viewer() -> Viewer:
    return Viewer(BASELINE, TASK, "rgb_array", 480, 400)


def test_pictures_are_new_arrays_and_depend_on_the_state_only(viewer: Viewer):
    first = draw(viewer, force_x=30.0, mode=1.0, volts_1=4.0, time=1.0)
    assert (first.shape, first.dtype, first.flags.writeable) == ((400, 480, 3), np.uint8, True)
    kept = first.copy()
    assert (draw(viewer, theta_a=0.6) != first).any()
    np.testing.assert_array_equal(first, kept)
    other = Viewer(BASELINE, TASK, "rgb_array", 480, 400)
    np.testing.assert_array_equal(draw(other, force_x=30.0, mode=1.0, volts_1=4.0, time=1.0), first)


@pytest.mark.parametrize(
    ("name", "value"),
    {
        "theta_b": 2.0,
        "force_y": 60.0,
        "time": 1.0,
        "normal_error": 0.01,
        "volts_2": 12.0,
        "torque_3": -20.0,
        "mode": 1.0,
        "terminated": 1.0,
    }.items(),
)
def test_each_quantity_changes_the_picture(viewer: Viewer, name: str, value: float):
    shown = draw(viewer, volts_1=5.0)
    assert (draw(viewer, volts_1=5.0, **{name: value}) != shown).any()


def test_the_handle_is_at_the_tip_and_the_trail_behind_it(viewer: Viewer):
    view = Picture(Subject(BASELINE, TASK), 480, 400).view
    picture = draw(viewer)
    for point, colour in ((TIP, drawing.INK), (TRAIL[15], drawing.TRAIL)):
        x, y = view.pixels(point).round().astype(int)
        assert "#" + bytes(picture[y, x]).hex() == colour


@settings(max_examples=25, deadline=None)
@given(st.integers(32, 700), st.integers(32, 700))
def test_any_size_can_be_drawn(width: int, height: int):
    assert Picture(Subject(BASELINE, TASK, "name" * 9), width, height).draw(row(), TRAIL).shape == (
        height,
        width,
        3,
    )


@pytest.mark.parametrize("direction", np.arange(8) * math.pi / 4)
def test_the_name_of_a_force_is_never_cut(direction: float, monkeypatch: pytest.MonkeyPatch):
    written = dict[str, tuple[float, float]]()
    monkeypatch.setattr(
        drawing.Canvas, "text", lambda _0, text, x, y, *_1: written.update({text: (x, y)})
    )
    picture = Picture(Subject(BASELINE, TASK), 480, 400)
    force = {"force_x": 900 * math.cos(direction), "force_y": 900 * math.sin(direction)}
    picture.draw(row(**force), TRAIL)
    half = 0.5 * drawing.text_width("900 N", picture._size)
    x, y = written["900 N"]
    assert half <= x <= 480 - half
    assert 0.5 * picture._size <= y <= picture._panel.low - 0.5 * picture._size


def test_mode_is_checked():
    with pytest.raises(ParameterError, match="mode"):
        Viewer(BASELINE, TASK, "ansi")  # pyright: ignore[reportArgumentType]


def test_nothing_is_drawn_before_the_first_picture_and_the_background_once(
    monkeypatch: pytest.MonkeyPatch,
):
    drawn: list[PathFollowing] = []
    monkeypatch.setattr(Picture, "_draw_background", lambda _, task: drawn.append(task))
    other = PathFollowing(path=Line(x=-0.1, y=0.5, direction=0.1, length=0.2))
    viewer = Viewer(BASELINE, TASK, "rgb_array", 320, 240)
    for task in (other, TASK):
        viewer.look_at(BASELINE, task)
    assert drawn == []
    draw(viewer)
    viewer.look_at(BASELINE, PathFollowing())
    draw(viewer)
    assert drawn == [TASK]
    viewer.look_at(BASELINE, other)
    draw(viewer)
    assert drawn == [TASK, other]


@pytest.mark.parametrize(
    ("mode", "expected"),
    [
        (ClutchMode.TWO_DOF, ["slipping", "slipping", "slipping", "released"]),
        (ClutchMode.STUCK_1, ["stuck", "slipping", "slipping", "released"]),
        (ClutchMode.STUCK_4, ["slipping", "slipping", "slipping", "released"]),
        (ClutchMode.ZERO_DOF, ["stuck", "stuck", "stuck", "released"]),
    ],
)
def test_clutch_states(mode: ClutchMode, expected: list[str]):
    shown = row(mode=mode, volts_1=3.0, torque_2=-1.0, volts_3=2.0, torque_3=1.0)
    assert clutch_states(shown, BASELINE) == expected
    assert clutch_states(shown, find_machine("two-brakes"))[2:] == ["absent", "absent"]


def run_fresh(program: str, **variables: str) -> str:
    """Run a program in a fresh process without a display; ``variables`` may set SDL's."""
    bare = {
        k: v
        for k, v in os.environ.items()
        if not k.startswith("SDL_") and k not in ("DISPLAY", "WAYLAND_DISPLAY")
    }
    result = subprocess.run(
        [sys.executable, "-c", SETUP + program],
        capture_output=True,
        text=True,
        check=False,
        env={**bare, **variables},
    )
    assert result.returncode == 0, result.stderr
    return result.stdout.splitlines()[-1]


SETUP = """
import sys, time
import numpy as np
from pter_gym.params import BASELINE
from pter_gym.tools.pictures.viewer import Viewer
from pter_gym.tasks.path_following import TELEMETRY, PathFollowing

row, trail = np.zeros(len(TELEMETRY)), np.zeros((0, 2))
"""


@pytest.mark.parametrize("variables", [{}, {"SDL_VIDEODRIVER": "x11"}], ids=["nothing", "x11"])
def test_pictures_need_no_display_and_windows_say_what_they_need(variables: dict[str, str]):
    program = """
import os, warnings
before, told = dict(os.environ), []
for missing in (False, True):
    if missing:
        sys.modules["pygame"] = None
    viewer = Viewer(BASELINE, PathFollowing(), "human")
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            told += [viewer.draw(row, trail), viewer.draw(row, trail), len(caught)]
        except Exception as error:
            told.append(type(error).__name__)
    assert os.environ == before
print(Viewer(BASELINE, PathFollowing(), "rgb_array").draw(row, trail).shape, *told)
"""
    pytest.importorskip("pygame")
    assert run_fresh(program, **variables) == "(600, 840, 3) None None 1 DependencyError"


def test_a_window_keeps_the_pace_and_stays_closed():
    pytest.importorskip("pygame")
    program = """
import pygame
viewer = Viewer(BASELINE, PathFollowing(control_period=0.02), "human")
viewer.draw(row, trail)
start = time.perf_counter()
drawn = [viewer.draw(row, trail) for _ in range(10)]
seconds = time.perf_counter() - start
shown = pygame.surfarray.array3d(pygame.display.get_surface()).transpose(1, 0, 2)
picture = Viewer(BASELINE, PathFollowing(control_period=0.02), "rgb_array").draw(row, trail)
pygame.event.post(pygame.event.Event(pygame.QUIT))
viewer.draw(row, trail)
gone = not pygame.display.get_init()
viewer.draw(row, trail)
viewer.close()
print(drawn == [None] * 10, seconds > 0.18, (shown == picture).all(), gone)
"""
    assert run_fresh(program, SDL_VIDEODRIVER="dummy") == "True True True True"


finite = st.floats(-10.0, 10.0)
ARM = Arm(length_a=0.5, length_b=0.3)


@given(finite, finite)
def test_opposite_bars_are_parallel_and_equal(theta_a: float, theta_b: float):
    bars = five_bar(ARM, theta_a, theta_b)
    np.testing.assert_allclose(bars.tip - bars.elbow_b, bars.elbow_a - bars.base, atol=1e-15)
    assert math.hypot(*bars.elbow_a) == pytest.approx(ARM.length_a)
    assert math.hypot(*bars.elbow_b) == pytest.approx(ARM.length_b)


@pytest.mark.parametrize("direction", [0.0, 0.5, -2.0])
def test_workspace_is_a_band_around_the_path(direction: float):
    path = Line(x=0.1, y=0.4, direction=direction, length=0.3)
    ahead = np.array([math.cos(direction), math.sin(direction)])
    from_start = band(path, 0.2, 0.2, 0.2) - (path.x, path.y)
    along, across = from_start @ ahead, from_start @ (-ahead[1], ahead[0])
    np.testing.assert_allclose(np.abs(across), 0.2)
    assert (along.min(), along.max()) == pytest.approx((-0.2, 0.3))
    np.testing.assert_allclose(path.sampled(129)[[0, -1]], [path.point(0.0), path.point(0.3)])
