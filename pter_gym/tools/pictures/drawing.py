"""The picture of a world: the arm on its path, its clutches below it.

Drawn with Pillow, which takes milliseconds.
"""

import math
from collections.abc import Iterable
from functools import cache, lru_cache
from importlib.util import find_spec
from itertools import cycle
from pathlib import Path as FilePath
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from PIL import Image, ImageDraw, ImageFont

from pter_gym._physics.friction import ClutchMode
from pter_gym.benchmark.cells import shorten
from pter_gym.controllers import CONTROLLERS
from pter_gym.params import Arm, Machine
from pter_gym.paths import Path
from pter_gym.policies import shipped_policies
from pter_gym.policies.tuned import SCALED, tuned_policies
from pter_gym.tasks.path_following import COLUMN, PathFollowing
from pter_gym.tools import palette
from pter_gym.tools.pictures.size import TILE_HEIGHT, TILE_WIDTH

Array = NDArray[np.float64]

BACKGROUND, PANEL, CARD, GROOVE = "#ffffff", "#f3f4f6", "#ffffff", "#e3e5e9"
INK, MUTED = "#1f2328", "#646b75"
WORKSPACE, WORKSPACE_EDGE, FREE, FREE_EDGE = "#eff5fb", "#d3e3f1", "#dcefe0", "#a9d6b3"
PATH = "#3b4048"
LINK_A, LINK_B, FORCE, TRAIL = palette.PICTURE.values()
LEGEND = {
    "path": PATH,
    "tip's trail": TRAIL,
    "hand's force": FORCE,
    "free band": FREE_EDGE,
    "workspace": WORKSPACE_EDGE,
}
"""Entries of the legend; those that find no room are left out from the end."""

LAST = "universal"
"""The policy that has what is left, so the others keep theirs."""

DRAWN_POLICIES = (*sorted(shipped_policies(), reverse=True), *tuned_policies(), *CONTROLLERS)
_OTHERS = [name for name in DRAWN_POLICIES if name not in (LAST, SCALED)]
POLICY_COLOURS = dict(zip((*_OTHERS, LAST), palette.POLICY_PALETTE, strict=False))
"""Colours of the package's policies in all pictures."""

BADGES = {
    "stuck": (INK, "#ffffff"),
    "slipping": ("#f6d7a0", INK),
    "released": (GROOVE, "#565d67"),
    "absent": (CARD, "#565d67"),
}
"""Colours of a clutch's states and of their names; they differ in lightness, too."""

TITLE, BODY, SMALL, MIN_TEXT = 14, 12, 11, 10
"""Sizes of text [px at the default size]; the smallest legible one [px]."""

MIN_SIZE_WITH_TEXT, MIN_HEIGHT_WITH_LEGEND, MIN_WIDTH_WITH_BARS = (240, 160), 340, 480
"""Sizes [px] below which there is no text, no legend, and no voltage and torque of a clutch."""

MARGIN, LINE, STATE_HEIGHT, BARS_HEIGHT, GAP = 16, 24, 26, 36, 8
"""Edge, heights of a line of text, of a clutch's state and of its bars, space between clutches, in
units of text."""

SUPERSAMPLING = 2
"""A canvas is drawn larger by this factor, then reduced, which smooths its edges."""

STROKE_GROWTH = 0.7
"""Power of the size by which strokes grow: small pictures need broad ones."""

METRES_PER_NEWTON, MIN_FORCE = 0.0016, 0.5
"""Length of the force's arrow, and the force [N] from which there is one."""

HUB, SCALE_BAR = 0.08, 0.1
"""Half the width of the drive and its stand [m], and the length of the scale bar [m]."""

MODE_NAMES = ("moves freely", *("moves along one line",) * 4, "held")
"""What the paper's dynamic modes (section III-A) let the tip do, in the order of ``ClutchMode``."""


# --- the mechanism and its workspace, in metres ---


class FiveBar(NamedTuple):
    """Pivots of the mechanism in the world, each an array (2,) [m]; the fifth bar is the ground.

    The drive turns both cranks about one axis at the origin: link A to ``elbow_a`` and link B to
    ``elbow_b``. A bar parallel to B leads from ``elbow_a`` to the tip, a bar parallel to A from
    ``elbow_b``.
    """

    base: Array
    elbow_a: Array
    elbow_b: Array
    tip: Array


