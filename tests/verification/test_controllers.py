"""The controllers against their definitions by an independent formulation (paper section III-A,
Fig. 6)."""

from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest
from numpy.typing import NDArray

from pter_gym._compiled.records import flat, leaves
from pter_gym._engine.batch import Batch
from pter_gym.controllers import (
    CONTROLLERS,
    MEMORY,
    Free,
    Guided,
    Impedance,
    Locked,
    PaceSchedule,
    PerClutch,
    PerLink,
    Playback,
    Policy,
    Random,
    SingleDof,
    TorqueFeedback,
    VelocityRatio,
    compiled,
    passive_torques,
    read_playback,
    table_voltage,
)
from pter_gym.errors import LawIndexError, ParameterError
from pter_gym.params import BASELINE
from pter_gym.tasks.path_following import PathFollowing, Sensors, observation_layout
from pter_gym.tasks.path_following._observation import OBS, Observation
from pter_gym.units import INCH_POUND
from rollouts import Acting

W = np.array([[1.0, 0.0], [0.0, 1.0], [1.0, -1.0], [1.0, 1.0]])
LAYOUT = observation_layout(BASELINE, "torque")
Array = NDArray[np.float64]


def allocate(want: Array, low: Array, high: Array, metric: Array) -> Array:
    """Enumerate which clutches sit at a bound: least weighted distance, then least norm, among the
    feasible points."""
    root = np.linalg.cholesky(metric).T
    found: list[Array] = []
    for states in product((False, True), repeat=4):
        free = np.array(states)
        bounds = product(
            *((0.0,) if state else ends for state, *ends in zip(states, low, high, strict=True))
        )
        torque = np.array(list(bounds))
        if free.any():
            inverse = np.linalg.pinv(root @ W[free].T, rcond=1e-9)
            torque[:, free] = (want - torque @ W) @ root.T @ inverse.T
        found.append(torque)
    torques = np.concatenate(found)
    torques = torques[((torques >= low - 1e-9) & (torques <= high + 1e-9)).all(axis=1)]
    distance = (((torques @ W - want) @ root.T) ** 2).sum(axis=1).round(9)
    return torques[np.lexsort(((torques**2).sum(axis=1), distance))[0]]


def jacobian_of(physical: dict[str, float]) -> Array:
    """Of the tip, from the angles themselves."""
    arm = BASELINE.arm
    a, b = (np.arctan2(physical[f"sin_{x}"], physical[f"cos_{x}"]) for x in "ab")
    return np.array(
        [
            [-arm.length_a * np.sin(a), -arm.length_b * np.sin(b)],
            [arm.length_a * np.cos(a), arm.length_b * np.cos(b)],
        ]
    )


def allocated(gains: Guided, joint_torque: Array, omega: Array, metric: Array) -> Array:
    """Magnitudes of the clutch torques nearest to a wanted joint torque."""
    limit = BASELINE.clutch.dynamic.torque(24.0)
    slip = W @ omega
    low = np.where(slip < -gains.slip_threshold, 0.0, -limit)
    high = np.where(slip > gains.slip_threshold, 0.0, limit)
    return np.abs(allocate(joint_torque, low, high, metric))


def metric_of(jacobian: Array, tip_space: bool) -> Array:
    """Of the joint torques: distances in tip force or in joint torque."""
    return np.asarray(np.linalg.inv(jacobian.T @ jacobian) if tip_space else np.eye(2), np.float64)


def voltages(
    gains: Guided, wanted: Array, physical: dict[str, float], feedback: float, hold: bool
) -> Array:
    """The table and the torque loop."""
    slip = W @ np.array([physical["omega_a"], physical["omega_b"]])
    knots = np.array(gains.table_volts)
    volts = np.interp(wanted, [BASELINE.clutch.dynamic.torque(v) for v in knots], knots)
    error = wanted - np.abs([physical[f"torque_{x}"] for x in range(1, 5)])
    idle = hold & (np.abs(slip) <= gains.slip_threshold) & (error > 0.0)
    return np.clip(volts + np.where(idle, 0.0, feedback * error), 0.0, 24.0)


def brake(gains: Guided, speed: float, pace: float) -> float:
    """Force along the path: none between standstill and the fraction of the pace, a damper
    outside."""
    free = gains.pace_fraction * pace
    excess = speed if speed < 0.0 else max(speed - free, 0.0)
    return -gains.damping_tangential * excess


