"""What every picture is made of: colours, the mechanism's geometry, views of the world, and a canvas."""

import math
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path as FilePath
from typing import Literal, NamedTuple

import matplotlib as mpl
import numpy as np
from numpy.typing import ArrayLike, NDArray
from PIL import Image, ImageDraw, ImageFont

from pter_gym._internal import palette
from pter_gym.params import Arm
from pter_gym.paths import Path

Array = NDArray[np.float64]

BACKGROUND, PANEL, CARD, GROOVE = "#ffffff", "#f3f4f6", "#ffffff", "#e3e5e9"
INK, MUTED = "#1f2328", "#646b75"
WORKSPACE, WORKSPACE_EDGE, PATH = "#eff5fb", "#d3e3f1", "#3b4048"
TRAIL, FORCE = palette.PURPLE, palette.GREEN
LINK_A, PARALLEL_A = palette.BLUE, "#80b9d9"
LINK_B, PARALLEL_B = palette.ORANGE, "#f3cf80"
VOLTS, TORQUE = palette.SKY_BLUE, palette.VERMILLION

TITLE, BODY, SMALL = 14, 12, 11
"""Sizes of text [px at the default size]."""

SUPERSAMPLING = 2
"""A canvas is drawn larger by this factor, then reduced, which smooths its edges."""

MIN_PIECE = 2.0
"""A line is drawn in pieces of at least this length [px]."""

MIN_TEXT = 10
"""Smallest legible size of text [px]."""

HUB = 0.08
"""Half the width of the drive and its stand [m]."""


# --- the mechanism and its path, in metres ---


class FiveBar(NamedTuple):
    """Pivots of the mechanism in the world, each an array (2,) [m]; the fifth bar is the ground.

    The drive turns both cranks about one axis at the origin: link A to ``elbow_a`` and link B to ``elbow_b``. A bar
    parallel to B leads from ``elbow_a`` to the tip, a bar parallel to A from ``elbow_b``.
    """

    base: Array
    elbow_a: Array
    elbow_b: Array
    tip: Array


def five_bar(arm: Arm, theta_a: float, theta_b: float) -> FiveBar:
    """Return the pivots at absolute link angles [rad]; the tip is at lA·(cos θA, sin θA) + lB·(cos θB, sin θB)."""
    elbow_a = arm.length_a * np.array([math.cos(theta_a), math.sin(theta_a)])
    elbow_b = arm.length_b * np.array([math.cos(theta_b), math.sin(theta_b)])
    return FiveBar(np.zeros(2), elbow_a, elbow_b, elbow_a + elbow_b)


def path_points(path: Path, count: int = 129) -> Array:
    """Return points along a path [m], shape (count, 2)."""
    return path.sampled(count)


def workspace(path: Path, error_max: float) -> Array:
    """Return the outline of the workspace [m], shape (K, 2): all points within the largest normal error of the path.

    It reaches back from the start of the path by the same distance.
    """
    x, y, heading, _ = path.arcs.at(np.linspace(0.0, path.length, 129))
    points, ahead = np.stack([x, y], axis=1), np.stack([np.cos(heading), np.sin(heading)], axis=1)
    points = np.vstack([points[0] - error_max * ahead[0], points])
    ahead = np.vstack([ahead[0], ahead])
    left = np.stack([-ahead[:, 1], ahead[:, 0]], axis=1)
    return np.vstack([points + error_max * left, (points - error_max * left)[::-1]])


# --- from the world to the screen ---


class Box(NamedTuple):
    """A rectangle by its edges: metres in the world (y upwards) or pixels on the screen (y downwards)."""

    left: float
    low: float
    right: float
    high: float

    @property
    def width(self) -> float:
        """Extent from left to right."""
        return self.right - self.left

    @property
    def height(self) -> float:
        """Extent from the lower to the higher edge."""
        return self.high - self.low