def policy_colours(names: Iterable[str]) -> dict[str, str]:
    """Return a colour for each policy: the package's have their own, all others what is left."""
    every = sorted(set(names))
    taken = {POLICY_COLOURS[name] for name in every if name in POLICY_COLOURS}
    others = cycle(colour for colour in palette.POLICY_PALETTE if colour not in taken)
    return {name: POLICY_COLOURS.get(name) or next(others) for name in every}


def five_bar(arm: Arm, theta_a: float, theta_b: float) -> FiveBar:
    """Return the pivots at absolute link angles [rad]."""
    elbow_a = arm.length_a * np.array([math.cos(theta_a), math.sin(theta_a)])
    elbow_b = arm.length_b * np.array([math.cos(theta_b), math.sin(theta_b)])
    return FiveBar(np.zeros(2), elbow_a, elbow_b, elbow_a + elbow_b)


def workspace(task: PathFollowing) -> Array:
    """Return the outline of the workspace [m], shape (K, 2): all points within the largest error.

    It reaches back from the start of the path by the same distance.
    """
    error = task.error_max
    return band(task.path, error + task.free_right, error + task.free_left, error)


def band(path: Path, right: float, left: float, behind: float = 0.0) -> Array:
    """Return the outline [m], shape (K, 2), of a band along a path from ``behind`` its start."""
    sampled = path.arcs.at(np.linspace(0.0, path.length, 129))
    x, y, heading, _ = (np.append(each[0], each) for each in sampled)
    x[0] -= behind * np.cos(heading[0])
    y[0] -= behind * np.sin(heading[0])
    points, normal = np.stack([x, y], axis=1), np.stack([-np.sin(heading), np.cos(heading)], axis=1)
    return np.vstack([points + left * normal, (points - right * normal)[::-1]])


def has_band(task: PathFollowing) -> bool:
    """Return whether the tip is free within a band along the path."""
    return task.free_left + task.free_right > 0.0


class Box(NamedTuple):
    """A rectangle by its edges: metres in the world (y up) or pixels on the screen (y down)."""

    left: float
    low: float
    right: float
    high: float


class View(NamedTuple):
    """World to screen: ``scale`` in pixels per metre, ``origin`` the pixel of the drive's axis."""

    scale: float
    origin: tuple[float, float]

    def pixels(self, points: ArrayLike) -> Array:
        """Return the pixels of points in the world [m], shape (2,) or (K, 2); not rounded."""
        return np.asarray(points, np.float64) * (self.scale, -self.scale) + self.origin


def fit(task: PathFollowing, arm: Arm, screen: Box) -> View:
    """Return the view that fits drive, workspace, and elbows to either side into a box [px]."""
    x, y = task.path.point(0.5 * task.path.length)
    sideways = max(arm.length_a, arm.length_b) / max(math.hypot(x, y), HUB) * np.array([-y, x])
    corners = np.vstack([workspace(task), [[-HUB, -HUB], [HUB, HUB]], sideways, -sideways])
    (left, low), (right, high) = corners.min(axis=0).tolist(), corners.max(axis=0).tolist()
    scale = min(
        (screen.right - screen.left) / (right - left), (screen.high - screen.low) / (high - low)
    )
    x, y = 0.5 * (screen.left + screen.right), 0.5 * (screen.low + screen.high)
    return View(scale, (x - 0.5 * scale * (left + right), y + 0.5 * scale * (low + high)))


# --- the canvas ---


