"""Hands, sensors and clutch errors in the environment, against open-loop simulation and closed
forms."""

import math
import tracemalloc
from dataclasses import replace
from pathlib import Path as File

import numpy as np
import pytest

from pter_gym import initial_state, simulate
from pter_gym._engine.batch import Batch
from pter_gym._engine.world import ROW
from pter_gym.errors import ParameterError
from pter_gym.hands import (
    NORMAL,
    RELAXED,
    TENSE,
    HumanArm,
    MultiSineHand,
    RecordedForces,
    read_forces,
)
from pter_gym.hands._operators import MAX_INSTANTS
from pter_gym.params import BASELINE, Hand
from pter_gym.paths import Arc, Line
from pter_gym.tasks.path_following import COLUMN, PathFollowing, Sensing

PERIOD, H = 0.01, BASELINE.substep
COUNT = round(PERIOD / H)
TASK = PathFollowing(
    path=Line(x=-0.3, y=0.6, direction=0.0, length=0.6), hand=MultiSineHand(push=12.0)
)
"""A line in the middle of the workspace and a hand that pushes gently."""


def stepped(
    task: PathFollowing, volts: np.ndarray, machine=BASELINE, **options
) -> tuple[np.ndarray, np.ndarray]:
    """Telemetry (T + 1, K) and observations of one world whose episode does not end."""
    batch = Batch(machine, task, **options)
    obs, row = batch.reset([0])
    rows, seen = [row[0]], [obs[0]]
    for command in volts:
        returns = batch.step(command[None])
        rows.append(returns.telemetry[0, 0])
        seen.append(returns.obs[0])
    assert not any(row[COLUMN.terminated] for row in rows)
    return np.array(rows), np.array(seen)


def intended(hand: HumanArm, pace: float, arc_lengths: np.ndarray) -> np.ndarray:
    """The intent's arc length at each control instant, by its definition."""
    places = [0.0]
    for step, s in enumerate(arc_lengths[:-1]):
        u = min((step + 0.5) * PERIOD / hand.rise, 1.0)
        moved = places[-1] + PERIOD * hand.eagerness * pace * (3.0 * u**2 - 2.0 * u**3)
        places.append(max(min(moved, s + hand.lead), places[-1]))
    return np.array(places)


@pytest.mark.parametrize("impedance", [RELAXED, NORMAL, TENSE])
@pytest.mark.parametrize("lead", [0.12, 0.01])
def test_a_human_arm_moves_the_tip_as_in_open_loop(impedance: Hand, lead: float) -> None:
    """The same mass, damper, spring and target through ``simulate``: equal up to rounding in 400
    substeps."""
    hand = HumanArm(
        impedance=impedance,
        eagerness=1.5,
        rise=0.25,
        lead=lead,
        amplitudes=(0.0,) * 5,
        phases=(0.1,) * 5,
    )
    path = Arc(x=-0.4, y=0.6, direction=0.3, radius=0.5, angle=-1.2)
    task = PathFollowing(path=path, hand=hand, pace=0.3, error_max=0.2)
    volts = np.tile([2.0, 1.0, 0.0, 0.5], (100, 1))
    rows, _ = stepped(task, volts)

    places = intended(hand, task.pace, rows[:, COLUMN.arc_length])
    points = np.array([path.point(s) for s in places])
    velocity = np.diff(points, axis=0) / PERIOD
    target = np.concatenate(
        [
            p + H * np.outer(np.arange(COUNT) + 0.5, v)
            for p, v in zip(points, velocity, strict=False)
        ]
    )
    machine = replace(BASELINE, hand=hand.impedance)
    force = hand.impedance.damping * np.repeat(velocity, COUNT, axis=0)
    open_loop = simulate(
        machine,
        initial_state(machine, rows[0, [*COLUMN.theta]]),
        np.repeat(volts, COUNT, axis=0),
        force,
        hand_target=target,
    )
    np.testing.assert_allclose(
        rows[1:, [*COLUMN.theta]], open_loop.theta[COUNT - 1 :: COUNT], atol=1e-10
    )
    np.testing.assert_allclose(
        rows[1:, COLUMN.kinetic_energy], open_loop.kinetic_energy[COUNT - 1 :: COUNT], atol=1e-10
    )
    np.testing.assert_allclose(
        rows[1:, COLUMN.energy.hand_work],
        open_loop.hand_work.reshape(-1, COUNT).sum(axis=1),
        rtol=1e-9,
        atol=1e-10,
    )


