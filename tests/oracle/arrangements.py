"""Dry friction of clutches with any rows of W: random problems, and their solution in the dual with
extended precision.

As in ``oracle.friction`` the unknowns are the impulses, each of which is at a bound or free.
Clutches with equal rows are one clutch here, with the sum of their capacities: to tell them apart
changes no velocity."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

WIDE = np.longdouble

NEAR = 0.01
"""Least difference of two rows that differ, relative to their size, as ``Machine`` has it."""


@dataclass(frozen=True)
class Arranged:
    """n problems: mass matrix (m11, m12, m22) (n, 3), momentum (n, 2), capacities (n, 4), rows of W
    (n, 4, 2)."""

    mass: np.ndarray
    p: np.ndarray
    c: np.ndarray
    w: np.ndarray

    @property
    def determinant(self) -> np.ndarray:
        m11, m12, m22 = self.mass.astype(WIDE).T
        return (m11 * m22 - m12 * m12).astype(float)

    @property
    def trace(self) -> np.ndarray:
        return self.mass[:, 0] + self.mass[:, 2]

    @property
    def momentum(self) -> np.ndarray:
        """Everything that enters the sums of the right-hand side: |p| and the largest impulses on
        the links."""
        return np.abs(self.p).sum(axis=1) + (self.c * np.abs(self.w).sum(axis=2)).sum(axis=1)


def slots(declared: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return four rows for one to four clutches: empty slots have a row of an axis, as long as one
    is missing."""
    missing = [row for row in ((1.0, 0.0), (0.0, 1.0)) if row not in declared]
    return (declared + missing + [(1.0, 0.0)] * 4)[:4]


def problems(rng: np.random.Generator, n: int) -> Arranged:
    """Return problems of one to four clutches, with equal rows, nearly equal rows and zero
    capacities among them."""
    count = rng.integers(1, 5, n)
    ratio = rng.choice([-1.0, 1.0], (n, 4)) * 10.0 ** rng.uniform(-2.0, 2.0, (n, 4))
    common = rng.choice([-2.0, -1.0, -0.5, 0.5, 1.0, 2.0], (n, 4))
    kind = rng.integers(0, 6, (n, 4))
    w = np.ones((n, 4, 2))
    w[..., 1] = np.select(
        [kind <= 1, kind == 2, kind == 3], [0.0, ratio, common], common * (1.0 + 1.001 * NEAR)
    )
    w[kind == 1] = (0.0, 1.0)
    twin = (kind == 5) & (np.arange(4) > 0)
    w = np.where(twin[..., None], np.roll(w, 1, axis=1), w)
    c = rng.uniform(0.0, 1.0, (n, 4)) * rng.integers(0, 3, (n, 4)).clip(0, 1)
    for i in range(n):
        w[i] = slots([tuple(row) for row in w[i, : count[i]].tolist()])
        c[i, count[i] :] = 0.0
    same = (w == w[:, :1]).all(axis=(1, 2))  # four in one direction: a machine refuses that
    w[same, 3] = np.where(w[same, 0, :1] == 0.0, (1.0, 0.0), (0.0, 1.0))
    m11, m22 = np.exp(rng.uniform(-3.0, 1.5, (2, n)))
    m12 = rng.uniform(-0.98, 0.98, n) * np.sqrt(m11 * m22)
    reach = 0.1 + (c * np.abs(w).sum(axis=2)).sum(axis=1)
    size, angle = np.exp(rng.uniform(-4.0, 2.0, n)) * reach, rng.uniform(0.0, 2.0 * np.pi, n)
    p = np.stack([size * np.cos(angle), size * np.sin(angle)], axis=1)
    return Arranged(np.stack([m11, m12, m22], axis=1), p, c, w)


