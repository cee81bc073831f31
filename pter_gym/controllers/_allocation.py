"""The clutch torques that come closest to the desired joint torques (paper section III-A), solved exactly.

The reachable joint torques form the same zonotope as in the friction problem, so finding the nearest one is a friction
problem too, with the metric in place of the mass matrix and the unreached remainder in place of the velocity.
"""

from pter_gym._compiled.compiler import device
from pter_gym._physics.arrangement import Own
from pter_gym._physics.clutch import PerClutch
from pter_gym._physics.friction import resolve, share, slip_velocities, torques_on_links


@device
def passive_low(slip: float, threshold: float, limit: float) -> float:
    """Return the smallest torque that a passive clutch can exert: 0 while it slips backwards."""
    return 0.0 if slip < -threshold else -limit


@device
def passive_high(slip: float, threshold: float, limit: float) -> float:
    """Return the largest torque that a passive clutch can exert: 0 while it slips forwards."""
    return 0.0 if slip > threshold else limit


@device
def allocate(
    want_a: float, want_b: float, low: PerClutch, high: PerClutch, m11: float, m12: float, m22: float, own: Own = None
) -> PerClutch:
    """Return the clutch torques within bounds that come closest to the desired joint torques [N·m].

    Minimises ``(Wᵀτ − want)ᵀ·M⁻¹·(Wᵀτ − want)``, then Σ τ_x² among the minimisers. M is the identity for distances in
    joint torque, or JᵀJ for distances in tip force.
    """
    half = PerClutch(
        0.5 * (high.x1 - low.x1), 0.5 * (high.x2 - low.x2), 0.5 * (high.x3 - low.x3), 0.5 * (high.x4 - low.x4)
    )
    middle = PerClutch(
        0.5 * (high.x1 + low.x1), 0.5 * (high.x2 + low.x2), 0.5 * (high.x3 + low.x3), 0.5 * (high.x4 + low.x4)
    )
    middle_a, middle_b = torques_on_links(middle, own)
    short_a, short_b = resolve(m11, m12, m22, want_a - middle_a, want_b - middle_b, half, own)
    got_a = want_a - (m11 * short_a + m12 * short_b)
    got_b = want_b - (m12 * short_a + m22 * short_b)
    short = slip_velocities(short_a, short_b, own)
    return share(got_a, got_b, pinned_low(short, low, high), pinned_high(short, low, high), 0.0, own)


@device
def pinned_low(short: PerClutch, low: PerClutch, high: PerClutch) -> PerClutch:
    """Return the lower bounds after the clutches that fall short are pinned to their upper bounds."""
    return PerClutch(
        high.x1 if short.x1 > 0.0 else low.x1,
        high.x2 if short.x2 > 0.0 else low.x2,
        high.x3 if short.x3 > 0.0 else low.x3,
        high.x4 if short.x4 > 0.0 else low.x4,
    )


@device
def pinned_high(short: PerClutch, low: PerClutch, high: PerClutch) -> PerClutch:
    """Return the upper bounds after the clutches that overshoot are pinned to their lower bounds."""
    return PerClutch(
        low.x1 if short.x1 < 0.0 else high.x1,
        low.x2 if short.x2 < 0.0 else high.x2,
        low.x3 if short.x3 < 0.0 else high.x3,
        low.x4 if short.x4 < 0.0 else high.x4,
    )
