"""Joint friction against independent oracles: the dual problem, exact fractions, scipy, and the
paper's own rule.

Tolerances. With u = 2⁻⁵³ the package forms the momentum in a sector with at most four roundings of
numbers no larger than P = |p_a| + |p_b| + Σc, so it is off by at most 4uP, and solves a 2×2 system
by Cramer's rule. A determinant of entries up to ‖M‖ is off by 2u‖M‖² or, relative to itself, 2uκ;
so are the numerators. Together

    |δω| ≤ ROUNDINGS · u · (‖M⁻¹‖ P + κ |ω|)       with a ROUNDINGS of eight,

and a point p that is farther than 8uκP from every line on which the mode changes must get its mode
right. Where κ is below 10⁵ that is well under 1e-10 of the free velocity M⁻¹p, which is asserted as
such."""

from __future__ import annotations

import functools
import operator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.optimize import lsq_linear

from compiled_friction import resolve_friction, share_torque
from oracle import friction as oracle, paper_rule
from oracle.problems import Problems, families
from oracle.sharing import share
from pter_gym._physics.clutch import PerClutch
from pter_gym._physics.friction import (
    COUPLING,
    LINES,
    ClutchMode,
    mode_of,
    slip_velocities,
    torques_on_links,
)

UNIT = 2.0**-53
ROUNDINGS = 8
W = np.array(oracle.W, float)
FAMILIES = families()


DETERMINISTIC = settings(derandomize=True, deadline=None, database=None, max_examples=200)
NUMBERS = st.floats(-1e100, 1e100)


def identify(index: int) -> str:
    return FAMILIES[index].name


@functools.cache
def resolved(index: int) -> np.ndarray:
    """Velocities and mode of the package, (n, 3)."""
    return np.array([resolve_friction(*row) for row in FAMILIES[index].rows()], float)


@functools.cache
def expected(index: int) -> oracle.Solution:
    return oracle.solve(*FAMILIES[index].numbers)


def rounding(problems: Problems, omega: np.ndarray) -> np.ndarray:
    """The derived bound on the error of a velocity, (n,)."""
    return (
        ROUNDINGS
        * UNIT
        * (problems.compliance * problems.momentum + problems.condition * np.hypot(*omega.T))
    )


@DETERMINISTIC
@given(NUMBERS, NUMBERS)
def test_slip_velocities_are_those_of_the_coupling(omega_a, omega_b):
    assert slip_velocities(omega_a, omega_b) == tuple(
        a * omega_a + b * omega_b for a, b in COUPLING
    )


@DETERMINISTIC
@given(st.tuples(NUMBERS, NUMBERS, NUMBERS, NUMBERS))
def test_torques_on_links_are_those_of_the_coupling(torque):
    for link, found in enumerate(torques_on_links(PerClutch(*torque))):
        parts = [row[link] * each for row, each in zip(COUPLING, torque, strict=True)]
        # from Python 3.12 on sum() rounds once
        assert found == functools.reduce(operator.add, parts)


def test_the_coupling_is_the_papers():
    assert np.array_equal(COUPLING, W)


@DETERMINISTIC
@given(NUMBERS.filter(bool))
def test_along_its_line_only_its_clutch_does_not_slip(speed):
    for number, (row, (a, b)) in enumerate(zip(COUPLING, LINES, strict=True)):
        assert row[0] * a + row[1] * b == 0.0
        slips = slip_velocities(speed * a, speed * b)
        assert [clutch for clutch, slip in enumerate(slips) if slip == 0.0] == [number]
        assert mode_of(speed * a, speed * b) == ClutchMode(1 + number)


def test_there_are_100000_friction_problems():
    assert sum(map(len, FAMILIES)) >= 100_000


@pytest.mark.parametrize("index", range(len(FAMILIES)), ids=identify)
def test_velocities_are_those_of_the_dual_and_so_are_modes_away_from_ties(index):
    problems, solution = FAMILIES[index], expected(index)
    omega = resolved(index)[:, :2]
    error = np.hypot(omega[:, 0] - solution.omega[0], omega[:, 1] - solution.omega[1]).astype(float)

    assert np.all(error <= rounding(problems, omega))
    usual = problems.condition < 1e5
    assert usual.any()
    assert np.all(error[usual] <= 1e-10 * problems.free_speed[usual])
    if problems.tied:
        return
    margin = ROUNDINGS * UNIT * problems.condition * problems.momentum
    clear = oracle.tie_distance(*problems.numbers, solution) > margin
    assert np.mean(clear) > 0.97
    assert np.array_equal(resolved(index)[clear, 2], oracle.modes(solution.omega)[clear])


@pytest.mark.parametrize("index", range(len(FAMILIES)), ids=identify)
def test_modes_say_which_slips_are_zero(index):
    *omega, mode = resolved(index).T
    assert np.array_equal(mode, oracle.modes(omega))
    assert isinstance(resolve_friction(*next(FAMILIES[index].rows()))[2], ClutchMode)


