"""What the integrator can hold: how fast an arm may be, and how hard a hand may push.

A kick is explicit in the velocity term V. An arm that is too fast for it gains energy from it, is
faster still at the next substep, and leaves the numbers that a computer can hold. So machines and
tasks are accepted only where that cannot happen within a control step that begins below a kinetic
energy, ``largest_energy``; and an episode whose arm is above it at the end of a control step ends
there, as a failure.

Derivation. Let h be the substep, T the control period with n = T/h substeps, μ the smallest
eigenvalue of M over all poses, c the coupling, and Ω the largest |ω| in a substep. Let a kick have
the parts 1 … J ≤ ``MAX_PARTS``, which last until the times t_j = t_{j−1} + h_j and change the
velocity by Δ_j to ω_j; t_0 = 0, t_J = h. With δ = θA − θB in the middle of the substep,
F(ω) = c·sin δ·ωA·ωB·(ωA − ωB) = −ω·V(ω), so |F| ≤ 0.71|c||ω|³ and |∇F| ≤ 2.13|c||ω|².

Half a drift changes the kinetic energy by ∓½h·F up to ⅛h²|c|Ω⁴, as it changes cos δ. So what the
arm would have in the pose that belongs to a time of the kick,

    K_j = ½·ω_jᵀMω_j − (t_j − ½h)·F(ω_j)

with M of the middle, is up to that its kinetic energy before the substep and after it, for j = 0
and j = J. A part does the work W_j of the hand, takes D_j ≥ 0 in the clutches and N_j = ½·Δ_jᵀMΔ_j,
and has V(ω_{j−1}), so

    K_j − K_{j−1} ≤ W_j − N_j + (t_j − ½h)·(F(ω_{j−1}) − F(ω_j)) − h_j·Δ_jᵀV(ω_{j−1})
                 ≤ W_j − ½·ν·μ|Δ_j|² + (1.07h + h_j)·|c|Ω²|Δ_j|
                 ≤ W_j + (1.07h + h_j)²·c²Ω⁴/(2νμ)

for any friction. Here ν is what the explicit share of the hand's damping leaves of N_j: with
B = b·JᵀJ and the implicit share θ, the damper's work is
−h_j·ω_jᵀB(θω_j + (1 − θ)ω_{j−1}) ≤ ¼(1 − θ)h_j·Δ_jᵀBΔ_j, at most ½(1 − θ)h·bℓ²/μ of N_j with
ℓ² = lA² + lB², and ``implicit`` is such that ν ≥ ½. Over a substep, with four parts, the
second-order terms are

    h²aΩ⁴/2.22      a = 8.6·c²/(νμ) + 0.56|c|

Let u = √(2K_j). The part of K_j with F is small, as all is done for u ≤ U with h|c|U ≤ μ^1.5/12 and
hφ ≤ U/10, where φ = ℓF/√μ for the hand's force F: 0.96u ≤ √(ωᵀMω) ≤ 1.04u. So the hand's work is
W_j ≤ h_j|ω_j||JᵀF| ≤ h_j·1.04u·φ. Friction is a contraction in the norm of M⁻¹, which alone gives
√(ω_jᵀMω_j) ≤ √(ω_{j−1}ᵀMω_{j−1}) + h_j(|c|Ω²/√μ + φ) and so Ω ≤ 1.22U/√μ: no velocity jumps beyond.
With 1.22⁴ = 2.22 and β = ha/μ²,

    u⁺² − u² ≤ 2h·u⁺·Φ      Φ = 1.04φ + βU³

for the largest u so far, u, and that of a substep later, u⁺; so u⁺ ≤ hΦ + √(u² + h²Φ²), and after n
of them u ≤ u₀ + Φ·(T + h + ½h·ln n) ≤ u₀ + Φ·T′ with T′ = T + √(hT). Of U, the integrator may add
0.3 and the hand 0.67; the start of a control step may have what both leave:

    βU³T′ ≤ 0.3·U      1.04·φT′ ≤ 0.67·U      u₀ ≤ 0.7·U − 1.04·φT′

The first is U² ≤ 0.3·μ²/(haT′). In addition no link turns by more than ``MAX_TURN`` in a substep,
hU ≤ ½√μ, for which the series of ``rotated`` is made. The spring of a hand counts as the mean of
its force: what it has at a control instant, and half of what the arm's way in a control step adds.

The rest is rounding. A 2×2 system loses as many digits as its condition has, so ``MAX_CONDITION``
leaves twelve of sixteen; the hand's damping in the direction of most, as if all of it were
implicit, and the viscous friction of the axes are part of it. The latter takes energy only, and so
do dry friction and the clutches, however their torques depend on speed. All other numbers are
limited in ``pter_gym.params`` to ``MIN_POSITIVE`` and ``MAX_NUMBER``, of whose products no number
of a substep has more than twenty factors.
"""