def test_the_intent_waits_for_a_tip_that_cannot_move() -> None:
    """Locked: the spring's pull is at most stiffness · lead, up to the bend of the path."""
    hand = HumanArm(impedance=TENSE, lead=0.05, amplitudes=(0.0,) * 5)
    rows, _ = stepped(
        PathFollowing(path=Line(length=0.5), hand=hand, pace=0.4), np.full((150, 4), 24.0)
    )
    pull = np.hypot(rows[1:, COLUMN.force.x], rows[1:, COLUMN.force.y])
    assert pull.max() <= 600.0 * 0.0501 + hand.impedance.damping * 0.4 * hand.eagerness
    assert pull[-1] == pytest.approx(
        600.0 * math.hypot(0.05, rows[-1, COLUMN.normal_error]), rel=1e-9
    )


def test_a_hand_may_come_with_the_machine_or_with_the_task() -> None:
    held = replace(BASELINE, hand=Hand(mass=1.0))
    with pytest.raises(ParameterError, match=r"Machine\.hand"):
        Batch(held, PathFollowing(hand=HumanArm()))
    with pytest.raises(ParameterError, match=r"impedance\.stiffness"):
        HumanArm(impedance=Hand(mass=1.0))
    stiff = HumanArm(impedance=Hand(mass=0.5, stiffness=1e6))
    with pytest.raises(ParameterError, match=r"hand\.stiffness"):
        Batch(BASELINE, PathFollowing(hand=stiff))


def test_recorded_forces_act_as_recorded(tmp_path: File) -> None:
    file = tmp_path / "forces.csv"
    file.write_text("time,along,across\n0,3,0\n0.105,5,8\n0.33,4.2,-8\n")
    hand = read_forces(file)
    rows, _ = stepped(replace(TASK, hand=hand), np.zeros((50, 4)))
    instants = PERIOD * np.arange(51)
    for column, force in ((COLUMN.force.x, hand.along), (COLUMN.force.y, hand.across)):
        held = np.interp(instants, hand.times, force)
        np.testing.assert_allclose(rows[1:, column], held[1:], atol=1e-12)


def test_a_recording_in_microseconds_is_refused_before_memory_is_taken() -> None:
    hand = RecordedForces(times=(0.0, 1e6, 2e6), along=(40.0,) * 3, across=(0.0,) * 3)
    tracemalloc.start()
    try:
        with pytest.raises(ParameterError, match="times"):
            Batch(BASELINE, replace(TASK, hand=hand))
        assert tracemalloc.get_traced_memory()[1] < 5e6
    finally:
        tracemalloc.stop()
    most = MAX_INSTANTS * PERIOD
    longest = RecordedForces(times=(0.0, most), along=(1.0, 2.0), across=(0.0, 0.0))
    assert longest.sampled(PERIOD)[-1].tolist() == [2.0, 0.0]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("time,along\n0,1\n", "column across"),
        ("time,along,across\n0.1,1,1\n0.2,1,1\n", "line 2"),
        ("time,along,across\n0,1,1\n0.2,1,1\n0.1,1,1\n", "line 4"),
        ("time,along,across\n0,1,1\n10,1,1\n20,1,1\n", "time"),
        ("time,along,across\n" + "".join(f"{0.2 * row:.1f},1,1\n" for row in range(3100)), "time"),
        ("time,along,across\n0,1,inf\n", "line 2.*across"),
        ("time,along,across\n", "time"),
    ],
)
def test_bad_recordings_are_refused(tmp_path: File, text: str, message: str) -> None:
    file = tmp_path / "forces.csv"
    file.write_text(text)
    with pytest.raises(ParameterError, match=message):
        read_forces(file)


def test_torque_errors_and_drift_scale_the_clutches() -> None:
    """A clutch with a factor is one with scaled curves; drift grows by its rate in each control
    step."""
    factor = 0.8
    curves = replace(
        BASELINE.clutch,
        breakaway=BASELINE.clutch.breakaway.scaled(factor),
        dynamic=BASELINE.clutch.dynamic.scaled(factor),
    )
    volts = np.tile([5.0, 2.0, 1.0, 3.0], (40, 1))
    a, _ = stepped(TASK, volts, replace(BASELINE, clutch_scale=(factor,) * 4))
    b, _ = stepped(TASK, volts, replace(BASELINE, clutch=curves))
    np.testing.assert_allclose(a[:, [*COLUMN.tip]], b[:, [*COLUMN.tip]], atol=1e-12)

    rate, fast = -0.5, replace(BASELINE, clutch=replace(BASELINE.clutch, time_constant=1e-4))
    locked = replace(
        PathFollowing(), friction_drift=rate, hand=MultiSineHand(push=0.0, amplitudes=(0.0,) * 5)
    )
    batch = Batch(fast, locked)
    batch.reset([0])
    for step in range(50):
        batch.step(np.full((1, 4), 10.0))
        breakaway = batch.get_state()["worlds"][0, ROW.torques.breakaway.x1, 0]
        expected = fast.clutch.breakaway.torque(10.0) * (1.0 + rate * PERIOD * step)
        assert breakaway == pytest.approx(expected, rel=1e-12)


