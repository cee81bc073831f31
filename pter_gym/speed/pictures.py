"""How fast pictures are drawn, on one core."""

from collections.abc import Sequence
from dataclasses import dataclass

import gymnasium
import numpy as np

from pter_gym.errors import DependencyError
from pter_gym.render import style
from pter_gym.speed.ours import ID, Skipped
from pter_gym.speed.timing import Effort, Load, rate

DEFAULT = (style.WIDTH, style.HEIGHT)
SIZES = ((style.TILE_WIDTH, style.TILE_HEIGHT), DEFAULT, (1920, 1080))
"""Widths and heights [px] that are measured."""


@dataclass(frozen=True)
class Pictures:
    """Rate [1/s] of ``env.step`` and ``env.render`` for pictures of a size [px]."""

    width: int
    height: int
    per_second: float


def measure_pictures(sizes: Sequence[tuple[int, int]], effort: Effort) -> tuple[tuple[Pictures, ...], list[Skipped]]:
    """Measure one world that moves and is drawn after each step; skipped where pygame is missing."""
    try:
        rows = tuple(Pictures(*size, rate(_film(*size), effort)) for size in sizes)
    except DependencyError as error:
        return (), [Skipped("pictures", str(error))]
    return rows, []


def _film(width: int, height: int) -> Load:
    env = gymnasium.make(ID, render_mode="rgb_array", width=width, height=height)
    env.reset(seed=0)
    volts = np.full(4, 5.0, np.float32)

    def draw() -> None:
        _, _, terminated, truncated, _ = env.step(volts)
        env.render()
        if terminated or truncated:
            env.reset()

    return Load(draw, 1, env.close)