def reference(gains: Impedance, obs: Array, feedback: float = 0.0, hold: bool = False) -> Array:
    """The two controllers as the paper words them, in plain numpy."""
    physical = dict(zip(LAYOUT.names, obs * LAYOUT.scales, strict=True))
    omega = np.array([physical["omega_a"], physical["omega_b"]])
    jacobian = jacobian_of(physical)
    tangent = np.array([physical["heading_cos"], physical["heading_sin"]])
    normal = np.array([-tangent[1], tangent[0]])
    velocity = jacobian @ omega
    force = (
        -(gains.stiffness * physical["normal_error"] + gains.damping_normal * (velocity @ normal))
        * normal
        + brake(gains, float(velocity @ tangent), physical["pace"]) * tangent
    )
    wanted = allocated(gains, jacobian.T @ force, omega, metric_of(jacobian, gains.tip_space))
    return voltages(gains, wanted, physical, feedback, hold)


def steering_reference(gains: SingleDof | VelocityRatio, obs: Array) -> Array:
    """The two steering laws by angles and by simulated turns, where the laws use products."""
    physical = dict(zip(LAYOUT.names, obs * LAYOUT.scales, strict=True))
    omega = np.array([physical["omega_a"], physical["omega_b"]])
    jacobian = jacobian_of(physical)
    tangent = np.array([physical["heading_cos"], physical["heading_sin"]])
    velocity = jacobian @ omega
    joint_torque = jacobian.T @ (
        brake(gains, float(velocity @ tangent), physical["pace"]) * tangent
    )
    turn = (
        gains.lead * physical["curvature"] * (velocity @ tangent)
        - gains.approach * physical["normal_error"]
    )
    heading = np.arctan2(tangent[1], tangent[0]) + np.arctan(turn)
    if isinstance(gains, VelocityRatio):
        ratio = np.linalg.solve(jacobian, [np.cos(heading), np.sin(heading)])
        off = np.arctan2(omega[1], omega[0]) - np.arctan2(ratio[1], ratio[0])
        normal = np.array([-ratio[1], ratio[0]]) / np.linalg.norm(ratio)
        size = np.linalg.norm(omega)
        joint_torque = (
            joint_torque - gains.strength * np.sin(off) * min(size / gains.slow, 1.0) * normal
        )
        wanted = allocated(gains, joint_torque, omega, metric_of(jacobian, gains.tip_space))
    else:
        wanted = allocated(gains, joint_torque, omega, np.eye(2))
        wanted = wanted + engaged(gains, heading, physical, omega, jacobian)
    volts = voltages(gains, wanted, physical, gains.feedback, gains.hold_when_stuck)
    left = np.array([-tangent[1], tangent[0]])
    leaves = physical["normal_error"] * (velocity @ left) > 0.0
    lost = gains.release > 0.0 and abs(physical["normal_error"]) > gains.release and leaves
    return np.where(lost & (np.abs(W @ omega) < 0.02), 0.0, volts)


def engaged(
    gains: SingleDof, heading: float, physical: dict[str, float], omega: Array, jacobian: Array
) -> Array:
    """Torque of the clutch with the best line: brake with each for a moment and see which way the
    tip turns."""
    arm = BASELINE.arm
    m12 = arm.coupling * np.cos(
        np.arctan2(physical["sin_a"], physical["cos_a"])
        - np.arctan2(physical["sin_b"], physical["cos_b"])
    )
    mass = np.array([[arm.inertia_a, m12], [m12, arm.inertia_b]])
    velocity = jacobian @ omega
    if not velocity.any():
        return np.zeros(4)
    off = np.angle(np.exp(1j * (heading - np.arctan2(velocity[1], velocity[0]))))
    best, chosen = -1.0, -1
    for x in range(4):
        torque = -1.0 if W[x] @ omega >= 0.0 else 1.0
        change = np.asarray(np.linalg.solve(mass, W[x] * torque), np.float64)
        after = jacobian @ (omega + 1e-6 * change)
        turned = np.angle(
            np.exp(1j * (np.arctan2(after[1], after[0]) - np.arctan2(velocity[1], velocity[0])))
        )
        free = np.linalg.svd(W[x : x + 1])[2][1]
        line = jacobian @ free
        match = np.cos(np.arctan2(line[1], line[0]) - heading) ** 2
        if turned * np.sin(off) > 0.0 and match > best:
            best, chosen = match, x
    torques = np.zeros(4)
    if chosen >= 0:
        torques[chosen] = (
            gains.strength * abs(np.sin(off)) * min(np.linalg.norm(velocity) / gains.slow, 1.0)
        )
    return torques


