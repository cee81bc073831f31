"""A window on the screen."""

from typing import Any

from pter_gym.render.canvas import load_pygame

INVISIBLE = ("dummy", "offscreen")
"""Drivers of SDL that show nothing."""


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
        if self._pygame.display.get_surface() is None:
            self._open = False
        if self._open:
            for event in self._pygame.event.get():
                if event.type == self._pygame.QUIT or (
                    event.type == self._pygame.KEYDOWN and event.key == self._pygame.K_ESCAPE
                ):
                    self.close()
                    break
        return self._open

    def show(self, surface: Any) -> None:
        """Show a picture, then wait until the next one is due."""
        self._screen.blit(surface, (0, 0))
        self._pygame.display.flip()
        self._clock.tick(self._rate)

    def close(self) -> None:
        """Close the window. May be called again."""
        if self._open:
            self._open = False
            self._pygame.display.quit()
