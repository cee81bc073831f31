"""The picture of a world: the arm on its path, its clutches below it."""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pter_gym._physics.friction import ClutchMode
from pter_gym.envs._size import TILE_HEIGHT, TILE_WIDTH
from pter_gym.params import Machine
from pter_gym.tasks.path_following import COLUMN, PathFollowing
from pter_gym.tools.pictures import drawing as d
from pter_gym.tools.pictures.drawing import Array, Box, Canvas, fit, five_bar, text_width

MIN_SIZE_WITH_TEXT = (240, 160)
"""Width and height [px] below which there is no room for text."""

MIN_HEIGHT_WITH_LEGEND = 340

STROKE_GROWTH = 0.7
"""Power of the size by which strokes grow: small pictures need broad ones."""

MARGIN, LINE, CARD, GAP = 16, 24, 62, 8
"""Edge of the drawing, heights of a line of text and of a clutch's card, and space between cards, in units of text."""

METRES_PER_NEWTON, MIN_FORCE = 0.0016, 0.5
"""Length of the force's arrow, and the force [N] from which there is one."""

SCALE_BAR = 0.1

LEGEND = {"path": d.PATH, "tip's trail": d.TRAIL, "hand's force": d.FORCE, "workspace": d.WORKSPACE_EDGE}

MODE_NAMES = ("two DOF", *(f"one DOF ({x} stuck)" for x in range(1, 5)), "zero DOF")
"""The paper's dynamic modes (section III-A) in the order of ``ClutchMode``."""

BADGES = {
    "stuck": (d.INK, "#ffffff"),
    "slipping": ("#f6d7a0", d.INK),
    "released": (d.GROOVE, "#565d67"),
    "absent": (d.CARD, "#565d67"),
}
"""Colours of a clutch's states and of their names, which differ in lightness, so they need no colour vision."""


class Subject(NamedTuple):
    """The subject of a picture: a machine, its task, and a title, if any."""

    machine: Machine
    task: PathFollowing
    name: str = ""