MAX_NUMBER = {
    "omega_a": 10.0,
    "omega_b": 10.0,
    "normal_error": 0.25,
    "speed_along": 4.0,
    "speed_across": 4.0,
}
"""Largest magnitudes to draw, in SI; of the other entries, their scales."""


def observations(count: int) -> NDArray[np.float32]:
    """Draw plausible observations, many with stuck clutches."""
    rng = np.random.default_rng(3)
    largest = np.array(
        [
            MAX_NUMBER.get(name, scale)
            for name, scale in zip(LAYOUT.names, LAYOUT.scales, strict=True)
        ]
    )
    obs = largest * rng.uniform(-1.0, 1.0, (count, len(LAYOUT)))
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
    obs[:, LAYOUT.index("pace")] = rng.uniform(0.0, 0.8, count)
    return (obs / LAYOUT.scales).astype(np.float32)


@pytest.mark.parametrize(
    "gains",
    [
        *(
            Impedance(
                stiffness=800.0 * strength, damping_normal=200.0 * strength, tip_space=tip_space
            )
            for strength, tip_space in product((0.05, 1.0), (False, True))
        ),
        Impedance(pace_fraction=0.5),
        TorqueFeedback(feedback=0.7, hold_when_stuck=False),
        TorqueFeedback(feedback=0.7, hold_when_stuck=True),
    ],
    ids=lambda gains: type(gains).__name__,
)
def test_the_papers_controllers(gains: Impedance) -> None:
    obs = observations(400)
    found = Acting(gains.bind(BASELINE, LAYOUT))(obs)
    loop = (
        (gains.feedback, gains.hold_when_stuck)
        if isinstance(gains, TorqueFeedback)
        else (0.0, False)
    )
    expected = np.array([reference(gains, row.astype(float), *loop) for row in obs])
    np.testing.assert_allclose(found, expected, rtol=2e-6, atol=2e-5)
    assert (found > 0.0).mean() > 0.2


@pytest.mark.parametrize(
    ("gains", "change"),
    [
        (TorqueFeedback(feedback=0.7), {"hold_when_stuck": True}),
        (Impedance(), {"pace_fraction": 0.5}),
    ],
)
def test_a_gain_changes_the_voltages(gains: Guided, change: dict[str, Any]) -> None:
    plain, changed = (
        Acting(law.bind(BASELINE, LAYOUT))(observations(400))
        for law in (gains, replace(gains, **change))
    )
    assert (plain != changed).any()


@pytest.mark.parametrize(
    "gains",
    [
        SingleDof(strength=15.0, approach=5.0, lead=0.1, reluctance=0.0),
        SingleDof(strength=40.0, slow=0.5, reluctance=0.0, feedback=0.3, pace_fraction=0.4),
        SingleDof(strength=40.0, reluctance=0.0, feedback=0.3, release=0.05),
        VelocityRatio(strength=15.0, approach=5.0, release=0.05),
        VelocityRatio(strength=15.0, approach=5.0, lead=0.1),
        VelocityRatio(strength=40.0, slow=2.0, tip_space=True, feedback=0.3, hold_when_stuck=True),
    ],
    ids=lambda gains: type(gains).__name__,
)
def test_steering(gains: SingleDof | VelocityRatio) -> None:
    obs = observations(400)
    found = Acting(gains.bind(BASELINE, LAYOUT))(obs)
    expected = np.array([steering_reference(gains, row.astype(float)) for row in obs])
    np.testing.assert_allclose(found, expected, rtol=2e-6, atol=5e-5)
    assert (found > 0.0).mean() > 0.2


def test_steering_prefers_the_engaged_clutch() -> None:
    obs = observations(400)
    obs[:, LAYOUT.index("progress")] = 0.5  # all of one episode
    fickle, stubborn = (
        Acting(SingleDof(damping_tangential=0.0, reluctance=reluctance).bind(BASELINE, LAYOUT))
        for reluctance in (0.0, 0.99)
    )
    engaged_by = [
        np.array([policy(row) for row in obs]).argmax(axis=1) for policy in (fickle, stubborn)
    ]
    changes = [(np.diff(engaged) != 0).sum() for engaged in engaged_by]
    assert changes[1] < 0.9 * changes[0]


