"""Dry friction of the four clutches, solved in the dual and without rounding.

The package minimises over velocities (13 candidates in the plane). Here the unknowns are the four
clutch impulses,

    impulse = argmin ½ (p − Wᵀλ)ᵀ M⁻¹ (p − Wᵀλ)   over the box  |λ_x| ≤ c_x,
    velocity = M⁻¹ (p − Wᵀλ),

a bounded least-squares problem. Each clutch is at its lower bound, at its upper bound or free: 81
states. Any two rows of W are independent, so the nine states with three or four free clutches
add nothing: the velocity is zero, as in a state with two free clutches. The other 72 are tried one
by one, and the state that violates the optimality conditions least is taken.

The arithmetic is plain `+ − × ÷` on whatever numbers come in: `numpy.longdouble` arrays for many
problems at once, `fractions.Fraction` for an exact answer to one."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np

W = ((1, 0), (0, 1), (1, -1), (1, 1))
"""Slip of clutch x = W[x] · (omega_a, omega_b): A to ground, B to ground, A to B, A to B through
the inverting gear."""

LINE = ((0, 1), (1, 0), (1, 1), (1, -1))
"""Direction in the plane of velocities along which clutch x does not slip: W[x] · LINE[x] = 0."""

TWO_DOF, ZERO_DOF = 0, 5
"""Modes as numbers; 1 … 4 is the clutch that alone does not slip."""

STATES = tuple(s for s in itertools.product((-1, 0, 1), repeat=4) if s.count(0) <= 2)
"""Sign of the impulse for a clutch at its bound, 0 for a free one."""

Number = Any
"""A float, a Fraction or an array of one number per problem."""


@dataclass(frozen=True)
class Solution:
    """Velocities (a, b), the four impulses (they oppose the slips) and the violation of the
    optimality conditions."""

    omega: tuple[Number, Number]
    impulse: tuple[Number, ...]
    violation: Number


def slip(x: int, omega: tuple[Number, Number]) -> Number:
    return W[x][0] * omega[0] + W[x][1] * omega[1]


def _positive(value: Number) -> Number:
    return (value + abs(value)) / 2


def _along_line(x: int, mass: tuple[Number, Number, Number], rest: tuple[Number, Number]):
    """Velocity on the line of clutch x, and its impulse, when the other clutches leave the momentum
    `rest`."""
    m11, m12, m22 = mass
    d_a, d_b = LINE[x]
    speed = (d_a * rest[0] + d_b * rest[1]) / (
        d_a * d_a * m11 + 2 * d_a * d_b * m12 + d_b * d_b * m22
    )
    omega = (d_a * speed, d_b * speed)
    left = (rest[0] - m11 * omega[0] - m12 * omega[1], rest[1] - m12 * omega[0] - m22 * omega[1])
    return omega, slip(x, left) / (W[x][0] ** 2 + W[x][1] ** 2)


def _candidate(state, mass, p, c) -> Solution:
    """The velocity and impulses of one of the 72 states, whether or not it is the right one."""
    m11, m12, m22 = mass
    impulse = [sign * cap for sign, cap in zip(state, c, strict=True)]
    rest = tuple(p[i] - sum(W[x][i] * impulse[x] for x in range(4)) for i in (0, 1))
    free = [x for x in range(4) if state[x] == 0]
    if not free:
        det = m11 * m22 - m12 * m12
        omega = ((m22 * rest[0] - m12 * rest[1]) / det, (m11 * rest[1] - m12 * rest[0]) / det)
    elif len(free) == 1:
        omega, impulse[free[0]] = _along_line(free[0], mass, rest)
    else:
        x, y = free
        det = W[x][0] * W[y][1] - W[x][1] * W[y][0]
        impulse[x] = (W[y][1] * rest[0] - W[y][0] * rest[1]) / det
        impulse[y] = (W[x][0] * rest[1] - W[x][1] * rest[0]) / det
        omega = (0 * rest[0], 0 * rest[0])
    return Solution(omega, tuple(impulse), _violation(state, mass, p, c, omega, impulse))


def _violation(state, mass, p, c, omega, impulse) -> Number:
    """How far impulses leave their bounds and slips their sign, added up.

    Impulses are measured against all the momentum there is, slips against the fastest that it can
    move the arm."""
    m11, m12, m22 = mass
    momentum = abs(p[0]) + abs(p[1]) + sum(c)
    compliance = (m11 + m22) / (m11 * m22 - m12 * m12)
    impulses = sum(_positive(abs(impulse[x]) - c[x]) for x in range(4) if state[x] == 0)
    slips = sum(_positive(-state[x] * slip(x, omega)) for x in range(4) if state[x] != 0)
    return (impulses + slips / compliance) / momentum


def solve_exactly(m11, m12, m22, p_a, p_b, c) -> tuple[Solution, int]:
    """One problem in rational arithmetic: the exact solution for the floats given, and its mode."""
    mass = tuple(Fraction(float(v)) for v in (m11, m12, m22))
    p = (Fraction(float(p_a)), Fraction(float(p_b)))
    cap = tuple(Fraction(float(v)) for v in c)
    if not any(p):
        return Solution((Fraction(0), Fraction(0)), (Fraction(0),) * 4, Fraction(0)), ZERO_DOF
    for state in STATES:
        solution = _candidate(state, mass, p, cap)
        if solution.violation == 0:
            return solution, int(modes(solution.omega))
    raise AssertionError("a strictly convex problem has a solution")


def solve(m11, m12, m22, p_a, p_b, c) -> Solution:
    """Many problems in extended precision: arrays (n,), `c` (n, 4); returns arrays (n,)."""
    wide = np.longdouble
    mass = tuple(np.asarray(v, wide) for v in (m11, m12, m22))
    p = (np.asarray(p_a, wide), np.asarray(p_b, wide))
    cap = tuple(np.asarray(c, wide).T)
    still = (p[0] == 0) & (p[1] == 0) & (sum(cap) == 0)
    p_safe = (np.where(still, 1, p[0]), p[1])  # no momentum at all: answered below
    best = _candidate(STATES[0], mass, p_safe, cap)
    for state in STATES[1:]:
        other = _candidate(state, mass, p_safe, cap)
        better = other.violation < best.violation
        pick = lambda new, old, take=better: np.where(take, new, old)  # noqa: E731
        best = Solution(
            (pick(other.omega[0], best.omega[0]), pick(other.omega[1], best.omega[1])),
            tuple(pick(new, old) for new, old in zip(other.impulse, best.impulse, strict=True)),
            pick(other.violation, best.violation),
        )
    omega = (np.where(still, 0, best.omega[0]), np.where(still, 0, best.omega[1]))
    return Solution(omega, best.impulse, np.where(still, 0, best.violation))


def modes(omega) -> np.ndarray:
    """The mode of a velocity: which slip is exactly zero, ties to the fewest degrees of freedom."""
    mode = np.zeros(np.shape(omega[0]), dtype=int)
    for x in range(4):
        mode = np.where(slip(x, omega) == 0, x + 1, mode)
    return np.where((omega[0] == 0) & (omega[1] == 0), ZERO_DOF, mode)


def tie_distance(m11, m12, m22, p_a, p_b, c, solution: Solution) -> np.ndarray:
    """How far p is from the nearest point where the mode changes, in the units of p (arrays (n,)).

    Around the solution the plane of p is cut by straight lines only. At rest they are the sides of
    the zonotope of the capacities, whose side x has the normal LINE[x]. On the line of clutch x
    they are the rays along M·LINE[x] where |λ_x| = c_x, and the sides of the zonotope. In a sector
    they are the lines on which a slip vanishes, W[x] M⁻¹ δp = −w_x."""
    c = np.asarray(c)
    det = m11 * m22 - m12 * m12
    mode = modes(solution.omega)
    sides = np.stack([_side_distance(x, p_a, p_b, c) for x in range(4)])
    distance = np.where(mode == ZERO_DOF, np.min(-sides, axis=0), np.inf)
    for x in range(4):
        d_a, d_b = LINE[x]
        push = (m11 * d_a + m12 * d_b, m12 * d_a + m22 * d_b)
        across = abs(W[x][0] * push[1] - W[x][1] * push[0]) / np.hypot(*push)
        slack = (c[:, x] - abs(solution.impulse[x])) * across
        distance = np.where(mode == x + 1, np.minimum(slack, np.max(sides, axis=0)), distance)
        response = np.hypot(m22 * W[x][0] - m12 * W[x][1], m11 * W[x][1] - m12 * W[x][0]) / det
        near = abs(slip(x, solution.omega)) / response
        distance = np.where(mode == TWO_DOF, np.minimum(distance, near), distance)
    return np.asarray(distance, float)


def _side_distance(x: int, p_a, p_b, c):
    """Distance of p outside (negative: inside) the two sides of the zonotope that are parallel to
    W[x]."""
    d_a, d_b = LINE[x]
    reach = sum(c[:, y] * abs(slip(y, (d_a, d_b))) for y in range(4))
    return (abs(d_a * p_a + d_b * p_b) - reach) / np.hypot(d_a, d_b)