class Canvas:
    """A picture to draw on; coordinates are pixels from its top left corner."""

    def __init__(self, image: Image.Image) -> None:
        self._image = image
        self._draw = ImageDraw.Draw(image)

    @classmethod
    def blank(cls, width: int, height: int) -> "Canvas":
        """Return a blank canvas of a size [px]."""
        return cls(Image.new("RGB", (SUPERSAMPLING * width, SUPERSAMPLING * height), BACKGROUND))

    def copy(self) -> "Canvas":
        """Return an independent canvas with the same picture."""
        return Canvas(self._image.copy())

    def pixels(self) -> NDArray[np.uint8]:
        """Return the picture as a new array, shape (height, width, 3)."""
        return np.array(self._image.reduce(SUPERSAMPLING))

    def polygon(self, points: ArrayLike, colour: str) -> None:
        """Fill a polygon, points (K, 2)."""
        self._draw.polygon(_enlarged(points), colour)

    def line(self, points: Array, colour: str, width: float) -> None:
        """Draw a line through points (K, 2) in pieces of at least two pixels; one draws none."""
        if len(points) > 2:
            travelled = np.cumsum(np.hypot(*np.diff(points, axis=0).T))
            kept = np.diff(np.floor(0.5 * travelled), prepend=0.0) > 0.0
            kept[-1] = True
            points = np.vstack([points[:1], points[1:][kept]])
        if len(points) > 1:
            self._draw.line(_enlarged(points), colour, max(round(SUPERSAMPLING * width), 1))

    def disc(self, centre: Array, radius: float, colour: str) -> None:
        """Fill a circle."""
        self._draw.ellipse(_enlarged([centre - radius, centre + radius]), colour)

    def ring(self, centre: Array, radius: float, thickness: float, colour: str) -> None:
        """Draw a circle of a colour with the background inside."""
        self.disc(centre, radius, colour)
        self.disc(centre, radius - thickness, BACKGROUND)

    def bar(self, start: Array, end: Array, width: float, colour: str) -> None:
        """Fill a bar with round ends between two points."""
        self._draw.line(_enlarged([start, end]), colour, round(SUPERSAMPLING * width))
        self.disc(start, 0.5 * width, colour)
        self.disc(end, 0.5 * width, colour)

    def arrow(self, tail: Array, ahead: Array, length: float, width: float, colour: str) -> None:
        """Fill an arrow in a direction, a unit vector, with a shaft of a given width."""
        left = np.array([-ahead[1], ahead[0]])
        head, neck = tail + length * ahead, tail + max(length - 3.5 * width, 0.0) * ahead
        shaft, barb = 0.5 * width * left, 1.75 * width * left
        one_side = [tail + shaft, neck + shaft, neck + barb]
        other_side = [neck - barb, neck - shaft, tail - shaft]
        self.polygon([*one_side, head, *other_side], colour)

    def box(
        self, left: float, low: float, right: float, high: float, colour: str, radius: float = 0.0
    ) -> None:
        """Fill a rectangle, with round corners if ``radius`` is positive."""
        left, low, right, high = (round(SUPERSAMPLING * edge) for edge in (left, low, right, high))
        if right > left and high > low:
            self._draw.rounded_rectangle(
                (left, low, right - 1, high - 1), SUPERSAMPLING * radius, colour
            )

    def text(
        self,
        text: str,
        x: float,
        y: float,
        size: float,
        colour: str,
        align: Literal["l", "m", "r"] = "l",
    ) -> None:
        """Write a line of text around the height ``y``; its left, middle or right is at ``x``."""
        self._draw.text(
            (SUPERSAMPLING * x, SUPERSAMPLING * y), drawable(text), colour, _font(size), f"{align}m"
        )


def _enlarged(points: ArrayLike) -> list[float]:
    return (SUPERSAMPLING * np.asarray(points)).ravel().tolist()


def text_width(text: str, size: float) -> float:
    """Return the width of a line of text [px]."""
    return _font(size).getlength(drawable(text)) / SUPERSAMPLING


def shortened(name: str, size: float, width: float) -> str:
    """Return a name, without its middle if it is wider than ``width`` [px]."""
    text = shown = drawable(name)
    kept = len(text)
    while kept > 3 and text_width(shown, size) > width:
        kept -= 1
        shown = shorten(text, kept)
    return shown


def apart(places: Array, line: float, most: float) -> Array:
    """Return ascending places of labels, moved a ``line`` apart and, if they fit, to ``most``."""
    lines = line * np.arange(len(places))
    return np.minimum(np.maximum.accumulate(places - lines) + lines, most + lines - lines[-1])


def drawable(text: str) -> str:
    r"""Return text in which characters that the typeface lacks are escaped, such as ``\u65e5``."""
    return "".join(
        each if _has(each) else each.encode("ascii", "backslashreplace").decode() for each in text
    )