def test_the_integral_of_the_pace_adds_to_the_brake_and_begins_again() -> None:
    """What a damper and the integral give together, another damper gives alone at that speed."""
    row = observations(400)[(observations(400)[:, LAYOUT.index("speed_along")] > 0.0)][7].copy()
    jacobian = jacobian_of(dict(zip(LAYOUT.names, row * LAYOUT.scales, strict=True)))
    tangent = np.array([row[LAYOUT.index("heading_cos")], row[LAYOUT.index("heading_sin")]])
    omega = slice(LAYOUT.index("omega_a"), LAYOUT.index("omega_b") + 1)
    row[omega] = np.linalg.solve(jacobian, 0.5 * tangent) / LAYOUT.scales[omega]
    row[LAYOUT.index("pace")] = 0.3 / LAYOUT.scales[LAYOUT.index("pace")]
    volts = slice(LAYOUT.index("volts_1"), LAYOUT.index("volts_4") + 1)
    row[volts] = 0.1
    row[LAYOUT.index("progress")] = 0.5
    law = Impedance(damping_tangential=100.0, pace_integral=10.0)
    policy = Acting(law.bind(BASELINE, LAYOUT))
    for steps in range(1, 6):
        braking = 100.0 * 0.5 + 10.0 * 0.2 * steps
        alone = Acting(Impedance(damping_tangential=braking / 0.5).bind(BASELINE, LAYOUT))
        np.testing.assert_allclose(policy(row), alone(row), rtol=1e-4, atol=1e-4)
    policy.reset()
    first = Acting(Impedance(damping_tangential=(100.0 * 0.5 + 2.0) / 0.5).bind(BASELINE, LAYOUT))
    np.testing.assert_allclose(policy(row), first(row), rtol=1e-4, atol=1e-4)
    row[volts] = 0.1
    row[LAYOUT.index("pace")] = 3.0 / LAYOUT.scales[LAYOUT.index("pace")]
    for _ in range(200):
        volts_given = policy(row)
    np.testing.assert_allclose(
        volts_given,
        Acting(Impedance(damping_tangential=0.0).bind(BASELINE, LAYOUT))(row),
        rtol=1e-4,
        atol=1e-4,
    )


@pytest.mark.parametrize("kind", [Impedance, TorqueFeedback, SingleDof, VelocityRatio])
def test_a_grip_engages_all_clutches_only_at_the_start(kind: Any) -> None:
    batch = Batch(BASELINE, PathFollowing(), 3)
    obs, _ = batch.reset([0, 1, 2])
    gripping, plain = (
        Acting(kind(grip=grip, pace_integral=0.0).bind(BASELINE, batch.layout))
        for grip in (4.0, 0.0)
    )
    for step in range(12):
        volts = gripping(obs)
        without = plain(obs)
        if step < 4:
            assert (volts == 24.0).all()
            assert not (without == 24.0).all()
        else:
            np.testing.assert_array_equal(volts, without)
        obs = batch.step(volts).obs
    while (batch.layout.physical(obs, "progress") < 0.05).all():
        np.testing.assert_array_equal(gripping(obs), plain(obs), "no voltage is no beginning")
        obs = batch.step(np.zeros((3, 4))).obs
    late = Acting(kind(grip=4.0, pace_integral=0.0).bind(BASELINE, batch.layout))
    np.testing.assert_array_equal(
        late(obs)[0], plain(obs)[0], "an episode that it did not see begin"
    )
    obs, _ = batch.reset([3, 4, 5])
    assert not (gripping(obs) == 24.0).all(), "a tip back at the start is no new episode"
    gripping.reset()
    assert (gripping(obs) == 24.0).all(), "a new episode"


def test_a_schedule_is_linear_between_its_knots_and_flat_beyond() -> None:
    slow = TorqueFeedback(stiffness=200.0, damping_tangential=600.0, feedback=0.1)
    brisk = TorqueFeedback(stiffness=1000.0, damping_tangential=100.0, feedback=0.5)
    schedule = PaceSchedule(((0.125, slow), (0.25, TorqueFeedback()), (0.5, brisk))).bind(
        BASELINE, LAYOUT
    )
    between = TorqueFeedback(
        stiffness=0.5 * (1000.0 + TorqueFeedback().stiffness),
        damping_tangential=0.5 * (100.0 + TorqueFeedback().damping_tangential),
        feedback=0.5 * (0.5 + TorqueFeedback().feedback),
    )
    obs = observations(100)
    for pace, gains in (
        (0.0625, slow),
        (0.125, slow),
        (0.25, TorqueFeedback()),
        (0.375, between),
        (1.0, brisk),
    ):
        obs[:, LAYOUT.index("pace")] = pace / LAYOUT.scales[LAYOUT.index("pace")]
        np.testing.assert_allclose(
            Acting(schedule)(obs), Acting(gains.bind(BASELINE, LAYOUT))(obs), rtol=1e-6, atol=1e-5
        )


