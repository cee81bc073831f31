"""Drawing with smooth edges: on a surface of twice the size, which is then shrunk."""

from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pter_gym.errors import DependencyError
from pter_gym.render.geometry import Box, normals, thinned

if TYPE_CHECKING:
    import pygame

Align = Literal["left", "centre", "right"]

OVERSAMPLING = 2

SHORTEST_PIECE = 1.5
"""A line is drawn in pieces of at least this length [px]."""


def load_pygame() -> Any:
    """Return the module ``pygame``, or raise a DependencyError that says how to install it."""
    try:
        import pygame
    except ImportError as error:
        raise DependencyError('rendering needs pygame: run `pip install "pter-gym[render]"`') from error
    return pygame


class Canvas:
    """A picture of ``width`` × ``height`` pixels in memory; coordinates are pixels from its top left corner.

    No display is needed.
    """

    def __init__(self, width: int, height: int, background: str) -> None:
        self._pygame = load_pygame()
        self._size = (width, height)
        self._large = self._pygame.Surface((OVERSAMPLING * width, OVERSAMPLING * height), 0, 32)
        self._large.fill(background)
        self._fonts: dict[int, Any] = {}

    def copy(self) -> "Canvas":
        """Return an independent canvas with the same picture.

        It loads its own fonts: older ones are void if other code has shut pygame down in the meantime.
        """
        other = Canvas.__new__(Canvas)
        other._pygame = self._pygame
        other._size = self._size
        other._large = self._large.copy()
        other._fonts = {}
        return other

    def surface(self) -> "pygame.Surface":
        """Return the picture as a new surface."""
        return self._pygame.transform.smoothscale(self._large, self._size)

    def pixels(self) -> NDArray[np.uint8]:
        """Return the picture as a new array, shape (height, width, 3)."""
        columns = self._pygame.surfarray.array3d(self.surface())
        return np.ascontiguousarray(columns.transpose(1, 0, 2))

    def clip(self, box: Box) -> None:
        """Draw inside a box only, from now on."""
        self._large.set_clip(_rectangle(box))

    def polygon(self, points: ArrayLike, colour: str) -> None:
        """Fill a polygon, points (K, 2)."""
        self._pygame.draw.polygon(self._large, colour, _large(points))

    def polyline(self, points: NDArray[np.float64], colour: str, width: float) -> None:
        """Draw a line through points (K, 2); nothing for fewer than two distinct points."""
        corners = thinned(points, SHORTEST_PIECE)
        if len(corners) < 2:
            return
        side = 0.5 * width * normals(corners)
        left, right = _large(corners + side), _large(corners - side)
        for k in range(len(corners) - 1):
            quad = (left[k], left[k + 1], right[k + 1], right[k])
            self._pygame.draw.polygon(self._large, colour, quad)

    def disc(self, centre: ArrayLike, radius: float, colour: str) -> None:
        """Fill a circle."""
        self._pygame.draw.circle(self._large, colour, _large(centre), OVERSAMPLING * radius)

    def bar(self, start: NDArray[np.float64], end: NDArray[np.float64], width: float, colour: str) -> None:
        """Fill a bar with round ends between two points."""
        reach = end - start
        length = float(np.hypot(*reach))
        if length > 0.0:
            side = 0.5 * width / length * np.array([-reach[1], reach[0]])
            self.polygon([start + side, end + side, end - side, start - side], colour)
        self.disc(start, 0.5 * width, colour)
        self.disc(end, 0.5 * width, colour)

    def box(self, box: Box, colour: str, radius: float = 0.0) -> None:
        """Fill a rectangle, with round corners if ``radius`` is given."""
        self._pygame.draw.rect(self._large, colour, _rectangle(box), border_radius=round(OVERSAMPLING * radius))

    def text(self, text: str, at: tuple[float, float], size: int, colour: str, align: Align = "left") -> None:
        """Write a line of text; ``at`` is its left end, middle or right end, halfway up."""
        image = self._font(size).render(text, True, colour)
        share = {"left": 0.0, "centre": 0.5, "right": 1.0}[align]
        corner = (
            round(OVERSAMPLING * at[0] - share * image.get_width()),
            round(OVERSAMPLING * at[1] - 0.5 * image.get_height()),
        )
        self._large.blit(image, corner)

    def text_width(self, text: str, size: int) -> float:
        """Return the width of a line of text [px]."""
        return self._font(size).size(text)[0] / OVERSAMPLING

    def _font(self, size: int) -> Any:
        if size not in self._fonts:
            self._pygame.font.init()
            self._fonts[size] = self._pygame.font.Font(None, OVERSAMPLING * size)
        return self._fonts[size]


def _large(points: ArrayLike) -> Any:
    return (OVERSAMPLING * np.asarray(points, np.float64)).tolist()


def _rectangle(box: Box) -> tuple[int, int, int, int]:
    left, top, right, bottom = (round(OVERSAMPLING * edge) for edge in box)
    return left, top, right - left, bottom - top
