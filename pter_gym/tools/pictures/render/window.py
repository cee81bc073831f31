"""A window on the screen, with pygame."""

import os
import sys
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pter_gym.errors import needs_extra

INVISIBLE = ("dummy", "offscreen")
"""Drivers of SDL that show nothing."""


def load_pygame() -> Any:
    """Return the module ``pygame``, or raise a DependencyError that says how to install it."""
    try:
        import pygame
    except ImportError as error:
        raise needs_extra("a window", "render") from error
    if sys.platform == "linux" and "XDG_RUNTIME_DIR" not in os.environ:
        os.environ.setdefault("SDL_VIDEODRIVER", "x11")  # Wayland needs that folder, and its library would complain
    return pygame


def has_display() -> bool:
    """Tell whether a window would be seen."""
    pygame: Any = load_pygame()
    was_on = pygame.display.get_init()
    try:
        pygame.display.init()
        return pygame.display.get_driver() not in INVISIBLE
    except pygame.error:
        return False
    finally:
        if not was_on:
            pygame.display.quit()


class Window:
    """A window on the screen that shows pictures of a size [px] at a limited rate [1/s]."""

    def __init__(self, size: tuple[int, int], rate: float, title: str = "PTER") -> None:
        self._pygame: Any = load_pygame()
        self._rate = rate
        self._pygame.display.init()
        self._pygame.display.set_caption(title)
        self._screen = self._pygame.display.set_mode(size)
        self._clock = self._pygame.time.Clock()
        self._open = True

    def is_open(self) -> bool:
        """Handle the window's events; return False once it is closed: by its button, Escape, or other code."""
        pygame = self._pygame
        if pygame.display.get_surface() is None:
            self._open = False
        events = pygame.event.get() if self._open else ()
        if any(e.type == pygame.QUIT or (e.type == pygame.KEYDOWN and e.key == pygame.K_ESCAPE) for e in events):
            self.close()
        return self._open

    def show(self, picture: NDArray[np.uint8]) -> None:
        """Show a picture (height, width, 3), then wait until the next one is due."""
        self._pygame.surfarray.blit_array(self._screen, picture.swapaxes(0, 1))
        self._pygame.display.flip()
        self._clock.tick(self._rate)

    def close(self) -> None:
        """Close the window. May be called again."""
        if self._open:
            self._open = False
            self._pygame.display.quit()
