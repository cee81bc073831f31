"""The picture: the arm on its path to the left, the clutches to the right."""

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from pter_gym.params import Machine
from pter_gym.render import style
from pter_gym.render.canvas import Canvas, text_width
from pter_gym.render.geometry import Box, View, arrow, fit, five_bar, path_points, workspace, world_box
from pter_gym.render.panel import Panel
from pter_gym.render.snapshot import Snapshot
from pter_gym.tasks.path_following import PathFollowing

Array = NDArray[np.float64]

METRES_PER_NEWTON = 0.002
"""Length of the force's arrow."""

SMALLEST_FORCE = 0.5
"""Forces below this [N] have no arrow."""

_SCENE = Box(style.MARGIN, 52, style.WIDTH - style.PANEL_WIDTH - style.MARGIN, style.HEIGHT - style.MARGIN)
_SCALE_BAR = 0.1


class Picture:
    """Draws a machine at a task; what never changes is drawn once."""

    def __init__(self, machine: Machine, task: PathFollowing) -> None:
        self.view = fit(world_box(machine.arm, task.path, task.error_max), _SCENE)
        self._arm = machine.arm
        self._panel = Panel(machine, Box(style.WIDTH - style.PANEL_WIDTH, 0, style.WIDTH, style.HEIGHT))
        self._still = Canvas(style.WIDTH, style.HEIGHT, style.BACKGROUND)
        draw_task(self._still, self.view, task)
        draw_legend(self._still)
        draw_scale_bar(self._still, self.view)
        self._panel.draw_still(self._still)

    def draw(self, snapshot: Snapshot, trail: Array) -> Canvas:
        """Return a canvas with one state; ``trail`` holds past tip positions [m], shape (K, 2)."""
        canvas = self._still.copy()
        canvas.polyline(self.view.pixels(np.reshape(trail, (-1, 2))), style.TRAIL, 2.5)
        bars = [self.view.pixels(pivot) for pivot in five_bar(self._arm, snapshot.theta_a, snapshot.theta_b)]
        draw_arm(canvas, *bars)
        draw_force(canvas, self.view, bars[3], snapshot.force)
        self._panel.draw(canvas, snapshot)
        return canvas


def draw_task(canvas: Canvas, view: View, task: PathFollowing) -> None:
    """Draw the workspace, the path, and its start and end."""
    canvas.polygon(view.pixels(workspace(task.path, task.error_max)), style.WORKSPACE)
    points = view.pixels(path_points(task.path))
    canvas.polyline(points, style.PATH, 1.5)
    canvas.disc(points[0], 5, style.PATH)
    canvas.disc(points[0], 3, style.BACKGROUND)
    canvas.disc(points[-1], 5, style.PATH)


def draw_arm(canvas: Canvas, base: Array, elbow_a: Array, elbow_b: Array, tip: Array) -> None:
    """Draw the five bars from the pixels of their pivots."""
    draw_ground(canvas, base)
    canvas.bar(elbow_b, tip, 8, style.PARALLEL_A)
    canvas.bar(elbow_a, tip, 8, style.PARALLEL_B)
    canvas.bar(base, elbow_b, 13, style.LINK_B)
    canvas.bar(base, elbow_a, 13, style.LINK_A)
    for pivot in (base, elbow_a, elbow_b):
        canvas.disc(pivot, 6, style.INK)
        canvas.disc(pivot, 3.5, style.BACKGROUND)
    canvas.disc(tip, 8, style.INK)


def draw_ground(canvas: Canvas, base: Array) -> None:
    """Draw the housing of the drive, fixed to the ground."""
    canvas.disc(base, 20, style.GROOVE)


def draw_force(canvas: Canvas, view: View, tip: Array, force: Array) -> None:
    """Draw the hand's force [N] as an arrow from the tip [px], with its size."""
    size = math.hypot(*force)
    if size < SMALLEST_FORCE:
        return
    head = tip + view.scale * METRES_PER_NEWTON * force * (1.0, -1.0)
    canvas.polygon(arrow(tip, head, 5), style.FORCE)
    canvas.text(f"{size:.0f} N", (head[0], head[1] - 16), style.BODY, style.FORCE, "centre")


def draw_scale_bar(canvas: Canvas, view: View) -> None:
    """Draw a bar of known length into the scene's lower left corner."""
    left, y = style.MARGIN, style.HEIGHT - style.MARGIN - 6
    right = left + view.scale * _SCALE_BAR
    canvas.box(Box(left, y, right, y + 2), style.MUTED)
    canvas.text(f"{_SCALE_BAR:g} m", (0.5 * (left + right), y - 9), style.SMALL, style.MUTED, "centre")


def draw_legend(canvas: Canvas) -> None:
    """Name what is drawn, along the scene's upper edge."""
    x = style.MARGIN
    entries: list[tuple[str, Callable[[float], None]]] = [
        ("path", lambda at: canvas.box(Box(at, 23, at + 18, 25), style.PATH)),
        ("tip's trail", lambda at: canvas.box(Box(at, 22.5, at + 18, 25.5), style.TRAIL)),
        ("hand's force", lambda at: canvas.polygon(arrow(np.array([at, 24]), np.array([at + 18, 24]), 3), style.FORCE)),
        ("workspace", lambda at: canvas.box(Box(at, 17, at + 18, 31), style.WORKSPACE)),
    ]
    for name, draw in entries:
        draw(x)
        canvas.text(name, (x + 25, 24), style.BODY, style.INK)
        x += 25 + text_width(name, style.BODY) + 20
