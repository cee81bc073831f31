"""Friction compiled by itself, from plain numbers, to compare with other formulations."""

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pter_gym._compiled.compiler import compile_kernel, compiled
from pter_gym._physics.arrangement import Arrangement
from pter_gym._physics.clutch import PerClutch
from pter_gym._physics.friction import ClutchMode, mode_of, resolve, split_load

Array = NDArray[np.float64]


def _build_resolve(digest: str) -> Any:
    def kernel(
        m11: float,
        m12: float,
        m22: float,
        p_a: float,
        p_b: float,
        c1: float,
        c2: float,
        c3: float,
        c4: float,
    ) -> tuple[float, float, int]:
        _ = digest
        omega_a, omega_b = resolve(m11, m12, m22, p_a, p_b, PerClutch(c1, c2, c3, c4))
        return omega_a, omega_b, mode_of(omega_a, omega_b)

    return kernel


def _build_share(digest: str) -> Any:
    def kernel(
        load_a: float,
        load_b: float,
        l1: float,
        l2: float,
        l3: float,
        l4: float,
        u1: float,
        u2: float,
        u3: float,
        u4: float,
    ) -> PerClutch:
        _ = digest
        return split_load(load_a, load_b, PerClutch(l1, l2, l3, l4), PerClutch(u1, u2, u3, u4))

    return kernel


@cache
def _resolve_kernel() -> Any:
    return compile_kernel(_build_resolve)


@cache
def _share_kernel() -> Any:
    return compile_kernel(_build_share)


def resolve_friction(*numbers: float) -> tuple[float, float, ClutchMode]:
    """Return velocities and mode for a mass matrix, a momentum and four capacities."""
    omega_a, omega_b, mode = _resolve_kernel()(*map(float, numbers))
    return omega_a, omega_b, ClutchMode(mode)


def share_torque(
    load_a: float,
    load_b: float,
    low: tuple[float, float, float, float],
    high: tuple[float, float, float, float],
) -> PerClutch:
    """Return the four clutch torques of least Σ τ_x² with Wᵀτ = load and low ≤ τ ≤ high [N·m]."""
    return PerClutch(*_share_kernel()(float(load_a), float(load_b), *map(float, (*low, *high))))


@compiled
def _four(numbers: Any) -> PerClutch:
    return PerClutch(numbers[0], numbers[1], numbers[2], numbers[3])


@compiled
def _own(w: Any) -> Arrangement:
    return Arrangement(_four(w[:, 0]), _four(w[:, 1]), PerClutch(0.0, 0.0, 0.0, 0.0), 4.0)


def _build_arranged(digest: str) -> Any:
    def kernel(mass: Any, p: Any, c: Any, w: Any, omega: Any) -> None:
        _ = digest
        for i in range(len(p)):
            m = mass[i]
            omega[i, 0], omega[i, 1] = resolve(
                m[0], m[1], m[2], p[i, 0], p[i, 1], _four(c[i]), _own(w[i])
            )

    return kernel


def _build_shared(digest: str) -> Any:
    def kernel(load: Any, low: Any, high: Any, w: Any, torque: Any) -> None:
        _ = digest
        for i in range(len(load)):
            found = split_load(
                load[i, 0], load[i, 1], _four(low[i]), _four(high[i]), 0.0, _own(w[i])
            )
            for x in range(4):
                torque[i, x] = found[x]

    return kernel


@cache
def _arranged_kernel() -> Any:
    return compile_kernel(_build_arranged, _four=_four, _own=_own)


@cache
def _shared_kernel() -> Any:
    return compile_kernel(_build_shared, _four=_four, _own=_own)


def resolve_arranged(mass: Array, p: Array, c: Array, w: Array) -> Array:
    """Return velocities (n, 2) for n masses (3), momenta (2), capacities (4), rows of W (4, 2)."""
    omega = np.empty_like(p)
    _arranged_kernel()(mass, p, c, w, omega)
    return omega


def share_arranged(load: Array, low: Array, high: Array, w: Array) -> Array:
    """Return torques (n, 4) for loads (n, 2), bounds (n, 4) and rows of W (n, 4, 2)."""
    torque = np.empty_like(low)
    _shared_kernel()(load, low, high, w, torque)
    return torque
