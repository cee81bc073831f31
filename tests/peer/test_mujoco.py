"""MuJoCo on the same mechanism, step by step: its own kinematics, dynamics and friction solver
against ours.

MuJoCo moves the arm by a whole step after each change of velocity, we by half a step before and
half after it. So MuJoCo starts half a drift ahead of us, stays there, and finds forces, geometry
and torques where we do: in the middle of our substeps. Where a clutch changes within a step,
MuJoCo's own slip tells when, and it takes shorter ones.

Loads are a hand force of four random sines and a constant, about as large as the clutches can hold,
and a small joint torque; poses, velocities and voltages are random. In both, the force acts on the
tip."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import mujoco
import numpy as np
import pytest
from mujoco_arm import RATIOS, ArmNumbers, build
from numpy.typing import ArrayLike, NDArray

from pter_gym._engine.batch import Batch
from pter_gym._engine.world import ROW, SKIP
from pter_gym._physics.open_loop import initial_state, simulate
from pter_gym.hands import MultiSineHand
from pter_gym.params import BASELINE, DELRIN_EXPERIMENTAL, DELRIN_THEORETICAL, Clutch, Hand, Machine
from pter_gym.tasks.path_following import COLUMN, PathFollowing

STEPS = 800
SEEDS = range(20)
FEW_AND_MORE = [SEEDS[:1], pytest.param(SEEDS[1:], marks=pytest.mark.long)]
STEP = BASELINE.substep
ARM = ArmNumbers(
    BASELINE.arm.length_a,
    BASELINE.arm.length_b,
    BASELINE.arm.inertia_a,
    BASELINE.arm.inertia_b,
    BASELINE.arm.coupling,
)
CURVE = BASELINE.clutch.dynamic
EQUAL = replace(BASELINE, clutch=Clutch(breakaway=CURVE, dynamic=CURVE))
"""A machine whose breakaway and dynamic torques are the same."""
MATERIALS = {
    "breakaway above dynamic": BASELINE,
    "equal": EQUAL,
    "dynamic above breakaway": DELRIN_THEORETICAL,
}

PARTS = 4
"""Most parts of a step in which clutches change."""
EDGE = 1.01
"""How far from zero the edge of the stick band counts as left, times δω."""

NEAR = 1e-9
"""Slip velocities as near as this to zero or to the edge of the stick band [rad/s] are there."""
TOLERANCE = 1e-10
"""Both solve each step to rounding [rad], and we see a clutch leave the stick band 1e-12 rad/s
beyond its edge.

