"""Joint dry friction for any W; ``pter_gym._physics.friction`` has it for the paper's."""

import math
from typing import Annotated, Any, NamedTuple

from pter_gym._compiled.compiler import inlined
from pter_gym._compiled.records import Entry, entrywise
from pter_gym._physics.clutch import PerClutch
from pter_gym._physics.scalars import clamp, sign

FAR = 1e300
"""A squared distance beyond any other."""


class Arrangement(NamedTuple):
    """W of a machine: a row (a, b) for each slot, which is (1, b) or (0, 1).

    So (−b·s, a·s) is on a slot's line for every speed s: its slip a·ω_a + b·ω_b is exactly zero
    there, in floating point too. A slot without a clutch has a row, and no torque but dry
    friction's.
    """

    a: Annotated[PerClutch, Entry("1", "slip velocity over that of link A")]
    b: Annotated[PerClutch, Entry("1", "slip velocity over that of link B")]
    dry: Annotated[PerClutch, Entry("N·m", "dry friction of the axis that slips with it")]
    number: Annotated[
        float, Entry("1", "number of clutches, in the first slots; 0 for the paper's four")
    ]


OptionalArrangement = Arrangement | None
"""The arrangement of a machine, None for the paper's."""


class OnLine(NamedTuple):
    """The minimum on a clutch's line, (−b, a)·speed [rad/s]; ``turn`` is the speed's sign.

    ``side`` is the sign of the clutch's slip in the solution, 0 where the solution is this minimum;
    valid if it moves.
    """

    moves: bool
    turn: float
    speed: float
    side: float


@inlined
def side(multiplier: float, capacity: float) -> float:
    """Return the side of a clutch's line on which the minimum lies, 0 if the clutch sticks."""
    over = 1.0 if multiplier > capacity else 0.0
    return -1.0 if multiplier < -capacity else over


@entrywise
@inlined
def combined(x: float, u: float, y: float, v: float) -> float:
    """Return u·x + v·y, for each clutch."""
    return u * x + v * y


within: Any = entrywise(clamp)


@inlined
def dot(x: PerClutch, y: PerClutch) -> float:
    """Return Σ x·y over the clutches."""
    return x.x1 * y.x1 + x.x2 * y.x2 + x.x3 * y.x3 + x.x4 * y.x4


@inlined
def cross(arrangement: Arrangement, x: int, y: int) -> float:
    """Return the slip of slot y at speed 1 on the line of slot x, exactly zero for equal rows."""
    return arrangement.a[x] * arrangement.b[y] - arrangement.b[x] * arrangement.a[y]


@inlined
def on_line(
    x: int,
    m11: float,
    m12: float,
    m22: float,
    p_a: float,
    p_b: float,
    c: PerClutch,
    arrangement: Arrangement,
) -> OnLine:
    """Return the minimum on the line of slot x; slots with equal rows act as one."""
    a, b = arrangement.a[x], arrangement.b[x]
    q = a * p_b - b * p_a
    turn = sign(q)
    reach, capacity, left_a, left_b = 0.0, 0.0, p_a, p_b
    for y in range(4):
        slip = cross(arrangement, x, y)
        impulse = turn * side(slip, 0.0) * c[y]
        reach += c[y] * abs(slip)
        capacity += c[y] if slip == 0.0 else 0.0
        left_a -= impulse * arrangement.a[y]
        left_b -= impulse * arrangement.b[y]
    push_a = a * m12 - b * m11
    push_b = a * m22 - b * m12
    speed = turn * (abs(q) - reach) / (a * push_b - b * push_a)
    multiplier = a * (left_a - speed * push_a) + b * (left_b - speed * push_b)
    return OnLine(abs(q) > reach, turn, speed, side(multiplier / (a * a + b * b), capacity))


@inlined
def resolve_any(
    m11: float,
    m12: float,
    m22: float,
    p_a: float,
    p_b: float,
    c: PerClutch,
    arrangement: Arrangement,
) -> tuple[float, float]:
    """Return what ``friction.resolve`` does and as it does, for rows of which two differ."""
    lines = (
        on_line(0, m11, m12, m22, p_a, p_b, c, arrangement),
        on_line(1, m11, m12, m22, p_a, p_b, c, arrangement),
        on_line(2, m11, m12, m22, p_a, p_b, c, arrangement),
        on_line(3, m11, m12, m22, p_a, p_b, c, arrangement),
    )
    moves, on_a_line, toward_a, toward_b = False, False, 0.0, 0.0
    for x in range(4):
        moves |= lines[x].moves
        on_a_line |= lines[x].moves & (lines[x].side == 0.0)
        toward_a = -lines[x].turn * arrangement.b[x] if lines[x].moves else toward_a
        toward_b = lines[x].turn * arrangement.a[x] if lines[x].moves else toward_b
    free_a, free_b = p_a, p_b
    for x in range(4):
        rest = side(arrangement.a[x] * toward_a + arrangement.b[x] * toward_b, 0.0)
        impulse = c[x] * (lines[x].side if lines[x].moves else rest)
        free_a -= impulse * arrangement.a[x]
        free_b -= impulse * arrangement.b[x]
    det = m11 * m22 - m12 * m12
    sector_a = (m22 * free_a - m12 * free_b) / det
    sector_b = (m11 * free_b - m12 * free_a) / det
    omega_a = sector_a if moves else 0.0
    omega_b = sector_b if moves else 0.0
    for x in range(4):
        wrong = lines[x].side * (arrangement.a[x] * sector_a + arrangement.b[x] * sector_b) < 0.0
        stuck = lines[x].moves & ((not on_a_line) & wrong | (lines[x].side == 0.0))
        omega_a = -(arrangement.b[x] * lines[x].speed) if stuck else omega_a
        omega_b = arrangement.a[x] * lines[x].speed if stuck else omega_b
    return omega_a, omega_b


