"""Random friction problems, the ordinary ones and those on which a solver breaks."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from oracle.friction import LINE, W

FACING = np.array([[np.sign(w[0] * d[0] + w[1] * d[1]) for w in W] for d in LINE])
"""FACING[x, y]: sign of the slip of clutch y when the arm moves along LINE[x]."""


@dataclass(frozen=True)
class Problems:
    """A named family of n problems: mass matrix and momentum (n,), capacities (n, 4)."""

    name: str
    m11: np.ndarray
    m12: np.ndarray
    m22: np.ndarray
    p_a: np.ndarray
    p_b: np.ndarray
    c: np.ndarray

    def __len__(self) -> int:
        return len(self.m11)

    def rows(self) -> Iterator[tuple]:
        """The nine numbers of one problem after the other, as Python floats."""
        table = np.column_stack([self.m11, self.m12, self.m22, self.p_a, self.p_b, self.c])
        return map(tuple, table.tolist())

    @property
    def numbers(self) -> tuple:
        return self.m11, self.m12, self.m22, self.p_a, self.p_b, self.c

    @property
    def tied(self) -> bool:
        """Whether these problems lie where the mode changes, on purpose."""
        return self.name.startswith(("side", "corner", "ray"))

    @property
    def determinant(self) -> np.ndarray:
        return np.asarray(np.longdouble(self.m11) * self.m22 - np.longdouble(self.m12) ** 2, float)

    @property
    def condition(self) -> np.ndarray:
        """At least the ratio of M's eigenvalues: trace² / determinant."""
        return (self.m11 + self.m22) ** 2 / self.determinant

    @property
    def compliance(self) -> np.ndarray:
        """At least the largest eigenvalue of M⁻¹: trace / determinant."""
        return (self.m11 + self.m22) / self.determinant

    @property
    def momentum(self) -> np.ndarray:
        """Everything that enters the sums of the right-hand side: |p| and the capacities."""
        return np.abs(self.p_a) + np.abs(self.p_b) + self.c.sum(axis=1)

    @property
    def free_speed(self) -> np.ndarray:
        """|M⁻¹p|, how fast the arm would go without clutches."""
        a = np.longdouble(self.m22) * self.p_a - np.longdouble(self.m12) * self.p_b
        b = np.longdouble(self.m11) * self.p_b - np.longdouble(self.m12) * self.p_a
        return np.asarray(np.hypot(a, b), float) / self.determinant


def _masses(rng: np.random.Generator, n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    m11, m22 = np.exp(rng.uniform(-3.0, 1.5, (2, n)))
    return m11, rng.uniform(-0.98, 0.98, n) * np.sqrt(m11 * m22), m22


def _ordinary(name: str, rng: np.random.Generator, capacities: np.ndarray) -> Problems:
    n = len(capacities)
    size = np.exp(rng.uniform(-3.0, 2.0, n)) * (0.1 + capacities.sum(axis=1))
    angle = rng.uniform(0.0, 2.0 * np.pi, n)
    return Problems(name, *_masses(rng, n), size * np.cos(angle), size * np.sin(angle), capacities)


def _near_singular(rng: np.random.Generator, n: int) -> Problems:
    base = _ordinary("near-singular mass", rng, rng.uniform(0.0, 1.0, (n, 4)))
    gap = 10.0 ** rng.uniform(-10.0, -2.0, n)
    m12 = rng.choice([-1.0, 1.0], n) * np.sqrt(base.m11 * base.m22) * (1.0 - gap)
    return Problems(base.name, base.m11, m12, base.m22, base.p_a, base.p_b, base.c)


def _on_side(rng: np.random.Generator, n: int, whole: bool, corner: bool) -> Problems:
    """p on a side (or a corner) of the zonotope of the capacities; in whole numbers exactly, else
    up to rounding."""
    c = rng.integers(0, 9, (n, 4)).astype(float) if whole else rng.uniform(0.0, 1.0, (n, 4))
    x = rng.integers(0, 4, n)
    rows = np.arange(n)
    impulse = rng.choice([-1.0, 1.0], n)[:, None] * FACING[x] * c
    share = rng.choice([-1.0, 1.0], n) if corner else rng.uniform(-1.0, 1.0, n)
    impulse[rows, x] = np.rint(share * c[rows, x]) if whole else share * c[rows, x]
    p = impulse @ np.array(W, float)
    name = f"{'corner' if corner else 'side'}, {'exact' if whole else 'rounded'}"
    return Problems(name, *_masses(rng, n), p[:, 0], p[:, 1], c)


def _on_ray(rng: np.random.Generator, n: int) -> Problems:
    """p where a clutch that alone is stuck has reached its capacity: between one and two degrees of
    freedom."""
    c = rng.uniform(0.0, 1.0, (n, 4))
    m11, m12, m22 = _masses(rng, n)
    x = rng.integers(0, 4, n)
    d = np.array(LINE, float)[x]
    rows = np.arange(n)
    sign = rng.choice([-1.0, 1.0], n)
    impulse = sign[:, None] * FACING[x] * c
    impulse[rows, x] = rng.choice([-1.0, 1.0], n) * c[rows, x]
    p = impulse @ np.array(W, float)
    speed = sign * np.exp(rng.uniform(-6.0, 1.0, n))
    p_a = p[:, 0] + speed * (m11 * d[:, 0] + m12 * d[:, 1])
    p_b = p[:, 1] + speed * (m12 * d[:, 0] + m22 * d[:, 1])
    return Problems("ray between one and two DOF", m11, m12, m22, p_a, p_b, c)


def _any_units(rng: np.random.Generator, n: int) -> Problems:
    base = _ordinary("any units", rng, rng.uniform(0.0, 1.0, (n, 4)))
    m, p = 10.0 ** rng.uniform(-8.0, 8.0, (2, n))
    return Problems(
        base.name,
        m * base.m11,
        m * base.m12,
        m * base.m22,
        p * base.p_a,
        p * base.p_b,
        p[:, None] * base.c,
    )


def families(seed: int = 20260101) -> list[Problems]:
    """118,000 problems in eleven families; the same seed, the same problems."""
    rng = np.random.default_rng(seed)
    some = rng.uniform(0.0, 1.0, (15_000, 4)) * rng.integers(0, 2, (15_000, 4))
    spread = 10.0 ** rng.uniform(-9.0, 0.0, (10_000, 4))
    return [
        _ordinary("ordinary", rng, rng.uniform(0.0, 1.0, (40_000, 4))),
        _ordinary("zero capacities", rng, some),
        _ordinary(
            "equal capacities", rng, np.repeat(rng.uniform(0.0, 1.0, (10_000, 1)), 4, axis=1)
        ),
        _ordinary("capacities over nine decades", rng, spread),
        _on_side(rng, 5_000, whole=True, corner=False),
        _on_side(rng, 5_000, whole=True, corner=True),
        _on_side(rng, 5_000, whole=False, corner=False),
        _on_side(rng, 5_000, whole=False, corner=True),
        _on_ray(rng, 5_000),
        _near_singular(rng, 15_000),
        _any_units(rng, 3_000),
    ]