In the two seconds of a run that makes about 1e-12 rad, and a few dozen clutches leave it.
"""


def to_joints(angles: ArrayLike) -> NDArray[np.float64]:
    """Return (A, B − A) from (A, B), for angles and rates alike; the last axis has length two."""
    angles = np.asarray(angles, float)
    return np.stack([angles[..., 0], angles[..., 1] - angles[..., 0]], axis=-1)


def to_links(joints: ArrayLike) -> NDArray[np.float64]:
    """Return (A, B) from (A, B − A)."""
    joints = np.asarray(joints, float)
    return np.stack([joints[..., 0], joints[..., 0] + joints[..., 1]], axis=-1)


def to_joint_torque(torque: ArrayLike) -> NDArray[np.float64]:
    """Return generalised forces on (A, B − A) from torques on the links A and B: the same power."""
    torque = np.asarray(torque, float)
    return np.stack([torque[..., 0] + torque[..., 1], torque[..., 1]], axis=-1)


@dataclass(frozen=True)
class PeerCase:
    """Voltages (4,), hand force (T, 2), joint torque (2,), angles and velocities at the start
    (2,)."""

    volts: np.ndarray
    force: np.ndarray
    torque: np.ndarray
    theta: np.ndarray
    omega: np.ndarray


def draw(subset: int, seed: int) -> PeerCase:
    """Clutch x is engaged if bit x of the subset is set."""
    rng = np.random.default_rng([seed, subset])
    engaged = np.array([(subset >> x) & 1 for x in range(4)])
    time = STEP * (np.arange(STEPS)[:, None] + 0.5)
    waves = (
        rng.normal(0.0, 12.0, (4, 2)),
        rng.uniform(0.3, 3.0, 4),
        rng.uniform(0.0, 2.0 * np.pi, 4),
    )
    force = sum(
        size * np.sin(2.0 * np.pi * rate * time + phase)
        for size, rate, phase in zip(*waves, strict=True)
    )
    return PeerCase(
        volts=engaged * rng.uniform(4.0, 14.0, 4),
        force=force + rng.normal(0.0, 8.0, 2),
        torque=rng.normal(0.0, 1.0, 2),
        theta=rng.uniform(-np.pi, np.pi, 2),
        omega=rng.normal(0.0, 1.0, 2) * (rng.random() < 0.7),
    )


def ours(machine, case: PeerCase):
    start = initial_state(machine, case.theta, case.omega, case.volts)
    return simulate(machine, start, case.volts, case.force, case.torque)


class Peer:
    """MuJoCo half a drift ahead of our pose, and its own slips.

    Attributes
    ----------
    rates
        Angular velocities of A and B − A [rad/s].
    """

    def __init__(self, arm: ArmNumbers, machine: Machine, theta: ArrayLike, omega: ArrayLike):
        self.model = build(arm, machine.substep)
        self.data = mujoco.MjData(self.model)
        self.step, self.threshold = machine.substep, machine.slip_threshold
        self.pose, self.rates = to_joints(theta), to_joints(omega)
        self.drift(0.5 * self.step)

    @property
    def slip(self) -> np.ndarray:
        return RATIOS @ self.rates

    @property
    def theta(self) -> np.ndarray:
        """Our pose: half a drift ago."""
        return to_links(self.pose - 0.5 * self.step * self.rates)

    def drift(self, time: float) -> None:
        self.pose = self.pose + time * self.rates

    def rates_after(
        self, time: float, load: tuple, losses: np.ndarray, sliding: np.ndarray
    ) -> np.ndarray:
        """Return the rates after a step, with losses and with torques of clutches that slide
        whatever happens."""
        model, data = self.model, self.data
        model.opt.timestep = time
        model.tendon_solref_fri[:, 1] = -0.9999 / time
        model.tendon_frictionloss[:] = np.maximum(losses, 1e-300)
        data.qpos[:], data.qvel[:] = self.pose, self.rates
        data.ctrl[:], data.qfrc_applied[:] = load[0], to_joint_torque(load[1]) + RATIOS.T @ sliding
        mujoco.mj_step(model, data)
        return data.qvel.copy()

    def advance(self, load: tuple, breakaway: np.ndarray, dynamic: np.ndarray) -> None:
        """Take a step under a force on the tip and torques on the links, in parts where clutches
        change."""
        left = self.step
        for part in range(PARTS):
            held = np.maximum(breakaway, dynamic)
            slides = np.abs(self.slip) >= self.threshold - NEAR
            losses = np.where(slides, dynamic, held)
            after = self.rates_after(left, load, losses, np.zeros(4))
            share = self.share_before_change(after, left, load, slides, losses, held > dynamic)
            if part == PARTS - 1 or share >= 1.0 - 1e-6:
                break
            self.rates = self.rates_after(share * left, load, losses, np.zeros(4))
            left -= share * left
        self.rates = after
        self.drift(self.step)

    def share_before_change(
        self, after, time: float, load: tuple, slides, losses, holds_more
    ) -> float:
        """Return the share of a step after which a slip passes zero or leaves a band in which more
        is held, or 1.

        Up to then, clutches that slide go on sliding, so all slips change evenly.
        """
        before, end = self.slip, RATIOS @ after
        end = np.where(np.abs(end) < NEAR, 0.0, end)
        passes = slides & (before * end <= 0.0)
        leaves = ~slides & (np.abs(end) >= self.threshold) & holds_more
        if passes.any():
            still_slide = np.where(passes, -np.sign(before) * losses, 0.0)
            end = RATIOS @ self.rates_after(time, load, np.where(passes, 0.0, losses), still_slide)
        passes &= before * end < 0.0
        leaves &= np.abs(end) > EDGE * self.threshold
        to_pass = before[passes] / (before - end)[passes]
        to_leave = (np.copysign(EDGE * self.threshold, end) - before)[leaves] / (end - before)[
            leaves
        ]
        return min([1.0, *to_pass, *to_leave])


def peers(machine: Machine, case: PeerCase) -> np.ndarray:
    """Angles (T, 2) at the ends of our substeps."""
    breakaway = np.array([machine.clutch.breakaway.torque(v) for v in case.volts])
    dynamic = np.array([machine.clutch.dynamic.torque(v) for v in case.volts])
    peer = Peer(ARM, machine, case.theta, case.omega)
    angles = np.empty((STEPS, 2))
    for k, force in enumerate(case.force):
        peer.advance((force, case.torque), breakaway, dynamic)
        angles[k] = peer.theta
    return angles


def test_acceleration_is_that_of_the_closed_form():
    """Without friction, over random states, forces and torques: M θ̈ = JᵀF + τ − V, relative to the
    largest."""
    model = build(ARM, STEP)
    data = mujoco.MjData(model)
    rng = np.random.default_rng(3)
    for _ in range(500):
        theta, omega = rng.uniform(-np.pi, np.pi, 2), rng.normal(0.0, 3.0, 2)
        force, torque = rng.normal(0.0, 50.0, 2), rng.normal(0.0, 10.0, 2)
        data.qpos[:], data.qvel[:] = to_joints(theta), to_joints(omega)
        data.ctrl[:], data.qfrc_applied[:] = force, to_joint_torque(torque)
        mujoco.mj_forward(model, data)
        expected = closed_form(theta, omega, force, torque)
        assert np.allclose(
            to_links(data.qacc), expected, rtol=0.0, atol=1e-12 * np.abs(expected).max()
        )


def closed_form(theta, omega, force, torque) -> np.ndarray:
    (a, b), cos, sin = theta, np.cos(theta[0] - theta[1]), np.sin(theta[0] - theta[1])
    mass = np.array([[ARM.inertia_a, ARM.coupling * cos], [ARM.coupling * cos, ARM.inertia_b]])
    velocity_terms = ARM.coupling * sin * np.array([omega[1] ** 2, -(omega[0] ** 2)])
    jacobian = np.array(
        [
            [-ARM.length_a * np.sin(a), -ARM.length_b * np.sin(b)],
            [ARM.length_a * np.cos(a), ARM.length_b * np.cos(b)],
        ]
    )
    return np.linalg.solve(mass, jacobian.T @ force + torque - velocity_terms)


def test_one_free_step_of_ours_has_the_same_acceleration():
    """(ω⁺ − ω) / h of one substep with released clutches is that of its middle; the difference
    costs u·|ω|/h.

    Where no slip changes its sign, for there a substep has parts.
    """
    rng = np.random.default_rng(4)
    compared = 0
    for _ in range(200):
        theta, omega = rng.uniform(-np.pi, np.pi, 2), rng.normal(0.0, 3.0, 2)
        force, torque = rng.normal(0.0, 50.0, 2), rng.normal(0.0, 10.0, 2)
        released = np.zeros(4)
        step = simulate(
            BASELINE, initial_state(BASELINE, theta, omega), released, force, torque, duration=STEP
        )
        if np.any((RATIOS @ to_joints(omega)) * step.slip_velocity[0] <= 0.0):
            continue
        compared += 1
        expected = closed_form(theta + 0.5 * STEP * omega, omega, force, torque)
        scale = 1e-12 * np.abs(expected).max() + 8.0 * 2.0**-53 * np.abs(step.omega[0]).max() / STEP
        assert np.allclose((step.omega[0] - omega) / STEP, expected, rtol=0.0, atol=scale)
    assert compared > 150


@pytest.mark.slow
@pytest.mark.parametrize("machine", MATERIALS.values(), ids=MATERIALS)
@pytest.mark.parametrize("seeds", FEW_AND_MORE, ids=["few", "more"])
@pytest.mark.parametrize("subset", range(16))
def test_poses_are_those_of_mujoco(subset, machine, seeds):
    for seed in seeds:
        case = draw(subset, seed)
        assert np.abs(ours(machine, case).theta - peers(machine, case)).max() <= TOLERANCE


def test_cases_cover_every_mode_often():
    modes = np.concatenate([ours(BASELINE, draw(subset, 0)).mode for subset in range(16)])
    assert np.all(np.bincount(modes, minlength=6) > 0.03 * len(modes))


VOLTS = np.array(
    [
        [21.5, 3, 0, 5],
        [2, 21.5, 9, 0],
        [0, 0, 0, 0],
        [9, 0, 22, 4],
        [5, 0, 2, 22],
        [24, 24, 24, 24],
        [19, 19.5, 0, 8],
    ]
)
"""Held voltages of seven worlds, exact in float32: the paper's modes occur, except a stuck clutch 1
alone."""

MACHINES = (
    BASELINE,
    EQUAL,
    DELRIN_EXPERIMENTAL,
    DELRIN_THEORETICAL,
    replace(BASELINE, clutch=replace(BASELINE.clutch, time_constant=0.02)),
    replace(BASELINE, clutch=replace(BASELINE.clutch, time_constant=0.2)),
    replace(BASELINE, hand=Hand(mass=0.7)),
)

TASKS = tuple(
    PathFollowing(
        hand=MultiSineHand(
            push=push,
            phases=(0.1 * world, 0.2, 0.4, 0.8 * world, 1.6),
            amplitudes=(9.0, 22.0, 15.0, 8.0, 3.0),
        )
    )
    for world, push in enumerate((40.0, 30.0, 15.0, 50.0, 35.0, 45.0, 35.0))
)


@dataclass(frozen=True)
class Flight:
    """A world at the control instants: telemetry (T, columns) and angular velocities (T, 2)."""

    rows: np.ndarray
    omega: np.ndarray


@pytest.fixture(scope="module")
def told() -> list[Flight]:
    """Seven machines, voltages and hands in one batch.

    From rest with released clutches, so their torques rise with their lag.
    """
    batch = Batch(MACHINES, TASKS)
    telemetry = [batch.reset(list(range(len(MACHINES))))[1]]
    omega = [velocities(batch)]
    for _ in range(60):
        telemetry.append(batch.step(VOLTS, SKIP).telemetry[0])
        omega.append(velocities(batch))
    lengths = np.isfinite(np.array(telemetry)[:, :, 0]).sum(axis=0)
    assert lengths.min() >= 20
    worlds = [
        Flight(np.array(telemetry)[:n, k], np.array(omega)[:n, k]) for k, n in enumerate(lengths)
    ]
    assert {0, 2, 3, 4, 5} <= {mode for world in worlds for mode in world.rows[1:, COLUMN.mode]}
    return worlds


def velocities(batch: Batch) -> np.ndarray:
    """Angular velocities (worlds, 2)."""
    return batch.get_state()["worlds"][
        0, [ROW.motion.omega_a, ROW.motion.omega_b], : len(MACHINES)
    ].T


@pytest.mark.parametrize("world", range(len(MACHINES)))
def test_batch_moves_as_mujoco_does(world, told):
    """Whole control steps; MuJoCo gets the hand's force alone."""
    theta = told[world].rows[:, [*COLUMN.theta]]
    assert np.abs(theta - batch_peers(world, theta[0], len(theta) - 1)).max() <= TOLERANCE


