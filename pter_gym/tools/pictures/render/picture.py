"""The picture: the arm on its path, its clutches below it; several pictures make a sheet."""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pter_gym.envs._size import TILE_HEIGHT, TILE_WIDTH
from pter_gym.params import Machine
from pter_gym.tasks.path_following import COLUMN, PathFollowing
from pter_gym.tools.pictures.render import scene, style
from pter_gym.tools.pictures.render.canvas import Canvas, text_width
from pter_gym.tools.pictures.render.geometry import Box, fit, five_bar, world_box
from pter_gym.tools.pictures.render.readings import Limits, draw_card, outcome, signed

Array = NDArray[np.float64]

TEXT_FROM = (240, 160)
"""Width and height [px] below which there is no room for text."""

LEGEND_FROM = 340
"""Height [px] from which there is a legend."""

STROKE_GROWTH = 0.7
"""Power of the size by which strokes grow: small pictures need broad ones."""

MARGIN, LINE, CARD, GAP = 16, 24, 62, 8
"""Edge of the drawing, heights of a line of text and of a clutch's card, and space between cards, in units of text."""


class Subject(NamedTuple):
    """The subject of a picture: a machine, its task, and a title, if any."""

    machine: Machine
    task: PathFollowing
    name: str = ""


class Picture:
    """Draws a subject in a size [px]; constant parts are drawn once."""

    def __init__(self, subject: Subject, width: int, height: int) -> None:
        machine, task, name = subject
        self._arm, self._limits = machine.arm, Limits.of(machine)
        self._has_text = width >= TEXT_FROM[0] and height >= TEXT_FROM[1]
        self._unit = unit = 0.9 * math.sqrt(min(width / TILE_WIDTH, height / TILE_HEIGHT))
        head = (2 if height >= LEGEND_FROM else 1) * LINE * unit
        self._panel = Box(0, height - (LINE + CARD + 2 * GAP) * unit, width, height)
        drawing = Box(MARGIN * unit, head, width - MARGIN * unit, self._panel.low - 0.5 * MARGIN * unit)
        if not self._has_text:
            margin = 0.03 * min(width, height)
            drawing = Box(margin, margin, width - margin, height - margin)
        self.view = fit(world_box(machine.arm, task.path, task.error_max), drawing)
        self._stroke = min(drawing.width / 508, drawing.height / 532) ** STROKE_GROWTH
        self._still = Canvas(width, height, style.BACKGROUND)
        scene.draw_task(self._still, self.view, task, self._stroke)
        scene.draw_stand(self._still, self.view, self._stroke)
        if self._has_text:
            size, left = style.TITLE * unit, drawing.left
            self._still.text(_cut(name, drawing.width - 64 * unit, size), left, 0.5 * LINE * unit, size, style.INK)
            scene.draw_scale_bar(self._still, self.view, left, drawing.high, style.SMALL * unit)
            if height >= LEGEND_FROM:
                scene.draw_legend(self._still, left, 1.5 * LINE * unit, min(style.BODY * unit, drawing.width / 32))

    def draw(self, row: Any, trail: Array) -> NDArray[np.uint8]:
        """Return a telemetry row, shape (len(TELEMETRY),), as pixels; ``trail`` holds past tips [m], shape (K, 2)."""
        canvas = self._still.copy()
        size = style.BODY * self._unit if self._has_text else 0.0
        canvas.line(self.view.pixels(np.reshape(trail, (-1, 2))), style.TRAIL, max(3 * self._stroke, 1.5))
        pivots = [self.view.pixels(pivot) for pivot in five_bar(self._arm, *map(float, row[[*COLUMN.theta]]))]
        scene.draw_arm(canvas, pivots, self._stroke, size)
        scene.draw_handle(canvas, self.view, pivots[3], row[[*COLUMN.force]], self._stroke, size)
        if self._has_text:
            self._draw_readings(canvas, row, size)
        return canvas.pixels()

    def _draw_readings(self, canvas: Canvas, row: Any, size: float) -> None:
        """Write the time above the scene; below it the error and the mode, and draw a card for each clutch."""
        left, top, right, bottom = self._panel
        gap, line, pad = GAP * self._unit, LINE * self._unit, MARGIN * self._unit
        canvas.text(f"{row[COLUMN.time]:.2f} s", right - pad, 0.5 * line, size, style.MUTED, "r")
        canvas.box(self._panel, style.PANEL)
        y, error = top + 0.5 * (gap + line), signed(1e3 * float(row[COLUMN.normal_error]))
        canvas.text(f"error {error} mm", pad, y, size, style.INK)
        canvas.text(outcome(row), right - pad, y, size, style.INK, "r")
        step = (right - left - gap) / 4
        for clutch in range(4):
            box = Box(left + gap + clutch * step, top + gap + line, left + (clutch + 1) * step, bottom - gap)
            draw_card(canvas, box, clutch, row, self._limits, self._unit)


class Sheet:
    """Pictures of subjects in a grid that fills ``width`` × ``height`` pixels, row by row."""

    def __init__(self, width: int, height: int, subjects: Sequence[Subject]) -> None:
        rows, columns = grid(len(subjects))
        x, y = (
            np.linspace(0, length, count + 1).round().astype(int)
            for length, count in ((width, columns), (height, rows))
        )
        self._size = width, height
        self._corners = [(x[k % columns], y[k // columns]) for k in range(len(subjects))]
        self._pictures = [
            Picture(subject, int(x[k % columns + 1] - x[k % columns]), int(y[k // columns + 1] - y[k // columns]))
            for k, subject in enumerate(subjects)
        ]

    def draw(self, states: Sequence[tuple[Array, Array]]) -> NDArray[np.uint8]:
        """Return the pictures of a telemetry row and a trail, (K, 2) [m], of each subject: (height, width, 3)."""
        width, height = self._size
        whole = np.full((height, width, 3), 255, np.uint8)
        for (left, top), picture, state in zip(self._corners, self._pictures, states, strict=True):
            pixels = picture.draw(*state)
            pixels[: 1 if top else 0] = pixels[:, : 1 if left else 0] = 227
            whole[top : top + len(pixels), left : left + pixels.shape[1]] = pixels
        return whole


def grid(count: int) -> tuple[int, int]:
    """Return rows and columns of a grid for that many pictures: up to three side by side, then about square."""
    columns = count if count <= 3 else math.ceil(math.sqrt(count))
    return -(-count // columns), columns


def _cut(text: str, room: float, size: float) -> str:
    """Return a text, or as much of its end as fits [px]."""
    while len(text) > 1 and text_width(text, size) > room:
        text = "…" + text.removeprefix("…")[1:]
    return text