def share(load: np.ndarray, low: np.ndarray, high: np.ndarray, w: np.ndarray) -> np.ndarray:
    """Return torques (n, 4): of 81 choices of who is at which bound, the possible one of least Σ
    τ².

    The others then have the least torques that carry the rest, by singular values.
    """
    best, found = np.full(len(load), np.inf), np.full_like(low, np.nan)
    size = np.abs(load).sum(axis=1) + (high - low).sum(axis=1)
    for state in itertools.product((-1, 0, 1), repeat=4):
        free = np.array(state) == 0
        torque = np.where(free, 0.0, np.where(np.array(state) < 0, low, high))
        rest = load - np.einsum("nx,nxi->ni", torque, w)
        if free.any():
            torque[:, free] = np.einsum(
                "nxi,ni->nx", np.linalg.pinv(w[:, free].transpose(0, 2, 1)), rest
            )
        off = np.abs(load - np.einsum("nx,nxi->ni", torque, w)).sum(axis=1)
        off += np.maximum(low - torque, torque - high).max(axis=1).clip(0.0)
        squares = (torque * torque).sum(axis=1)
        better = (off <= 1e-11 * size) & (squares < best)
        best, found = np.where(better, squares, best), np.where(better[:, None], torque, found)
    return found


def merged(given: Arranged) -> tuple[np.ndarray, np.ndarray]:
    """Return rows and capacities in which no two rows are equal; a clutch that was merged has no
    capacity."""
    w, c = given.w.astype(WIDE), given.c.astype(WIDE)
    for x, y in itertools.combinations(range(4), 2):
        equal = (w[:, x] == w[:, y]).all(axis=1)
        c[:, x] += np.where(equal, c[:, y], 0)
        c[:, y] = np.where(equal, 0, c[:, y])
        w[:, y] = np.where(equal[:, None], np.array([1, 1000 + y], WIDE), w[:, y])
    return w, c


def solve(given: Arranged) -> np.ndarray:
    """Return the velocities (n, 2): of 72 states of the impulses, that which violates the
    conditions least."""
    (w, c), mass, p = merged(given), given.mass.astype(WIDE), given.p.astype(WIDE)
    m11, m12, m22 = mass.T
    det = m11 * m22 - m12 * m12
    scale = given.momentum
    best, found = np.full(len(p), np.inf, WIDE), np.zeros_like(p)
    for state in itertools.product((-1, 0, 1), repeat=4):
        free = [x for x in range(4) if state[x] == 0]
        if len(free) > 2:
            continue
        impulse = c * np.array(state, WIDE)
        rest = p - np.einsum("nx,nxi->ni", impulse, w)
        omega = np.zeros_like(p)
        if not free:
            omega[:, 0] = (m22 * rest[:, 0] - m12 * rest[:, 1]) / det
            omega[:, 1] = (m11 * rest[:, 1] - m12 * rest[:, 0]) / det
        elif len(free) == 1:
            row = w[:, free[0]]
            d = np.stack([-row[:, 1], row[:, 0]], axis=1)
            push = np.stack([m11 * d[:, 0] + m12 * d[:, 1], m12 * d[:, 0] + m22 * d[:, 1]], axis=1)
            speed = (rest * d).sum(axis=1) / (push * d).sum(axis=1)
            omega = speed[:, None] * d
            impulse[:, free[0]] = ((rest - speed[:, None] * push) * row).sum(axis=1) / (
                row * row
            ).sum(axis=1)
        else:
            (a1, b1), (a2, b2) = w[:, free[0]].T, w[:, free[1]].T
            area = a1 * b2 - b1 * a2
            impulse[:, free[0]] = (b2 * rest[:, 0] - a2 * rest[:, 1]) / area
            impulse[:, free[1]] = (a1 * rest[:, 1] - b1 * rest[:, 0]) / area
        size = np.abs(w).sum(axis=2)
        over = (np.maximum(np.abs(impulse) - c, 0) * size)[:, free].sum(axis=1)
        slip = np.einsum("nxi,ni->nx", w, omega)
        back = (np.maximum(-slip * np.array(state, WIDE), 0) / size).sum(axis=1) * det / (m11 + m22)
        violation = (over + back) / scale
        better = violation < best
        best, found = np.where(better, violation, best), np.where(better[:, None], omega, found)
    return found
