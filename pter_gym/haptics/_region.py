"""The forces that the clutches can make at the handle, in closed form.

Clutches only resist, so which forces a passive device can display depends on how it moves.

With torques τ of the clutches, the force on the hand is F = J⁻ᵀ·Wᵀτ, and the clutches slip at
W·J⁻¹·v, where v is the velocity of the tip: one matrix and its transpose. Each torque is within an
interval, so the forces fill a zonotope, a sum of segments. Friction of the axes, inertia and the
lag of the clutches are left out.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pter_gym.params import Arm, Clutch, Machine

Array = NDArray[np.float64]

AT_REST = (0.0, 0.0)


def link_angles(arm: Arm, tip: ArrayLike) -> Array:
    """Return the angles (θA, θB) [rad], (…, 2), at tip positions (…, 2) [m]; θB leads, NaN where out of reach."""
    x, y = np.moveaxis(np.asarray(tip, np.float64), -1, 0)
    cos = (x * x + y * y - arm.length_a**2 - arm.length_b**2) / (2.0 * arm.length_a * arm.length_b)
    elbow = np.arccos(np.where(np.abs(cos) <= 1.0, cos, np.nan))
    theta_a = np.arctan2(y, x) - np.arctan2(
        arm.length_b * np.sin(elbow), arm.length_a + arm.length_b * np.cos(elbow)
    )
    return np.stack([theta_a, theta_a + elbow], axis=-1)


def force_per_torque(machine: Machine, theta: ArrayLike) -> Array:
    """Return W·J⁻¹ [1/m], shape (…, SLOTS, 2): for each clutch, the force on the hand (x, y) of a
    torque of 1 N·m.

    Its product with the velocity of the tip [m/s] is the slip velocity [rad/s]. Not finite at a
    singular pose.

    Parameters
    ----------
    machine, theta
        The machine, and the angles of its links, (…, 2) [rad].
    """
    angles = np.asarray(theta, np.float64)
    links = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        height = 1.0 / np.sin(angles[..., 1] - angles[..., 0])[..., None]
        of_a = (
            links[..., 1, :] * height / machine.arm.length_a
        )  # a torque on link A pushes along link B
        of_b = -links[..., 0, :] * height / machine.arm.length_b
        return np.stack([a * of_a + b * of_b for a, b in machine.slot_rows], axis=-2)


class _Limits(NamedTuple):
    """Breakaway and dynamic torque of a clutch at a voltage [N·m]."""

    breakaway: float
    dynamic: float

    @classmethod
    def at(cls, clutch: Clutch, volts: float) -> "_Limits":
        return cls(clutch.breakaway.torque(volts), clutch.dynamic.torque(volts))


def torque_limits(machine: Machine, slip: ArrayLike) -> tuple[Array, Array]:
    """Return the least and the largest steady torque [N·m] of the clutches over all voltages, (…,
    SLOTS) each.

    A clutch that slips makes at least its torque of 0 V and at most that of the largest voltage, at
    the present speed, against the slip. One that sticks makes any torque up to the one that it can
    hold, in either direction.

    Parameters
    ----------
    machine, slip
        The machine, and the slip velocities of its clutches, (…, SLOTS) [rad/s].
    """
    clutch, scale = machine.clutch, np.array(machine.slot_scale)
    speed, square = np.abs(slip), clutch.stribeck**2
    falls = square / (square + np.maximum(speed, machine.slip_threshold) ** 2)
    least, most = (
        curve.dynamic + falls * (curve.breakaway - curve.dynamic) + clutch.viscous * speed
        for curve in (_Limits.at(clutch, 0.0), _Limits.at(clutch, clutch.voltage_max))
    )
    held = max(_Limits.at(clutch, clutch.voltage_max))
    sticks = speed < machine.slip_threshold
    return np.where(sticks, -held, least) * scale, np.where(sticks, held, most) * scale


def force_region(machine: Machine, theta: ArrayLike, tip_velocity: ArrayLike = AT_REST) -> Array:
    """Return the corners [N] of the polygon of displayable forces, anticlockwise, shape (…,
    2·SLOTS, 2).

    Corners coincide where clutches are absent or push along the same line.

    Parameters
    ----------
    machine
        The machine.
    theta, tip_velocity
        The angles of its links [rad] and the velocity of the tip (x, y) [m/s], (…, 2) each; at rest
        by default.
    """
    per_torque = force_per_torque(machine, theta)
    slip = (per_torque * np.asarray(tip_velocity, np.float64)[..., None, :]).sum(axis=-1)
    least, largest = torque_limits(machine, slip)
    against = np.where(slip > 0.0, -1.0, 1.0)[..., None] * per_torque
    middle = (0.5 * (least + largest)[..., None] * against).sum(axis=-2)
    half = 0.5 * (largest - least)[..., None] * against
    upwards = np.where(
        (half[..., 1:] < 0.0) | ((half[..., 1:] == 0.0) & (half[..., :1] < 0.0)), -half, half
    )
    order = np.argsort(np.arctan2(upwards[..., 1], upwards[..., 0]), axis=-1)
    edges = 2.0 * np.take_along_axis(upwards, order[..., None], axis=-2)
    up = (middle - upwards.sum(axis=-2))[..., None, :] + np.cumsum(edges, axis=-2)
    return np.concatenate([up, 2.0 * middle[..., None, :] - up], axis=-2)


class ForceRange(NamedTuple):
    """The largest forces [N] of a polygon in three directions relative to the tip's velocity, an array (…) each."""

    resisting: Array
    left: Array
    right: Array

    @property
    def steering(self) -> Array:
        """The largest force [N] that is available to both sides: that of the weaker side."""
        return np.minimum(self.left, self.right)