def test_between_knots_never_is_infinitely_far() -> None:
    """Halfway from 10 mm to never is 20 mm, not 5 mm."""
    obs = observations(400)
    obs[:, LAYOUT.index("pace")] = 0.375 / LAYOUT.scales[LAYOUT.index("pace")]
    never, at_10_mm, at_20_mm = (SingleDof(release=each) for each in (0.0, 0.01, 0.02))
    schedule = PaceSchedule(((0.25, never), (0.5, at_10_mm)))
    found, expected, plain = (
        Acting(law.bind(BASELINE, LAYOUT))(obs) for law in (schedule, at_20_mm, never)
    )
    np.testing.assert_array_equal(found, expected)
    assert (found != plain).any()


@compiled
def weakened(g: Any, tip: Any, nominal: Any, want: Any, memory: Any, arrangement: Any) -> PerClutch:
    memory[int(g.place)] += 1.0
    less = PerLink(g.share * want.a, g.share * want.b)
    return passive_torques(g, tip, nominal, less, arrangement)


@dataclass(frozen=True, kw_only=True)
class Weakened(TorqueFeedback):
    """The torque-feedback law with a part of its joint torques; it counts in its memory."""

    steering = weakened
    share: float = 1.0
    place: float = float(MEMORY.kept)


def test_a_law_with_its_own_steering_and_gain_has_the_parts_of_the_others() -> None:
    obs = observations(200)
    whole = Impedance(stiffness=800.0, damping_normal=200.0, damping_tangential=100.0)
    plain = TorqueFeedback(**vars(whole), feedback=0.3)
    half = replace(plain, stiffness=400.0, damping_normal=100.0, damping_tangential=50.0)
    law = Weakened(**vars(plain))
    schedule = PaceSchedule(((0.2, replace(law, share=0.25)), (0.4, replace(law, share=0.75))))
    obs[:, LAYOUT.index("pace")] = 0.3 / LAYOUT.scales[LAYOUT.index("pace")]
    policy = Acting(schedule.bind(BASELINE, LAYOUT))
    np.testing.assert_allclose(
        policy(obs), Acting(half.bind(BASELINE, LAYOUT))(obs), rtol=1e-6, atol=1e-5
    )
    assert (policy.memory[:, MEMORY.kept] == 1.0).all()
    beyond = Acting(replace(law, place=4.0).bind(BASELINE, LAYOUT))
    with pytest.raises(LawIndexError, match="memory 4"):
        beyond(obs)


@pytest.mark.parametrize(
    "knots",
    [
        (),
        ((0.25, Impedance()), (0.125, Impedance())),
        ((0.0, Impedance()),),
        ((0.25, Free()),),
        ((0.25,),),
        ((0.125, Impedance()), (0.25, TorqueFeedback())),
        ((0.125, Impedance()), (0.25, Impedance(table_volts=(0.0, 24.0)))),
    ],
)
def test_a_bad_schedule_is_refused(knots: tuple[tuple[float, Impedance], ...]) -> None:
    with pytest.raises(ParameterError, match="knots"):
        PaceSchedule(knots)


def test_feedback_gain_is_the_papers() -> None:
    assert pytest.approx(0.531, abs=5e-4) == TorqueFeedback().feedback
    assert pytest.approx(0.06) == TorqueFeedback().feedback * INCH_POUND


@pytest.mark.parametrize("sensors", get_args(Sensors))
def test_the_record_is_the_layout(sensors: Sensors) -> None:
    """A law reads by the places in ``OBS``; they are those of the names, whatever the sensors."""
    layout = observation_layout(BASELINE, sensors)
    places = dict(zip((leaf.name for leaf in leaves(Observation)), flat(OBS), strict=True))
    assert {name: places[name] for name in layout.names} == {
        name: layout.index(name) for name in layout.names
    }
    assert (OBS.omega_a, OBS.heading.sin, OBS.torque.x4) == tuple(
        map(places.get, ("omega_a", "heading_sin", "torque_4"))
    )


