"""Viewers: telemetry in, a picture out, of one world or of many."""

from collections.abc import Sequence
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from pter_gym.envs._size import HEIGHT, WIDTH, check_size
from pter_gym.errors import ParameterError
from pter_gym.params import Machine
from pter_gym.tasks.path_following import COLUMN, PathFollowing
from pter_gym.tools.pictures.render.picture import Picture, Subject
from pter_gym.tools.pictures.render.window import Window

Array = NDArray[np.float64]
Mode = Literal["rgb_array", "human"]

MOST_WORLDS = 64
"""Worlds that are drawn; more on one screen could not be told apart."""


class Viewer:
    """Draws a PTER that follows a path.

    Parameters
    ----------
    machine, task
        The subject; it fixes the view, so the same state gives the same picture.
    mode
        ``"rgb_array"`` returns pictures and needs no display; ``"human"`` shows them in a window, at most one for each
        control period. A window that its user closes stays closed, and the program goes on without it.
    width, height
        Size of a picture [px].

    Raises
    ------
    DependencyError
        If a window is asked for and pygame is not installed.
    ParameterError
        If the mode is not one of the two, or the size is out of range.
    """

    def __init__(
        self, machine: Machine, task: PathFollowing, mode: Mode, width: int = WIDTH, height: int = HEIGHT
    ) -> None:
        if mode not in get_args(Mode):
            raise ParameterError(f"mode must be one of {', '.join(get_args(Mode))}, got {mode!r}")
        self._size = check_size(width, height)
        self._window = Window(self._size, 1.0 / task.control_period) if mode == "human" else None
        self.look_at(machine, task)

    def look_at(self, machine: Machine, task: PathFollowing) -> None:
        """Draw another machine and task from now on; the window stays open."""
        self._picture = Picture(Subject(machine, task), *self._size)

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
        """
        if self._window is None:
            return self._picture.draw(telemetry_row, trail)
        if self._window.is_open():
            self._window.show(self._picture.draw(telemetry_row, trail))
        return None

    def close(self) -> None:
        """Close the window, if there is one. May be called again."""
        if self._window is not None:
            self._window.close()


class WorldsViewer:
    """Draws each of N worlds, with the trail of its own episode.

    Parameters
    ----------
    pairs
        Machines and tasks; a world draws one of them for each episode.
    count
        N, at most ``MOST_WORLDS``.
    width, height
        Size of the picture of one world [px].

    Raises
    ------
    ParameterError
        If there are too many worlds, or the size is out of range.
    """

    def __init__(self, pairs: Sequence[tuple[Machine, PathFollowing]], count: int, width: int, height: int) -> None:
        if count > MOST_WORLDS:
            raise ParameterError(
                f"render_mode draws one picture for each world, of at most {MOST_WORLDS}; got num_envs = {count}: "
                "watch fewer in an environment of their own"
            )
        self._pairs = pairs
        self._size = check_size(width, height)
        self._pictures: dict[int, Picture] = {}
        self._rows: list[Array | None] = [None] * count
        self._trails: list[list[Array]] = [[] for _ in range(count)]

    @property
    def ready(self) -> bool:
        """Whether all worlds have been seen."""
        return all(row is not None for row in self._rows)

    def see(self, rows: Array, worlds: NDArray[np.bool_] | None = None) -> None:
        """Record telemetry (N, len(TELEMETRY)) after a step, or the worlds that were reset."""
        for world in np.flatnonzero(worlds if worlds is not None else np.ones(len(rows), np.bool_)).tolist():
            row = rows[world].copy()
            if row[COLUMN.time] == 0.0:
                self._trails[world] = []
            self._rows[world] = row
            self._trails[world].append(row[[*COLUMN.tip]])

    def draw(self, drawn: Sequence[int]) -> tuple[NDArray[np.uint8], ...]:
        """Return a picture of each world, uint8 (height, width, 3); ``drawn`` holds the numbers of their pairs."""
        self._pictures = {number: self._picture(number) for number in set(drawn)}
        return tuple(
            self._pictures[number].draw(row, np.array(trail))
            for number, row, trail in zip(drawn, self._rows, self._trails, strict=True)
            if row is not None
        )

    def _picture(self, number: int) -> Picture:
        return self._pictures.get(number) or Picture(Subject(*self._pairs[number]), *self._size)
