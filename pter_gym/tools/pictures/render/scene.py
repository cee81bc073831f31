"""The scene: path and workspace, the arm, the hand's force. Strokes are drawn in a unit, 1 in the default picture."""

import math

import numpy as np
from numpy.typing import NDArray

from pter_gym.tasks.path_following import PathFollowing
from pter_gym.tools.pictures.render import style
from pter_gym.tools.pictures.render.canvas import Canvas, text_width
from pter_gym.tools.pictures.render.geometry import Box, View, arrow, path_points, workspace

Array = NDArray[np.float64]

METRES_PER_NEWTON = 0.0016
"""Length of the force's arrow."""

SMALLEST_FORCE = 0.5
"""Forces below this [N] have no arrow."""

SCALE_BAR = 0.1

LEGEND = {
    "path": style.PATH,
    "tip's trail": style.TRAIL,
    "hand's force": style.FORCE,
    "workspace": style.WORKSPACE_EDGE,
}


def draw_task(canvas: Canvas, view: View, task: PathFollowing, unit: float) -> None:
    """Draw the workspace, the path, and its start and end."""
    outline = view.pixels(workspace(task.path, task.error_max))
    canvas.polygon(outline, style.WORKSPACE)
    canvas.line(np.vstack([outline, outline[:1]]), style.WORKSPACE_EDGE, 1.0)
    points = view.pixels(path_points(task.path))
    canvas.line(points, style.PATH, max(1.5 * unit, 1.0))
    canvas.disc(points[0], 5 * unit, style.PATH)
    canvas.disc(points[0], 3 * unit, style.BACKGROUND)
    canvas.disc(points[-1], 5 * unit, style.PATH)


def draw_stand(canvas: Canvas, view: View, unit: float) -> None:
    """Draw the stand of the drive."""
    x, y = view.origin
    floor = y + 32 * unit
    canvas.polygon(
        np.array([(x - 9 * unit, y), (x + 9 * unit, y), (x + 20 * unit, floor), (x - 20 * unit, floor)]), style.GROOVE
    )
    canvas.disc(np.array([x, y]), 13 * unit, style.GROOVE)
    canvas.box(Box(x - 32 * unit, floor, x + 32 * unit, floor + 3 * unit), style.MUTED)


def draw_arm(canvas: Canvas, pivots: list[Array], unit: float, size: float) -> None:
    """Draw the five bars from the pixels of their pivots, and the links' names in a size [px], 0 for none."""
    base, elbow_a, elbow_b, tip = pivots
    canvas.bar(elbow_b, tip, 8 * unit, style.PARALLEL_A)
    canvas.bar(elbow_a, tip, 8 * unit, style.PARALLEL_B)
    for name, elbow, other, colour in (("B", elbow_b, elbow_a, style.LINK_B), ("A", elbow_a, elbow_b, style.LINK_A)):
        canvas.bar(base, elbow, 14 * unit, colour)
        if size:
            away = (base - other) / math.hypot(*(base - other))  # from the inside of the parallelogram
            x, y = 0.5 * (base + elbow) + (10 * unit + 0.6 * size) * away
            canvas.text(name, x, y, size, style.INK, "m")
    for pivot in (base, elbow_a, elbow_b):
        canvas.disc(pivot, 6 * unit, style.INK)
        canvas.disc(pivot, 3.5 * unit, style.BACKGROUND)


def draw_handle(canvas: Canvas, view: View, tip: Array, force: Array, unit: float, size: float) -> None:
    """Draw the hand's force [N] as an arrow from the tip [px] with its strength in a size [px], and the handle."""
    strength = math.hypot(*force)
    if strength >= SMALLEST_FORCE:
        ahead = force / strength * (1.0, -1.0)
        head = tip + view.scale * METRES_PER_NEWTON * strength * ahead
        canvas.polygon(arrow(tip, head, 5 * unit), style.FORCE)
        if size:
            upwards = np.array([ahead[1], -ahead[0]]) if ahead[0] > 0.0 else np.array([-ahead[1], ahead[0]])
            x, y = head + upwards * (1.6 * size, 1.2 * size)  # beside the arrow, not on the path ahead of it
            canvas.text(f"{strength:.0f} N", x, y, size, style.FORCE, "m")
    canvas.disc(tip, 9 * unit, style.BACKGROUND)
    canvas.disc(tip, 7.5 * unit, style.INK)


def draw_scale_bar(canvas: Canvas, view: View, x: float, y: float, size: float) -> None:
    """Draw a bar of known length with its left end at a point [px], and the length above it in a size [px]."""
    right = x + view.scale * SCALE_BAR
    canvas.box(Box(x, y - 2.0, right, y), style.MUTED)
    canvas.text(f"{SCALE_BAR:g} m", 0.5 * (x + right), y - size, size, style.MUTED, "m")


def draw_legend(canvas: Canvas, x: float, y: float, size: float) -> None:
    """Draw a legend in a row from a point [px], with text of a size [px]."""
    for name, colour in LEGEND.items():
        canvas.box(Box(x, y - 0.2 * size, x + 1.4 * size, y + 0.2 * size), colour)
        canvas.text(name, x + 1.9 * size, y, size, style.INK)
        x += 3.2 * size + text_width(name, size)
