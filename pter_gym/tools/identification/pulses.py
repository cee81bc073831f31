# pyright: standard
"""Clutch pulses that make a hand's mass, damper and spring visible, and what a pulse does to it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pter_gym.errors import ParameterError
from pter_gym.params import Machine

Array = NDArray[np.float64]

SHORTEST, LONGEST = 0.04, 0.15
"""Duration of a pulse, or of a pause between two [s]."""

MIDDLE, AROUND = (0.72, 2.17), 0.35
"""Angles of the links in the middle of the motion [rad], and how far they go from there."""

SMOOTH_SLIP = 0.15
"""Slip velocity over which friction changes its sign in predictions [rad/s]."""

STEP = 5e-3
"""Longest step of a prediction [s]."""


def pulses(
    machine: Machine, middle: Array, seconds: float, interval: float, force: float, seed: int
) -> Array:
    """Return random voltages [V], (rows, 4), of one clutch or none at a time.

    Each differs from the one before, and is otherwise independent of all that went before, as the
    estimate requires.

    Parameters
    ----------
    machine
        The machine.
    middle
        Angles of the links in the middle of the motion [rad], shape (2,).
    seconds, interval
        Duration, and time between rows [s].
    force
        Force of each clutch on the tip, in that pose [N].
    seed
        Of the pulses.

    Raises
    ------
    ParameterError
        If the force is not positive.
    """
    if not force > 0.0:
        raise ParameterError(f"force must be > 0 N, got {force!r}")
    rng, levels = np.random.default_rng(seed), np.zeros((len(machine.clutches) + 1, 4))
    levers = np.linalg.norm(tip_forces(machine, np.asarray(middle)[None])[0], axis=1)
    for k in range(len(machine.clutches)):
        volts = machine.clutch.dynamic.voltage(force / levers[k] / machine.slot_scale[k])
        levels[k + 1, k] = min(volts, machine.clutch.voltage_max)
    rows, chosen, begin = np.empty(round(seconds / interval), np.int64), 0, 0
    while begin < len(rows):
        end = begin + max(1, round(rng.uniform(SHORTEST, LONGEST) / interval))
        chosen = rows[begin:end] = (chosen + rng.integers(1, len(levels))) % len(levels)
        begin = end
    return levels[rows]


def forces_around(machine: Machine) -> float:
    """Return the largest force of a pulse anywhere in the motion over that in its middle."""
    turns = AROUND * np.linspace(-1.0, 1.0, 5)
    poses = np.array([(MIDDLE[0] + a, MIDDLE[1] + b) for a in turns for b in turns])
    levers = np.linalg.norm(tip_forces(machine, poses), axis=2)
    middle = np.linalg.norm(tip_forces(machine, np.array([MIDDLE]))[0], axis=1)
    curves = machine.clutch.breakaway, machine.clutch.dynamic
    held, slips = (curve.torque(machine.clutch.voltage_max) for curve in curves)
    return float((levers / middle).max()) * max(held / slips, 1.0)


def joint_speeds(machine: Machine, theta: Array) -> Array:
    """Return J⁻¹ at angles (N, 2) [rad], shape (N, 2, 2)."""
    lengths = np.array([machine.arm.length_a, machine.arm.length_b])
    (sine_a, sine_b), (cosine_a, cosine_b) = ((lengths * of(theta)).T for of in (np.sin, np.cos))
    size = sine_b * cosine_a - sine_a * cosine_b
    rows = np.array([[cosine_b, sine_b], [-cosine_a, -sine_a]]) / size
    return rows.transpose(2, 0, 1)


def tip_forces(machine: Machine, theta: Array) -> Array:
    """Return the forces on the tip of 1 N·m in each clutch [N], (N, 4, 2), at angles (N, 2)."""
    return np.array(machine.slot_rows) @ joint_speeds(machine, theta)


def tip_positions(machine: Machine, theta: Array) -> Array:
    """Return the positions of the tip [m] at angles [rad], both of shape (N, 2)."""
    lengths = np.array([machine.arm.length_a, machine.arm.length_b])
    return np.stack([np.cos(theta) @ lengths, np.sin(theta) @ lengths], axis=1)


@dataclass(frozen=True)
class Switches:
    """Switches of voltages: ``rows`` of the log, angles and velocities before them, (N, 2).

    ``held`` are the clutches' torques at these rows, (N, 4); ``after`` those that they tend to from
    then on, (1 + D, N, 4): first what was drawn, then others that could have been; ``lasting`` are
    the times until the next switches [s], (N,).
    """

    rows: NDArray[np.int64]
    theta: Array
    omega: Array
    held: Array
    after: Array
    lasting: Array


def predict(
    machine: Machine, at: Switches, hand: tuple[Array, Array, Array], times: Array
) -> Array:
    """Return how the tip's motion changes by a switch, compared with what could have been drawn.

    Parameters
    ----------
    machine, at
        The machine and its switches.
    hand
        Stiffness, damping and mass of the hand in all directions, (2, 2) each.
    times
        Even times from the switches [s], from 0, shape (T,).

    Returns
    -------
    ndarray
        Position [m], velocity and acceleration, (3, N, T, 2), less their mean over the possible
        torques: so its expectation is zero, whatever the hand does by itself.
    """
    arm, (stiffness, damping, mass) = machine.arm, hand
    joints, forces = joint_speeds(machine, at.theta), tip_forces(machine, at.theta)
    slips = forces.transpose(0, 2, 1)  # slip per tip velocity: the same levers
    inertia = np.empty((len(at.rows), 2, 2))
    inertia[:, 0, 0], inertia[:, 1, 1] = arm.inertia_a, arm.inertia_b
    inertia[:, 0, 1] = inertia[:, 1, 0] = arm.coupling * np.cos(at.theta[:, 0] - at.theta[:, 1])
    compliance = np.linalg.inv(joints.transpose(0, 2, 1) @ inertia @ joints + mass)
    own = at.omega @ np.array(machine.slot_rows).T
    held = at.held * np.tanh(own / SMOOTH_SLIP)
    after = at.after.transpose(1, 0, 2)
    contrast = np.full(len(at.after), -1.0 / (len(at.after) - 1))
    contrast[0] = 1.0
    next_ = after.mean(axis=1, keepdims=True)
    ahead = at.held[:, None] - after
    position = np.zeros((*after.shape[:2], 2))
    velocity, acceleration = np.zeros_like(position), np.zeros_like(position)
    motion = np.zeros((3, len(at.rows), len(times), 2))
    parts = max(1, round((times[1] - times[0]) / STEP))
    step, lag = (times[1] - times[0]) / parts, machine.clutch.time_constant
    for n, time in enumerate(times):
        for k, each in enumerate((position, velocity, acceleration)):
            motion[k, :, n] = contrast @ each
        for part in range(parts):
            passed = max(time + (part + 0.5) * step - machine.delay, 0.0)
            torque = next_ + _fade(passed - at.lasting, lag) * (after - next_)
            torque = torque + np.exp(-passed / lag) * ahead
            slip = own[:, None] + velocity @ slips
            brake = torque * np.tanh(slip / SMOOTH_SLIP)
            load = (held[:, None] - brake) @ forces - position @ stiffness - velocity @ damping
            acceleration = load @ compliance
            velocity = velocity + step * acceleration
            position = position + step * velocity
    return motion


def _fade(since: Array, lag: float) -> Array:
    """Return the share of a torque that is left after its end by so many seconds, (N, 1, 1)."""
    return np.exp(-np.maximum(since, 0.0) / lag)[:, None, None]