import math

from pter_gym._physics.arm import Linkage

MAX_TURN = 0.5
"""Largest turn of a link in a substep [rad]."""

MAX_CONDITION = 1e4
"""Largest condition of the mass matrix with the hand's mass and its implicit damping."""

MAX_SUBSTEPS = 10_000
"""Most substeps in a control step: about a tenth of a millisecond for each world."""

_VELOCITY_TERMS, _A_PUSHS = 1.0 / 12.0, 1.0 / 10.0
"""Largest shares of the motion that the velocity term and the hand make in a substep."""

_INTEGRATORS, _HANDS = 0.3, 0.67
"""Shares of the largest motion that the integrator and the hand may add in a control step."""

_ROUNDING_UP = 1.04
"""Bound of √(ωᵀMω) over u."""


def smallest_inertia(arm: Linkage) -> float:
    """Return μ [kg·m²], the smallest eigenvalue of the mass matrix over all poses."""
    return 0.5 * (arm.m11 + arm.m22) - math.hypot(0.5 * (arm.m11 - arm.m22), arm.coupling)


def condition(arm: Linkage, h: float) -> float:
    """Return an upper bound of the condition of the effective mass matrix, perhaps infinite."""
    smallest = smallest_inertia(arm)
    largest = arm.m11 + arm.m22 + h * _most_damping(arm)
    largest += h * (arm.viscous_a + arm.viscous_b)
    return largest / smallest if smallest > 0.0 else math.inf


def largest_motion(arm: Linkage, h: float, period: float) -> float:
    """Return U² [J]: twice the kinetic energy for which a control step stays stable."""
    smallest, coupling = smallest_inertia(arm), abs(arm.coupling)
    turning = smallest * (MAX_TURN / h) ** 2
    damped = h * _most_damping(arm) / smallest
    remainder = 1.0 - 0.5 * (1.0 - arm.implicit) * damped
    a = 8.6 * coupling**2 / (remainder * smallest) + 0.56 * coupling
    # as below, 0 for no coupling, or one whose square is 0
    explicit = h * a * _lengthened(h, period) / _INTEGRATORS
    velocity_term = (h * coupling / _VELOCITY_TERMS) ** 2 / smallest
    divisor = max(explicit, velocity_term)
    return turning if turning * divisor <= smallest**2 else smallest**2 / divisor


def largest_energy(arm: Linkage, h: float, period: float, force: float) -> float:
    """Return the largest kinetic energy [J] with which a control step of a period [s] may begin.

    ``force`` [N] is the largest of the hand, at most ``largest_force``.
    """
    most = math.sqrt(largest_motion(arm, h, period))
    pushed = _ROUNDING_UP * _pull(arm, force) * _lengthened(h, period)
    return 0.5 * ((1.0 - _INTEGRATORS) * most - pushed) ** 2


def largest_force(arm: Linkage, h: float, period: float) -> float:
    """Return the largest force of the hand [N] in a control step of a period [s]."""
    most = math.sqrt(largest_motion(arm, h, period))
    return (
        most / _pull(arm, 1.0) * min(_HANDS / (_ROUNDING_UP * _lengthened(h, period)), _A_PUSHS / h)
    )


def largest_travel(arm: Linkage, h: float, period: float) -> float:
    """Return how far the tip may move in a control step of a period [m]."""
    speed = _ROUNDING_UP * math.sqrt(largest_motion(arm, h, period) / smallest_inertia(arm))
    return period * speed * math.hypot(arm.length_a, arm.length_b)


def _most_damping(arm: Linkage) -> float:
    """Return bℓ² [N·m·s], the trace of JᵀBJ with the hand's damping b in the direction of most."""
    return (arm.damping + math.hypot(*arm.damping_by)) * (arm.length_a**2 + arm.length_b**2)


def _pull(arm: Linkage, force: float) -> float:
    """Return φ [√J/s], what a force [N] adds to the motion u in a second."""
    return force * math.hypot(arm.length_a, arm.length_b) / math.sqrt(smallest_inertia(arm))


def _lengthened(h: float, period: float) -> float:
    """Return T′ [s]."""
    return period + math.sqrt(h * period)