def world_box(arm: Arm, path: Path, error_max: float) -> Box:
    """Return the part of the world [m] to show: the drive, the workspace, and the elbows on both sides of the drive."""
    x, y = path.point(0.5 * path.length)
    sideways = max(arm.length_a, arm.length_b) / max(math.hypot(x, y), HUB) * np.array([-y, x])
    shown = np.vstack([workspace(path, error_max), [[-HUB, -HUB], [HUB, HUB]], sideways, -sideways])
    return Box(*map(float, (*shown.min(axis=0), *shown.max(axis=0))))


@dataclass(frozen=True)
class View:
    """World to screen: x to the right, y upwards in the world and downwards on the screen.

    Attributes
    ----------
    scale
        Pixels per metre.
    origin
        Pixel (x, y) of the world's origin, the axis of the drive.
    """

    scale: float
    origin: tuple[float, float]

    def pixels(self, points: ArrayLike) -> Array:
        """Return the pixels of points in the world [m], shape (2,) or (K, 2); not rounded."""
        return np.asarray(points, np.float64) * (self.scale, -self.scale) + self.origin


def fit(world: Box, screen: Box) -> View:
    """Return the view in which a box of the world [m] fills a box of the screen [px], centred and undistorted."""
    scale = min(screen.width / world.width, screen.height / world.height)
    x, y = 0.5 * (screen.left + screen.right), 0.5 * (screen.low + screen.high)
    return View(scale, (x - scale * 0.5 * (world.left + world.right), y + scale * 0.5 * (world.low + world.high)))


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
        """Draw a line through points (K, 2); nothing for fewer than two."""
        if len(points) > 2:
            travelled = np.cumsum(np.hypot(*np.diff(points, axis=0).T))
            kept = np.diff(np.floor(travelled / MIN_PIECE), prepend=0.0) > 0.0
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

    def arrow(self, tail: Array, head: Array, width: float, colour: str) -> None:
        """Fill an arrow between two points, with a shaft of a given width."""
        reach = head - tail
        ahead = reach / math.hypot(*reach)
        left = np.array([-ahead[1], ahead[0]])
        neck = head - min(3.5 * width, math.hypot(*reach)) * ahead
        shaft, barb = 0.5 * width * left, 1.75 * width * left
        self.polygon([tail + shaft, neck + shaft, neck + barb, head, neck - barb, neck - shaft, tail - shaft], colour)

    def box(self, box: Box, colour: str, radius: float = 0.0) -> None:
        """Fill a rectangle, with round corners if ``radius`` is given."""
        left, top, right, bottom = (round(SUPERSAMPLING * edge) for edge in box)
        if right > left and bottom > top:
            self._draw.rounded_rectangle((left, top, right - 1, bottom - 1), SUPERSAMPLING * radius, colour)

    def text(
        self, text: str, x: float, y: float, size: float, colour: str, align: Literal["l", "m", "r"] = "l"
    ) -> None:
        """Write a line of text around the height ``y``; its left end, middle or right end is at ``x``."""
        self._draw.text((SUPERSAMPLING * x, SUPERSAMPLING * y), text, colour, _font(size), f"{align}m")


def text_width(text: str, size: float) -> float:
    """Return the width of a line of text [px]."""
    return _font(size).getlength(text) / SUPERSAMPLING


def _font(size: float) -> ImageFont.FreeTypeFont:
    return _load_font(round(SUPERSAMPLING * max(size, MIN_TEXT)))


@lru_cache
def _load_font(size: int) -> ImageFont.FreeTypeFont:
    """Load the typeface of the figures, which comes with Matplotlib."""
    return ImageFont.truetype(FilePath(mpl.get_data_path(), "fonts", "ttf", "DejaVuSans.ttf"), size)


def _enlarged(points: ArrayLike) -> list[tuple[float, ...]]:
    return [tuple(point) for point in (SUPERSAMPLING * np.asarray(points)).tolist()]
