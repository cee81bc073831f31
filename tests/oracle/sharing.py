"""How four clutches share a load on two axes: the smallest torques in a box that carry it.

    t = argmin |t|²   with   Wᵀt = load,  low ≤ t ≤ high

Since WᵀW = 3·1, the smallest unbounded answer is t₀ = W·load / 3, and every other one is t₀ + N·z
with |t|² = |t₀|² + |z|². What is left is the point of a polygon in the plane that is nearest to the
origin: a least-distance problem, solved by non-negative least squares (Lawson and Hanson, Solving
Least Squares Problems, chapter 23).
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import nnls

W = np.array([[1.0, 0.0], [0.0, 1.0], [1.0, -1.0], [1.0, 1.0]])
NULL = np.array([[-1.0, 1.0, 1.0, 0.0], [1.0, 1.0, 0.0, -1.0]]).T / np.sqrt(3.0)
"""Orthonormal columns with WᵀN = 0: torques that load nothing but each other."""


def share(load: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Torques (4,) for a load (2,) that the box can carry."""
    smallest = W @ load / 3.0
    sides = np.vstack([NULL, -NULL])
    reach = np.concatenate([low - smallest, smallest - high])
    if np.all(reach <= 0.0):
        return smallest
    system = np.vstack([sides.T, reach])
    wanted = np.array([0.0, 0.0, 1.0])
    weights, _ = nnls(system, wanted)
    residual = system @ weights - wanted
    return smallest + NULL @ (-residual[:2] / residual[2])
