"""Pictures: what is drawn where, without a display, the same each time."""

import os
import subprocess
import sys

import gymnasium
import numpy as np
import pytest

from pter_gym.errors import DependencyError, ParameterError
from pter_gym.params import BASELINE
from pter_gym.paths import Line
from pter_gym.physics.friction import ClutchMode
from pter_gym.render import Viewer, style
from pter_gym.render.geometry import Box, View
from pter_gym.render.picture import Picture
from pter_gym.render.scene import METRES_PER_NEWTON
from pter_gym.tasks.path_following import TELEMETRY, PathFollowing

TASK = PathFollowing()
SHAPE = (style.HEIGHT, style.WIDTH, 3)
NO_TRAIL = np.zeros((0, 2))
THETA = (0.4, 2.2)
TIP = (
    BASELINE.arm.length_a * np.array([np.cos(THETA[0]), np.sin(THETA[0])])
    + BASELINE.arm.length_b * np.array([np.cos(THETA[1]), np.sin(THETA[1])])
)  # fmt: skip


def row(**values: float) -> np.ndarray:
    telemetry = np.zeros(len(TELEMETRY))
    for name, value in {"theta_a": THETA[0], "theta_b": THETA[1], **values}.items():
        telemetry[TELEMETRY.index(name)] = value
    return telemetry


def rgb(colour: str) -> tuple[int, int, int]:
    return int(colour[1:3], 16), int(colour[3:5], 16), int(colour[5:7], 16)


def colour_at(picture: np.ndarray, pixel: np.ndarray) -> tuple[int, ...]:
    x, y = np.round(pixel).astype(int)
    return tuple(int(c) for c in picture[y, x])


def count(picture: np.ndarray, colour: str) -> int:
    return int((picture == rgb(colour)).all(axis=-1).sum())