def test_simple_policies() -> None:
    obs = observations(3)
    assert (Acting(Free().bind(BASELINE, LAYOUT))(obs) == 0.0).all()
    assert (Acting(Locked().bind(BASELINE, LAYOUT))(obs) == 24.0).all()
    one, two = (Acting(Random(seed=5).bind(BASELINE, LAYOUT)) for _ in range(2))
    volts = np.array([one(obs) for _ in range(500)])
    assert volts[0].tobytes() == two(obs).tobytes()
    assert len(np.unique(volts)) > 0.99 * volts.size
    assert volts.min() >= 0.0
    assert volts.max() <= 24.0
    assert abs(volts.mean() - 12.0) < 5.0 * 24.0 / np.sqrt(12.0 * volts.size)


@pytest.mark.parametrize(
    ("kind", "field", "value"),
    [
        (TorqueFeedback, "stiffness", -1.0),
        (TorqueFeedback, "damping_normal", float("nan")),
        (TorqueFeedback, "damping_tangential", float("inf")),
        (TorqueFeedback, "table_volts", (0.0, 5.0, 4.0)),
        (TorqueFeedback, "table_volts", (1.0, 24.0)),
        (TorqueFeedback, "tip_space", 1),
        (TorqueFeedback, "feedback", -0.1),
        (TorqueFeedback, "hold_when_stuck", "yes"),
        (SingleDof, "approach", -1.0),
        (SingleDof, "strength", float("nan")),
        (SingleDof, "lead", -0.1),
        (SingleDof, "release", -0.1),
        (SingleDof, "slow", 0.0),
        (SingleDof, "reluctance", 1.0),
        (SingleDof, "pace_fraction", 1.5),
        (SingleDof, "pace_integral", -1.0),
        (SingleDof, "grip", -1.0),
        (VelocityRatio, "tip_space", "no"),
    ],
)
def test_bad_gains_are_named(kind: Any, field: str, value: object) -> None:
    with pytest.raises(ParameterError, match=field):
        kind(**{field: value})


@pytest.mark.parametrize("top", [2.0, 10.0, 12.0, 24.0, 30.0])
def test_the_table_ends_at_the_largest_voltage_of_the_machine(top: float) -> None:
    machine = replace(BASELINE, clutch=replace(BASELINE.clutch, voltage_max=top))
    policy: Any = Impedance().bind(machine, observation_layout(machine, "torque"))
    for knot in (part * top for part in (0.0, 4.0 / 24.0, 10.0 / 24.0, 17.0 / 24.0, 1.0)):
        torque = machine.clutch.dynamic.torque(knot)
        assert table_voltage(policy.law.gains, torque) == pytest.approx(knot, rel=1e-12)
    assert (table_voltage(policy.law.gains, 0.0), table_voltage(policy.law.gains, 1e6)) == (
        0.0,
        top,
    )
    assert (
        np.diff([table_voltage(policy.law.gains, t) for t in np.linspace(0.0, 60.0, 200)]) >= 0.0
    ).all()
    longer: Any = Impedance(table_volts=(0.0, 4.0, 10.0, 17.0, 24.0, 30.0))
    np.testing.assert_array_equal(policy.law.gains, longer.bind(machine, policy.layout).law.gains)
    np.testing.assert_array_equal(
        Impedance(table_volts=(0.0, 12.0)).bind(BASELINE, LAYOUT).law.gains,
        Impedance(table_volts=(0.0, 12.0, 24.0)).bind(BASELINE, LAYOUT).law.gains,
    )


def test_observations_of_other_sensors_are_refused() -> None:
    encoders = observation_layout(BASELINE, "encoders")
    with pytest.raises(ParameterError, match="sensors"):
        TorqueFeedback().bind(BASELINE, encoders)
    policy: Policy = Impedance().bind(BASELINE, LAYOUT)
    for seen in (np.zeros((1, 18), np.float32), np.zeros((2, len(LAYOUT)), np.float32)):
        with pytest.raises(ParameterError, match="observation"):
            policy.act(seen, policy.start(1))


