"""Displayable forces against closed forms, all combinations of torques, and the simulator."""

import math

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.spatial import ConvexHull

from pter_gym._engine.batch import Batch
from pter_gym._physics.arm import motion_at
from pter_gym._physics.model import model_of
from pter_gym.benchmark.measures import per_clutch, vector
from pter_gym.controllers import Random
from pter_gym.haptics import (
    force_extremes,
    force_per_torque,
    force_range,
    force_region,
    forces,
    link_angles,
)
from pter_gym.params import BASELINE, MACHINES, Machine
from pter_gym.tasks.path_following import TELEMETRY, PathFollowing
from rollouts import simulate

ARM = BASELINE.arm
DYNAMIC, HELD = BASELINE.clutch.dynamic.torque(24.0), BASELINE.clutch.breakaway.torque(24.0)
RIGHT_ANGLE = (0.0, 0.5 * math.pi)
"""Link A along x, B along y: a torque on A pushes along y, one on B along −x."""

machines = st.sampled_from(sorted(MACHINES)).map(MACHINES.__getitem__)
angles = st.floats(-math.pi, math.pi)
elbows = st.floats(0.2, math.pi - 0.2)
velocities = st.one_of(
    st.just((0.0, 0.0)),
    st.builds(lambda v, at: (v * math.cos(at), v * math.sin(at)), st.floats(0.01, 1.0), angles),
)


def jacobian(machine: Machine, theta) -> np.ndarray:
    a, b = machine.arm.length_a, machine.arm.length_b
    return np.array(
        [
            [-a * np.sin(theta[0]), -b * np.sin(theta[1])],
            [a * np.cos(theta[0]), b * np.cos(theta[1])],
        ]
    )


def combinations(machine: Machine, theta, velocity) -> np.ndarray:
    """The forces of all combinations of extreme torques, by solving JᵀF = Wᵀτ: (16, 2)."""
    rows, j = np.array(machine.slot_rows), jacobian(machine, theta)
    slip = rows @ np.linalg.solve(j, velocity)
    top = np.array(machine.slot_scale)
    clutch = machine.clutch
    dynamic, breakaway = (
        clutch.dynamic.torque(clutch.voltage_max),
        clutch.breakaway.torque(clutch.voltage_max),
    )
    bounds = [
        (-max(dynamic, breakaway) * k, max(dynamic, breakaway) * k)
        if abs(s) < machine.slip_threshold
        else (-math.copysign(dynamic * k, s), 0.0)
        for k, s in zip(top, slip, strict=True)
    ]
    torques = np.stack(np.meshgrid(*bounds), axis=-1).reshape(-1, len(top))
    return np.linalg.solve(j.T, rows.T @ torques.T).T


def support(points: np.ndarray, count: int = 64) -> np.ndarray:
    """How far sets of points (…, K, 2) reach in equally spaced directions, (…, count)."""
    at = 2.0 * np.pi * np.arange(count) / count
    return (points @ np.stack([np.cos(at), np.sin(at)])).max(axis=-2)


def area(corners: np.ndarray) -> float:
    x, y = corners.T
    return 0.5 * float((x * np.roll(y, -1) - y * np.roll(x, -1)).sum())


# --- closed forms ---


@pytest.mark.parametrize(
    ("velocity", "x", "y"),
    [
        ((0.0, 0.0), (-HELD, HELD), (-HELD, HELD)),
        ((0.5, 0.5), (-DYNAMIC, 0.0), (-DYNAMIC, 0.0)),
        ((-0.5, 0.5), (0.0, DYNAMIC), (-DYNAMIC, 0.0)),
        ((0.5, 0.0), (-DYNAMIC, 0.0), (-HELD, HELD)),
    ],
)
def test_two_brakes_at_a_right_angle_make_a_rectangle(velocity, x, y) -> None:
    found = force_region(MACHINES["two-brakes"], RIGHT_ANGLE, velocity)
    box = np.array([[x[0], y[0]], [x[1], y[0]], [x[1], y[1]], [x[0], y[1]]]) / (
        ARM.length_b,
        ARM.length_a,
    )
    np.testing.assert_allclose(
        np.unique(found.round(9), axis=0), np.unique(box.round(9) + 0.0, axis=0), atol=1e-9
    )
    assert area(found) == pytest.approx(
        (x[1] - x[0]) * (y[1] - y[0]) / (ARM.length_a * ARM.length_b)
    )


