"""Pictures of many worlds: each of its own machine and task, with the trail of its own episode."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pter_gym.errors import ParameterError
from pter_gym.params import Machine
from pter_gym.render.arrangement import check_size
from pter_gym.render.canvas import load_pygame
from pter_gym.render.picture import Sheet, Subject
from pter_gym.render.snapshot import Snapshot
from pter_gym.tasks.path_following import COLUMN, PathFollowing

Array = NDArray[np.float64]

MOST_WORLDS = 64
"""Worlds that are drawn; more on one screen could not be told apart."""


class WorldsViewer:
    """Draws each of N worlds.

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
    DependencyError
        If pygame is not installed.
    ParameterError
        If there are too many worlds, or the size is out of range.
    """

    def __init__(self, pairs: Sequence[tuple[Machine, PathFollowing]], count: int, width: int, height: int) -> None:
        load_pygame()
        if count > MOST_WORLDS:
            raise ParameterError(
                f"render_mode draws one picture for each world, of at most {MOST_WORLDS}; got num_envs = {count}: "
                "watch fewer in an environment of their own"
            )
        self._pairs = pairs
        self._size = check_size(width, height)
        self._sheets: dict[int, Sheet] = {}
        self._rows: list[Array | None] = [None] * count
        self._trails: list[list[Array]] = [[] for _ in range(count)]

    @property
    def ready(self) -> bool:
        """Whether all worlds have been seen."""
        return all(row is not None for row in self._rows)

    def see(self, rows: Array, worlds: NDArray[np.bool_] | None = None) -> None:
        """Take note of telemetry (N, len(TELEMETRY)) after a step, or of the worlds that were reset."""
        for world in np.flatnonzero(worlds if worlds is not None else np.ones(len(rows), np.bool_)).tolist():
            row = rows[world].copy()
            if row[COLUMN.time] == 0.0:
                self._trails[world] = []
            self._rows[world] = row
            self._trails[world].append(row[[*COLUMN.tip]])

    def draw(self, drawn: Sequence[int]) -> tuple[NDArray[np.uint8], ...]:
        """Return a picture of each world, uint8 (height, width, 3); ``drawn`` holds the numbers of their pairs."""
        self._sheets = {number: self._sheet(number) for number in set(drawn)}
        return tuple(
            self._sheets[number].draw([(Snapshot.of(row), np.array(trail))]).pixels()
            for number, row, trail in zip(drawn, self._rows, self._trails, strict=True)
            if row is not None
        )

    def _sheet(self, number: int) -> Sheet:
        return self._sheets.get(number) or Sheet(*self._size, [Subject(*self._pairs[number])])