@pytest.mark.parametrize("kind", [*CONTROLLERS.values(), partial(Impedance, grip=5.0)])
@pytest.mark.parametrize("gone", range(4))
def test_an_absent_clutch_gets_no_voltage(kind: Any, gone: int) -> None:
    scale = tuple(0.0 if x == gone else 1.0 for x in range(4))
    machine = replace(BASELINE, clutch_scale=scale)
    layout = observation_layout(machine, "torque")
    seen = observations(200)
    volts, whole = (Acting(kind().bind(each, layout))(seen) for each in (machine, BASELINE))
    assert (volts[:, gone] == 0.0).all()
    assert np.isfinite(volts).all()
    assert volts.any() == np.delete(whole, gone, axis=1).any(), (
        "the other clutches brake as they would"
    )


@pytest.mark.parametrize("gone", range(4))
def test_existing_clutches_replace_absent_ones(gone: int) -> None:
    """The allocation is that of the clutches that are there: the torques come as close as theirs
    can."""
    scale = tuple(0.0 if x == gone else 1.0 for x in range(4))
    machine = replace(BASELINE, clutch_scale=scale)
    gains = Impedance()
    layout = observation_layout(machine, "torque")
    seen = observations(100)
    volts = Acting(gains.bind(machine, layout))(seen)
    whole = Acting(gains.bind(BASELINE, layout))(seen)
    needed = whole[:, gone] > 0.5
    assert needed.any()
    others = [x for x in range(4) if x != gone]
    assert (np.abs(volts[needed][:, others] - whole[needed][:, others]).max(axis=1) > 0.01).any()
    np.testing.assert_allclose(
        volts[whole[:, gone] == 0.0][:, others], whole[whole[:, gone] == 0.0][:, others], atol=1e-4
    )


def test_a_weaker_clutch_is_one_with_a_lower_curve() -> None:
    clutch = BASELINE.clutch
    lower = replace(
        clutch,
        breakaway=replace(
            clutch.breakaway,
            slope=0.5 * clutch.breakaway.slope,
            curvature=0.5 * clutch.breakaway.curvature,
        ),
        dynamic=replace(
            clutch.dynamic,
            slope=0.5 * clutch.dynamic.slope,
            curvature=0.5 * clutch.dynamic.curvature,
        ),
    )
    layout = observation_layout(BASELINE, "torque")
    seen = observations(100)
    for controller in (TorqueFeedback(), SingleDof(), VelocityRatio()):
        scaled, weaker = (
            Acting(controller.bind(machine, layout))(seen)
            for machine in (
                replace(BASELINE, clutch_scale=(0.5,) * 4),
                replace(BASELINE, clutch=lower),
            )
        )
        np.testing.assert_allclose(scaled, weaker, rtol=1e-6)


def test_a_table_of_voltages_is_played(tmp_path: Path):
    """Each row from the first step at or after its time on; of two in a step, the later one."""
    file = tmp_path / "table.csv"
    file.write_text("t_s,V1,V2,V3,V4\n0.015,1,0,0,0\n0.03,0,2,0,0\n0.042,9,9,9,9\n0.05,0,0,0,30\n")
    policy = read_playback(file).bind(BASELINE, LAYOUT)
    memory, seen = policy.start(2), np.zeros((2, len(LAYOUT)), np.float32)
    given = np.array([policy.act(seen, memory) for _ in range(8)])
    zero, one, two, top = (0.0,) * 4, (1.0, 0, 0, 0), (0, 2.0, 0, 0), (0, 0, 0, 24.0)
    expected = [zero, zero, one, two, two, top, top, top]
    np.testing.assert_array_equal(given, np.repeat(np.array(expected)[:, None], 2, axis=1))
    with pytest.raises(ParameterError, match="control_period"):
        policy.check_period(0.005)


@pytest.mark.parametrize(
    ("times", "volts", "field"),
    [
        ((), (), "times"),
        ((-0.1,), ((0.0,) * 4,), "times"),
        ((0.0, 0.0), ((0.0,) * 4,) * 2, "times"),
        ((0.0,), ((0.0,) * 3,), "volts"),
        ((0.0,), ((0.0, 0.0, 0.0, -1.0),), "volts"),
        ((0.0,), ((0.0,) * 4,) * 2, "volts"),
    ],
)
def test_a_table_that_cannot_be_played_is_refused(times: Any, volts: Any, field: str):
    with pytest.raises(ParameterError, match=rf"Playback\.{field}"):
        Playback(times=times, volts=volts)