def test_couplings_add_their_edges_at_a_right_angle() -> None:
    """Half the sides of the octagon are those of its four segments, whose area is the sum over
    their pairs."""
    found = force_region(BASELINE, RIGHT_ANGLE)
    along_y, along_x = 2.0 * HELD / ARM.length_a, 2.0 * HELD / ARM.length_b
    segments = [(along_x, 0.0), (0.0, along_y), (along_x, along_y), (-along_x, along_y)]
    edges = np.diff(found, axis=0, append=found[:1])
    np.testing.assert_allclose(
        np.hypot(*edges.T).sum(), 2.0 * sum(math.hypot(*each) for each in segments)
    )
    pairs = sum(
        abs(a[0] * b[1] - a[1] * b[0]) for k, a in enumerate(segments) for b in segments[:k]
    )
    assert area(found) == pytest.approx(pairs)


def test_torque_at_zero_volts_is_the_least_force(monkeypatch: pytest.MonkeyPatch) -> None:
    """Brakes that make 2 N·m at 0 V and at most 9 N·m."""
    limits = np.array([2.0, 2.0, 0.0, 0.0]), np.array([9.0, 9.0, 0.0, 0.0])
    monkeypatch.setattr(forces, "torque_limits", lambda *_: limits)
    against = -force_region(MACHINES["two-brakes"], RIGHT_ANGLE, (0.5, 0.5)) * (
        ARM.length_b,
        ARM.length_a,
    )
    np.testing.assert_allclose([against.min(axis=0), against.max(axis=0)], [[2.0, 2.0], [9.0, 9.0]])


def test_ranges_and_extremes_of_two_brakes_at_a_right_angle() -> None:
    """45°: each brake resists and steers with 1/√2 of its force.

    Along an axis only the one that sticks steers.
    """
    machine = MACHINES["two-brakes"]
    found = force_range(machine, RIGHT_ANGLE, (0.3, 0.3))
    of_a, of_b = (DYNAMIC / length for length in (ARM.length_a, ARM.length_b))
    assert found == pytest.approx(np.array([of_a + of_b, of_b, of_a]) / math.sqrt(2.0))
    assert found.steering == min(found.left, found.right)
    extremes = force_extremes(machine, RIGHT_ANGLE, directions=720)
    assert extremes.least_steering == pytest.approx(0.0, abs=0.01 * of_a)
    assert extremes.largest_steering == pytest.approx(max(of_a, of_b) * HELD / DYNAMIC)
    assert extremes.least_resisting == pytest.approx(min(of_a, of_b), rel=5e-3)
    assert extremes.largest_resisting == pytest.approx(math.hypot(of_a, of_b), rel=1e-5)


def test_the_papers_arm_can_steer_both_ways_in_every_direction_and_brakes_alone_cannot() -> None:
    """In the middle of the workspace; up to the distance to the nearest of the directions."""
    theta = link_angles(ARM, (0.0, 0.7))
    least = {
        name: float(force_extremes(machine, theta).least_steering)
        for name, machine in MACHINES.items()
    }
    assert least["baseline"] > 50.0
    assert [least[name] for name in ("two-brakes", "double-brakes")] == pytest.approx(
        [0.0, 0.0], abs=1.0
    )


# --- all combinations of torques ---