@cache
def _has(character: str) -> bool:
    """Return whether the typeface has a character; it draws the same box for all others."""
    if character.isascii():
        return True
    if not character.isprintable():  # such as half a surrogate pair, in a name that is no UTF-8
        return False
    font: Any = _font(BODY)
    return bytes(font.getmask(character)) != bytes(font.getmask("\uffff"))


@lru_cache
def _font(size: float) -> ImageFont.FreeTypeFont:
    """Load the typeface of the figures from Matplotlib's files, without importing Matplotlib."""
    package: Any = find_spec("matplotlib")
    fonts = FilePath(package.origin).parent / "mpl-data" / "fonts" / "ttf"
    return ImageFont.truetype(fonts / "DejaVuSans.ttf", round(SUPERSAMPLING * max(size, MIN_TEXT)))


# --- the picture ---


class Subject(NamedTuple):
    """The subject of a picture: a machine, its task, and a title, if any."""

    machine: Machine
    task: PathFollowing
    name: str = ""


class Picture:
    """Draws a subject in a size [px]; constant parts are drawn once."""

    def __init__(self, subject: Subject, width: int, height: int) -> None:
        self.subject, self._extent = subject, (width, height)
        self._machine, task, name = subject
        has_text = width >= MIN_SIZE_WITH_TEXT[0] and height >= MIN_SIZE_WITH_TEXT[1]
        self._unit = unit = 0.9 * math.sqrt(min(width / TILE_WIDTH, height / TILE_HEIGHT))
        self._has_bars = width >= MIN_WIDTH_WITH_BARS
        card = STATE_HEIGHT + BARS_HEIGHT * self._has_bars
        self._panel = Box(0, height - (LINE + card + 2 * GAP) * unit, width, height)
        margin = 0.03 * min(width, height)
        scene = Box(margin, margin, width - margin, height - margin)
        has_legend = has_text and height >= MIN_HEIGHT_WITH_LEGEND
        if has_text:
            margin = MARGIN * unit
            top, bottom = (1 + has_legend) * LINE * unit, self._panel.low - 0.5 * margin
            scene = Box(margin, top, width - margin, bottom)
        self.view = fit(task, self._machine.arm, scene)
        room = min((scene.right - scene.left) / 508, (scene.high - scene.low) / 532)
        self._stroke = room**STROKE_GROWTH
        self._size = BODY * unit * has_text
        self._background = Canvas.blank(width, height)
        self._draw_background(task)
        if has_text:
            self._draw_captions(name, scene)
        if has_legend:
            self._draw_legend(scene, has_band(task))
        self._torque_max = max(self._machine.clutch.largest)

    def draw(self, row: Any, trail: Array) -> NDArray[np.uint8]:
        """Return a telemetry row as pixels; ``trail`` holds past tips [m], shape (K, 2)."""
        canvas = self._background.copy()
        canvas.line(self.view.pixels(np.reshape(trail, (-1, 2))), TRAIL, max(3 * self._stroke, 1.5))
        pivots = self.view.pixels(five_bar(self._machine.arm, *row[[*COLUMN.theta]].tolist()))
        self._draw_arm(canvas, pivots)
        self._draw_handle(canvas, pivots[3], row[[*COLUMN.force]])
        if self._size:
            self._draw_readings(canvas, row)
        return canvas.pixels()

    def __reduce__(self) -> tuple[Any, ...]:
        return Picture, (self.subject, *self._extent)

    def _draw_background(self, task: PathFollowing) -> None:
        """Draw the workspace, the path with its start and end, and the stand of the drive."""
        canvas, unit = self._background, self._stroke
        outlines = [(workspace(task), WORKSPACE, WORKSPACE_EDGE)]
        if has_band(task):
            free = band(task.path, task.free_right, task.free_left)
            outlines.append((free, FREE, FREE_EDGE))
        for outline, fill, edge in outlines:
            points = self.view.pixels(outline)
            canvas.polygon(points, fill)
            canvas.line(np.vstack([points, points[:1]]), edge, 1.0)
        points = self.view.pixels(task.path.sampled(129))
        canvas.line(points, PATH, max(1.5 * unit, 1.0))
        canvas.ring(points[0], 5 * unit, 2 * unit, PATH)
        canvas.disc(points[-1], 5 * unit, PATH)
        x, y = self.view.origin
        floor = y + 32 * unit
        canvas.polygon(
            [(x - 9 * unit, y), (x + 9 * unit, y), (x + 20 * unit, floor), (x - 20 * unit, floor)],
            GROOVE,
        )
        canvas.disc(np.array([x, y]), 13 * unit, GROOVE)
        canvas.box(x - 32 * unit, floor, x + 32 * unit, floor + 3 * unit, MUTED)

    def _draw_captions(self, name: str, scene: Box) -> None:
        """Write the title and a scale bar."""
        canvas, unit, x = self._background, self._unit, scene.left
        title, small = TITLE * unit, SMALL * unit
        canvas.text(
            shortened(name, title, scene.right - x - 64 * unit), x, 0.5 * LINE * unit, title, INK
        )
        right = x + self.view.scale * SCALE_BAR
        canvas.box(x, scene.high - 2.0, right, scene.high, MUTED)
        canvas.text(f"{SCALE_BAR:g} m", 0.5 * (x + right), scene.high - small, small, MUTED, "m")

    def _draw_legend(self, scene: Box, has_band: bool) -> None:
        """Name the colours below the title, as far as there is room."""
        canvas, x, y = self._background, scene.left, 1.5 * LINE * self._unit
        size = min(self._size, (scene.right - x) / 32)
        for text, colour in LEGEND.items():
            end = x + 1.9 * size + text_width(text, size)
            if end <= scene.right and (has_band or colour != FREE_EDGE):
                canvas.box(x, y - 0.2 * size, x + 1.4 * size, y + 0.2 * size, colour)
                canvas.text(text, x + 1.9 * size, y, size, INK)
                x = end + 1.3 * size

    def _draw_arm(self, canvas: Canvas, pivots: Array) -> None:
        """Draw the five bars from the pixels of their pivots, and the links' names."""
        base, elbow_a, elbow_b, tip = pivots
        unit, size = self._stroke, self._size
        canvas.bar(elbow_b, tip, 8 * unit, palette.tint(LINK_A))
        canvas.bar(elbow_a, tip, 8 * unit, palette.tint(LINK_B))
        links = ("B", elbow_b, elbow_a, LINK_B), ("A", elbow_a, elbow_b, LINK_A)
        for name, elbow, other, colour in links:
            canvas.bar(base, elbow, 14 * unit, colour)
            if size:
                away = (base - other) / math.hypot(*(base - other))  # out of the parallelogram
                x, y = 0.5 * (base + elbow) + (10 * unit + 0.6 * size) * away
                canvas.text(name, x, y, size, INK, "m")
        for pivot in (base, elbow_a, elbow_b):
            canvas.ring(pivot, 6 * unit, 2.5 * unit, INK)

    def _draw_handle(self, canvas: Canvas, tip: Array, force: Array) -> None:
        """Draw the handle at the tip [px], and the hand's force [N] as an arrow."""
        unit, size, strength = self._stroke, self._size, math.hypot(*force)
        if strength >= MIN_FORCE:
            ahead = force / strength * (1.0, -1.0)
            length = self.view.scale * METRES_PER_NEWTON * strength
            canvas.arrow(tip, ahead, length, 5 * unit, FORCE)
            if size:
                upwards = np.array([ahead[1], -ahead[0]]) * math.copysign(1.0, ahead[0])
                beside = upwards * (1.6 * size, 1.2 * size)  # the path ahead
                text = f"{strength:.0f} N"
                room = 0.5 * np.array([text_width(text, size), size])
                edge = np.array([self._extent[0], self._panel.low])
                x, y = np.clip(tip + length * ahead + beside, room, edge - room)
                canvas.text(text, x, y, size, FORCE, "m")
        canvas.disc(tip, 9 * unit, BACKGROUND)
        canvas.disc(tip, 7.5 * unit, INK)

    def _draw_readings(self, canvas: Canvas, row: Any) -> None:
        """Write the time above the scene, error and outcome below it; draw each clutch's card."""
        left, top, right, bottom = self._panel
        size, unit = self._size, self._unit
        gap, line, margin = GAP * unit, LINE * unit, MARGIN * unit
        canvas.text(f"{row[COLUMN.time]:.2f} s", right - margin, 0.5 * line, size, MUTED, "r")
        canvas.box(left, top, right, bottom, PANEL)
        y = top + 0.5 * (gap + line)
        error = 1e3 * float(row[COLUMN.normal_error])
        if row[COLUMN.is_success]:
            text = f"arrived {abs(error):.1f} mm off {aim(self.subject.task)}"
            canvas.text(text, margin, y, size, INK)
        else:
            canvas.text(f"error {_signed(error)} mm", margin, y, size, INK)
            canvas.text(outcome(row), right - margin, y, size, INK, "r")
        step = (right - left - gap) / 4
        for clutch, state in enumerate(clutch_states(row, self._machine)):
            x = left + gap + clutch * step
            card = Box(x, top + gap + line, x + step - gap, bottom - gap)
            self._draw_card(canvas, card, clutch, state, row)

    def _draw_card(self, canvas: Canvas, card: Box, clutch: int, state: str, row: Any) -> None:
        """Draw a clutch's state and, where there is room, its voltage and torque, in its colour."""
        unit, (fill, ink) = self._unit, BADGES[state]
        colour = palette.clutch_colour(self._machine.slot_rows[clutch])
        volts, torque = float(row[COLUMN.volts[clutch]]), float(row[COLUMN.torque[clutch]])
        canvas.box(*card, PANEL if state == "absent" else colour, 5 * unit)
        card = card._replace(low=card.low + 4 * unit)
        canvas.box(*card, CARD, 5 * unit)
        left, right = card.left + 4 * unit, card.right - 4 * unit
        canvas.box(left, card.low + 4 * unit, right, card.low + 18 * unit, fill, 4 * unit)
        middle, y = 0.5 * (left + right), card.low + 11 * unit
        canvas.text(f"{clutch + 1} {state}", middle, y, SMALL * unit, ink, "m")
        if not self._has_bars:
            return
        width = max(right - left - 60 * unit, 0.0)
        voltage_share = volts / self._machine.clutch.voltage_max
        bars = (
            (28, 0.0, voltage_share, f"{volts:.1f} V"),
            (45, 0.5, torque / self._torque_max, f"{_signed(torque)} N·m"),
        )
        for place, zero, share, text in bars:
            y = card.low + place * unit
            canvas.text(text, right, y, SMALL * unit, INK, "r")
            canvas.box(left, y - 4 * unit, left + width, y + 4 * unit, GROOVE)
            start = left + zero * width
            end = start + (1.0 - zero) * min(max(share, -1.0), 1.0) * width
            canvas.box(min(start, end), y - 4 * unit, max(start, end), y + 4 * unit, colour)
            canvas.box(start - 0.5, y - 6 * unit, start + 0.5, y + 6 * unit, MUTED)