@inlined
def least_torques(
    load_a: float, load_b: float, fixed: int, torque: float, arrangement: Arrangement
) -> PerClutch:
    """Return the torques of least Σ τ_x² with Wᵀτ = load and slot ``fixed`` (−1: none) at a torque.

    They are NaN if the other rows are equal: then they cannot balance the load for every given
    torque.
    """
    g11, g12, g22, det = 0.0, 0.0, 0.0, 0.0
    for x in range(4):
        free = 0.0 if x == fixed else 1.0
        g11 += free * arrangement.a[x] * arrangement.a[x]
        g12 += free * arrangement.a[x] * arrangement.b[x]
        g22 += free * arrangement.b[x] * arrangement.b[x]
        load_a -= (1.0 - free) * arrangement.a[x] * torque
        load_b -= (1.0 - free) * arrangement.b[x] * torque
        for y in range(x):  # Cauchy and Binet: g11·g22 − g12², exactly zero for equal rows
            area = free * cross(arrangement, x, y) if y != fixed else 0.0
            det += area * area
    inverse = 1.0 / det if det > 0.0 else math.nan
    u = (g22 * load_a - g12 * load_b) * inverse
    v = (g11 * load_b - g12 * load_a) * inverse
    return replaced(combined(arrangement.a, u, arrangement.b, v), fixed, torque)


@inlined
def replaced(x: PerClutch, slot: int, value: float) -> PerClutch:
    """Return x with another value for one slot; −1 for none."""
    x1, x2 = value if slot == 0 else x.x1, value if slot == 1 else x.x2
    return PerClutch(x1, x2, value if slot == 2 else x.x3, value if slot == 3 else x.x4)


@inlined
def opposed(fixed: int, arrangement: Arrangement) -> PerClutch:
    """Return torques of all slots but one that together load no link."""
    i, j, k = (1 if fixed == 0 else 0), (1 if fixed > 1 else 2), (2 if fixed == 3 else 3)
    n_i, n_j, n_k = cross(arrangement, j, k), -cross(arrangement, i, k), cross(arrangement, i, j)
    return replaced(PerClutch(n_i, n_i if i == 1 else n_j, n_j if j == 2 else n_k, n_k), fixed, 0.0)


@inlined
def share_any(
    load_a: float,
    load_b: float,
    low: PerClutch,
    high: PerClutch,
    rounding: float,
    arrangement: Arrangement,
) -> PerClutch:
    """Return what ``friction.share`` does, for rows of which two differ.

    The torques that are possible are a convex polygon, each edge of which is a bound of one slot.
    If the least torques without bounds are not among them, the nearest possible ones are on an edge
    beyond which those lie.
    """
    least = least_torques(load_a, load_b, -1, 0.0, arrangement)
    slack = abs(load_a) + abs(load_b)
    for x in range(4):
        slack += high[x] - low[x]
    slack = 1e-12 * slack + 2.0 * rounding
    best, nearest = least, FAR
    for x in range(4):
        edge = clamp(least[x], low[x], high[x])
        at, along = least_torques(load_a, load_b, x, edge, arrangement), opposed(x, arrangement)
        first, last = -FAR, FAR
        for y in range(4):
            if along[y] != 0.0:
                to_low, to_high = (low[y] - at[y]) / along[y], (high[y] - at[y]) / along[y]
                first, last = max(first, min(to_low, to_high)), min(last, max(to_low, to_high))
        candidate = combined(
            at, 1.0, along, clamp(0.0, first, last) if first <= last else 0.5 * (first + last)
        )
        missed, shift = 0.0, combined(candidate, 1.0, least, -1.0)
        for y in range(4):
            missed = max(missed, low[y] - candidate[y], candidate[y] - high[y])
        distance = dot(shift, shift) if missed <= slack else FAR * min(missed, 1.0)
        closer = (edge != least[x]) & (distance < nearest)
        best, nearest = (candidate, distance) if closer else (best, nearest)
    return within(best, low, high)
