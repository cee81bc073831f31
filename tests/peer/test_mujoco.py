"""MuJoCo on the same mechanism, step by step: its own kinematics, dynamics and friction solver against ours.

Loads are a hand force of four random sines and a constant, about as large as the clutches can hold, and a small joint
torque; poses, velocities and voltages are random. In both, the force acts on the tip and is sampled at each step's
start.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import mujoco
import numpy as np
import pytest
from mujoco import rollout
from numpy.typing import ArrayLike, NDArray

from pter_gym._engine.batch import Batch
from pter_gym._engine.world import SKIP
from pter_gym._physics.open_loop import initial_state, simulate
from pter_gym.hands import MultiSineHand
from pter_gym.params import BASELINE, DELRIN_EXPERIMENTAL, DELRIN_THEORETICAL, Clutch, Hand
from pter_gym.tasks.path_following import TELEMETRY, PathFollowing
from pter_gym.tools.speed.mujoco_arm import RATIOS, ArmNumbers, build

STEPS = 2000
SEEDS = range(20)
FEW_AND_MORE = [SEEDS[:5], pytest.param(SEEDS[5:], marks=pytest.mark.long)]
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
class Case:
    """Voltages (4,), hand force (T, 2), joint torque (2,), angles and velocities at the start (2,)."""

    volts: np.ndarray
    force: np.ndarray
    torque: np.ndarray
    theta: np.ndarray
    omega: np.ndarray


def draw(subset: int, seed: int) -> Case:
    """Clutch x is engaged if bit x of the subset is set."""
    rng = np.random.default_rng([seed, subset])
    engaged = np.array([(subset >> x) & 1 for x in range(4)])
    time = STEP * np.arange(STEPS)[:, None]
    waves = rng.normal(0.0, 12.0, (4, 2)), rng.uniform(0.3, 3.0, 4), rng.uniform(0.0, 2.0 * np.pi, 4)
    force = sum(size * np.sin(2.0 * np.pi * rate * time + phase) for size, rate, phase in zip(*waves, strict=True))
    return Case(
        volts=engaged * rng.uniform(4.0, 14.0, 4),
        force=force + rng.normal(0.0, 8.0, 2),
        torque=rng.normal(0.0, 1.0, 2),
        theta=rng.uniform(-np.pi, np.pi, 2),
        omega=rng.normal(0.0, 1.0, 2) * (rng.random() < 0.7),
    )


def ours(machine, case: Case):
    start = initial_state(machine, case.theta, case.omega, case.volts)
    return simulate(machine, start, case.volts, case.force, case.torque)


def at_start(model: mujoco.MjModel, case: Case) -> mujoco.MjData:
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = to_joints(case.theta), to_joints(case.omega)
    return data


def roll(machine, case: Case) -> np.ndarray:
    """Angles (T, 2) with the dynamic torques as constant friction losses, all steps in one call."""
    model = build(ARM, STEP, [machine.clutch.dynamic.torque(v) for v in case.volts])
    data = at_start(model, case)
    state = np.empty(mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS))
    mujoco.mj_getState(model, data, state, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    inputs = np.hstack([case.force, np.broadcast_to(to_joint_torque(case.torque), (STEPS, 2))])
    spec = int(mujoco.mjtState.mjSTATE_CTRL | mujoco.mjtState.mjSTATE_QFRC_APPLIED)
    states, _ = rollout.rollout(model, data, state, inputs[None], control_spec=spec)
    return to_links(states[0, :, 1:3])


def karnopp(case: Case, threshold: float) -> np.ndarray:
    """Angles (T, 2), each loss switched every step by MuJoCo's own slip, and the crossing rule replayed."""
    model = build(ARM, STEP)
    data = at_start(model, case)
    data.qfrc_applied[:] = to_joint_torque(case.torque)
    breakaway = np.array([BASELINE.clutch.breakaway.torque(v) for v in case.volts])
    dynamic = np.array([BASELINE.clutch.dynamic.torque(v) for v in case.volts])
    angles = np.empty((STEPS, 2))
    for k, force in enumerate(case.force):
        karnopp_step(model, data, force, breakaway, dynamic, threshold)
        angles[k] = data.qpos
    return to_links(angles)