def aim(task: PathFollowing) -> str:
    """Return in words where errors count from."""
    return "the free band" if has_band(task) else "the path"


def outcome(row: Any) -> str:
    """Return the dynamic mode, or how the episode ended."""
    if row[COLUMN.terminated]:
        return "arrived" if row[COLUMN.is_success] else "left the workspace"
    return MODE_NAMES[int(row[COLUMN.mode])]


def clutch_states(row: Any, machine: Machine) -> list[str]:
    """Return the state of each clutch; without voltage and torque it is released, even at rest."""
    slots = zip(machine.slot_rows, machine.slot_scale, strict=True)
    rows = [slip if scale > 0.0 else None for slip, scale in slots]
    idle = (row[[*COLUMN.volts]] == 0.0) & (row[[*COLUMN.torque]] == 0.0)
    mode = int(row[COLUMN.mode])
    stuck = rows[mode - 1] if ClutchMode.TWO_DOF < mode < ClutchMode.ZERO_DOF else None
    return [
        "absent"
        if slip is None
        else "released"
        if is_idle
        else "stuck"
        if mode == ClutchMode.ZERO_DOF or slip == stuck
        else "slipping"
        for slip, is_idle in zip(rows, idle, strict=True)
    ]


def _signed(value: float) -> str:
    """Return a number with one decimal and its sign; 0.0 has none."""
    return f"{value:+.1f}".replace("-", "−") if round(value, 1) else "0.0"
