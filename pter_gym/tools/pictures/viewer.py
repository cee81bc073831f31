"""Viewers: telemetry in, a picture out, of one world or of many.

A window needs pygame, from the extra ``render``.
"""

import os
import sys
from collections.abc import Sequence
from typing import Any, Literal, get_args

import gymnasium
import numpy as np
from numpy.typing import NDArray

from pter_gym.errors import ParameterError, needs_extra, unknown_name
from pter_gym.params import Machine
from pter_gym.tasks.path_following import COLUMN, TELEMETRY, PathFollowing
from pter_gym.tools.pictures.drawing import Array, Picture, Subject
from pter_gym.tools.pictures.size import HEIGHT, WIDTH, check_size

__all__ = ["Viewer", "Window", "WorldsViewer"]

Mode = Literal["rgb_array", "human"]

MAX_WORLDS = 64
"""Most worlds that are drawn; more on one screen would be indistinguishable."""


INVISIBLE = ("dummy", "offscreen")
"""SDL's drivers without visible windows."""


class Viewer:
    """Draws a PTER that follows a path. Nothing is drawn before the first call of ``draw``.

    Parameters
    ----------
    machine, task
        The subject; it fixes the view, so the same state gives the same picture.
    mode
        ``"rgb_array"`` returns pictures and needs no display; ``"human"`` shows them in a window,
        at most one for each control period. It opens with the first picture; without a display
        there is a warning instead. A window that its user closes stays closed, and the program goes
        on without it.
    width, height
        Size of a picture [px].

    Raises
    ------
    ParameterError
        If the mode is not one of the two, or the size is out of range.
    """

    def __init__(
        self,
        machine: Machine,
        task: PathFollowing,
        mode: Mode,
        width: int = WIDTH,
        height: int = HEIGHT,
    ) -> None:
        if mode not in get_args(Mode):
            raise unknown_name("mode", mode, get_args(Mode))
        self._size = check_size(width, height)
        self._rate = 1.0 / task.control_period
        self._mode = mode
        self._display = True
        self._window: Window | None = None
        self._picture: Picture | None = None
        self.look_at(machine, task)

    def look_at(self, machine: Machine, task: PathFollowing) -> None:
        """Draw another machine and task from now on; the window stays open."""
        self._subject = Subject(machine, task)

    def draw(self, telemetry_row: Array, trail: Array) -> NDArray[np.uint8] | None:
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
            A new uint8 array (height, width, 3), or None with ``mode="human"``.

        Raises
        ------
        DependencyError
            If a window is asked for and pygame is not installed.
        """
        if self._mode == "human" and not self._is_shown():
            return None
        if self._picture is None or self._picture.subject != self._subject:
            self._picture = Picture(self._subject, *self._size)
        pixels = self._picture.draw(telemetry_row, trail)
        return self._window.show(pixels) if self._window else pixels

    def _is_shown(self) -> bool:
        """Return whether there is a window; it opens at first, or else there is one warning."""
        if self._window is None and self._display:
            try:
                self._window = Window(self._size, self._rate)
            except ParameterError as error:
                gymnasium.logger.warn(f"nothing is shown: {error}")
                self._display = False
        return bool(self._window and self._window.is_open())

    def close(self) -> None:
        """Close the window, if there is one. May be called again."""
        if self._window:
            self._window.close()


class WorldsViewer:
    """Draws each of N worlds, with the trail of its own episode.

    Parameters
    ----------
    pairs
        Machines and tasks; a world draws one of them for each episode.
    count
        N, at most ``MAX_WORLDS``.
    width, height
        Size of the picture of one world [px].

    Raises
    ------
    ParameterError
        If there are too many worlds, or the size is out of range.
    """

    def __init__(
        self, pairs: Sequence[tuple[Machine, PathFollowing]], count: int, width: int, height: int
    ) -> None:
        if count > MAX_WORLDS:
            raise ParameterError(
                f"num_envs must be at most {MAX_WORLDS} with a render_mode, got {count}"
            )
        self._pairs = pairs
        self._size = check_size(width, height)
        self._pictures: dict[int, Picture] = {}
        self._rows = np.zeros((count, len(TELEMETRY)))
        self._trails: list[list[Array]] = [[] for _ in range(count)]

    @property
    def ready(self) -> bool:
        """Whether all worlds have telemetry."""
        return all(self._trails)

    def update(self, rows: Array, worlds: NDArray[np.bool_] | None = None) -> None:
        """Record telemetry (N, len(TELEMETRY)) of all worlds, or of those that were reset."""
        for world in range(len(rows)) if worlds is None else np.flatnonzero(worlds).tolist():
            self._rows[world] = row = rows[world]
            if row[COLUMN.time] == 0.0:
                self._trails[world] = []
            self._trails[world].append(row[[*COLUMN.tip]])

    def draw(self, numbers: Sequence[int]) -> tuple[NDArray[np.uint8], ...]:
        """Return a picture of each world, uint8 (height, width, 3), from the number of its pair."""
        self._pictures = {
            number: self._pictures.get(number)
            or Picture(Subject(*self._pairs[number]), *self._size)
            for number in set(numbers)
        }
        return tuple(
            self._pictures[number].draw(self._rows[world], np.array(self._trails[world]))
            for world, number in enumerate(numbers)
        )


class Window:
    """A window that shows pictures of a size [px] at a limited rate [1/s]; see ``open_display``."""

    def __init__(self, size: tuple[int, int], rate: float, title: str = "PTER") -> None:
        self._pygame = open_display()
        self._rate = rate
        self._pygame.display.set_caption(title)
        self._screen = self._pygame.display.set_mode(size)
        self._clock = self._pygame.time.Clock()
        self._open = True

    def is_open(self) -> bool:
        """Handle events; return False once the window is closed by its button, Escape or code."""
        pygame = self._pygame
        self._open = self._open and pygame.display.get_surface() is not None
        for event in pygame.event.get() if self._open else ():
            if event.type == pygame.QUIT or getattr(event, "key", None) == pygame.K_ESCAPE:
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


def open_display() -> Any:
    """Return pygame with an initialised display.

    A display that shows nothing is refused, unless ``SDL_VIDEODRIVER`` asks for it.

    Raises
    ------
    DependencyError
        If pygame is not installed.
    ParameterError
        If there is no display.
    """
    try:
        import pygame
    except ImportError as error:
        raise needs_extra("a window", "render") from error
    reason = "this computer has none"
    driver_set = "SDL_VIDEODRIVER" in os.environ
    if driver_set or sys.platform != "linux" or {"DISPLAY", "WAYLAND_DISPLAY"} & set(os.environ):
        try:
            pygame.display.init()
            if driver_set or pygame.display.get_driver() not in INVISIBLE:
                return pygame
            pygame.display.quit()
        except pygame.error as error:
            reason = str(error)
    raise ParameterError(
        f"a window needs a display, and {reason}: give `pter watch` a file, --out film.webp, and "
        'environments render_mode="rgb_array"'
    )
