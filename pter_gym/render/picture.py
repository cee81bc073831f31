"""The picture: the arm on its path to the left, the clutches to the right."""

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from pter_gym.params import Machine
from pter_gym.render import style
from pter_gym.render.canvas import Canvas
from pter_gym.render.geometry import Box, View, arrow, fit, five_bar, path_points, workspace, world_box
from pter_gym.render.panel import Panel
from pter_gym.render.snapshot import Snapshot
from pter_gym.tasks.path_following import PathFollowing

Array = NDArray[np.float64]

METRES_PER_NEWTON = 0.0016
"""Length of the force's arrow."""

SMALLEST_FORCE = 0.5
"""Forces below this [N] have no arrow."""

_LEFT = Box(0, 0, style.WIDTH - style.PANEL_WIDTH, style.HEIGHT)
_RIGHT = Box(style.WIDTH - style.PANEL_WIDTH, 0, style.WIDTH, style.HEIGHT)
_SCENE = Box(_LEFT.left + style.MARGIN, 52, _LEFT.right - style.MARGIN, _LEFT.high - style.MARGIN)
_SCALE_BAR = 0.1


class Picture:
    """Draws a machine at a task; what never changes is drawn once."""

    def __init__(self, machine: Machine, task: PathFollowing) -> None:
        self.view = fit(world_box(machine.arm, task.path, task.error_max), _SCENE)
        self._arm = machine.arm
        self._panel = Panel(machine, _RIGHT)
        self._still = Canvas(style.WIDTH, style.HEIGHT, style.BACKGROUND)
        draw_task(self._still, self.view, task)
        draw_legend(self._still)
        draw_scale_bar(self._still, self.view)
        self._panel.draw_still(self._still)

    def draw(self, snapshot: Snapshot, trail: Array) -> Canvas:
        """Return a canvas with one state; ``trail`` holds past tip positions [m], shape (K, 2)."""
        canvas = self._still.copy()
        canvas.clip(_LEFT)
        canvas.polyline(self.view.pixels(np.reshape(trail, (-1, 2))), style.TRAIL, 3)
        pivots = [self.view.pixels(pivot) for pivot in five_bar(self._arm, snapshot.theta_a, snapshot.theta_b)]
        draw_arm(canvas, *pivots)
        draw_force(canvas, self.view, pivots[3], snapshot.force)
        draw_handle(canvas, pivots[3])
        canvas.clip(_RIGHT)
        self._panel.draw(canvas, snapshot)
        return canvas


def draw_task(canvas: Canvas, view: View, task: PathFollowing) -> None:
    """Draw the workspace, the path, and its start and end."""
    outline = view.pixels(workspace(task.path, task.error_max))
    canvas.polygon(outline, style.WORKSPACE)
    canvas.polyline(np.vstack([outline, outline[:1]]), style.WORKSPACE_EDGE, 1)
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
    canvas.bar(base, elbow_b, 14, style.LINK_B)
    canvas.bar(base, elbow_a, 14, style.LINK_A)
    for pivot in (base, elbow_a, elbow_b):
        canvas.disc(pivot, 6, style.INK)
        canvas.disc(pivot, 3.5, style.BACKGROUND)
    draw_link_name(canvas, "A", base, elbow_a, tip)
    draw_link_name(canvas, "B", base, elbow_b, tip)


def draw_link_name(canvas: Canvas, name: str, base: Array, elbow: Array, tip: Array) -> None:
    """Write a link's name beside its middle, on the outer side of the mechanism."""
    link, diagonal = elbow - base, tip - base
    left = np.array([-link[1], link[0]]) / math.hypot(*link)
    inwards = 1.0 if left @ diagonal > 0.0 else -1.0
    at = base + 0.5 * link - 20 * inwards * left
    canvas.text(name, (at[0], at[1]), style.TITLE, style.INK, "centre")


def draw_ground(canvas: Canvas, base: Array) -> None:
    """Draw the stand of the drive on hatched ground."""
    x, y = base
    floor = y + 32
    canvas.polygon([(x - 9, y), (x + 9, y), (x + 20, floor), (x - 20, floor)], style.GROOVE)
    canvas.disc(base, 13, style.GROOVE)
    for left in range(-30, 30, 10):
        canvas.polyline(np.array([(x + left, floor + 8), (x + left + 8, floor)]), style.MUTED, 1)
    canvas.box(Box(x - 32, floor, x + 32, floor + 1.5), style.MUTED)


def draw_force(canvas: Canvas, view: View, tip: Array, force: Array) -> None:
    """Draw the hand's force [N] as an arrow from the tip [px], with its size."""
    size = math.hypot(*force)
    if size < SMALLEST_FORCE:
        return
    ahead = force / size * (1.0, -1.0)
    head = tip + view.scale * METRES_PER_NEWTON * size * ahead
    canvas.polygon(arrow(tip, head, 5), style.FORCE)
    at = head + (26, 14) * ahead
    canvas.text(f"{size:.0f} N", (at[0], at[1]), style.BODY, style.FORCE, "centre")


def draw_handle(canvas: Canvas, tip: Array) -> None:
    """Draw the handle at the tip."""
    canvas.disc(tip, 9, style.BACKGROUND)
    canvas.disc(tip, 7.5, style.INK)


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
        ("workspace", lambda at: draw_swatch(canvas, Box(at, 17, at + 18, 31))),
    ]
    for name, draw in entries:
        draw(x)
        canvas.text(name, (x + 25, 24), style.BODY, style.INK)
        x += 25 + canvas.text_width(name, style.BODY) + 20


def draw_swatch(canvas: Canvas, box: Box) -> None:
    """Draw a piece of the workspace for the legend."""
    canvas.box(box, style.WORKSPACE_EDGE)
    canvas.box(Box(box.left + 1, box.low + 1, box.right - 1, box.high - 1), style.WORKSPACE)
