"""The forces that the clutches can exert at the handle, in closed form.

Clutches only resist, so the forces that a passive device can display depend on its motion.

With torques τ of the clutches, the force on the hand is F = J⁻ᵀ·Wᵀτ, and the clutches slip at
W·J⁻¹·v, where v is the velocity of the tip: one matrix and its transpose. Each torque is within an
interval, so the forces fill a zonotope, a sum of segments. Friction of the axes, inertia and the
lag of the clutches are neglected.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pter_gym._physics.arm import Vector, links_at, motion_of, moving
from pter_gym._physics.clutch import PerClutch, falling, holding, sliding
from pter_gym._physics.friction import slip_velocities
from pter_gym._physics.model import model_of, optional_arrangement
from pter_gym.params import SLOTS, Arm, Machine

Array = NDArray[np.float64]

STILL = (0.0, 0.0)


def link_angles(arm: Arm, tip: ArrayLike) -> Array:
    """Return the angles [rad] at tip positions [m], both (…, 2); θB leads, NaN out of reach."""
    links: Any = arm
    at: Any = np.moveaxis(np.asarray(tip, np.float64), -1, 0)
    with np.errstate(invalid="ignore"):
        a, b = links_at(links, *at)
    theta_a = np.arctan2(a.sin, a.cos)
    elbow = np.arctan2(b.sin * a.cos - b.cos * a.sin, b.cos * a.cos + b.sin * a.sin)
    return np.stack([theta_a, theta_a + elbow], axis=-1)


def force_per_torque(machine: Machine, theta: ArrayLike) -> Array:
    """Return W·J⁻¹ [1/m], (…, SLOTS, 2): the force on the hand of 1 N·m of each clutch.

    Its product with the velocity of the tip [m/s] is the slip velocity [rad/s]. Not finite at a
    singular pose.

    Parameters
    ----------
    machine, theta
        The machine, and the angles of its links, (…, 2) [rad].
    """
    arm, q, arrangement = model_of(machine).arm, motion_of(theta), optional_arrangement(machine)
    with np.errstate(divide="ignore", invalid="ignore"):
        moved = [moving(arm, q, Vector(*velocity)) for velocity in ((1.0, 0.0), (0.0, 1.0))]
        slips = [slip_velocities(along.omega_a, along.omega_b, arrangement) for along in moved]
    return np.stack([np.stack(each, axis=-1) for each in slips], axis=-1)


def torque_limits(machine: Machine, slip: ArrayLike) -> tuple[Array, Array]:
    """Return the least and largest steady torques [N·m] over all voltages, (…, SLOTS) each.

    A slipping clutch exerts at least what a fall to 0 V leaves and at most its torque at the
    largest voltage, at the present speed, against the slip. A sticking one exerts any torque up to
    the largest that it can hold, in either direction.

    Parameters
    ----------
    machine, slip
        The machine, and the slip velocities of its clutches, (…, SLOTS) [rad/s].
    """
    clutch, scale = machine.clutch, np.array(machine.slot_scale)
    speed: Any = np.abs(slip)
    part = _falling(machine, speed)
    least = sliding(speed, *clutch.least, part, clutch.viscous)
    most = sliding(speed, *clutch.largest, part, clutch.viscous)
    hold = clutch.largest.breakaway if clutch.band == "printed" else holding(*clutch.largest)
    sticks = speed < machine.slip_threshold
    return np.where(sticks, -hold, least) * scale, np.where(sticks, hold, most) * scale


def _falling(machine: Machine, speed: Array) -> Any:
    """Return what slip velocities (…, SLOTS) [rad/s] leave of breakaway above dynamic torque."""
    square = machine.clutch.stribeck**2
    if square == 0.0:
        return 0.0
    rows = (PerClutch(*row) for row in speed.reshape(-1, SLOTS).tolist())
    parts = np.array([falling(row, machine.slip_threshold, square) for row in rows])
    return parts.reshape(speed.shape)


def force_region(machine: Machine, theta: ArrayLike, tip_velocity: ArrayLike = STILL) -> Array:
    """Return the corners [N] of the polygon of displayable forces, anticlockwise.

    Their shape is (…, 2·SLOTS, 2). Corners coincide where clutches are absent or push along the
    same line.

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
    x, y = half[..., :1], half[..., 1:]
    upwards = np.where((y < 0.0) | ((y == 0.0) & (x < 0.0)), -half, half)
    order = np.argsort(np.arctan2(upwards[..., 1], upwards[..., 0]), axis=-1)
    edges = 2.0 * np.take_along_axis(upwards, order[..., None], axis=-2)
    up = (middle - upwards.sum(axis=-2))[..., None, :] + np.cumsum(edges, axis=-2)
    return np.concatenate([up, 2.0 * middle[..., None, :] - up], axis=-2)


class ForceRange(NamedTuple):
    """The largest forces [N] in three directions relative to the tip's velocity, (…) each."""

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
    ``force_region``; the tip must move.
    """
    velocity = np.asarray(tip_velocity, np.float64)
    x, y = np.moveaxis(velocity / np.linalg.norm(velocity, axis=-1, keepdims=True), -1, 0)
    forces = force_region(machine, theta, velocity)
    along = forces[..., 0] * x[..., None] + forces[..., 1] * y[..., None]
    across = forces[..., 1] * x[..., None] - forces[..., 0] * y[..., None]
    return ForceRange(-along.min(axis=-1), across.max(axis=-1), -across.min(axis=-1))


class ForceExtremes(NamedTuple):
    """The extremes of ``ForceRange`` over all directions of motion [N], (…) each."""

    least_resisting: Array
    largest_resisting: Array
    least_steering: Array
    largest_steering: Array


def force_extremes(
    machine: Machine, theta: ArrayLike, *, speed: float = 0.25, directions: int = 360
) -> ForceExtremes:
    """Return the extremes of ``force_range`` over directions of motion.

    The directions are equally spaced, plus those in which a clutch sticks. The smallest steering
    force is the one to the weaker side, in the worst direction.

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
    ranges = force_range(machine, angles, speed * np.stack([np.cos(at), np.sin(at)], axis=-1))
    return ForceExtremes(
        ranges.resisting.min(axis=-1),
        ranges.resisting.max(axis=-1),
        ranges.steering.min(axis=-1),
        np.maximum(ranges.left, ranges.right).max(axis=-1),
    )
