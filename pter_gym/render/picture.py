"""The picture: the arm on its path, and its clutches beside or below it; several pictures make a sheet."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pter_gym.params import Machine
from pter_gym.render import scene, style
from pter_gym.render.arrangement import HEADER, Arrangement, arrange, cells
from pter_gym.render.canvas import Align, Canvas
from pter_gym.render.clutches import readings
from pter_gym.render.geometry import Box, fit, five_bar, world_box
from pter_gym.render.panel import Panel
from pter_gym.render.snapshot import Snapshot
from pter_gym.render.strip import Strip
from pter_gym.tasks.path_following import PathFollowing

Array = NDArray[np.float64]

WHOLE = Box(0, 0, style.WIDTH, style.HEIGHT)


class Subject(NamedTuple):
    """What a picture is of: a machine at a task, and what it is called, if anything."""

    machine: Machine
    task: PathFollowing
    name: str = ""


class Picture:
    """Draws a subject into a box of the canvas [px]."""

    def __init__(self, machine: Machine, task: PathFollowing, box: Box = WHOLE, name: str = "") -> None:
        self._parts = arrange(box)
        self.view = fit(world_box(machine.arm, task.path, task.error_max), self._parts.drawing)
        self._arm, self._task, self._name = machine.arm, task, name
        self._beside = _beside(machine, self._parts)

    def draw_still(self, canvas: Canvas) -> None:
        """Draw what never changes."""
        parts = self._parts
        canvas.clip(parts.scene)
        scene.draw_task(canvas, self.view, self._task, parts.stroke)
        if parts.kind == "panel":
            self._write_name(canvas, (parts.drawing.right, parts.drawing.high - 8 * parts.text), "right")
        if parts.legend:
            top = parts.scene.low + (HEADER if parts.kind == "strip" else style.MARGIN) * parts.text
            scene.draw_legend(canvas, (parts.drawing.left, top), parts.legend)
        if parts.kind != "none":
            scene.draw_scale_bar(canvas, self.view, (parts.drawing.left, parts.drawing.high), parts.text)
        canvas.clip(parts.readings)
        if self._beside:
            self._beside.draw_still(canvas)

    def draw(self, canvas: Canvas, snapshot: Snapshot, trail: Array) -> None:
        """Draw one state; ``trail`` holds past tip positions [m], shape (K, 2)."""
        parts = self._parts
        written = parts.kind != "none"
        canvas.clip(parts.scene)
        canvas.polyline(self.view.pixels(np.reshape(trail, (-1, 2))), style.TRAIL, max(3 * parts.stroke, 1.5))
        pivots = [self.view.pixels(pivot) for pivot in five_bar(self._arm, snapshot.theta_a, snapshot.theta_b)]
        scene.draw_arm(canvas, pivots, parts.stroke)
        if written:
            scene.draw_link_names(canvas, pivots, parts.stroke, style.TITLE * parts.text)
        size = style.BODY * parts.text if written else 0.0
        scene.draw_force(canvas, self.view, pivots[3], snapshot.force, parts.stroke, size)
        scene.draw_handle(canvas, pivots[3], parts.stroke)
        if parts.kind == "strip":
            self._draw_header(canvas, readings(snapshot).time.value)
        canvas.clip(parts.readings)
        if self._beside:
            self._beside.draw(canvas, snapshot)

    def _draw_header(self, canvas: Canvas, time: str) -> None:
        """Write name and time above the scene of a tile."""
        parts = self._parts
        y = parts.scene.low + 0.5 * HEADER * parts.text
        canvas.text(time, (parts.drawing.right, y), style.BODY * parts.text, style.MUTED, "right")
        room = canvas.text_width(f"  {time}", style.BODY * parts.text)
        self._write_name(canvas, (parts.drawing.left, y), "left", room)

    def _write_name(self, canvas: Canvas, at: tuple[float, float], align: Align, taken: float = 0.0) -> None:
        """Write the name, or what there is room for of its end."""
        size = style.TITLE * self._parts.text
        room = self._parts.drawing.right - self._parts.drawing.left - taken
        text = self._name
        while len(text) > 1 and canvas.text_width(text, size) > room:
            text = "…" + text.removeprefix("…")[1:]
        canvas.text(text, at, size, style.INK, align)


class Sheet:
    """A canvas of ``width`` × ``height`` pixels with pictures of subjects; what never changes is drawn once."""

    def __init__(self, width: int, height: int, subjects: Sequence[Subject]) -> None:
        boxes = cells(width, height, len(subjects))
        self._pictures = [
            Picture(subject.machine, subject.task, box, subject.name)
            for subject, box in zip(subjects, boxes, strict=True)
        ]
        self._still = Canvas(width, height, style.BACKGROUND)
        for picture in self._pictures:
            picture.draw_still(self._still)
        self._still.clip(Box(0, 0, width, height))
        for box in boxes:
            if box.left > 0:
                self._still.box(Box(box.left - 0.5, box.low, box.left + 0.5, box.high), style.GROOVE)
            if box.low > 0:
                self._still.box(Box(box.left, box.low - 0.5, box.right, box.low + 0.5), style.GROOVE)

    def draw(self, states: Sequence[tuple[Snapshot, Array]]) -> Canvas:
        """Return a canvas with a state and a trail, (K, 2) [m], of each subject."""
        canvas = self._still.copy()
        for picture, (snapshot, trail) in zip(self._pictures, states, strict=True):
            picture.draw(canvas, snapshot, trail)
        return canvas


def _beside(machine: Machine, parts: Arrangement) -> Panel | Strip | None:
    """Return what draws the readings, if there is room for them."""
    if parts.kind == "none":
        return None
    return (Panel if parts.kind == "panel" else Strip)(machine, parts.readings, parts.text)
