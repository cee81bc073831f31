"""Friction compiled by itself, from plain numbers: what the tests compare with other formulations."""

from functools import cache
from typing import Any

from pter_gym._compiled.compiler import compile_kernel
from pter_gym._physics.clutch import PerClutch
from pter_gym._physics.friction import ClutchMode, mode_of, resolve, share


def _build_resolve(digest: str) -> Any:
    def kernel(
        m11: float, m12: float, m22: float, p_a: float, p_b: float, c1: float, c2: float, c3: float, c4: float
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
        return share(load_a, load_b, PerClutch(l1, l2, l3, l4), PerClutch(u1, u2, u3, u4))

    return kernel


@cache
def _resolve_kernel() -> Any:
    return compile_kernel(_build_resolve)


@cache
def _share_kernel() -> Any:
    return compile_kernel(_build_share)


def resolve_friction(*numbers: float) -> tuple[float, float, ClutchMode]:
    """Return velocities and mode for the mass matrix (m11, m12, m22), the momentum (p_a, p_b) and four capacities."""
    omega_a, omega_b, mode = _resolve_kernel()(*map(float, numbers))
    return omega_a, omega_b, ClutchMode(mode)


def share_torque(
    load_a: float, load_b: float, low: tuple[float, float, float, float], high: tuple[float, float, float, float]
) -> PerClutch:
    """Return the four clutch torques of least Σ τ_x² with Wᵀτ = load and low ≤ τ ≤ high [N·m]."""
    return PerClutch(*_share_kernel()(float(load_a), float(load_b), *map(float, (*low, *high))))
