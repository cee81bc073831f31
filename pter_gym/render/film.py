"""A film: episodes side by side, in frames of equal distance in time."""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pter_gym.render import style
from pter_gym.render.arrangement import check_size, grid
from pter_gym.render.canvas import Canvas
from pter_gym.render.picture import Sheet, Subject
from pter_gym.render.snapshot import Snapshot
from pter_gym.tasks.path_following import COLUMN

Array = NDArray[np.float64]

SIDE_BY_SIDE = (480, 540)
"""Width and height of one of several pictures [px]."""

LARGEST = (1920, 1080)
"""Several pictures take no more than this together [px]."""

PAUSE = 1.0
"""Time for which the last frame is shown [s]."""


class Shot(NamedTuple):
    """An episode to show: of what, and its telemetry from the reset on, (T + 1, len(TELEMETRY))."""

    subject: Subject
    telemetry: Array


class Film:
    """Frames of episodes that begin together; one that is over stays at its end.

    Parameters
    ----------
    shots
        The episodes, at least one.
    rate
        Frames for each second [1/s].
    speed
        Time of the episodes over that of the film: 0.5 is slow motion.
    size
        Width and height [px]; ``default_size`` by default.

    Raises
    ------
    ParameterError
        If the speed is not > 0, or the size is out of range.
    """

    def __init__(
        self, shots: Sequence[Shot], rate: float, speed: float = 1.0, size: tuple[int, int] | None = None
    ) -> None:
        self.size = check_size(*(size or default_size(len(shots))))
        self._sheet = Sheet(*self.size, [shot.subject for shot in shots])
        self._shots = shots
        self._step = speed / rate
        self._moving = 1 + math.ceil(max(shot.telemetry[-1, int(COLUMN.time)] for shot in shots) / self._step - 1e-9)
        self._frames = self._moving + round(PAUSE * rate)

    def __len__(self) -> int:
        """Return the number of frames."""
        return self._frames

    def canvas(self, frame: int) -> Canvas:
        """Return a frame."""
        time = min(frame, self._moving) * self._step
        return self._sheet.draw([_state(shot.telemetry, time) for shot in self._shots])

    def pixels(self, frame: int) -> NDArray[np.uint8]:
        """Return a frame as a new array, shape (height, width, 3)."""
        return self.canvas(frame).pixels()


def default_size(count: int) -> tuple[int, int]:
    """Return the size of so many pictures side by side [px]: that of a single one is the viewer's."""
    if count == 1:
        return style.WIDTH, style.HEIGHT
    rows, columns = grid(count)
    width, height = columns * SIDE_BY_SIDE[0], rows * SIDE_BY_SIDE[1]
    scale = min(1.0, LARGEST[0] / width, LARGEST[1] / height)
    return round(scale * width), round(scale * height)


def _state(telemetry: Any, time: float) -> tuple[Snapshot, Array]:
    """Return the state at a time [s] or at the end, and the trail until then."""
    row = int(np.searchsorted(telemetry[:, COLUMN.time], time + 1e-9, side="right")) - 1
    return Snapshot.of(telemetry[row]), telemetry[: row + 1, [*COLUMN.tip]]