def force_range(machine: Machine, theta: ArrayLike, tip_velocity: ArrayLike) -> ForceRange:
    """Return the largest force against the velocity of the tip and the largest ones normal to it.

    Each is the largest component, whatever the other one is. Arguments are those of
    ``force_region``; the tip moves.
    """
    velocity = np.asarray(tip_velocity, np.float64)
    x, y = np.moveaxis(velocity / np.linalg.norm(velocity, axis=-1, keepdims=True), -1, 0)
    forces = force_region(machine, theta, velocity)
    along = forces[..., 0] * x[..., None] + forces[..., 1] * y[..., None]
    across = forces[..., 1] * x[..., None] - forces[..., 0] * y[..., None]
    return ForceRange(-along.min(axis=-1), across.max(axis=-1), -across.min(axis=-1))


class ForceExtremes(NamedTuple):
    """The smallest and the largest of ``ForceRange`` over all directions of motion [N], an array (…) each."""

    least_resisting: Array
    largest_resisting: Array
    least_steering: Array
    largest_steering: Array


def force_extremes(
    machine: Machine, theta: ArrayLike, *, speed: float = 0.25, directions: int = 360
) -> ForceExtremes:
    """Return the extremes of ``force_range`` over equally spaced directions, and those in which a
    clutch sticks.

    The smallest steering force is the one to the side that has less, in the worst direction.

    Parameters
    ----------
    machine, theta
        The machine, and the angles of its links, (…, 2) [rad].
    speed, directions
        Speed of the tip [m/s], and the number of equally spaced directions.
    """
    angles = np.asarray(theta, np.float64)[..., None, :]
    x, y = np.moveaxis(force_per_torque(machine, angles[..., 0, :]), -1, 0)
    stuck = np.arctan2(x, -y)
    even = 2.0 * np.pi * (np.arange(directions) + 0.5) / directions
    at = np.concatenate(
        [np.broadcast_to(even, (*stuck.shape[:-1], directions)), stuck, stuck + np.pi], axis=-1
    )
    found = force_range(machine, angles, speed * np.stack([np.cos(at), np.sin(at)], axis=-1))
    either = np.maximum(found.left, found.right)
    return ForceExtremes(
        found.resisting.min(axis=-1),
        found.resisting.max(axis=-1),
        found.steering.min(axis=-1),
        either.max(axis=-1),
    )
