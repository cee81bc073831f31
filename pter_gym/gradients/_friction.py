# pyright: standard
"""The derivatives of the friction problem ``friction.resolve``, written by hand."""

from pter_gym._compiled.compiler import inlined
from pter_gym._physics.arrangement import OptionalArrangement
from pter_gym._physics.clutch import PerClutch
from pter_gym._physics.friction import sliding_torque, slip_velocities, torques_on_links


@inlined
def momentum_bar(
    m11: float,
    m12: float,
    m22: float,
    omega_a: float,
    omega_b: float,
    by_a: float,
    by_b: float,
    slip: PerClutch,
) -> tuple[float, float]:
    """Return the adjoint of the momentum before friction, from the adjoint λ of ω after it.

    It is M⁻¹·λ where all clutches slip, d·dᵀ·λ/(dᵀM·d) if a clutch sticks and ω has the direction
    d, and 0 at rest.
    """
    if (slip.x1 == 0.0) | (slip.x2 == 0.0) | (slip.x3 == 0.0) | (slip.x4 == 0.0):
        size = max(abs(omega_a), abs(omega_b))
        if size == 0.0:
            return 0.0, 0.0
        d_a, d_b = omega_a / size, omega_b / size
        inertia = m11 * d_a * d_a + 2.0 * m12 * d_a * d_b + m22 * d_b * d_b
        along = (d_a * by_a + d_b * by_b) / inertia
        return along * d_a, along * d_b
    inverse = 1.0 / (m11 * m22 - m12 * m12)
    return inverse * (m22 * by_a - m12 * by_b), inverse * (m11 * by_b - m12 * by_a)


@inlined
def resolve_adjoint(
    m11: float,
    m12: float,
    m22: float,
    p_a: float,
    p_b: float,
    c: PerClutch,
    arrangement: OptionalArrangement,
    omega_a: float,
    omega_b: float,
    by_a: float,
    by_b: float,
) -> tuple[float, float, float, float, float, float, float, float, float]:
    """Return the adjoints of M (3), p (2) and c (4) of ``friction.resolve``, by those of ω.

    With P of ``momentum_bar``, ω changes by P·(dp − dM·ω − Σ_x W_xᵀ·sign(W_x·ω)·dc_x).
    """
    _ = p_a, p_b, c
    slip = slip_velocities(omega_a, omega_b, arrangement)
    q_a, q_b = momentum_bar(m11, m12, m22, omega_a, omega_b, by_a, by_b, slip)
    c1, c2, c3, c4 = sliding_torque(slip, slip_velocities(q_a, q_b, arrangement))
    return -q_a * omega_a, -q_a * omega_b - q_b * omega_a, -q_b * omega_b, q_a, q_b, c1, c2, c3, c4


@inlined
def resolve_tangent(
    m11: float,
    m12: float,
    m22: float,
    p_a: float,
    p_b: float,
    c: PerClutch,
    arrangement: OptionalArrangement,
    omega_a: float,
    omega_b: float,
    d11: float,
    d12: float,
    d22: float,
    d_a: float,
    d_b: float,
    d1: float,
    d2: float,
    d3: float,
    d4: float,
) -> tuple[float, float]:
    """Return the tangents of ω of ``friction.resolve``, by those of M (3), p (2) and c (4)."""
    _ = p_a, p_b, c
    slip = slip_velocities(omega_a, omega_b, arrangement)
    less_a, less_b = torques_on_links(sliding_torque(slip, PerClutch(d1, d2, d3, d4)), arrangement)
    by_a = d_a - d11 * omega_a - d12 * omega_b + less_a
    by_b = d_b - d12 * omega_a - d22 * omega_b + less_b
    return momentum_bar(m11, m12, m22, omega_a, omega_b, by_a, by_b, slip)
