"""The viewer: a telemetry row and the tip's trail in, a picture out."""

from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from pter_gym.errors import ParameterError
from pter_gym.params import Machine
from pter_gym.render.arrangement import check_size
from pter_gym.render.canvas import load_pygame
from pter_gym.render.picture import Sheet, Subject
from pter_gym.render.snapshot import Snapshot
from pter_gym.render.style import HEIGHT, WIDTH
from pter_gym.render.window import Window
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
    width, height
        Size of a picture [px].

    Raises
    ------
    DependencyError
        If pygame is not installed.
    ParameterError
        If the mode is not one of the two, or the size is out of range.
    """

    def __init__(
        self, machine: Machine, task: PathFollowing, mode: Mode, width: int = WIDTH, height: int = HEIGHT
    ) -> None:
        if mode not in get_args(Mode):
            raise ParameterError(f"mode must be one of {', '.join(get_args(Mode))}, got {mode!r}")
        load_pygame()
        self._size = check_size(width, height)
        self.look_at(machine, task)
        self._window = Window(self._size, 1.0 / task.control_period) if mode == "human" else None

    def look_at(self, machine: Machine, task: PathFollowing) -> None:
        """Draw another machine at another task from now on; the window stays."""
        self._sheet = Sheet(*self._size, [Subject(machine, task)])

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
            return self._canvas(telemetry_row, trail).pixels()
        if self._window.is_open():
            self._window.show(self._canvas(telemetry_row, trail).surface())
        return None

    def close(self) -> None:
        """Close the window, if there is one. May be called again."""
        if self._window is not None:
            self._window.close()

    def _canvas(self, telemetry_row: NDArray[np.float64], trail: NDArray[np.float64]) -> Any:
        return self._sheet.draw([(Snapshot.of(telemetry_row), trail)])
