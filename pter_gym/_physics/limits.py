"""What the integrator can hold: how fast an arm may be, and how hard a hand may push, so that no number is lost.

The substep is explicit in the velocity term V. An arm that is too fast for it gains energy from it, is faster still at
the next substep, and leaves the numbers that a computer can hold. So machines and tasks are accepted only where that
cannot happen within a control step that begins below a kinetic energy, ``largest_energy``; and an episode whose arm is
above it at the end of a control step ends there, as a failure.

Derivation. Let u = √(2K), h the substep, T the control period with n = T/h substeps, μ the smallest eigenvalue of M
over all poses, c the coupling, and Ω the larger of |ω| before and |ω⁺| after a substep, so Ω ≤ u/√μ. In

    ΔK = W − D − N + R      N = ½·ΔωᵀMΔω ≥ ½·μ|Δω|²      D ≥ 0

insert V into R. Its parts of first order in h cancel, since ½·ωᵀṀω = ωᵀV. What is left is the change of V with Δω, at
most 2h|c|Ω²|Δω|, and the curvature of cos(θA − θB), at most ½h²|c|Ω⁴. The first is largest against N at
|Δω| = 2h|c|Ω²/μ, so for any friction

    R − N ≤ h²aΩ⁴      a = 2c²/μ + ½|c|

The hand's work is W ≤ h|ω⁺||JᵀF| ≤ h·u⁺φ with φ = ℓF/√μ and ℓ² = lA² + lB²; damping only takes energy. While u stays
below a U, both together give u⁺² − u² ≤ 2h·u⁺·(φ + βU³) with β = ha/μ², so

    u⁺ ≤ hΦ + √(u² + h²Φ²)      Φ = φ + βU³

and after n substeps u ≤ u₀ + Φ·(T + h + ½h·ln n) ≤ u₀ + Φ·T′ with T′ = T + √(hT). (Nor can u jump beyond: friction is
a contraction in the norm of M⁻¹, which alone gives u⁺ ≤ 1.3·(u + h|c|u²/μ^1.5 + hφ).) The three thirds of U are what
an arm has at the start of a control step, what the integrator may add, and what the hand may:

    u₀ ≤ U/3      βU³T′ ≤ U/3      φT′ ≤ U/3

The second is U² ≤ μ²/(3haT′). In addition no link turns by more than ``LONGEST_TURN`` in a substep, hU ≤ ½√μ, for
which the series of ``rotated`` is made. The third is the largest force, for which the spring of a hand counts with all
of the length that it can have.

The rest is rounding. A 2×2 system loses as many digits as its condition has, so ``LARGEST_CONDITION`` leaves twelve
of sixteen; the hand's damping, which is implicit, is part of it. All other numbers are limited in ``pter_gym.params``
to ``SMALLEST`` and ``LARGEST``, of whose products no number of a substep has more than twenty factors.
"""

import math

from pter_gym._physics.arm import Linkage

LONGEST_TURN = 0.5
"""Largest turn of a link in a substep [rad]."""

LARGEST_CONDITION = 1e4
"""Largest condition of the mass matrix with the hand's mass and its implicit damping."""

MOST_SUBSTEPS = 10_000
"""Most substeps in a control step: about a tenth of a millisecond for each world."""


def smallest_inertia(arm: Linkage) -> float:
    """Return μ [kg·m²], the smallest eigenvalue of the mass matrix over all poses."""
    return 0.5 * (arm.m11 + arm.m22) - math.hypot(0.5 * (arm.m11 - arm.m22), arm.coupling)


def condition(arm: Linkage, h: float) -> float:
    """Return an upper bound of the condition of the effective mass matrix, infinite where rounding leaves nothing."""
    smallest = smallest_inertia(arm)
    largest = arm.m11 + arm.m22 + h * arm.damping * (arm.length_a**2 + arm.length_b**2)
    return largest / smallest if smallest > 0.0 else math.inf


def largest_motion(arm: Linkage, h: float, period: float) -> float:
    """Return U² [J]: twice the kinetic energy below which an arm stays within a control step."""
    smallest, coupling = smallest_inertia(arm), abs(arm.coupling)
    turning = smallest * (LONGEST_TURN / h) ** 2
    a = 2.0 * coupling**2 / smallest + 0.5 * coupling
    explicit = 3.0 * h * a * _lengthened(h, period)  # 0 without a coupling, or with one too small for its products
    return turning if turning * explicit <= smallest**2 else smallest**2 / explicit


def largest_energy(arm: Linkage, h: float, period: float) -> float:
    """Return the largest kinetic energy [J] with which a control step of a period [s] may begin."""
    return largest_motion(arm, h, period) / 18.0


def largest_force(arm: Linkage, h: float, period: float) -> float:
    """Return the largest force of the hand [N] in a control step of a period [s]."""
    motion = math.sqrt(largest_motion(arm, h, period) * smallest_inertia(arm)) / 3.0
    return motion / (_lengthened(h, period) * math.hypot(arm.length_a, arm.length_b))


def _lengthened(h: float, period: float) -> float:
    """Return T′ [s]."""
    return period + math.sqrt(h * period)
