"""The clutch torques that come closest to the desired joint torques (paper section III-A).

The reachable joint torques form the same zonotope as in the friction problem, so finding the
nearest one is a friction problem too, with the metric in place of the mass matrix and the unreached
remainder in place of the velocity.
"""

from typing import Any

from pter_gym._compiled.compiler import inlined
from pter_gym._compiled.records import entrywise
from pter_gym._physics.arm import PerLink, cos_difference
from pter_gym._physics.arrangement import OptionalArrangement
from pter_gym._physics.clutch import PerClutch
from pter_gym._physics.friction import resolve, slip_velocities, split_load, torques_on_links
from pter_gym.controllers._gains import Entries, Nominal
from pter_gym.controllers._laws import Tip


@entrywise
@inlined
def lower_bound(slip: float, threshold: float, limit: float, scale: float) -> float:
    """Return the smallest torque of a passive clutch [N·m]: 0 while it slips backwards."""
    return 0.0 if slip < -threshold else -(limit * scale)


@entrywise
@inlined
def upper_bound(slip: float, threshold: float, limit: float, scale: float) -> float:
    """Return the largest torque of a passive clutch [N·m]: 0 while it slips forwards."""
    return 0.0 if slip > threshold else limit * scale


@inlined
def allocate(
    want_a: float,
    want_b: float,
    low: PerClutch,
    high: PerClutch,
    m11: float,
    m12: float,
    m22: float,
    arrangement: OptionalArrangement = None,
) -> PerClutch:
    """Return the clutch torques within bounds that come closest to the desired joint torques [N·m].

    Minimises ``(Wᵀτ − want)ᵀ·M⁻¹·(Wᵀτ − want)``, then Σ τ_x² among the minimisers. M is the
    identity for distances in joint torque, or JᵀJ for distances in tip force.
    """
    middle_a, middle_b = torques_on_links(mean(low, high), arrangement)
    half = mean(negative(low), high)
    short_a, short_b = resolve(
        m11, m12, m22, want_a - middle_a, want_b - middle_b, half, arrangement
    )
    got_a = want_a - (m11 * short_a + m12 * short_b)
    got_b = want_b - (m12 * short_a + m22 * short_b)
    short = slip_velocities(short_a, short_b, arrangement)
    return split_load(
        got_a, got_b, pinned(short, high, low), pinned(negative(short), low, high), 0.0, arrangement
    )


@entrywise
@inlined
def mean(low: float, high: float) -> float:
    """Return the mean of two torques."""
    return 0.5 * (high + low)


@entrywise
@inlined
def negative(value: float) -> float:
    """Return a number with the other sign."""
    return -value


@entrywise
@inlined
def pinned(short: float, bound: float, other: float) -> float:
    """Return ``bound`` for a clutch that falls short of its wanted torque, else ``other``."""
    return bound if short > 0.0 else other


@inlined
def passive_torques(
    g: Any, tip: Tip, nominal: Nominal, want: PerLink, arrangement: OptionalArrangement = None
) -> PerClutch:
    """Return the torques [N·m] of braking clutches that come closest to joint torques [N·m].

    Distances are in joint torque, or in tip force if ``g.tip_space``.
    """
    low = lower_bound(tip.slip, g.slip_threshold, nominal.torque_limit, nominal.scale)
    high = upper_bound(tip.slip, g.slip_threshold, nominal.torque_limit, nominal.scale)
    m11, m12, m22 = 1.0, 0.0, 1.0
    if g.tip_space >= 0.5:
        length_a, length_b = tip.arm.length_a, tip.arm.length_b
        m11, m12, m22 = (
            length_a * length_a,
            length_a * length_b * cos_difference(tip.q),
            length_b * length_b,
        )
    return allocate(want.a, want.b, low, high, m11, m12, m22, arrangement)


@inlined
def unsteered(
    g: Any,
    tip: Tip,
    nominal: Nominal,
    want: PerLink,
    memory: Entries,  # noqa: ARG001
    arrangement: OptionalArrangement,
) -> PerClutch:
    """Return the clutch torques [N·m] of a law that steers by its tip force alone."""
    return passive_torques(g, tip, nominal, want, arrangement)
