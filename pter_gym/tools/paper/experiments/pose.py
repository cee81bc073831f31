"""Pose and resolution of the single-clutch tests, and plain Python wrappers of the arm's equations."""

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pter_gym._physics import arm, friction
from pter_gym._physics.model import model_of
from pter_gym.params import Machine

Array = NDArray[np.float64]

POSE = (0.5, 2.0)
"""Angles of the links [rad]: tip in front of the drive, elbow near a right angle."""

RESOLUTION = 1e-3
"""Longest substep of the single-clutch tests [s]: they record a torque once per substep."""


def resolved(machine: Machine, longest: float = RESOLUTION) -> Machine:
    """Return a machine whose substep is at most a given length [s]."""
    return replace(machine, substep=min(machine.substep, longest))


def linkage(machine: Machine) -> arm.Linkage:
    """Return the constants of a machine's arm as the equations take them."""
    return model_of(machine).arm


def motion(theta: ArrayLike, omega: ArrayLike = (0.0, 0.0)) -> arm.Motion:
    """Return angles [rad] and angular velocities [rad/s], shape (2,), as the equations take them."""
    (a, b), (omega_a, omega_b) = np.asarray(theta, float), np.asarray(omega, float)
    return arm.Motion(a, b, omega_a, omega_b, np.cos(a), np.sin(a), np.cos(b), np.sin(b))


def slip_rows() -> Array:
    """Return W, shape (4, 2): slip velocities of the clutches from the links' angular velocities."""
    return np.array(friction.COUPLING)


def tip(machine: Machine, theta: ArrayLike) -> Array:
    """Return the tip position [m], shape (2,), at angles [rad]."""
    return np.array(arm.tip_position(linkage(machine), motion(theta)))


def tip_force(machine: Machine, theta: ArrayLike, joint_torque: ArrayLike) -> Array:
    """Return the tip force [N], shape (2,), that loads the links with given torques [N·m] at angles [rad]."""
    at = linkage(machine), motion(theta)
    columns = [arm.joint_torque(*at, 1.0, 0.0), arm.joint_torque(*at, 0.0, 1.0)]
    return np.linalg.solve(np.array(columns).T, np.asarray(joint_torque, float))
