"""The scene: path and workspace, the arm, the hand's force. Strokes are drawn in a unit, 1 in the default picture."""

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from pter_gym.render import style
from pter_gym.render.canvas import Canvas
from pter_gym.render.geometry import Box, View, arrow, path_points, workspace
from pter_gym.tasks.path_following import PathFollowing

Array = NDArray[np.float64]

METRES_PER_NEWTON = 0.0016
"""Length of the force's arrow."""

SMALLEST_FORCE = 0.5
"""Forces below this [N] have no arrow."""

_SCALE_BAR = 0.1


def draw_task(canvas: Canvas, view: View, task: PathFollowing, unit: float) -> None:
    """Draw the workspace, the path, and its start and end."""
    outline = view.pixels(workspace(task.path, task.error_max))
    canvas.polygon(outline, style.WORKSPACE)
    canvas.polyline(np.vstack([outline, outline[:1]]), style.WORKSPACE_EDGE, 1)
    points = view.pixels(path_points(task.path))
    canvas.polyline(points, style.PATH, max(1.5 * unit, 1.0))
    canvas.disc(points[0], 5 * unit, style.PATH)
    canvas.disc(points[0], 3 * unit, style.BACKGROUND)
    canvas.disc(points[-1], 5 * unit, style.PATH)


def draw_arm(canvas: Canvas, pivots: list[Array], unit: float) -> None:
    """Draw the five bars from the pixels of their pivots: base, elbow of A, elbow of B, tip."""
    base, elbow_a, elbow_b, tip = pivots
    draw_ground(canvas, base, unit)
    canvas.bar(elbow_b, tip, 8 * unit, style.PARALLEL_A)
    canvas.bar(elbow_a, tip, 8 * unit, style.PARALLEL_B)
    canvas.bar(base, elbow_b, 14 * unit, style.LINK_B)
    canvas.bar(base, elbow_a, 14 * unit, style.LINK_A)
    for pivot in (base, elbow_a, elbow_b):
        canvas.disc(pivot, 6 * unit, style.INK)
        canvas.disc(pivot, 3.5 * unit, style.BACKGROUND)


def draw_link_names(canvas: Canvas, pivots: list[Array], unit: float, size: float) -> None:
    """Write the names of the links, of a size [px]."""
    base, elbow_a, elbow_b, tip = pivots
    draw_link_name(canvas, "A", base, elbow_a, tip, unit, size)
    draw_link_name(canvas, "B", base, elbow_b, tip, unit, size)


def draw_link_name(canvas: Canvas, name: str, base: Array, elbow: Array, tip: Array, unit: float, size: float) -> None:
    """Write a link's name beside its middle, on the outer side of the mechanism."""
    link, diagonal = elbow - base, tip - base
    left = np.array([-link[1], link[0]]) / math.hypot(*link)
    inwards = 1.0 if left @ diagonal > 0.0 else -1.0
    at = base + 0.5 * link - (10 * unit + 0.5 * size) * inwards * left
    canvas.text(name, (at[0], at[1]), size, style.INK, "centre")


def draw_ground(canvas: Canvas, base: Array, unit: float) -> None:
    """Draw the stand of the drive on hatched ground."""
    x, y = base
    floor = y + 32 * unit
    foot = [(x - 9 * unit, y), (x + 9 * unit, y), (x + 20 * unit, floor), (x - 20 * unit, floor)]
    canvas.polygon(foot, style.GROOVE)
    canvas.disc(base, 13 * unit, style.GROOVE)
    for left in range(-30, 30, 10):
        hatch = [(x + left * unit, floor + 8 * unit), (x + (left + 8) * unit, floor)]
        canvas.polyline(np.array(hatch), style.MUTED, unit)
    canvas.box(Box(x - 32 * unit, floor, x + 32 * unit, floor + 1.5 * unit), style.MUTED)


def draw_force(canvas: Canvas, view: View, tip: Array, force: Array, unit: float, size: float) -> None:
    """Draw the hand's force [N] as an arrow from the tip [px], with its size in text of a size [px], 0 for none."""
    strength = math.hypot(*force)
    if strength < SMALLEST_FORCE:
        return
    ahead = force / strength * (1.0, -1.0)
    head = tip + view.scale * METRES_PER_NEWTON * strength * ahead
    canvas.polygon(arrow(tip, head, 5 * unit), style.FORCE)
    if size > 0.0:
        upwards = np.array([ahead[1], -ahead[0]]) if ahead[0] > 0.0 else np.array([-ahead[1], ahead[0]])
        at = head + upwards * (1.2 * size, size)  # beside the arrow, not on the path ahead of it
        canvas.text(f"{strength:.0f} N", (at[0], at[1]), size, style.FORCE, "centre")


def draw_handle(canvas: Canvas, tip: Array, unit: float) -> None:
    """Draw the handle at the tip."""
    canvas.disc(tip, 9 * unit, style.BACKGROUND)
    canvas.disc(tip, 7.5 * unit, style.INK)


def draw_scale_bar(canvas: Canvas, view: View, corner: tuple[float, float], unit: float) -> None:
    """Draw a bar of known length above the scene's lower left corner [px], with text in a unit."""
    left, y = corner[0], corner[1] - 6 * unit
    right = left + view.scale * _SCALE_BAR
    canvas.box(Box(left, y, right, y + 2 * unit), style.MUTED)
    canvas.text(f"{_SCALE_BAR:g} m", (0.5 * (left + right), y - 9 * unit), style.SMALL * unit, style.MUTED, "centre")


def draw_legend(canvas: Canvas, corner: tuple[float, float], unit: float) -> None:
    """Name what is drawn, in a row from a corner [px]."""
    x, y = corner[0], corner[1] + 8 * unit
    for name, swatch in _SWATCHES.items():
        swatch(canvas, Box(x, y - 7 * unit, x + 18 * unit, y + 7 * unit), unit)
        canvas.text(name, (x + 25 * unit, y), style.BODY * unit, style.INK)
        x += 45 * unit + canvas.text_width(name, style.BODY * unit)


def _middle(box: Box, half: float) -> Box:
    y = 0.5 * (box.low + box.high)
    return box._replace(low=y - half, high=y + half)


def _path_swatch(canvas: Canvas, box: Box, unit: float) -> None:
    canvas.box(_middle(box, unit), style.PATH)


def _trail_swatch(canvas: Canvas, box: Box, unit: float) -> None:
    canvas.box(_middle(box, 1.5 * unit), style.TRAIL)


def _force_swatch(canvas: Canvas, box: Box, unit: float) -> None:
    y = 0.5 * (box.low + box.high)
    canvas.polygon(arrow(np.array([box.left, y]), np.array([box.right, y]), 3 * unit), style.FORCE)


def _workspace_swatch(canvas: Canvas, box: Box, unit: float) -> None:
    canvas.box(box, style.WORKSPACE_EDGE)
    inside = Box(box.left + unit, box.low + unit, box.right - unit, box.high - unit)
    canvas.box(inside, style.WORKSPACE)


_SWATCHES: dict[str, Callable[[Canvas, Box, float], None]] = {
    "path": _path_swatch,
    "tip's trail": _trail_swatch,
    "hand's force": _force_swatch,
    "workspace": _workspace_swatch,
}
