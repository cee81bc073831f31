"""Drawing with smooth edges: shapes on a surface of twice the size, which is shrunk, and text above them."""

from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pter_gym.errors import needs_extra
from pter_gym.render.geometry import Box, normals, thinned

if TYPE_CHECKING:
    import pygame

Align = Literal["left", "centre", "right"]

OVERSAMPLING = 2

SHORTEST_PIECE = 1.5
"""A line is drawn in pieces of at least this length [px]."""

SMALLEST_TEXT = 11
"""Text is never smaller than this [px]: it could not be read."""

MOST_TEXTS = 2000
"""Pictures of text that are kept."""


def load_pygame() -> Any:
    """Return the module ``pygame``, or raise a DependencyError that says how to install it."""
    try:
        import pygame
    except ImportError as error:
        raise needs_extra("rendering with pygame", "render") from error
    return pygame


class Written(NamedTuple):
    """A text on the canvas: its picture, its upper left corner and the rectangle that it stays in [px]."""

    image: Any
    corner: tuple[int, int]
    clip: Any


class Canvas:
    """A picture of ``width`` × ``height`` pixels in memory; coordinates are pixels from its top left corner.

    No display is needed.
    """

    def __init__(self, width: int, height: int, background: str) -> None:
        self._pygame = load_pygame()
        self._size = (width, height)
        self._large = self._pygame.Surface((OVERSAMPLING * width, OVERSAMPLING * height), 0, 32)
        self._large.fill(background)
        self._texts: list[Written] = []
        self._clip: Any = None
        self._lettering = Lettering(self._pygame)

    def copy(self) -> "Canvas":
        """Return an independent canvas with the same picture."""
        other = Canvas.__new__(Canvas)
        other._pygame = self._pygame
        other._size = self._size
        other._large = self._large.copy()
        other._texts = self._texts.copy()
        other._clip = None
        other._large.set_clip(None)
        other._lettering = self._lettering
        return other

    def surface(self) -> "pygame.Surface":
        """Return the picture as a new surface."""
        surface = self._pygame.transform.smoothscale(self._large, self._size)
        for text in self._texts:
            surface.set_clip(text.clip)
            surface.blit(text.image, text.corner)
        surface.set_clip(None)
        return surface

    def pixels(self) -> NDArray[np.uint8]:
        """Return the picture as a new array, shape (height, width, 3)."""
        width, height = self._size
        flat = np.frombuffer(self._pygame.image.tobytes(self.surface(), "RGB"), np.uint8)
        return flat.reshape(height, width, 3).copy()

    def clip(self, box: Box) -> None:
        """Draw inside a box only, from now on."""
        self._large.set_clip(_rectangle(box, OVERSAMPLING))
        self._clip = _rectangle(box, 1)

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
        corner = round(OVERSAMPLING * radius)
        self._pygame.draw.rect(self._large, colour, _rectangle(box, OVERSAMPLING), border_radius=corner)

    def text(self, text: str, at: tuple[float, float], size: float, colour: str, align: Align = "left") -> None:
        """Write a line of text above all shapes; ``at`` is its left end, middle or right end, halfway up."""
        image = self._lettering.image(text, size, colour)
        share = {"left": 0.0, "centre": 0.5, "right": 1.0}[align]
        corner = (round(at[0] - share * image.get_width()), round(at[1] - 0.5 * image.get_height()))
        self._texts.append(Written(image, corner, self._clip))

    def text_width(self, text: str, size: float) -> float:
        """Return the width of a line of text [px]."""
        return self._lettering.image(text, size, "black").get_width()


class Lettering:
    """Text as pictures, which are kept: most of it is the same in the next frame."""

    def __init__(self, pygame: Any) -> None:
        self._pygame = pygame
        self._fonts: dict[int, Any] = {}
        self._images: dict[tuple[str, int, str], Any] = {}

    def image(self, text: str, size: float, colour: str) -> Any:
        """Return the picture of a line of text."""
        key = (text, max(round(size), SMALLEST_TEXT), colour)
        if key not in self._images:
            if len(self._images) >= MOST_TEXTS:
                self._images.clear()
            self._images[key] = self._drawn(*key)
        return self._images[key]

    def _drawn(self, text: str, size: int, colour: str) -> Any:
        """Draw large and shrink: letters then keep their distances."""
        try:
            large = self._font(size).render(text, True, colour)
        except self._pygame.error:  # other code has shut pygame down in the meantime, which voids its fonts
            self._fonts.clear()
            large = self._font(size).render(text, True, colour)
        smaller = [round(length / OVERSAMPLING) for length in large.get_size()]
        return self._pygame.transform.smoothscale(large, smaller)

    def _font(self, size: int) -> Any:
        if size not in self._fonts:
            self._pygame.font.init()
            self._fonts[size] = self._pygame.font.Font(None, OVERSAMPLING * size)
        return self._fonts[size]


def _large(points: ArrayLike) -> Any:
    return (OVERSAMPLING * np.asarray(points, np.float64)).tolist()


def _rectangle(box: Box, scale: int) -> tuple[int, int, int, int]:
    left, top, right, bottom = (round(scale * edge) for edge in box)
    return left, top, right - left, bottom - top