@pytest.mark.parametrize("world", range(len(MACHINES)))
def test_batch_reports_the_torques_of_the_instant(world, told):
    """Clutches that slip exert their limit, stuck ones together what MuJoCo needs for them to have
    no acceleration."""
    model = build(numbers_with_hand(MACHINES[world]), STEP)
    data = mujoco.MjData(model)
    for rows, omega in zip(told[world].rows[1:], told[world].omega[1:], strict=True):
        torque = rows[[*COLUMN.torque]]
        breakaway, dynamic = limits(world, rows[COLUMN.time])
        data.qpos[:], data.qvel[:] = to_joints(rows[[*COLUMN.theta]]), to_joints(omega)
        slip = RATIOS @ data.qvel
        limit = np.where(
            np.abs(slip) >= MACHINES[world].slip_threshold, dynamic, np.maximum(breakaway, dynamic)
        )
        sliding = -np.sign(slip) * limit
        model.tendon_frictionloss[:] = np.where(slip == 0.0, limit, 1e-300)
        data.ctrl[:], data.qfrc_applied[:] = (
            hands_force(world, rows[COLUMN.time]),
            RATIOS.T @ sliding,
        )
        mujoco.mj_forward(model, data)
        scale = max(1.0, *limit)
        assert np.allclose(torque[slip != 0.0], sliding[slip != 0.0], rtol=0.0, atol=1e-12 * scale)
        stuck = data.qfrc_constraint + data.qfrc_applied
        assert np.allclose(RATIOS.T @ torque, stuck, rtol=0.0, atol=1e-10 * scale)


