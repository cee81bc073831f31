"""Clutches that creep: Eq. 2 as printed, where the dynamic torque T_k exceeds breakaway T_s.

Such a clutch exerts T_s within the stick band and T_k beyond it, so its friction has the convex
potential T_s·|s| up to the edge of the band, |s| = δω, and the slope T_k from there on: a kink of
capacity T_s at rest, and at each edge one of capacity (T_k − T_s)/2 about (T_k + T_s)/2. Under a
load between the two it stays at the edge. All clutches together still have one convex problem, and
its solution is exact for a substep of any length.
"""

import math

from pter_gym._compiled.compiler import inlined
from pter_gym._compiled.records import entrywise
from pter_gym._physics.arrangement import OptionalArrangement
from pter_gym._physics.clutch import PerClutch
from pter_gym._physics.friction import resolve, sliding_torque, slip_velocities, torques_on_links
from pter_gym._physics.scalars import sign

MAX_CROSSINGS = 16
"""Most kinks at which the search stops; in a hundred thousand random problems it stopped at 8."""

AT_EDGE = 1e-6
"""How near to the edge of the band, relative to it, a slip velocity is at it: rounding is less."""


@entrywise
@inlined
def held_torque(capacity: float, breakaway: float, dynamic: float, creeps: float) -> float:
    """Return the torque [N·m] of a clutch within the band, from that beyond it."""
    return breakaway if creeps * dynamic > breakaway else capacity


@entrywise
@inlined
def inner_torque(slip: float, edge: float, least: float, most: float) -> float:
    """Return the smallest torque [N·m] against its slip that a clutch may exert."""
    return most if abs(slip) > edge else least


@entrywise
@inlined
def outer_torque(slip: float, edge: float, least: float, most: float) -> float:
    """Return the largest torque [N·m] against its slip that a clutch may exert."""
    return least if abs(slip) < edge else most


@entrywise
@inlined
def mean_torque(inner: float, outer: float) -> float:
    """Return the middle of the torques [N·m] that a clutch may exert against its slip."""
    return 0.5 * (inner + outer)


@entrywise
@inlined
def half_width(slip: float, inner: float, outer: float) -> float:
    """Return how far torques [N·m] that a clutch may exert are from their middle."""
    return outer if slip == 0.0 else 0.5 * (outer - inner)


@entrywise
@inlined
def next_kink(slip: float, change: float, edge: float, least: float, most: float) -> float:
    """Return the next slip velocity [rad/s] in the direction of a change at which torque jumps."""
    along = slip if change > 0.0 else -slip
    edge = edge if most > least else 0.0
    kink = 0.0 if along < 0.0 else (edge if along < edge else math.inf)
    kink = -edge if along < -edge else kink
    return kink if change > 0.0 else -kink


@entrywise
@inlined
def share_to(slip: float, change: float, kink: float) -> float:
    """Return the share of a change of slip at which it is at a kink."""
    return math.inf if change == 0.0 else (kink - slip) / change


@entrywise
@inlined
def moved(slip: float, change: float, kink: float, own: float, share: float) -> float:
    """Return a slip velocity [rad/s] after a share of its change, exact at its kink."""
    return kink if own <= share else slip + share * change


@entrywise
@inlined
def snapped(slip: float, edge: float) -> float:
    """Return a slip velocity [rad/s], exact at the edge of the band."""
    return sign(slip) * edge if abs(abs(slip) - edge) <= AT_EDGE * edge else slip


@inlined
def creeping(
    m11: float,
    m12: float,
    m22: float,
    p_a: float,
    p_b: float,
    edge: float,
    least: PerClutch,
    most: PerClutch,
    arrangement: OptionalArrangement = None,
) -> tuple[float, float, PerClutch]:
    """Return the angular velocities [rad/s] of least potential, and slip velocities exact at kinks.

    ``least`` and ``most`` are the clutches' impulses [N·m·s] within the band and beyond it. From
    rest on, each step leads to the least of the potential as it is here, or to the first kink on
    the way, so the potential falls with each.
    """
    omega_a, omega_b, slip = 0.0, 0.0, PerClutch(0.0, 0.0, 0.0, 0.0)
    for _ in range(MAX_CROSSINGS):
        inner, outer = inner_torque(slip, edge, least, most), outer_torque(slip, edge, least, most)
        mean = sliding_torque(slip, mean_torque(inner, outer))
        mean_a, mean_b = torques_on_links(mean, arrangement)
        turn_a, turn_b = resolve(
            m11,
            m12,
            m22,
            p_a - (m11 * omega_a + m12 * omega_b) + mean_a,
            p_b - (m12 * omega_a + m22 * omega_b) + mean_b,
            half_width(slip, inner, outer),
            arrangement,
        )
        change = slip_velocities(turn_a, turn_b, arrangement)
        kink = next_kink(slip, change, edge, least, most)
        own = share_to(slip, change, kink)
        share = min(1.0, own.x1, own.x2, own.x3, own.x4)
        slip = moved(slip, change, kink, own, share)
        omega_a, omega_b = omega_a + share * turn_a, omega_b + share * turn_b
        if share == 1.0:
            break
    return omega_a, omega_b, slip
