"""The reach of an arm, without loading anything that compiles."""

import math

import numpy as np
from numpy.typing import NDArray

from pter_gym.errors import ParameterError

SINGULARITY_MARGIN = 0.2
"""Smallest |sin(θA − θB)| of a workspace by default."""


def check_reach(
    points: NDArray[np.float64], length_a: float, length_b: float, margin: float
) -> None:
    """Check that the tip can be at points of a path, (K, 2) [m], with |sin(θA − θB)| > margin.

    Raises
    ------
    ParameterError
        That names the first point out of reach and, if it is ten times too far, millimetres.
    """
    both = length_a**2 + length_b**2
    part = 2.0 * length_a * length_b * math.sqrt(1.0 - margin**2)
    outside = np.abs(np.square(points).sum(axis=1) - both) >= part
    if outside.any():
        x, y = points[outside.argmax()].tolist()
        nearest, farthest = math.sqrt(both - part), math.sqrt(both + part)
        unit = "; are these millimetres?" if math.hypot(x, y) > 10.0 * farthest else ""
        raise ParameterError(
            f"PathFollowing.path must be within reach, {nearest:.2g} to {farthest:.2g} m from the "
            f"base at (0, 0), but ({x:.4g}, {y:.4g}) m is not{unit}"
        )
