# pyright: standard
"""The derivatives of ``friction.resolve`` and ``creep.creeping``, written by hand."""

from pter_gym._compiled.compiler import inlined
from pter_gym._compiled.records import entrywise
from pter_gym._physics.arrangement import OptionalArrangement
from pter_gym._physics.clutch import PerClutch
from pter_gym._physics.creep import inner_torque, outer_torque
from pter_gym._physics.friction import sliding_torque, slip_velocities, torques_on_links


@inlined
def momentum_bar(
    m11: float,
    m12: float,
    m22: float,
    along_a: float,
    along_b: float,
    by_a: float,
    by_b: float,
    slip: PerClutch,
) -> tuple[float, float]:
    """Return the adjoint of the momentum before friction, from the adjoint λ of ω after it.

    It is M⁻¹·λ where all clutches slip, d·dᵀ·λ/(dᵀM·d) if a clutch does not, d along the line of
    its ω, and 0 where there is no such line, as at rest.
    """
    if (slip.x1 == 0.0) | (slip.x2 == 0.0) | (slip.x3 == 0.0) | (slip.x4 == 0.0):
        size = max(abs(along_a), abs(along_b))
        if size == 0.0:
            return 0.0, 0.0
        d_a, d_b = along_a / size, along_b / size
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


@entrywise
@inlined
def free_slip(slip: float, edge: float, least: float, most: float) -> float:
    """Return a slip velocity [rad/s], 0 where a clutch holds it at a kink of its potential."""
    held = inner_torque(slip, edge, least, most) < outer_torque(slip, edge, least, most)
    return 0.0 if held else slip


@inlined
def line_of(slip: PerClutch, arrangement: OptionalArrangement) -> tuple[float, float]:
    """Return the direction of the line on which no slip that is 0 changes, 0 for a point."""
    a, b = slip_velocities(1.0, 0.0, arrangement), slip_velocities(0.0, 1.0, arrangement)
    d_a, d_b, count = 0.0, 0.0, 0
    for x in range(4):
        if slip[x] == 0.0:
            if count == 0:
                d_a, d_b = -b[x], a[x]
            elif a[x] * d_a + b[x] * d_b != 0.0:
                d_a, d_b = 0.0, 0.0
            count += 1
    return d_a, d_b


@inlined
def creeping_adjoint(
    m11: float,
    m12: float,
    m22: float,
    p_a: float,
    p_b: float,
    edge: float,
    least: PerClutch,
    most: PerClutch,
    arrangement: OptionalArrangement,
    omega_a: float,
    omega_b: float,
    slip: PerClutch,
    by_a: float,
    by_b: float,
    by_slip: float,
) -> tuple[float, ...]:
    """Return the adjoints of the numbers of ``creep.creeping``, by those of ω.

    ω changes as by ``friction.resolve``, with clutches at an edge as those at rest, but for
    (ω − P·M·ω)/edge by the edge: what is at kinks is in proportion to it.
    """
    _ = p_a, p_b, by_slip
    free = free_slip(slip, edge, least, most)
    d_a, d_b = line_of(free, arrangement)
    q_a, q_b = momentum_bar(m11, m12, m22, d_a, d_b, by_a, by_b, free)
    c = sliding_torque(free, slip_velocities(q_a, q_b, arrangement))
    left_a, left_b = by_a - m11 * q_a - m12 * q_b, by_b - m12 * q_a - m22 * q_b
    by_edge = (left_a * omega_a + left_b * omega_b) / edge
    by11, by12, by22 = -q_a * omega_a, -q_a * omega_b - q_b * omega_a, -q_b * omega_b
    d1, d2, d3, d4 = inner_torque(slip, edge, c, 0.0)
    e1, e2, e3, e4 = inner_torque(slip, edge, 0.0, c)
    return by11, by12, by22, q_a, q_b, by_edge, d1, d2, d3, d4, e1, e2, e3, e4


@inlined
def creeping_tangent(
    m11: float,
    m12: float,
    m22: float,
    p_a: float,
    p_b: float,
    edge: float,
    least: PerClutch,
    most: PerClutch,
    arrangement: OptionalArrangement,
    omega_a: float,
    omega_b: float,
    slip: PerClutch,
    d11: float,
    d12: float,
    d22: float,
    d_a: float,
    d_b: float,
    d_edge: float,
    d1: float,
    d2: float,
    d3: float,
    d4: float,
    e1: float,
    e2: float,
    e3: float,
    e4: float,
) -> tuple[float, float, float]:
    """Return the tangents of ω of ``creep.creeping``, by those of its numbers, and 0 for slips."""
    _ = p_a, p_b
    free = free_slip(slip, edge, least, most)
    change = inner_torque(slip, edge, PerClutch(d1, d2, d3, d4), PerClutch(e1, e2, e3, e4))
    less_a, less_b = torques_on_links(sliding_torque(free, change), arrangement)
    rise = d_edge / edge
    d11, d12, d22 = d11 + rise * m11, d12 + rise * m12, d22 + rise * m22
    by_a = d_a - d11 * omega_a - d12 * omega_b + less_a
    by_b = d_b - d12 * omega_a - d22 * omega_b + less_b
    along_a, along_b = line_of(free, arrangement)
    by_a, by_b = momentum_bar(m11, m12, m22, along_a, along_b, by_a, by_b, free)
    return by_a + rise * omega_a, by_b + rise * omega_b, 0.0