def karnopp_step(model, data, force, breakaway, dynamic, threshold: float) -> None:
    """One step of MuJoCo with the losses that its own slip asks for; again from its start if a slip crossed zero."""
    data.ctrl[:] = force
    start = data.qpos.copy(), data.qvel.copy()
    slip = RATIOS @ start[1]
    moving = np.abs(slip) >= threshold
    model.tendon_frictionloss[:] = np.where(moving, dynamic, np.maximum(breakaway, dynamic))
    mujoco.mj_step(model, data)
    crossed = moving & (slip * (RATIOS @ data.qvel) < 0.0)
    if crossed.any():
        data.qpos[:], data.qvel[:] = start
        model.tendon_frictionloss[crossed] = np.maximum(breakaway, dynamic)[crossed]
        mujoco.mj_step(model, data)


def test_acceleration_is_that_of_the_closed_form():
    """Without friction, over random states, forces and torques: M θ̈ = JᵀF + τ − V, relative to the largest."""
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
        assert np.allclose(to_links(data.qacc), expected, rtol=0.0, atol=1e-12 * np.abs(expected).max())


def closed_form(theta, omega, force, torque) -> np.ndarray:
    (a, b), cos, sin = theta, np.cos(theta[0] - theta[1]), np.sin(theta[0] - theta[1])
    mass = np.array([[ARM.inertia_a, ARM.coupling * cos], [ARM.coupling * cos, ARM.inertia_b]])
    velocity_terms = ARM.coupling * sin * np.array([omega[1] ** 2, -(omega[0] ** 2)])
    jacobian = np.array(
        [[-ARM.length_a * np.sin(a), -ARM.length_b * np.sin(b)], [ARM.length_a * np.cos(a), ARM.length_b * np.cos(b)]]
    )
    return np.linalg.solve(mass, jacobian.T @ force + torque - velocity_terms)


def test_one_free_step_of_ours_has_the_same_acceleration():
    """(ω⁺ − ω) / h of one substep with released clutches; the difference of velocities costs u·|ω|/h."""
    rng = np.random.default_rng(4)
    for _ in range(200):
        theta, omega = rng.uniform(-np.pi, np.pi, 2), rng.normal(0.0, 3.0, 2)
        force, torque = rng.normal(0.0, 50.0, 2), rng.normal(0.0, 10.0, 2)
        released = np.zeros(4)
        step = simulate(BASELINE, initial_state(BASELINE, theta, omega), released, force, torque, duration=STEP)
        expected = closed_form(theta, omega, force, torque)
        scale = 1e-12 * np.abs(expected).max() + 8.0 * 2.0**-53 * np.abs(step.omega[0]).max() / STEP
        assert np.allclose((step.omega[0] - omega) / STEP, expected, rtol=0.0, atol=scale)


@pytest.mark.slow
@pytest.mark.parametrize("machine", [EQUAL, DELRIN_THEORETICAL], ids=["equal", "dynamic above breakaway"])
@pytest.mark.parametrize("seeds", FEW_AND_MORE, ids=["few", "more"])
@pytest.mark.parametrize("subset", range(16))
def test_one_torque_for_stick_and_slip(subset, machine, seeds):
    """T_s = T_k; and T_s < T_k, where the breakaway torque is unobservable."""
    for seed in seeds:
        case = draw(subset, seed)
        assert np.abs(ours(machine, case).theta - roll(machine, case)).max() <= 1e-8


@pytest.mark.slow
@pytest.mark.parametrize("seeds", FEW_AND_MORE, ids=["few", "more"])
@pytest.mark.parametrize("subset", range(16))
def test_breakaway_above_dynamic(subset, seeds):
    for seed in seeds:
        case = draw(subset, seed)
        assert np.abs(ours(BASELINE, case).theta - karnopp(case, BASELINE.slip_threshold)).max() <= 1e-8


