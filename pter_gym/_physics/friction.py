"""Joint dry friction of up to four clutches on two axes, independent of the arm's kinematics.

One substep asks for the velocity that minimises ``½·ωᵀMω − pᵀω + Σ c_x·|W_x·ω|``: implicit Euler
with maximum dissipation, strictly convex. Here p is the momentum without clutches, c_x the largest
impulse of clutch x, and W_x its row in W, see ``COUPLING``. This is the paper's W, which needs no
numbers here; functions that depend on it take the ``Arrangement`` of a machine with other clutches
as ``arrangement``.

The four lines W_x·ω = 0 cut the plane into one point (the paper's zero-DOF mode), four lines (its
one-DOF modes) and eight sectors (its two-DOF mode). Line x has the direction d_x with W_x·d_x = 0,
see ``LINES``.
"""

from enum import IntEnum

from pter_gym._compiled.compiler import inlined
from pter_gym._compiled.records import entrywise
from pter_gym._physics.arrangement import (
    FAR,
    OptionalArrangement,
    combined,
    dot,
    resolve_any,
    share_any,
    side,
    within,
)
from pter_gym._physics.clutch import PerClutch
from pter_gym._physics.scalars import clamp, sign
from pter_gym.params import PAPER_CLUTCHES

COUPLING = tuple(each.row for each in PAPER_CLUTCHES)
"""W: slip velocities from the angular velocities of the links (paper Eqs. 3 and 4)."""

LINES = ((0.0, 1.0), (1.0, 0.0), (1.0, 1.0), (1.0, -1.0))
"""Angular velocities of the links, up to a factor, at which each clutch does not slip."""


class ClutchMode(IntEnum):
    """The paper's six dynamic modes (section III-A): which clutch has no relative motion."""

    TWO_DOF = 0
    STUCK_1 = 1
    STUCK_2 = 2
    STUCK_3 = 3
    STUCK_4 = 4
    ZERO_DOF = 5


@inlined
def slip_velocities(
    omega_a: float, omega_b: float, arrangement: OptionalArrangement = None
) -> PerClutch:
    """Return W·ω [rad/s], the slip velocity of each clutch."""
    if arrangement is not None:
        return combined(arrangement.a, omega_a, arrangement.b, omega_b)
    return PerClutch(omega_a, omega_b, omega_a - omega_b, omega_a + omega_b)


@inlined
def torques_on_links(
    torque: PerClutch, arrangement: OptionalArrangement = None
) -> tuple[float, float]:
    """Return Wᵀτ [N·m], what torques of the clutches make together on each link."""
    if arrangement is not None:
        return dot(arrangement.a, torque), dot(arrangement.b, torque)
    return torque.x1 + torque.x3 + torque.x4, torque.x2 - torque.x3 + torque.x4


@inlined
def with_dry(
    capacity: PerClutch, dry_a: float, dry_b: float, arrangement: OptionalArrangement = None
) -> PerClutch:
    """Return capacities [N·m] with the axes' dry friction, which brakes as clutches 1 and 2."""
    if arrangement is not None:
        return combined(capacity, 1.0, arrangement.dry, 1.0)
    return PerClutch(capacity.x1 + dry_a, capacity.x2 + dry_b, capacity.x3, capacity.x4)


@inlined
def without_dry(
    torque: PerClutch, dry_a: float, dry_b: float, arrangement: OptionalArrangement = None
) -> PerClutch:
    """Return the clutches' own part of torques [N·m]; dry friction holds what it can first."""
    if arrangement is not None:
        return combined(
            torque,
            1.0,
            within(torque, combined(arrangement.dry, -1.0, arrangement.dry, 0.0), arrangement.dry),
            -1.0,
        )
    return PerClutch(
        torque.x1 - clamp(torque.x1, -dry_a, dry_a),
        torque.x2 - clamp(torque.x2, -dry_b, dry_b),
        torque.x3,
        torque.x4,
    )


