"""The viewer: a telemetry row and the tip's trail in, a picture out."""

from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from pter_gym.errors import ParameterError
from pter_gym.params import Machine
from pter_gym.render.canvas import load_pygame
from pter_gym.render.picture import Picture
from pter_gym.render.snapshot import Snapshot
from pter_gym.render.style import HEIGHT, WIDTH
from pter_gym.tasks.path_following import PathFollowing

Mode = Literal["rgb_array", "human"]


class Viewer:
    """Draws a PTER that follows a path.

    Parameters
    ----------
    machine, task
        What is drawn; they fix the view, so the same state gives the same picture.
    mode
        ``"rgb_array"`` returns pictures and needs no display; ``"human"`` shows them in a window, at most one for each
        control period. A window that its user closes stays closed, and the program goes on without it.

    Raises
    ------
    DependencyError
        If pygame is not installed.
    ParameterError
        If the mode is not one of the two.
    """

    def __init__(self, machine: Machine, task: PathFollowing, mode: Mode) -> None:
        if mode not in get_args(Mode):
            raise ParameterError(f"mode must be one of {', '.join(get_args(Mode))}, got {mode!r}")
        load_pygame()
        self._picture = Picture(machine, task)
        self._window = Window(1.0 / task.control_period) if mode == "human" else None

    def draw(self, telemetry_row: NDArray[np.float64], trail: NDArray[np.float64]) -> NDArray[np.uint8] | None:
        """Draw one state.

        Parameters
        ----------
        telemetry_row
            float64 (len(TELEMETRY),) of the present control step.
        trail
            Past positions of the tip [m], shape (K, 2), oldest first.

        Returns
        -------
        picture
            A fresh uint8 array (height, width, 3), or None with ``mode="human"``.
        """
        if self._window is None:
            return self._picture.draw(Snapshot.of(telemetry_row), trail).pixels()
        if self._window.is_open():
            self._window.show(self._picture.draw(Snapshot.of(telemetry_row), trail).surface())
        return None

    def close(self) -> None:
        """Close the window, if there is one. May be called again."""
        if self._window is not None:
            self._window.close()


class Window:
    """A window on the screen that shows pictures at a limited rate [1/s]."""

    def __init__(self, rate: float) -> None:
        self._pygame: Any = load_pygame()
        self._rate = rate
        self._pygame.display.init()
        self._pygame.display.set_caption("PTER")
        self._screen = self._pygame.display.set_mode((WIDTH, HEIGHT))
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
