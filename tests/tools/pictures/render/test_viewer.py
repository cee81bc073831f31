"""Pictures: what a telemetry row shows, without a display, the same each time; and windows."""

import os
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pter_gym.tools.pictures.render import Viewer, style
from pter_gym.tools.pictures.render.picture import Picture, Subject
from pter_gym.tools.pictures.render.readings import clutch_states

from pter_gym._physics.friction import ClutchMode
from pter_gym.envs._size import HEIGHT, WIDTH
from pter_gym.errors import DependencyError, ParameterError
from pter_gym.params import BASELINE
from pter_gym.paths import Line
from pter_gym.tasks.path_following import TELEMETRY, PathFollowing

TASK = PathFollowing()
THETA = (0.4, 2.2)
TIP = np.array(
    [
        BASELINE.arm.length_a * turn(THETA[0]) + BASELINE.arm.length_b * turn(THETA[1])
        for turn in (np.cos, np.sin)
    ]
)  # fmt: skip
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


def test_pictures_are_fresh_arrays_and_inputs_stay_as_they_are(viewer: Viewer):
    telemetry, trail = row(force_x=10.0), TRAIL.copy()
    first = viewer.draw(telemetry, trail)
    assert first is not None
    kept = first.copy()
    second = draw(viewer, theta_a=0.6)
    assert (first.shape, first.dtype, first.flags.writeable) == ((400, 480, 3), np.uint8, True)
    assert (first != second).any()
    np.testing.assert_array_equal(first, kept)
    np.testing.assert_array_equal(telemetry, row(force_x=10.0))
    np.testing.assert_array_equal(trail, TRAIL)


def test_the_same_state_gives_the_same_picture(viewer: Viewer):
    values = {"force_x": 30.0, "force_y": -20.0, "mode": 1.0, "volts_1": 4.0, "torque_1": -9.0, "time": 1.0}
    first = draw(viewer, **values)
    np.testing.assert_array_equal(first, draw(Viewer(BASELINE, TASK, "rgb_array", 480, 400), **values))


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
def test_each_quantity_shows(viewer: Viewer, name: str, value: float):
    shown = draw(viewer, volts_1=5.0)
    assert (draw(viewer, volts_1=5.0, **{name: value}) != shown).any()


def test_the_handle_is_at_the_tip_and_the_trail_behind_it(viewer: Viewer):
    view = Picture(Subject(BASELINE, TASK), 480, 400).view
    picture = draw(viewer)
    for point, colour in ((TIP, style.INK), (TRAIL[15], style.TRAIL)):
        x, y = view.pixels(point).round().astype(int)
        assert "#" + bytes(picture[y, x]).hex() == colour


@settings(max_examples=25, deadline=None)
@given(st.integers(32, 700), st.integers(32, 700))
def test_any_size_can_be_drawn(width: int, height: int):
    assert Picture(Subject(BASELINE, TASK, "name" * 9), width, height).draw(row(), TRAIL).shape == (height, width, 3)


def test_mode_is_checked():
    with pytest.raises(ParameterError, match="mode must be one of rgb_array, human"):
        Viewer(BASELINE, TASK, "ansi")  # pyright: ignore[reportArgumentType]


def test_another_machine_is_drawn_from_now_on():
    task = PathFollowing(path=Line(x=-0.1, y=0.5, direction=0.1, length=0.2))
    viewer = Viewer(BASELINE, TASK, "rgb_array", 320, 240)
    before = draw(viewer)
    viewer.look_at(BASELINE, task)
    after = draw(viewer)
    np.testing.assert_array_equal(after, draw(Viewer(BASELINE, task, "rgb_array", 320, 240)))
    assert (before != after).any()


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
    assert clutch_states(row(mode=mode, volts_1=3.0, torque_2=-1.0, volts_3=2.0, torque_3=1.0)) == expected


def run_fresh(program: str, **variables: str) -> str:
    """Run a program in a fresh process without a display, and without SDL's variables unless they are given."""
    bare = {k: v for k, v in os.environ.items() if not k.startswith("SDL_") and k not in ("DISPLAY", "WAYLAND_DISPLAY")}
    result = subprocess.run(
        [sys.executable, "-c", SETUP + program], capture_output=True, text=True, check=False, env={**bare, **variables}
    )
    assert result.returncode == 0, result.stderr
    return result.stdout.splitlines()[-1]


SETUP = """
import os, sys, time
import numpy as np
from pter_gym.params import BASELINE
from pter_gym.tools.pictures.render import Viewer
from pter_gym.tasks.path_following import TELEMETRY, PathFollowing

row, trail = np.zeros(len(TELEMETRY)), np.zeros((0, 2))
"""


def test_pictures_need_neither_pygame_nor_a_display_and_windows_name_it():
    program = """
sys.modules["pygame"] = None
picture = Viewer(BASELINE, PathFollowing(), "rgb_array").draw(row, trail)
try:
    Viewer(BASELINE, PathFollowing(), "human")
except Exception as error:
    print(picture.shape, type(error).__name__, "pip install -e '.[render]'" in str(error))
"""
    assert run_fresh(program) == f"{(HEIGHT, WIDTH, 3)} {DependencyError.__name__} True"


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
other = Viewer(BASELINE, PathFollowing(), "human")
pygame.quit()
other.draw(row, trail)
other.close()
print(drawn == [None] * 10, seconds > 0.18, (shown == picture).all(), gone, pygame.display.get_init())
"""
    assert run_fresh(program, SDL_VIDEODRIVER="dummy") == "True True True True False"