@settings(max_examples=200, deadline=None)
@given(machines, angles, elbows, velocities, st.integers(0, 2**32 - 1))
def test_corners_are_the_hull_of_all_combinations_and_hold_all_others(
    machine, theta_a, elbow, velocity, seed
) -> None:
    theta = (theta_a, theta_a + elbow)
    found, every = force_region(machine, theta, velocity), combinations(machine, theta, velocity)
    assert found.shape == (8, 2)
    np.testing.assert_allclose(support(found), support(every), atol=1e-8 * np.abs(every).max())
    assert area(found) == pytest.approx(ConvexHull(every, qhull_options="QJ").volume, rel=1e-6), (
        "in order, once around"
    )
    inside = np.random.default_rng(seed).dirichlet(np.ones(len(every)), size=20) @ every
    assert (support(inside[:, None]) <= support(found) + 1e-8 * np.abs(every).max()).all()
    if any(velocity):
        creep = 4.0 * HELD * machine.slip_threshold  # of clutches within the stick band
        assert (found @ velocity).max() <= 1.001 * creep, "no force feeds the motion"


@settings(max_examples=50, deadline=None)
@given(machines, angles, elbows, velocities, angles)
def test_the_region_turns_with_the_arm(machine, theta_a, elbow, velocity, turn) -> None:
    turned = np.array([[math.cos(turn), math.sin(turn)], [-math.sin(turn), math.cos(turn)]])
    first = support(force_region(machine, (theta_a, theta_a + elbow), velocity) @ turned)
    second = support(
        force_region(machine, (theta_a + turn, theta_a + turn + elbow), velocity @ turned)
    )
    slips = force_per_torque(machine, (theta_a, theta_a + elbow)) @ velocity
    if (np.abs(np.abs(slips) - machine.slip_threshold) > 1e-9).all():
        np.testing.assert_allclose(first, second, rtol=1e-9, atol=1e-7)


def test_many_poses_are_as_many_alone() -> None:
    theta = link_angles(ARM, np.array([[[0.3, 0.5], [0.0, 0.7]], [[-0.6, 0.2], [3.0, 0.0]]]))
    velocity = np.array([[0.1, 0.0], [0.0, -0.2]])
    found, extremes = force_region(BASELINE, theta, velocity), force_extremes(BASELINE, theta)
    for i, j in ((0, 0), (0, 1), (1, 0)):
        np.testing.assert_array_equal(found[i, j], force_region(BASELINE, theta[i, j], velocity[j]))
        assert [values[i, j] for values in extremes] == [*force_extremes(BASELINE, theta[i, j])]
    assert np.isnan(found[1, 1]).all(), "out of reach"


# --- the simulator ---


def test_angles_are_those_of_the_tasks() -> None:
    for tip in ((0.3, 0.7), (-0.5, 0.2), (0.2, -0.6)):
        motion = motion_at(model_of(BASELINE).arm, *tip)
        turns = (link_angles(ARM, tip) - (motion.theta_a, motion.theta_b)) / (2.0 * math.pi)
        np.testing.assert_allclose(turns, turns.round(), atol=1e-12)


def test_simulated_forces_are_displayable() -> None:
    """Random voltages: at every control instant, the clutches' force is within the region of the
    tip's velocity."""
    batch = Batch(BASELINE, PathFollowing(), 16)
    rows = simulate(batch, Random(seed=3), range(16), 200)[1:].reshape(-1, len(TELEMETRY))
    rows = rows[np.isfinite(rows[:, 0])]
    theta = rows[:, [TELEMETRY.index("theta_a"), TELEMETRY.index("theta_b")]]
    force = np.einsum("nx,nxi->ni", per_clutch(rows, "torque"), force_per_torque(BASELINE, theta))
    velocity = vector(rows, "tip_velocity")
    np.testing.assert_allclose(
        (force * velocity).sum(axis=1), per_clutch(rows, "power").sum(axis=1), atol=1e-6
    )
    beyond = support(force[:, None]) - support(force_region(BASELINE, theta, velocity))
    assert beyond.max() < 1e-6
    assert len(rows) > 500
