"""Geometry: the five bars in the world, and the world on the screen. Nothing is drawn here."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pter_gym.params import Arm
from pter_gym.paths import Path

Array = NDArray[np.float64]

HUB = 0.08
"""Half the width of the space that the drive and its stand take [m]."""

_PATH_SAMPLES = 129


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


def path_points(path: Path) -> Array:
    """Return points along a path [m], shape (K, 2)."""
    return np.array([path.point(s) for s in _arc_lengths(path)])


def workspace(path: Path, error_max: float) -> Array:
    """Return the outline of the workspace [m], shape (K, 2): the path's surroundings up to the largest normal error.

    It reaches back from the start of the path by the same distance.
    """
    headings = np.array([path.heading(s) for s in _arc_lengths(path)])
    ahead = np.stack([np.cos(headings), np.sin(headings)], axis=1)
    points = path_points(path)
    points = np.vstack([points[0] - error_max * ahead[0], points])
    ahead = np.vstack([ahead[0], ahead])
    left = np.stack([-ahead[:, 1], ahead[:, 0]], axis=1)
    return np.vstack([points + error_max * left, (points - error_max * left)[::-1]])


def world_box(arm: Arm, path: Path, error_max: float) -> Box:
    """Return the part of the world [m] to show: the drive, the workspace, and the elbows on both sides of the drive."""
    outline = workspace(path, error_max)
    x, y = path.point(0.5 * path.length)
    sideways = max(arm.length_a, arm.length_b) / max(math.hypot(x, y), HUB) * np.array([-y, x])
    corners = np.array([[-HUB, -HUB], [HUB, HUB]])
    shown = np.vstack([outline, corners, sideways, -sideways])
    return Box(*(float(edge) for edge in (*shown.min(axis=0), *shown.max(axis=0))))


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
    return View(
        scale,
        (
            0.5 * (screen.left + screen.right) - scale * 0.5 * (world.left + world.right),
            0.5 * (screen.low + screen.high) + scale * 0.5 * (world.low + world.high),
        ),
    )


def arrow(tail: Array, head: Array, width: float) -> Array:
    """Return the outline (7, 2) of an arrow between two points, with a shaft of a given width; all in one unit."""
    reach = head - tail
    length = math.hypot(*reach)
    ahead = reach / length
    left = np.array([-ahead[1], ahead[0]])
    neck = head - min(3.5 * width, length) * ahead
    shaft, barb = 0.5 * width * left, 1.75 * width * left
    return np.array([tail + shaft, neck + shaft, neck + barb, head, neck - barb, neck - shaft, tail - shaft])


def thinned(points: Array, step: float) -> Array:
    """Return a part of the points (K, 2) of a line: the ends, and between them one for each ``step`` of its length."""
    if len(points) < 3:
        return points
    travelled = np.cumsum(np.hypot(*np.diff(points, axis=0).T))
    kept = np.diff(np.floor(travelled / step), prepend=0.0) > 0.0
    kept[-1] = True
    return np.vstack([points[:1], points[1:][kept]])


def _arc_lengths(path: Path) -> list[float]:
    return [float(s) for s in np.linspace(0.0, path.length, _PATH_SAMPLES)]