@inlined
def mode_of(omega_a: float, omega_b: float, arrangement: OptionalArrangement = None) -> int:
    """Return the ClutchMode; ties go to the fewest degrees of freedom and the first clutch."""
    mode = 0
    if arrangement is not None:
        slip = slip_velocities(omega_a, omega_b, arrangement)
        for x in range(3, -1, -1):
            mode = x + 1 if (slip[x] == 0.0) & (x < arrangement.number) else mode
        return 5 if (omega_a == 0.0) & (omega_b == 0.0) else mode
    mode = 1 if omega_a == 0.0 else mode
    mode = 2 if omega_b == 0.0 else mode
    mode = 3 if omega_a == omega_b else mode
    mode = 4 if omega_a == -omega_b else mode
    return 5 if (omega_a == 0.0) & (omega_b == 0.0) else mode


@inlined
def rest_sides(
    g1: float, g2: float, g3: float, g4: float, moves1: bool, moves2: bool, moves3: bool
) -> tuple[float, float, float, float]:
    """Return the side of each line with its minimum at rest on which another overload lies."""
    return (
        g2 if moves2 else (g3 if moves3 else g4),
        g1 if moves1 else (g3 if moves3 else -g4),
        -g1 if moves1 else (g2 if moves2 else g4),
        g1 if moves1 else (g2 if moves2 else g3),
    )


@inlined
def resolve(
    m11: float,
    m12: float,
    m22: float,
    p_a: float,
    p_b: float,
    c: PerClutch,
    arrangement: OptionalArrangement = None,
) -> tuple[float, float]:
    """Return the angular velocities [rad/s] after friction. Exact, without iteration or branch.

    Along line x the minimum is a soft threshold, s = max(|p·d| − h(d), 0)/dᵀMd. If clutch x can
    hold the multiplier found there, that is the solution. If not, the multiplier's sign tells on
    which side of the line the solution lies, and four signs name the sector. On a line whose
    minimum is at rest, any other line's overload tells the side. Where rounding puts the sector's
    solution on the wrong side of a line, it belongs to that line.
    """
    if arrangement is not None:
        return resolve_any(m11, m12, m22, p_a, p_b, c, arrangement)
    # p·d along each line, what is left of it by the other clutches' friction h(d), and so whether
    # the minimum on the line moves
    q1 = p_b
    q2 = p_a
    q3 = p_a + p_b
    q4 = p_a - p_b
    g1 = sign(q1)
    g2 = sign(q2)
    g3 = sign(q3)
    g4 = sign(q4)
    excess1 = abs(q1) - (c.x2 + c.x3 + c.x4)
    excess2 = abs(q2) - (c.x1 + c.x3 + c.x4)
    excess3 = abs(q3) - (c.x1 + c.x2 + 2.0 * c.x4)
    excess4 = abs(q4) - (c.x1 + c.x2 + 2.0 * c.x3)
    moves1 = excess1 > 0.0
    moves2 = excess2 > 0.0
    moves3 = excess3 > 0.0
    moves4 = excess4 > 0.0

    # the speed of that minimum, and the multiplier's sign there: 0 if the line's clutch can hold it
    s1 = g1 * excess1 / m22
    s2 = g2 * excess2 / m11
    s3 = g3 * excess3 / (m11 + 2.0 * m12 + m22)
    s4 = g4 * excess4 / (m11 - 2.0 * m12 + m22)
    side1 = side(p_a - m12 * s1 + g1 * (c.x3 - c.x4), c.x1)
    side2 = side(p_b - m12 * s2 + g2 * (c.x3 - c.x4), c.x2)
    side3 = side(0.5 * (q4 - s3 * (m11 - m22) - g3 * (c.x1 - c.x2)), c.x3)
    side4 = side(0.5 * (q3 - s4 * (m11 - m22) - g4 * (c.x1 - c.x2)), c.x4)

    # the sector beside the lines: each clutch slips to the side that its line tells
    rest1, rest2, rest3, rest4 = rest_sides(g1, g2, g3, g4, moves1, moves2, moves3)
    f1 = c.x1 * (side1 if moves1 else rest1)
    f2 = c.x2 * (side2 if moves2 else rest2)
    f3 = c.x3 * (side3 if moves3 else rest3)
    f4 = c.x4 * (side4 if moves4 else rest4)

    free_a = p_a - f1 - f3 - f4
    free_b = p_b - f2 + f3 - f4
    det = m11 * m22 - m12 * m12
    omega_a = (m22 * free_a - m12 * free_b) / det
    omega_b = (m11 * free_b - m12 * free_a) / det

    # at most one clutch sticks in motion, by its multiplier or, in a sector's solution on the wrong
    # side of its line, by rounding
    stuck1 = moves1 & (side1 == 0.0)
    stuck2 = moves2 & (side2 == 0.0)
    stuck3 = moves3 & (side3 == 0.0)
    stuck4 = moves4 & (side4 == 0.0)
    sector = (not stuck1) & (not stuck2) & (not stuck3) & (not stuck4)
    stuck1 = stuck1 | (sector & moves1 & (side1 * omega_a < 0.0))
    stuck2 = stuck2 | (sector & moves2 & (side2 * omega_b < 0.0))
    stuck3 = stuck3 | (sector & moves3 & (side3 * (omega_a - omega_b) < 0.0))
    stuck4 = stuck4 | (sector & moves4 & (side4 * (omega_a + omega_b) < 0.0))
    # a stuck clutch's line is met exactly: not by the sector's formula
    omega_a = 0.0 if stuck1 else (s2 if stuck2 else (s3 if stuck3 else (s4 if stuck4 else omega_a)))
    omega_b = (
        s1 if stuck1 else (0.0 if stuck2 else (s3 if stuck3 else (-s4 if stuck4 else omega_b)))
    )
    moves = moves1 | moves2 | moves3 | moves4
    return (omega_a if moves else 0.0), (omega_b if moves else 0.0)


