"""Antialiased drawing: on a picture of twice the size, which is then halved."""

from copy import copy
from functools import lru_cache
from pathlib import Path
from typing import Literal, Self

import matplotlib as mpl
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from pter_gym.tools.pictures.render.geometry import Box, thinned

Array = NDArray[np.float64]
Align = Literal["l", "m", "r"]
"""Which part of a text is at its point: the left end, the middle or the right end."""

SCALE = 2

SHORTEST_PIECE = 2.0
"""A line is drawn in pieces of at least this length [px]."""

SMALLEST_TEXT = 10
"""Text is never smaller than this [px], so that it can be read."""


class Canvas:
    """A picture of ``width`` × ``height`` pixels; coordinates are pixels from its top left corner."""

    def __init__(self, width: int, height: int, background: str) -> None:
        self._use(Image.new("RGB", (SCALE * width, SCALE * height), background))

    def _use(self, image: Image.Image) -> None:
        self._image = image
        self._draw = ImageDraw.Draw(image)

    def __getstate__(self) -> Image.Image:
        """Return the picture only, since the drawing object can be neither copied nor pickled."""
        return self._image.copy()

    def __setstate__(self, image: Image.Image) -> None:
        self._use(image)

    def copy(self) -> Self:
        """Return an independent canvas with the same picture."""
        return copy(self)

    def pixels(self) -> NDArray[np.uint8]:
        """Return the picture as a new array, shape (height, width, 3)."""
        return np.array(self._image.reduce(SCALE))

    def polygon(self, points: Array, colour: str) -> None:
        """Fill a polygon, points (K, 2)."""
        self._draw.polygon(_large(points), colour)

    def line(self, points: Array, colour: str, width: float) -> None:
        """Draw a line through points (K, 2); nothing for fewer than two."""
        corners = thinned(points, SHORTEST_PIECE)
        if len(corners) > 1:
            self._draw.line(_large(corners), colour, max(round(SCALE * width), 1))

    def disc(self, centre: Array, radius: float, colour: str) -> None:
        """Fill a circle."""
        self._draw.ellipse(_large(np.array([centre - radius, centre + radius])), colour)

    def bar(self, start: Array, end: Array, width: float, colour: str) -> None:
        """Fill a bar with round ends between two points."""
        self._draw.line(_large(np.array([start, end])), colour, round(SCALE * width))
        self.disc(start, 0.5 * width, colour)
        self.disc(end, 0.5 * width, colour)

    def box(self, box: Box, colour: str, radius: float = 0.0) -> None:
        """Fill a rectangle, with round corners if ``radius`` is given."""
        left, top, right, bottom = (round(SCALE * edge) for edge in box)
        if right > left and bottom > top:
            self._draw.rounded_rectangle((left, top, right - 1, bottom - 1), SCALE * radius, colour)

    def text(self, text: str, x: float, y: float, size: float, colour: str, align: Align = "l") -> None:
        """Write a line of text around the height ``y``."""
        self._draw.text((SCALE * x, SCALE * y), text, colour, _font(size), f"{align}m")


def text_width(text: str, size: float) -> float:
    """Return the width of a line of text [px]."""
    return _font(size).getlength(text) / SCALE


def _font(size: float) -> ImageFont.FreeTypeFont:
    return _load_font(round(SCALE * max(size, SMALLEST_TEXT)))


@lru_cache
def _load_font(size: int) -> ImageFont.FreeTypeFont:
    """Load the typeface of the figures, which comes with Matplotlib."""
    return ImageFont.truetype(Path(mpl.get_data_path(), "fonts", "ttf", "DejaVuSans.ttf"), size)


def _large(points: Array) -> list[tuple[float, ...]]:
    return [tuple(point) for point in (SCALE * np.asarray(points)).tolist()]