class Picture:
    """Draws a subject in a size [px]; constant parts are drawn once."""

    def __init__(self, subject: Subject, width: int, height: int) -> None:
        self.subject, self._extent = subject, (width, height)
        machine, task, name = subject
        self._machine = machine
        self._has_text = width >= MIN_SIZE_WITH_TEXT[0] and height >= MIN_SIZE_WITH_TEXT[1]
        self._unit = unit = 0.9 * math.sqrt(min(width / TILE_WIDTH, height / TILE_HEIGHT))
        head = (2 if height >= MIN_HEIGHT_WITH_LEGEND else 1) * LINE * unit
        self._panel = Box(0, height - (LINE + CARD + 2 * GAP) * unit, width, height)
        scene = Box(MARGIN * unit, head, width - MARGIN * unit, self._panel.low - 0.5 * MARGIN * unit)
        if not self._has_text:
            margin = 0.03 * min(width, height)
            scene = Box(margin, margin, width - margin, height - margin)
        self.view = fit(d.world_box(machine.arm, task.path, task.error_max), scene)
        self._stroke = min(scene.width / 508, scene.height / 532) ** STROKE_GROWTH
        self._size = d.BODY * unit if self._has_text else 0.0
        self._background = Canvas.blank(width, height)
        self._draw_background(task)
        if self._has_text:
            self._draw_captions(name, scene, height >= MIN_HEIGHT_WITH_LEGEND)
        curves = (machine.clutch.breakaway, machine.clutch.dynamic)
        self._torque_max = max(curve.torque(machine.clutch.voltage_max) for curve in curves)

    def draw(self, row: Any, trail: Array) -> NDArray[np.uint8]:
        """Return a telemetry row, shape (len(TELEMETRY),), as pixels; ``trail`` holds past tips [m], shape (K, 2)."""
        canvas = self._background.copy()
        canvas.line(self.view.pixels(np.reshape(trail, (-1, 2))), d.TRAIL, max(3 * self._stroke, 1.5))
        pivots = [self.view.pixels(pivot) for pivot in five_bar(self._machine.arm, *map(float, row[[*COLUMN.theta]]))]
        self._draw_arm(canvas, pivots)
        self._draw_handle(canvas, pivots[3], row[[*COLUMN.force]])
        if self._has_text:
            self._draw_readings(canvas, row)
        return canvas.pixels()

    def __reduce__(self) -> tuple[Any, ...]:
        return Picture, (self.subject, *self._extent)

    def _draw_background(self, task: PathFollowing) -> None:
        """Draw the workspace, the path with its start and end, and the stand of the drive."""
        canvas, unit = self._background, self._stroke
        outline = self.view.pixels(d.workspace(task.path, task.error_max))
        canvas.polygon(outline, d.WORKSPACE)
        canvas.line(np.vstack([outline, outline[:1]]), d.WORKSPACE_EDGE, 1.0)
        points = self.view.pixels(d.path_points(task.path))
        canvas.line(points, d.PATH, max(1.5 * unit, 1.0))
        canvas.ring(points[0], 5 * unit, 2 * unit, d.PATH)
        canvas.disc(points[-1], 5 * unit, d.PATH)
        x, y = self.view.origin
        floor = y + 32 * unit
        canvas.polygon([(x - 9 * unit, y), (x + 9 * unit, y), (x + 20 * unit, floor), (x - 20 * unit, floor)], d.GROOVE)
        canvas.disc(np.array([x, y]), 13 * unit, d.GROOVE)
        canvas.box(Box(x - 32 * unit, floor, x + 32 * unit, floor + 3 * unit), d.MUTED)

    def _draw_captions(self, name: str, scene: Box, has_legend: bool) -> None:
        """Write the title, a scale bar and, where there is room, a legend."""
        canvas, unit, x = self._background, self._unit, scene.left
        title, small = d.TITLE * unit, d.SMALL * unit
        canvas.text(_cut(name, scene.width - 64 * unit, title), x, 0.5 * LINE * unit, title, d.INK)
        right = x + self.view.scale * SCALE_BAR
        canvas.box(Box(x, scene.high - 2.0, right, scene.high), d.MUTED)
        canvas.text(f"{SCALE_BAR:g} m", 0.5 * (x + right), scene.high - small, small, d.MUTED, "m")
        size, y = min(self._size, scene.width / 32), 1.5 * LINE * unit
        for text, colour in LEGEND.items() if has_legend else ():
            canvas.box(Box(x, y - 0.2 * size, x + 1.4 * size, y + 0.2 * size), colour)
            canvas.text(text, x + 1.9 * size, y, size, d.INK)
            x += 3.2 * size + text_width(text, size)

    def _draw_arm(self, canvas: Canvas, pivots: list[Array]) -> None:
        """Draw the five bars from the pixels of their pivots, and the links' names."""
        base, elbow_a, elbow_b, tip = pivots
        unit, size = self._stroke, self._size
        canvas.bar(elbow_b, tip, 8 * unit, d.PARALLEL_A)
        canvas.bar(elbow_a, tip, 8 * unit, d.PARALLEL_B)
        for name, elbow, other, colour in (("B", elbow_b, elbow_a, d.LINK_B), ("A", elbow_a, elbow_b, d.LINK_A)):
            canvas.bar(base, elbow, 14 * unit, colour)
            if size:
                away = (base - other) / math.hypot(*(base - other))  # from the inside of the parallelogram
                x, y = 0.5 * (base + elbow) + (10 * unit + 0.6 * size) * away
                canvas.text(name, x, y, size, d.INK, "m")
        for pivot in (base, elbow_a, elbow_b):
            canvas.ring(pivot, 6 * unit, 2.5 * unit, d.INK)

    def _draw_handle(self, canvas: Canvas, tip: Array, force: Array) -> None:
        """Draw the hand's force [N] as an arrow from the tip [px] with its strength, and the handle."""
        unit, size, strength = self._stroke, self._size, math.hypot(*force)
        if strength >= MIN_FORCE:
            ahead = force / strength * (1.0, -1.0)
            head = tip + self.view.scale * METRES_PER_NEWTON * strength * ahead
            canvas.arrow(tip, head, 5 * unit, d.FORCE)
            if size:
                upwards = np.array([ahead[1], -ahead[0]]) if ahead[0] > 0.0 else np.array([-ahead[1], ahead[0]])
                x, y = head + upwards * (1.6 * size, 1.2 * size)  # beside the arrow, not on the path ahead of it
                canvas.text(f"{strength:.0f} N", x, y, size, d.FORCE, "m")
        canvas.disc(tip, 9 * unit, d.BACKGROUND)
        canvas.disc(tip, 7.5 * unit, d.INK)

    def _draw_readings(self, canvas: Canvas, row: Any) -> None:
        """Write the time above the scene; below it the error and the mode, and draw a card for each clutch."""
        left, top, right, bottom = self._panel
        size, gap, line, pad = self._size, GAP * self._unit, LINE * self._unit, MARGIN * self._unit
        canvas.text(f"{row[COLUMN.time]:.2f} s", right - pad, 0.5 * line, size, d.MUTED, "r")
        canvas.box(self._panel, d.PANEL)
        y, error = top + 0.5 * (gap + line), _signed(1e3 * float(row[COLUMN.normal_error]))
        canvas.text(f"error {error} mm", pad, y, size, d.INK)
        canvas.text(outcome(row), right - pad, y, size, d.INK, "r")
        step, states = (right - left - gap) / 4, clutch_states(row, self._machine)
        for clutch, state in enumerate(states):
            box = Box(left + gap + clutch * step, top + gap + line, left + (clutch + 1) * step, bottom - gap)
            self._draw_card(canvas, box, clutch, state, row)

    def _draw_card(self, canvas: Canvas, box: Box, clutch: int, state: str, row: Any) -> None:
        """Draw a clutch's state, and voltage and torque as bars and numbers."""
        unit, (fill, ink) = self._unit, BADGES[state]
        volts, torque = float(row[COLUMN.volts[clutch]]), float(row[COLUMN.torque[clutch]])
        canvas.box(box, d.CARD, 5 * unit)
        left, right, line = box.left + 4 * unit, box.right - 4 * unit, box.height / 3
        canvas.box(Box(left, box.low + 0.2 * line, right, box.low + 0.95 * line), fill, 4 * unit)
        canvas.text(f"{clutch + 1} {state}", 0.5 * (left + right), box.low + 0.58 * line, d.SMALL * unit, ink, "m")
        bars = (
            (0.0, volts / self._machine.clutch.voltage_max, d.VOLTS, f"{volts:.1f} V"),
            (0.5, torque / self._torque_max, d.TORQUE, f"{_signed(torque)} N·m"),
        )
        for place, (zero, share, colour, text) in enumerate(bars):
            y = box.low + (1.45 + 0.9 * place) * line
            canvas.text(text, right, y, d.SMALL * unit, d.INK, "r")
            groove = Box(left, y - 4 * unit, right - 60 * unit, y + 4 * unit)
            canvas.box(groove, d.GROOVE)
            parts = (zero, zero + (1.0 - zero) * min(max(share, -1.0), 1.0))
            start, end = (groove.left + part * groove.width for part in parts)
            canvas.box(groove._replace(left=min(start, end), right=max(start, end)), colour)
            canvas.box(Box(start - 0.5, groove.low - 2 * unit, start + 0.5, groove.high + 2 * unit), d.MUTED)


