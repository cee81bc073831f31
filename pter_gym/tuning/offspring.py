"""New points of a search from its best ones, as differential evolution makes them."""

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from pter_gym.tuning.spaces import SPACES, Range

FLIP = 0.1
"""Chance that a switch is not that of the parent."""

JITTER = 0.01
"""Standard deviation of the noise on each coordinate, relative to its range."""

Point = Mapping[str, float | bool]


def offspring(controller: str, best: Sequence[Point], rng: np.random.Generator) -> dict[str, float | bool]:
    """Return a point that comes from good ones.

    A parent moves a part of the way towards the best point, and by a part of the difference of two others (Storn and
    Price, "Differential evolution", Journal of Global Optimization 11, 1997; the variant current-to-best), plus noise.

    Parameters
    ----------
    controller
        Its name.
    best
        Points, the best one first.
    rng
        Of the draws.
    """
    parent, one, two = (int(k) for k in rng.integers(len(best), size=3))
    x, a, b, top = (_relative(controller, best[k]) for k in (parent, one, two, 0))
    towards, along = rng.uniform(0.0, 1.0, 2)
    moved: NDArray[np.float64] = x + towards * (top - x) + along * (a - b) + rng.normal(0.0, JITTER, len(x))
    inside = 1.0 - np.abs(1.0 - np.abs(moved))  # reflected at both ends
    flips = (rng.uniform(size=len(x)) < FLIP).tolist()
    return {
        name: _absolute(space, part) if isinstance(space, Range) else bool(best[parent][name]) != flip
        for (name, space), part, flip in zip(SPACES[controller].items(), inside.tolist(), flips, strict=True)
    }


def _relative(controller: str, point: Point) -> NDArray[np.float64]:
    """Return where a point lies within the ranges, from 0 to 1; switches as 0."""
    return np.array(
        [_part(space, point[name]) if isinstance(space, Range) else 0.0 for name, space in SPACES[controller].items()]
    )


def _part(space: Range, value: float) -> float:
    low, high = _scaled(space, space.low), _scaled(space, space.high)
    return (_scaled(space, value) - low) / (high - low)


def _absolute(space: Range, part: float) -> float:
    low, high = _scaled(space, space.low), _scaled(space, space.high)
    value = low + min(max(part, 0.0), 1.0) * (high - low)
    return min(max(math.exp(value) if space.log else value, space.low), space.high)


def _scaled(space: Range, value: float) -> float:
    return math.log(value) if space.log else value