def test_the_cases_visit_every_mode_often():
    modes = np.concatenate([ours(BASELINE, draw(subset, 0)).mode for subset in range(16)])
    assert np.all(np.bincount(modes, minlength=6) > 0.03 * len(modes))


VOLTS = np.array(
    [[21.5, 3, 0, 5], [2, 21.5, 9, 0], [0, 0, 0, 0], [9, 0, 22, 4], [5, 0, 2, 22], [24, 24, 24, 24], [19, 19.5, 0, 8]]
)
"""Held voltages of seven worlds, exact in float32: the paper's modes occur, except a stuck clutch 1 alone."""

MACHINES = (
    BASELINE,
    EQUAL,
    DELRIN_EXPERIMENTAL,
    DELRIN_THEORETICAL,
    replace(BASELINE, clutch=replace(BASELINE.clutch, time_constant=0.02)),
    replace(BASELINE, clutch=replace(BASELINE.clutch, time_constant=0.2)),
    replace(BASELINE, hand=Hand(mass=0.7)),
)

THETA = TELEMETRY.index("theta_a")

TASKS = tuple(
    PathFollowing(
        hand=MultiSineHand(
            push=push, phases=(0.1 * world, 0.2, 0.4, 0.8 * world, 1.6), amplitudes=(9.0, 22.0, 15.0, 8.0, 3.0)
        )
    )
    for world, push in enumerate((40.0, 30.0, 15.0, 50.0, 35.0, 45.0, 35.0))
)


def test_batch_moves_as_mujoco_does():
    """Whole control steps of seven machines, voltages and hands in one batch; MuJoCo gets the hand's force alone.

    From rest with released clutches, so their torques rise with their lag. The tolerance is that of the single
    runs above: both solve each step to rounding, which stick-slip carries on.
    """
    batch = Batch(MACHINES, TASKS)
    _, first = batch.reset(list(range(len(MACHINES))))
    steps = [batch.step(VOLTS, SKIP).telemetry[0] for _ in range(60)]
    telemetry = np.stack([first, *steps], axis=1)
    for world in range(len(MACHINES)):
        rows = telemetry[world][np.isfinite(telemetry[world, :, 0])]
        mine = rows[:, THETA : THETA + 2]
        assert len(mine) >= 20
        assert np.abs(mine - batch_peer(world, mine[0], len(mine) - 1)).max() <= 1e-8
    modes = telemetry[:, 1:, TELEMETRY.index("mode")]
    assert {0, 2, 3, 4, 5} <= set(modes[np.isfinite(modes)])


def batch_peer(world: int, start: np.ndarray, steps: int) -> np.ndarray:
    """Angles (steps + 1, 2) of one world in MuJoCo, at the ends of its control steps."""
    machine, task = MACHINES[world], TASKS[world]
    a, b = machine.arm.length_a, machine.arm.length_b
    mass = machine.hand.mass
    arm = ArmNumbers(
        a,
        b,
        machine.arm.inertia_a + mass * a * a,
        machine.arm.inertia_b + mass * b * b,
        machine.arm.coupling + mass * a * b,
    )
    heading = task.path.heading(0.0)
    turn = np.array([[math.cos(heading), -math.sin(heading)], [math.sin(heading), math.cos(heading)]])
    breakaway = np.array([machine.clutch.breakaway.torque(v) for v in VOLTS[world]])
    dynamic = np.array([machine.clutch.dynamic.torque(v) for v in VOLTS[world]])
    model = build(arm, STEP)
    data = mujoco.MjData(model)
    data.qpos[:] = to_joints(start)
    angles = [start]
    count = round(task.control_period / STEP)
    for k in range(steps * count):
        force = turn @ [task.hand.push, task.hand.normal_force(k * STEP)]
        risen = -math.expm1(-(k + 1) * STEP / machine.clutch.time_constant)
        karnopp_step(model, data, force, risen * breakaway, risen * dynamic, machine.slip_threshold)
        if (k + 1) % count == 0:
            angles.append(to_links(data.qpos))
    return np.array(angles)