def outcome(row: Any) -> str:
    """Return the dynamic mode, or how the episode ended."""
    if row[COLUMN.terminated]:
        return "arrived" if row[COLUMN.is_success] else "left the workspace"
    return MODE_NAMES[int(row[COLUMN.mode])]


def clutch_states(row: Any, machine: Machine) -> list[str]:
    """Return the state of each of the four clutches; one without voltage and torque is released, even at rest."""
    slots = zip(machine.slot_rows, machine.slot_scale, strict=True)
    rows = [slip if scale > 0.0 else None for slip, scale in slots]
    idle = (row[[*COLUMN.volts]] == 0.0) & (row[[*COLUMN.torque]] == 0.0)
    mode = int(row[COLUMN.mode])
    stuck = rows[mode - 1] if ClutchMode.TWO_DOF < mode < ClutchMode.ZERO_DOF else None
    held = [mode == ClutchMode.ZERO_DOF or each == stuck for each in rows]
    states = ["released" if idle[x] else "stuck" if held[x] else "slipping" for x in range(4)]
    return ["absent" if each is None else state for each, state in zip(rows, states, strict=True)]


def _signed(value: float) -> str:
    """Return a number with one digit and its sign, or 0.0 without one."""
    return f"{value:+.1f}".replace("-", "−") if round(value, 1) else "0.0"


def _cut(text: str, room: float, size: float) -> str:
    """Return a text, or as much of its end as fits [px]."""
    while len(text) > 1 and text_width(text, size) > room:
        text = "…" + text.removeprefix("…")[1:]
    return text
