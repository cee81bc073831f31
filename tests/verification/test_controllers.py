"""The controllers against their definitions by an independent formulation (paper section III-A, Fig. 6)."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from numpy.typing import NDArray

from pter_gym.controllers import Free, Impedance, Locked, Policy, Random, TorqueFeedback, laws
from pter_gym.errors import ParameterError
from pter_gym.params import BASELINE
from pter_gym.tasks.path_following import observation_layout
from pter_gym.units import INCH_POUND

W = np.array([[1.0, 0.0], [0.0, 1.0], [1.0, -1.0], [1.0, 1.0]])
LAYOUT = observation_layout(BASELINE, "torque")
Array = NDArray[np.float64]


def allocate(want: Array, low: Array, high: Array, metric: Array) -> Array:
    """Enumerate which clutches sit at a bound: least weighted distance, then least norm, among the feasible points."""
    root = np.linalg.cholesky(metric).T
    best: tuple[float, float, Array] | None = None
    for states in product((-1, 0, 1), repeat=4):
        fixed = np.array(states)
        torque = np.where(fixed < 0, low, np.where(fixed > 0, high, 0.0))
        free = fixed == 0
        if free.any():
            torque[free] = np.linalg.pinv(root @ W[free].T, rcond=1e-9) @ (root @ (want - W.T @ torque))
        if (torque < low - 1e-9).any() or (torque > high + 1e-9).any():
            continue
        rest = root @ (W.T @ torque - want)
        candidate = (round(float(rest @ rest), 9), float(torque @ torque), torque)
        if best is None or candidate[:2] < best[:2]:
            best = candidate
    assert best is not None
    return best[2]


def reference(gains: Impedance, obs: Array, feedback: float = 0.0, hold: bool = False) -> Array:
    """The two controllers as the paper words them, in plain numpy."""
    arm = BASELINE.arm
    physical = dict(zip(LAYOUT.names, obs * LAYOUT.scales, strict=True))
    a, b = ((physical[f"cos_{x}"], physical[f"sin_{x}"]) for x in "ab")
    omega = np.array([physical["omega_a"], physical["omega_b"]])
    jacobian = np.array([[-arm.length_a * a[1], -arm.length_b * b[1]], [arm.length_a * a[0], arm.length_b * b[0]]])
    tangent = np.array([physical["heading_cos"], physical["heading_sin"]])
    normal = np.array([-tangent[1], tangent[0]])
    velocity = jacobian @ omega
    force = (
        -(gains.stiffness * physical["normal_error"] + gains.damping_normal * (velocity @ normal)) * normal
        - gains.damping_tangential * (velocity @ tangent) * tangent
    )
    limit = BASELINE.clutch.dynamic.torque(24.0)
    slip = W @ omega
    low = np.where(slip < -gains.slip_threshold, 0.0, -limit)
    high = np.where(slip > gains.slip_threshold, 0.0, limit)
    metric = np.linalg.inv(jacobian @ jacobian.T) if gains.tip_space else np.eye(2)
    metric = np.linalg.inv(jacobian.T @ jacobian) if gains.tip_space else metric
    wanted = np.abs(allocate(jacobian.T @ force, low, high, metric))
    knots = np.array(gains.table_volts)
    volts = np.interp(wanted, [BASELINE.clutch.dynamic.torque(v) for v in knots], knots)
    generated = np.abs([physical[f"torque_{x}"] for x in range(1, 5)])
    error = wanted - generated
    idle = hold & (np.abs(slip) <= gains.slip_threshold) & (error > 0.0)
    return np.clip(volts + np.where(idle, 0.0, feedback * error), 0.0, 24.0)


def observations(count: int) -> NDArray[np.float32]:
    """Draw plausible observations, many with stuck clutches."""
    rng = np.random.default_rng(3)
    obs = rng.uniform(-1.0, 1.0, (count, len(LAYOUT)))
    theta_a = rng.uniform(-np.pi, np.pi, count)
    theta_b = theta_a + rng.uniform(0.3, 2.8, count)
    heading = rng.uniform(-np.pi, np.pi, count)
    for name, values in {
        "cos_a": np.cos(theta_a),
        "sin_a": np.sin(theta_a),
        "cos_b": np.cos(theta_b),
        "sin_b": np.sin(theta_b),
        "heading_cos": np.cos(heading),
        "heading_sin": np.sin(heading),
    }.items():
        obs[:, LAYOUT.index(name)] = values
    omega = slice(LAYOUT.index("omega_a"), LAYOUT.index("omega_b") + 1)
    obs[:, omega] *= rng.choice([0.3, 0.02], (count, 1))
    stuck = rng.integers(0, 6, count)
    obs[stuck == 0, omega] = 0.0
    obs[stuck == 1, omega.start] = 0.0
    obs[stuck == 2, omega.start + 1] = 0.0
    obs[stuck == 3, omega.start] = obs[stuck == 3, omega.start + 1]
    obs[stuck == 4, omega.start] = -obs[stuck == 4, omega.start + 1]
    torque = slice(LAYOUT.index("torque_1"), LAYOUT.index("torque_4") + 1)
    obs[:, torque] *= 0.3
    return obs.astype(np.float32)


@pytest.mark.parametrize("tip_space", [False, True])
@pytest.mark.parametrize("strength", [0.05, 1.0])
def test_impedance(tip_space: bool, strength: float) -> None:
    gains = Impedance(stiffness=800.0 * strength, damping_normal=200.0 * strength, tip_space=tip_space)
    policy = gains.bind(BASELINE, LAYOUT)
    obs = observations(400)
    found = policy(obs)
    expected = np.array([reference(gains, row.astype(float)) for row in obs])
    np.testing.assert_allclose(found, expected, rtol=2e-6, atol=2e-5)
    assert (found > 0.0).mean() > 0.2


@pytest.mark.parametrize("hold", [False, True])
def test_torque_feedback(hold: bool) -> None:
    gains = TorqueFeedback(feedback=0.7, hold_when_stuck=hold)
    obs = observations(400)
    found = gains.bind(BASELINE, LAYOUT)(obs)
    expected = np.array([reference(gains, row.astype(float), 0.7, hold) for row in obs])
    np.testing.assert_allclose(found, expected, rtol=2e-6, atol=2e-5)
    if hold:
        plain = replace(gains, hold_when_stuck=False).bind(BASELINE, LAYOUT)(obs)
        assert (plain != found).any()


def test_feedback_gain_is_the_papers() -> None:
    assert pytest.approx(0.531, abs=5e-4) == TorqueFeedback().feedback
    assert pytest.approx(0.06) == TorqueFeedback().feedback * INCH_POUND


def test_without_feedback_both_laws_are_one() -> None:
    obs = observations(50)
    np.testing.assert_array_equal(
        TorqueFeedback(feedback=0.0).bind(BASELINE, LAYOUT)(obs), Impedance().bind(BASELINE, LAYOUT)(obs)
    )


def test_table_is_clamped_and_zero_torque_is_zero_volts() -> None:
    gains = Impedance().bind(BASELINE, LAYOUT).gains
    table = getattr(laws.table_voltage, "py_func", laws.table_voltage)
    dynamic = BASELINE.clutch.dynamic
    assert table(gains, 0.0) == 0.0
    assert table(gains, 1e6) == 24.0
    for knot in Impedance().table_volts:
        assert table(gains, dynamic.torque(knot)) == pytest.approx(knot, abs=1e-12)
    torques = np.linspace(0.0, 60.0, 200)
    volts = [table(gains, t) for t in torques]
    assert (np.diff(volts) >= 0.0).all()


def test_positions_in_the_observation() -> None:
    for name in (
        "COS_A",
        "SIN_A",
        "COS_B",
        "SIN_B",
        "OMEGA_A",
        "OMEGA_B",
        "NORMAL_ERROR",
        "HEADING_COS",
        "HEADING_SIN",
    ):
        assert getattr(laws, name) == LAYOUT.index(name.lower())
    assert LAYOUT.index("torque_1") == laws.TORQUE


def test_simple_policies() -> None:
    obs = observations(3)
    assert (Free().bind(BASELINE, LAYOUT)(obs) == 0.0).all()
    assert (Locked().bind(BASELINE, LAYOUT)(obs) == 24.0).all()
    one, two = (Random(seed=5).bind(BASELINE, LAYOUT) for _ in range(2))
    volts = np.array([one(obs) for _ in range(500)])
    assert volts[0].tobytes() == two(obs).tobytes()
    assert len(np.unique(volts)) > 0.99 * volts.size
    assert volts.min() >= 0.0
    assert volts.max() <= 24.0
    assert abs(volts.mean() - 12.0) < 5.0 * 24.0 / np.sqrt(12.0 * volts.size)


@pytest.mark.parametrize(
    ("field", "keywords"),
    [
        ("stiffness", {"stiffness": -1.0}),
        ("damping_normal", {"damping_normal": float("nan")}),
        ("damping_tangential", {"damping_tangential": float("inf")}),
        ("table_volts", {"table_volts": (0.0, 5.0, 4.0)}),
        ("table_volts", {"table_volts": (1.0, 24.0)}),
        ("tip_space", {"tip_space": 1}),
        ("feedback", {"feedback": -0.1}),
        ("hold_when_stuck", {"hold_when_stuck": "yes"}),
    ],
)
def test_bad_gains_are_named(field: str, keywords: dict[str, object]) -> None:
    with pytest.raises(ParameterError, match=rf"\.{field} must be"):
        TorqueFeedback(**keywords)  # pyright: ignore[reportArgumentType]


def test_what_does_not_fit_is_refused() -> None:
    encoders = observation_layout(BASELINE, "encoders")
    with pytest.raises(ParameterError, match="torque sensors"):
        TorqueFeedback().bind(BASELINE, encoders)
    with pytest.raises(ParameterError, match="voltage_max"):
        Impedance(table_volts=(0.0, 12.0)).bind(BASELINE, LAYOUT)
    policy: Policy = Impedance().bind(BASELINE, LAYOUT)
    with pytest.raises(ParameterError, match="22 entries"):
        policy(np.zeros(18, np.float32))