@pytest.mark.parametrize("index", range(len(FAMILIES)), ids=identify)
def test_impulses_exist_that_explain_the_velocity(index):
    """The optimality conditions from the velocity alone: p − Mω is a sum of impulses.

    Where there is slip, be it of the size of a rounding, they are at their capacity against it. The
    rest, of clutches without slip, must lie in the zonotope of their capacities; whatever the
    subset, its sides have their normals among the four lines. An arm that as a whole is no faster
    than rounding counts as at rest."""
    problems = FAMILIES[index]
    omega = resolved(index)[:, :2]
    slips = omega @ W.T
    free = (slips == 0.0) | (np.hypot(*omega.T) <= rounding(problems, omega))[:, None]
    moved = np.where(free, 0.0, problems.c * np.sign(slips)) @ W
    left_a = problems.p_a - problems.m11 * omega[:, 0] - problems.m12 * omega[:, 1] - moved[:, 0]
    left_b = problems.p_b - problems.m12 * omega[:, 0] - problems.m22 * omega[:, 1] - moved[:, 1]
    tolerance = 2.0 * (problems.m11 + problems.m22) * rounding(problems, omega)
    for d in np.array(oracle.LINE, float):
        reach = np.where(free, problems.c, 0.0) @ np.abs(W @ d)
        assert np.all(np.abs(left_a * d[0] + left_b * d[1]) <= reach + tolerance)


@pytest.mark.parametrize("name", ["side, exact", "corner, exact"])
def test_a_load_of_exactly_the_capacity_is_held(name):
    index = [f.name for f in FAMILIES].index(name)
    assert np.all(resolved(index) == [0.0, 0.0, ClutchMode.ZERO_DOF])


@pytest.mark.parametrize("capacity", [0.0, 1.0])
def test_no_momentum_is_rest(capacity):
    assert resolve_friction(1.2, -0.2, 0.4, 0.0, 0.0, *[capacity] * 4) == (
        0.0,
        0.0,
        ClutchMode.ZERO_DOF,
    )


@pytest.mark.parametrize("index", range(len(FAMILIES)), ids=identify)
def test_the_oracle_itself_is_right_in_exact_arithmetic(index):
    """Extended precision and the package against fractions: velocities within the bound, modes
    equal off ties."""
    problems, solution = FAMILIES[index], expected(index)
    chosen = np.random.default_rng(index).choice(len(problems), 30, replace=False)
    limit = rounding(problems, resolved(index)[:, :2])
    margin = ROUNDINGS * 2.0**-64 * problems.condition * problems.momentum
    tied = oracle.tie_distance(*problems.numbers, solution) <= margin
    for i, row in zip(chosen, np.array(list(problems.rows()))[chosen], strict=True):
        truth, mode = oracle.solve_exactly(*row[:5], row[5:])
        exact = np.array([float(v) for v in truth.omega])
        assert np.hypot(*(resolved(index)[i, :2] - exact)) <= limit[i]
        assert np.hypot(*(np.array([v[i] for v in solution.omega], float) - exact)) <= limit[i]
        assert mode == oracle.modes([v[i] for v in solution.omega]) or tied[i]


def test_bounded_least_squares_of_scipy_agrees():
    """A third voice: scipy minimises |L⁻¹(p − Wᵀλ)|², M = LLᵀ, over the box of the capacities (to
    1e-10 of P)."""
    problems = FAMILIES[0]
    for row, mine in zip(list(problems.rows())[:300], resolved(0), strict=False):
        mass, p, c = (
            np.array([[row[0], row[1]], [row[1], row[2]]]),
            np.array(row[3:5]),
            np.array(row[5:]),
        )
        factor = np.linalg.cholesky(mass)
        fit = lsq_linear(
            np.linalg.solve(factor, W.T),
            np.linalg.solve(factor, p),
            bounds=(-c, c),
            method="bvls",
            tol=1e-15,
        )
        omega = np.linalg.solve(mass, p - W.T @ fit.x)
        compliance = np.linalg.norm(np.linalg.inv(mass), 2)
        assert np.allclose(
            omega, mine[:2], rtol=0.0, atol=1e-10 * compliance * (np.abs(p).sum() + c.sum())
        )


def loads_to_share(rng: np.random.Generator, kind: str):
    """A load and a box that can carry it; slipping clutches have no choice (low = high)."""
    capacity = rng.uniform(0.0, 1.0, 4)
    low, high = -capacity, capacity.copy()
    if kind == "slipping":
        fixed = rng.random(4) < 0.4
        low[fixed] = high[fixed] = np.where(rng.random(4) < 0.5, -capacity, capacity)[fixed]
    if kind == "released":
        engaged = rng.integers(0, 2, 4)
        low, high = low * engaged, high * engaged
    inside = low + (high - low) * (rng.integers(0, 2, 4) if kind == "corner" else rng.random(4))
    return W.T @ inside, low, high