@inlined
def largest(x: float, y: float, z: float) -> float:
    """Return the largest of three numbers."""
    x = x if x > y else y
    return x if x > z else z


@inlined
def smallest(x: float, y: float, z: float) -> float:
    """Return the smallest of three numbers."""
    x = x if x < y else y
    return x if x < z else z


@inlined
def along_edge(
    beyond: float, across: float, low: float, high: float, slack: float
) -> tuple[float, float]:
    """Return where an edge of a convex region comes nearest to a point, and the squared distance.

    ``beyond`` is how far the point lies beyond the edge's line (0: inside), ``across`` its
    coordinate along that line, on which the edge runs from ``low`` to ``high``. A point that faces
    the inside of an edge has found its projection, so its distance is given as −1; it is infinite
    where the edge does not count.
    """
    nearest = clamp(across, low, high)
    shift = across - nearest
    distance = -1.0 if shift == 0.0 else beyond * beyond + shift * shift
    counts = (beyond != 0.0) & (low <= high + slack)
    return nearest, (distance if counts else FAR)


@inlined
def nearer(
    u: float, v: float, distance: float, other_u: float, other_v: float, other_distance: float
) -> tuple[float, float, float]:
    """Return the nearer of two points and its squared distance; ties go to the first."""
    closer = other_distance < distance
    return (
        (other_u if closer else u),
        (other_v if closer else v),
        (other_distance if closer else distance),
    )