def numbers_with_hand(machine: Machine) -> ArmNumbers:
    a, b, mass = machine.arm.length_a, machine.arm.length_b, machine.hand.mass
    return ArmNumbers(
        a,
        b,
        machine.arm.inertia_a + mass * a * a,
        machine.arm.inertia_b + mass * b * b,
        machine.arm.coupling + mass * a * b,
    )


def hands_force(world: int, time: float) -> np.ndarray:
    """Force on the tip [N] of a world, whose path is straight."""
    task = TASKS[world]
    heading = task.path.heading(0.0)
    turn = np.array(
        [[math.cos(heading), -math.sin(heading)], [math.sin(heading), math.cos(heading)]]
    )
    return turn @ [task.hand.push, task.hand.normal_force(time)]


def limits(world: int, time: float) -> tuple[np.ndarray, np.ndarray]:
    """Breakaway and dynamic torques of a world [N·m], which have risen since the start."""
    clutch = MACHINES[world].clutch
    risen = -math.expm1(-time / clutch.time_constant)
    return tuple(
        risen * np.array([curve.torque(v) for v in VOLTS[world]])
        for curve in (clutch.breakaway, clutch.dynamic)
    )


def batch_peers(world: int, start: np.ndarray, steps: int) -> np.ndarray:
    """Angles (steps + 1, 2) of one world in MuJoCo, at the ends of its control steps."""
    machine = MACHINES[world]
    peer = Peer(numbers_with_hand(machine), machine, start, (0.0, 0.0))
    angles = [start]
    count = round(TASKS[world].control_period / STEP)
    for k in range(steps * count):
        middle = (k + 0.5) * STEP
        peer.advance((hands_force(world, middle), np.zeros(2)), *limits(world, middle))
        if (k + 1) % count == 0:
            angles.append(peer.theta)
    return np.array(angles)