@pytest.mark.parametrize("kind", ["stuck", "slipping", "released", "corner"])
def test_a_load_is_shared_with_the_smallest_torques(kind):
    """Against a least-distance problem solved by scipy's nnls, whose own answer is good to about
    1e-10."""
    rng = np.random.default_rng(7)
    for _ in range(1_000):
        load, low, high = loads_to_share(rng, kind)
        mine = np.array(share_torque(*load, tuple(low), tuple(high)))
        scale = np.abs(high).sum() + np.abs(low).sum()
        assert np.all((low <= mine) & (mine <= high))
        assert np.allclose(W.T @ mine, load, rtol=0.0, atol=1e-12 * scale)
        assert np.allclose(mine, share(load, low, high), rtol=0.0, atol=1e-8 * scale)


# --- the paper's own rule ---

RECORDED_AGREEMENT = {
    0: (1.0, 1.0),
    1: (1.0, 1.0),
    2: (0.985, 0.955),
    3: (0.909, 0.729),
    4: (0.854, 0.553),
}
"""By number of engaged clutches: shares of random states at rest on which the two agree, as in
verification.md."""


def random_situation(rng: np.random.Generator, kind: str, engaged: int) -> paper_rule.ClutchProblem:
    """A state at rest, on a clutch's line or in a sector, with a load up to 1.5 times what the
    clutches can hold.

    Breakaway torques uniform in 5 … 60 N·m, T_s/T_k = 1.15, M11, M22, c of the order of PTER's,
    slips of 0.1 rad/s and more."""
    m11, m22 = rng.uniform(0.8, 2.0), rng.uniform(0.2, 0.6)
    m12 = rng.uniform(-0.7, 0.7) * np.sqrt(m11 * m22)
    breakaway = np.zeros(4)
    breakaway[rng.choice(4, engaged, replace=False)] = rng.uniform(5.0, 60.0, engaged)
    if kind == "rest":
        slip = np.zeros(4)
    elif kind == "line":
        x = rng.choice(np.flatnonzero(breakaway)) if engaged else rng.integers(4)
        slip = W @ np.array(oracle.LINE[x], float) * rng.choice([-1.0, 1.0]) * rng.uniform(0.1, 3.0)
    else:
        slip = np.zeros(4)
        while np.min(np.abs(slip)) < 0.1:
            slip = W @ rng.uniform(-3.0, 3.0, 2)
    angle = rng.uniform(0.0, 2.0 * np.pi)
    direction = np.array([np.cos(angle), np.sin(angle)])
    normals = np.stack([W[:, 1], -W[:, 0]], axis=1)
    with np.errstate(divide="ignore"):
        reach = np.min(np.abs(normals @ W.T) @ breakaway / np.abs(normals @ direction))
    load = direction * rng.uniform(0.0, 1.5) * (reach if engaged > 1 else 30.0)
    return paper_rule.ClutchProblem(
        np.array([[m11, m12], [m12, m22]]), load, slip, breakaway, breakaway / 1.15
    )


def agrees(now: paper_rule.ClutchProblem, step: float = 1e-6) -> bool:
    """Same mode after a step too short for any moving clutch to stop, and the same acceleration to
    1e-6."""
    answer = paper_rule.decide(now)
    omega = now.slip[:2]
    p = now.mass @ omega + step * now.load
    capacity = step * np.where(now.slip == 0.0, now.breakaway, now.dynamic)
    a, b, mode = resolve_friction(now.mass[0, 0], now.mass[0, 1], now.mass[1, 1], *p, *capacity)
    acceleration = (np.array([a, b]) - omega) / step
    free = np.linalg.norm(np.linalg.solve(now.mass, now.load)) + np.linalg.norm(answer.acceleration)
    return mode == answer.mode and bool(
        np.linalg.norm(acceleration - answer.acceleration) <= 1e-6 * free
    )


@functools.cache
def agreement(kind: str, engaged: int, draws: int = 1_000) -> tuple[float, float]:
    """Share of states on which the two agree: of all, and of those that the paper's rule does not
    leave at rest."""
    rng = np.random.default_rng([31, engaged, len(kind)])
    situations = [random_situation(rng, kind, engaged) for _ in range(draws)]
    same = np.array([agrees(now) for now in situations])
    moves = np.array([paper_rule.decide(now).mode != ClutchMode.ZERO_DOF for now in situations])
    return float(same.mean()), float(same[moves].mean())


@pytest.mark.parametrize("engaged", range(5))
@pytest.mark.parametrize("kind", ["sector", "line"])
def test_the_papers_rule_agrees_wherever_an_axis_moves(kind, engaged):
    assert agreement(kind, engaged) == (1.0, 1.0)


@pytest.mark.parametrize("engaged", range(5))
def test_the_papers_rule_agrees_from_rest_as_often_as_published(engaged):
    """Within three standard errors, so another version of numpy's generators may draw other
    states."""
    document = (Path(__file__).parents[2] / "docs" / "development" / "verification.md").read_text(
        encoding="utf-8"
    )
    for rate, recorded in zip(agreement("rest", engaged), RECORDED_AGREEMENT[engaged], strict=True):
        assert abs(rate - recorded) <= 3.0 * np.sqrt(recorded * (1.0 - recorded) / 1_000)
    published = " | ".join(
        f"{recorded:.1%}".replace("%", " %") for recorded in RECORDED_AGREEMENT[engaged]
    )
    assert f"| {engaged} | {published} |" in document