def test_missing_pygame_is_named(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(sys.modules, "pygame", None)
    with pytest.raises(DependencyError, match=r"pygame .*pip install -e '\.\[render\]'") as caught:
        Viewer(BASELINE, TASK, "rgb_array")
    assert isinstance(caught.value, gymnasium.error.DependencyNotInstalled)


class TestPicture:
    @pytest.fixture(autouse=True)
    def _needs_pygame(self):
        pytest.importorskip("pygame")

    @pytest.fixture
    def viewer(self) -> Viewer:
        return Viewer(BASELINE, TASK, "rgb_array")

    @pytest.fixture
    def view(self) -> View:
        return Picture(BASELINE, TASK).view

    def draw(self, viewer: Viewer, trail: np.ndarray = NO_TRAIL, **values: float) -> np.ndarray:
        picture = viewer.draw(row(**values), trail)
        assert picture is not None
        return picture

    def test_shape_type_and_freshness(self, viewer: Viewer):
        first = self.draw(viewer)
        kept = first.copy()
        second = self.draw(viewer, theta_a=0.6, volts_1=3.0)
        assert first.shape == SHAPE
        assert first.dtype == np.uint8
        assert first.flags.c_contiguous
        assert first.flags.writeable
        assert not np.shares_memory(first, second)
        np.testing.assert_array_equal(first, kept)
        assert (first != second).any()

    def test_the_same_state_gives_the_same_picture(self, viewer: Viewer):
        values = {"force_x": 30.0, "force_y": -20.0, "mode": 1.0, "volts_1": 4.0, "torque_1": -9.0, "time": 1.0}
        trail = TIP + np.linspace((-0.2, 0.05), (0.0, 0.0), 40)
        first = self.draw(viewer, trail, **values)
        self.draw(viewer, theta_a=0.9)
        np.testing.assert_array_equal(first, self.draw(viewer, trail, **values))
        other = Viewer(BASELINE, TASK, "rgb_array")
        np.testing.assert_array_equal(first, self.draw(other, trail, **values))

    def test_inputs_stay_as_they_are(self, viewer: Viewer):
        telemetry, trail = row(force_x=10.0), TIP + np.linspace((-0.1, 0.0), (0.0, 0.0), 5)
        before = telemetry.copy(), trail.copy()
        viewer.draw(telemetry, trail)
        np.testing.assert_array_equal(telemetry, before[0])
        np.testing.assert_array_equal(trail, before[1])

    def test_bars_and_tip_are_where_the_kinematics_says(self, viewer: Viewer, view: View):
        picture = self.draw(viewer)
        elbow_a = BASELINE.arm.length_a * np.array([np.cos(THETA[0]), np.sin(THETA[0])])
        elbow_b = TIP - elbow_a
        assert colour_at(picture, view.pixels(TIP)) == rgb(style.INK)
        assert colour_at(picture, view.pixels(0.5 * elbow_a)) == rgb(style.LINK_A)
        assert colour_at(picture, view.pixels(0.5 * elbow_b)) == rgb(style.LINK_B)
        assert colour_at(picture, view.pixels(elbow_a + 0.5 * elbow_b)) == rgb(style.PARALLEL_B)
        assert colour_at(picture, view.pixels(elbow_b + 0.5 * elbow_a)) == rgb(style.PARALLEL_A)

    def test_path_and_workspace(self, viewer: Viewer, view: View):
        picture = self.draw(viewer)
        path = TASK.path
        assert colour_at(picture, view.pixels(path.point(0.1 * path.length))) == rgb(style.PATH)
        x, y = path.point(0.1 * path.length)
        assert colour_at(picture, view.pixels((x, y + 0.9 * TASK.error_max))) == rgb(style.WORKSPACE)
        assert colour_at(picture, view.pixels((x, y + 1.1 * TASK.error_max))) == rgb(style.BACKGROUND)

    def test_trail(self, viewer: Viewer, view: View):
        trail = TIP + np.linspace((0.0, 0.1), (0.1, 0.2), 30)
        middle = view.pixels(trail[15])
        assert colour_at(self.draw(viewer, trail), middle) == rgb(style.TRAIL)
        assert colour_at(self.draw(viewer), middle) != rgb(style.TRAIL)

    @pytest.mark.parametrize("trail", [TIP[None], np.repeat(TIP[None], 50, axis=0), [tuple(TIP)] * 2])
    def test_a_trail_without_length_is_no_line(self, viewer: Viewer, trail: np.ndarray):
        np.testing.assert_array_equal(self.draw(viewer, trail), self.draw(viewer))

    @pytest.mark.parametrize("force", [(60.0, 0.0), (0.0, 60.0), (-40.0, 40.0)])
    def test_force_points_where_it_pushes(self, viewer: Viewer, view: View, force: tuple[float, float]):
        picture = self.draw(viewer, force_x=force[0], force_y=force[1])
        pushed = view.pixels(TIP + 0.5 * METRES_PER_NEWTON * np.array(force))
        opposite = view.pixels(TIP - 0.5 * METRES_PER_NEWTON * np.array(force))
        assert colour_at(picture, pushed) == rgb(style.FORCE)
        assert colour_at(picture, opposite) != rgb(style.FORCE)

    def test_no_force_no_arrow(self, viewer: Viewer):
        legend = count(self.draw(viewer), style.FORCE)
        assert count(self.draw(viewer, force_x=0.1), style.FORCE) == legend
        assert count(self.draw(viewer, force_x=50.0), style.FORCE) > 2 * legend

    def test_a_strong_force_stays_out_of_the_panel(self, viewer: Viewer):
        panel = np.s_[:, style.WIDTH - style.PANEL_WIDTH :]
        np.testing.assert_array_equal(self.draw(viewer, force_x=900.0)[panel], self.draw(viewer)[panel])

    def test_voltage_bars_grow_with_the_voltage(self, viewer: Viewer):
        top = BASELINE.clutch.voltage_max
        none, half, full = (count(self.draw(viewer, volts_2=volts), style.VOLTS) for volts in (0.0, 0.5 * top, top))
        assert none == 0
        assert half > 0
        assert full == pytest.approx(2 * half, rel=0.05)
        assert count(self.draw(viewer, volts_2=2.0 * top), style.VOLTS) == full

    def test_torque_bars_have_a_sign(self, viewer: Viewer):
        columns = {
            torque: np.flatnonzero((self.draw(viewer, torque_3=torque) == rgb(style.TORQUE)).all(axis=-1).any(axis=0))
            for torque in (-20.0, 20.0)
        }
        assert columns[-20.0].max() < columns[20.0].min()
        assert len(columns[-20.0]) == pytest.approx(len(columns[20.0]), abs=1)

    def test_stuck_and_slipping_look_different(self, viewer: Viewer):
        pictures = [self.draw(viewer, volts_1=5.0, mode=mode) for mode in (ClutchMode.TWO_DOF, ClutchMode.STUCK_1)]
        assert (pictures[0] != pictures[1]).any()
        assert count(pictures[1], style.INK) > count(pictures[0], style.INK) + 500

    def test_all_poses_of_the_task_stay_in_the_scene(self, view: View):
        arm = BASELINE.arm
        scene = Box(0, 0, style.WIDTH - style.PANEL_WIDTH, style.HEIGHT)
        for s in np.linspace(0.0, TASK.path.length, 9):
            tip = complex(*TASK.path.point(float(s)))
            cos = (abs(tip) ** 2 - arm.length_a**2 - arm.length_b**2) / (2.0 * arm.length_a * arm.length_b)
            elbow_a = tip * arm.length_a / (arm.length_a + arm.length_b * np.exp(1j * np.arccos(cos)))
            for elbow in (elbow_a, tip - elbow_a):
                x, y = view.pixels((elbow.real, elbow.imag))
                assert scene.left + 8 < x < scene.right - 8
                assert scene.low + 8 < y < scene.high - 8

    def test_other_code_may_shut_pygame_down(self, viewer: Viewer):
        import pygame

        before = self.draw(viewer)
        pygame.quit()
        np.testing.assert_array_equal(self.draw(viewer), before)

    def test_mode_is_checked(self):
        with pytest.raises(ParameterError, match="mode must be one of rgb_array, human"):
            Viewer(BASELINE, TASK, "ansi")  # pyright: ignore[reportArgumentType]

    def test_closing_twice_is_fine(self, viewer: Viewer):
        viewer.close()
        viewer.close()


def run_fresh(program: str, **variables: str) -> str:
    """Run a program in a fresh process without a display, and without SDL's variables unless they are given."""
    bare = {k: v for k, v in os.environ.items() if not k.startswith("SDL_") and k not in ("DISPLAY", "WAYLAND_DISPLAY")}
    result = subprocess.run(
        [sys.executable, "-c", SETUP + program], capture_output=True, text=True, check=False, env={**bare, **variables}
    )
    assert result.returncode == 0, result.stderr
    return result.stdout.splitlines()[-1]


SETUP = """
import os, time
import numpy as np
import pygame
from pter_gym.params import BASELINE
from pter_gym.render import Viewer
from pter_gym.tasks.path_following import TELEMETRY, PathFollowing

row, trail = np.zeros(len(TELEMETRY)), np.zeros((0, 2))
before = dict(os.environ)
"""


def test_pictures_need_no_display():
    pytest.importorskip("pygame")
    program = """
picture = Viewer(BASELINE, PathFollowing(), "rgb_array").draw(row, trail)
print(picture.shape, pygame.display.get_init(), dict(os.environ) == before)
"""
    assert run_fresh(program) == f"{SHAPE} False True"


def test_a_window_keeps_the_pace_and_stays_closed():
    pytest.importorskip("pygame")
    program = """
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
print(drawn == [None] * 10, seconds > 0.18, (shown == picture).all(), gone, pygame.display.get_init())
"""
    assert run_fresh(program, SDL_VIDEODRIVER="dummy") == "True True True True False"


def test_a_film_plays_again_until_its_window_is_closed():
    pytest.importorskip("pygame")
    program = """
from pter_gym.render.film import Film, Shot
from pter_gym.render.picture import Subject
from pter_gym.render.recording import show_film

shown = []
class Watched(Film):
    def canvas(self, frame):
        shown.append(frame)
        if shown[-3:] == [0, 1, 2] and len(shown) > len(self):
            pygame.event.post(pygame.event.Event(pygame.KEYDOWN, key=pygame.K_ESCAPE))
        return super().canvas(frame)

film = Watched([Shot(Subject(BASELINE, PathFollowing()), np.stack([row, row]))], 100.0, size=(64, 48))
show_film(film, 1000.0, "film")
print(shown == [*range(len(film)), 0, 1, 2], pygame.display.get_init())
"""
    assert run_fresh(program, SDL_VIDEODRIVER="dummy") == "True False"


@pytest.mark.skipif(sys.platform != "linux", reason="other systems always have a display")
def test_a_display_that_nobody_sees_is_none():
    pytest.importorskip("pygame")
    program = """
from pter_gym.render.window import has_display
found = [has_display()]
for driver in ("dummy", "offscreen"):
    os.environ["SDL_VIDEODRIVER"] = driver
    found.append(has_display())
print(found, pygame.display.get_init())
"""
    assert run_fresh(program) == "[False, False, False] False"


def test_another_machine_is_drawn_from_now_on():
    pytest.importorskip("pygame")
    telemetry = row()
    viewer = Viewer(BASELINE, TASK, "rgb_array", 320, 240)
    before = viewer.draw(telemetry, NO_TRAIL)
    task = PathFollowing(path=Line(x=-0.1, y=0.5, direction=0.1, length=0.2))
    viewer.look_at(BASELINE, task)
    after = viewer.draw(telemetry, NO_TRAIL)
    np.testing.assert_array_equal(after, Viewer(BASELINE, task, "rgb_array", 320, 240).draw(telemetry, NO_TRAIL))
    assert (before != after).any()


def test_a_window_that_other_code_closed_stays_closed():
    pytest.importorskip("pygame")
    program = """
viewer = Viewer(BASELINE, PathFollowing(), "human")
viewer.draw(row, trail)
pygame.quit()
viewer.draw(row, trail)
viewer.close()
print(pygame.display.get_init())
"""
    assert run_fresh(program, SDL_VIDEODRIVER="dummy") == "False"