def test_quantised_angles_are_multiples_and_everything_else_follows_them() -> None:
    resolution = 2.0 * math.pi / 1024.0
    task = replace(TASK, sensing=Sensing(angle_resolution=resolution))
    rows, seen = stepped(task, np.full((30, 4), 2.0))
    angle = np.arctan2(seen[:, 1].astype(float), seen[:, 0])
    # float32 observations
    assert np.abs(np.remainder(angle / resolution + 0.5, 1.0) - 0.5).max() < 1e-4
    assert np.abs(angle - rows[:, COLUMN.theta.a]).max() <= 0.5 * resolution + 1e-6
    exact = Batch(BASELINE, PathFollowing()).layout
    error = exact.physical(seen, "normal_error")
    assert np.abs(error - rows[:, COLUMN.normal_error]).max() > 1e-6


def test_noise_has_its_size_and_comes_from_the_seed() -> None:
    sensing = Sensing(velocity_noise=0.02, torque_noise=0.5, force_noise=0.7)
    still = replace(BASELINE.arm, inertia_a=1e6, inertia_b=1e6, coupling=0.0)
    task = PathFollowing(sensing=sensing, hand=MultiSineHand(push=5.0, amplitudes=(0.0,) * 5))
    machine = replace(BASELINE, arm=still)
    batch = Batch(machine, task, 400, sensors="force")
    rows = []
    for repeat in range(2):
        rows.append([batch.reset(list(range(400)))[0]])
        rows[repeat] += [batch.step(np.zeros((400, 4))).obs for _ in range(25)]
    first, second = (np.array(each) for each in rows)
    np.testing.assert_array_equal(first, second)
    layout = batch.layout
    count = first[..., 0].size
    for name, sigma in (
        ("omega_a", 0.02),
        ("omega_b", 0.02),
        ("torque_3", 0.5),
        ("force_across", 0.7),
    ):
        values = layout.physical(first, name)
        assert abs(values.mean()) < 5.0 * sigma / math.sqrt(count) + 1e-6
        assert values.std() == pytest.approx(sigma, rel=5.0 / math.sqrt(2.0 * count))
    pairs = np.corrcoef(
        np.stack([layout.physical(first, n).ravel() for n in ("omega_a", "omega_b", "torque_1")])
    )
    assert np.abs(pairs - np.eye(3)).max() < 5.0 / math.sqrt(count)


@pytest.mark.parametrize("delay", [0, 1, 2])
def test_sensors_are_late_by_whole_control_steps(delay: int) -> None:
    late = Sensing(delay=delay, force_noise=1e-30)
    volts = np.tile([3.0, 1.0, 0.5, 0.0], (40, 1))
    rows, seen = stepped(replace(TASK, sensing=late), volts, sensors="force")
    _, now = stepped(TASK, volts, sensors="force")
    layout = Batch(BASELINE, PathFollowing(), sensors="force").layout
    for name in ("omega_a", "normal_error", "speed_along", "torque_2", "force_across"):
        column = layout.index(name)
        np.testing.assert_allclose(seen[delay:, column], now[: len(now) - delay, column], atol=2e-7)
    np.testing.assert_array_equal(seen[:, layout.index("volts_1")], now[:, layout.index("volts_1")])
    assert np.isfinite(rows[:, COLUMN.tip_velocity.x]).all()


@pytest.mark.parametrize(
    ("field", "value"),
    [("delay", 3), ("delay", 0.5), ("angle_resolution", -1.0), ("velocity_noise", math.inf)],
)
def test_bad_sensing_is_named(field: str, value: float) -> None:
    with pytest.raises(ParameterError, match=rf"Sensing\.{field}"):
        Sensing(**{field: value})  # pyright: ignore[reportArgumentType]


def test_recordings_are_checked() -> None:
    with pytest.raises(ParameterError, match=r"RecordedForces\.along"):
        RecordedForces(times=(0.0, 1.0), along=(1.0,), across=(1.0, 2.0))