@inlined
def split_load(
    load_a: float,
    load_b: float,
    low: PerClutch,
    high: PerClutch,
    rounding: float = 0.0,
    arrangement: OptionalArrangement = None,
) -> PerClutch:
    """Return the torques of least Σ τ_x² with Wᵀτ = load, in reach, and low ≤ τ ≤ high.

    A load that is known to a ``rounding`` [N·m] only may be as far out of reach.

    With (u, v) = (τ3, τ4) the equations leave τ1 = load_a − u − v and τ2 = load_b + u − v, and the
    sum of squares is 3·|(u, v) − (u0, v0)|² + constant. So the answer is the Euclidean projection
    of (u0, v0) onto an octagon whose edges bound u, v, u + v and u − v.
    """
    if arrangement is not None:
        return share_any(load_a, load_b, low, high, rounding, arrangement)
    u0 = (load_a - load_b) / 3.0
    v0 = (load_a + load_b) / 3.0
    sum_low = load_a - high.x1
    sum_high = load_a - low.x1
    diff_low = low.x2 - load_b
    diff_high = high.x2 - load_b
    ranges = high.x1 - low.x1 + high.x2 - low.x2 + high.x3 - low.x3 + high.x4 - low.x4
    slack = 1e-12 * (abs(load_a) + abs(load_b) + ranges) + 2.0 * rounding
    edge_u = clamp(u0, low.x3, high.x3)
    edge_v = clamp(v0, low.x4, high.x4)
    edge_sum = clamp(u0 + v0, sum_low, sum_high)
    edge_diff = clamp(u0 - v0, diff_low, diff_high)

    v, best = along_edge(
        u0 - edge_u,
        v0,
        largest(low.x4, sum_low - edge_u, edge_u - diff_high),
        smallest(high.x4, sum_high - edge_u, edge_u - diff_low),
        slack,
    )
    u = edge_u
    nearest, distance = along_edge(
        v0 - edge_v,
        u0,
        largest(low.x3, sum_low - edge_v, edge_v + diff_low),
        smallest(high.x3, sum_high - edge_v, edge_v + diff_high),
        slack,
    )
    u, v, best = nearer(u, v, best, nearest, edge_v, distance)
    nearest, distance = along_edge(
        u0 + v0 - edge_sum,
        u0 - v0,
        largest(diff_low, 2.0 * low.x3 - edge_sum, edge_sum - 2.0 * high.x4),
        smallest(diff_high, 2.0 * high.x3 - edge_sum, edge_sum - 2.0 * low.x4),
        slack,
    )
    u, v, best = nearer(
        u, v, best, 0.5 * (edge_sum + nearest), 0.5 * (edge_sum - nearest), 0.5 * distance
    )
    nearest, distance = along_edge(
        u0 - v0 - edge_diff,
        u0 + v0,
        largest(sum_low, 2.0 * low.x3 - edge_diff, edge_diff + 2.0 * low.x4),
        smallest(sum_high, 2.0 * high.x3 - edge_diff, edge_diff + 2.0 * high.x4),
        slack,
    )
    u, v, best = nearer(
        u, v, best, 0.5 * (nearest + edge_diff), 0.5 * (nearest - edge_diff), 0.5 * distance
    )

    inside = best >= 0.5 * FAR
    u = clamp(u0 if inside else u, low.x3, high.x3)
    v = clamp(v0 if inside else v, low.x4, high.x4)
    return PerClutch(
        clamp(load_a - u - v, low.x1, high.x1), clamp(load_b + u - v, low.x2, high.x2), u, v
    )


@entrywise
@inlined
def sliding_torque(slip: float, capacity: float) -> float:
    """Return the torque [N·m] of a sliding clutch, 0 for one that does not slip."""
    return 0.0 if slip == 0.0 else -sign(slip) * capacity


@entrywise
@inlined
def lower_bound(slip: float, inner: float, outer: float) -> float:
    """Return the smallest torque on the arm that a clutch can generate at a slip velocity."""
    return inner if slip < 0.0 else -outer


@entrywise
@inlined
def upper_bound(slip: float, inner: float, outer: float) -> float:
    """Return the largest torque on the arm that a clutch can generate at a slip velocity."""
    return -inner if slip > 0.0 else outer


@inlined
def generated_torques(
    slip: PerClutch,
    load_a: float,
    load_b: float,
    inner: PerClutch,
    outer: PerClutch,
    rounding: float = 0.0,
    arrangement: OptionalArrangement = None,
) -> PerClutch:
    """Return the torque of each clutch on the arm [N·m], from what all four exert on the links.

    A slipping clutch generates a torque from ``inner`` to ``outer`` against the slip, which are
    equal but for one that creeps; a stuck one has at most ``outer`` in either direction. They share
    what is left open with the least Σ τ_x²; where the paper's equations are statically
    indeterminate (section III-A) this picks one answer.
    """
    low, high = lower_bound(slip, inner, outer), upper_bound(slip, inner, outer)
    return split_load(load_a, load_b, low, high, rounding, arrangement)
