"""The five-bar arm: kinematics, mass matrix, velocity terms, energy (paper Eqs. 3 and 4).

Both angles are absolute. With a coaxial drive and a parallelogram the mass matrix depends on
θA − θB alone::

    M(θ)·θ̈ + V(θ, θ̇) = Wᵀτ + JᵀF      M12 = c·cos(θA − θB)   V = c·sin(θA − θB)·(θ̇B², −θ̇A²)
"""

import math
from typing import Annotated, Any, NamedTuple

import numpy as np

from pter_gym._compiled.compiler import inlined
from pter_gym._compiled.records import Entry


class Vector(NamedTuple):
    """A vector in the world frame, or a point from the axis of the drive."""

    x: Annotated[float, Entry("", "x of {}")]
    y: Annotated[float, Entry("", "y of {}")]


class UnitVector(NamedTuple):
    """Cosine and sine of an angle."""

    cos: Annotated[float, Entry("1", "cosine of {}")]
    sin: Annotated[float, Entry("1", "sine of {}")]


class Deviator(NamedTuple):
    """The traceless part of a symmetric 2×2 matrix, [[stretch, shear], [shear, −stretch]]."""

    stretch: Annotated[float, Entry("", "half of the {} along x less that along y")]
    shear: Annotated[float, Entry("", "{} along x against motion along y")]


ISOTROPIC = Deviator(0.0, 0.0)
"""The same in all directions."""


class PerLink(NamedTuple):
    """One number for each of the two links."""

    a: Annotated[float, Entry("", "link A's {}")]
    b: Annotated[float, Entry("", "link B's {}")]


class Linkage(NamedTuple):
    """Constants of one arm with the hand that holds it."""

    length_a: Annotated[float, Entry("m", "length of link A")]
    length_b: Annotated[float, Entry("m", "length of link B")]
    m11: Annotated[float, Entry("kg·m²", "inertia about axis A, with the hand's mass")]
    m22: Annotated[float, Entry("kg·m²", "inertia about axis B, with the hand's mass")]
    coupling: Annotated[
        float, Entry("kg·m²", "M12 over cos(θA − θB) in the mass matrix, with the hand's mass")
    ]
    damping: Annotated[float, Entry("N·s/m", "the hand's damping, the mean over all directions")]
    stiffness: Annotated[float, Entry("N/m", "the hand's stiffness, the mean over all directions")]
    implicit: Annotated[
        float, Entry("1", "share of the hand's damping by the velocity after a kick, not before it")
    ]
    dry_a: Annotated[float, Entry("N·m", "dry friction of axis A against the base")] = 0.0
    dry_b: Annotated[float, Entry("N·m", "dry friction of axis B against the base")] = 0.0
    viscous_a: Annotated[float, Entry("N·m·s", "viscous friction of axis A against the base")] = 0.0
    viscous_b: Annotated[float, Entry("N·m·s", "viscous friction of axis B against the base")] = 0.0
    damping_by: Annotated[Deviator, Entry("N·s/m", "the hand's damping", name="damping")] = (
        ISOTROPIC
    )
    stiffness_by: Annotated[Deviator, Entry("N/m", "the hand's stiffness", name="stiffness")] = (
        ISOTROPIC
    )


class Motion(NamedTuple):
    """Angles, angular velocities and the unit vectors of the links."""

    theta_a: Annotated[float, Entry("rad", "angle of link A")]
    theta_b: Annotated[float, Entry("rad", "angle of link B")]
    omega_a: Annotated[float, Entry("rad/s", "angular velocity of link A")]
    omega_b: Annotated[float, Entry("rad/s", "angular velocity of link B")]
    cos_a: Annotated[float, Entry("1", "cosine of link A's angle")]
    sin_a: Annotated[float, Entry("1", "sine of link A's angle")]
    cos_b: Annotated[float, Entry("1", "cosine of link B's angle")]
    sin_b: Annotated[float, Entry("1", "sine of link B's angle")]


class Load(NamedTuple):
    """What acts on the arm in addition to the clutches.

    Attributes
    ----------
    force_x, force_y
        Force of the hand on the tip, world frame [N].
    torque_a, torque_b
        Torques on the links [N·m].
    target_x, target_y
        Tip position to which the hand's spring pulls, world frame [m].
    """

    force_x: float
    force_y: float
    torque_a: float
    torque_b: float
    target_x: float
    target_y: float


@inlined
def components(vector: Vector, direction: UnitVector) -> tuple[float, float]:
    """Return the components of a vector along a direction and across it, positive to its left."""
    return (
        vector.x * direction.cos + vector.y * direction.sin,
        vector.y * direction.cos - vector.x * direction.sin,
    )


def motion_of(theta: Any, omega: Any = (0.0, 0.0)) -> Any:
    """Return the ``Motion`` of angles [rad] and angular velocities [rad/s], both (…, 2)."""
    (a, b), (omega_a, omega_b) = (
        np.moveaxis(np.asarray(x, np.float64), -1, 0) for x in (theta, omega)
    )
    return Motion(a, b, omega_a, omega_b, np.cos(a), np.sin(a), np.cos(b), np.sin(b))


@inlined
def elbow_cosine(length_a: float, length_b: float, x: float, y: float) -> float:
    """Return cos(θA − θB) with the tip at (x, y) [m]; beyond ±1 it is out of reach."""
    return (x * x + y * y - length_a * length_a - length_b * length_b) / (2.0 * length_a * length_b)


@inlined
def links_at(arm: Linkage, x: float, y: float) -> tuple[UnitVector, UnitVector]:
    """Return the directions of both links with the tip at (x, y) [m]; θB leads θA.

    Called from Python, it takes arrays too, and returns NaN out of reach.
    """
    cos = elbow_cosine(arm.length_a, arm.length_b, x, y)
    sin = np.sqrt(1.0 - cos * cos)
    re = arm.length_a + arm.length_b * cos
    im = arm.length_b * sin
    square = x * x + y * y
    cos_a = (x * re + y * im) / square
    sin_a = (y * re - x * im) / square
    cos_b = cos_a * cos - sin_a * sin
    sin_b = sin_a * cos + cos_a * sin
    return UnitVector(cos_a, sin_a), UnitVector(cos_b, sin_b)


@inlined
def motion_at(arm: Linkage, x: float, y: float) -> Motion:
    """Return the arm at rest with the tip at (x, y) [m]; θB leads θA."""
    a, b = links_at(arm, x, y)
    theta_a, theta_b = math.atan2(a.sin, a.cos), math.atan2(b.sin, b.cos)
    return Motion(theta_a, theta_b, 0.0, 0.0, a.cos, a.sin, b.cos, b.sin)


@inlined
def tip_position(arm: Linkage, q: Motion) -> tuple[float, float]:
    """Return the tip position (x, y) [m], from the axis of the drive."""
    return (
        arm.length_a * q.cos_a + arm.length_b * q.cos_b,
        arm.length_a * q.sin_a + arm.length_b * q.sin_b,
    )


@inlined
def tip_velocity(arm: Linkage, q: Motion) -> tuple[float, float]:
    """Return the tip velocity (x, y) [m/s]."""
    speed_a = arm.length_a * q.omega_a
    speed_b = arm.length_b * q.omega_b
    return -speed_a * q.sin_a - speed_b * q.sin_b, speed_a * q.cos_a + speed_b * q.cos_b


@inlined
def moving(arm: Linkage, q: Motion, velocity: Vector) -> Motion:
    """Return the arm in the pose of ``q``, not singular, with a velocity of the tip [m/s]."""
    scale = 1.0 / (q.cos_a * q.sin_b - q.sin_a * q.cos_b)
    omega_a = scale * (velocity.x * q.cos_b + velocity.y * q.sin_b) / arm.length_a
    omega_b = -scale * (velocity.x * q.cos_a + velocity.y * q.sin_a) / arm.length_b
    return Motion(q.theta_a, q.theta_b, omega_a, omega_b, q.cos_a, q.sin_a, q.cos_b, q.sin_b)


@inlined
def joint_torque(arm: Linkage, q: Motion, force_x: float, force_y: float) -> tuple[float, float]:
    """Return Jᵀ·F [N·m], the torque on each link of a force at the tip [N]."""
    return (
        arm.length_a * (q.cos_a * force_y - q.sin_a * force_x),
        arm.length_b * (q.cos_b * force_y - q.sin_b * force_x),
    )


@inlined
def directed(mean: float, by: Deviator, x: float, y: float) -> Vector:
    """Return a vector (x, y) times the symmetric matrix with a mean and a deviator."""
    return Vector((mean + by.stretch) * x + by.shear * y, by.shear * x + (mean - by.stretch) * y)


@inlined
def cos_difference(q: Motion) -> float:
    """Return cos(θA − θB)."""
    return q.cos_a * q.cos_b + q.sin_a * q.sin_b


@inlined
def damper_matrix(arm: Linkage, q: Motion) -> tuple[float, float, float]:
    """Return entries 11, 12 and 22 of JᵀBJ [N·m·s], the hand's damping B at the links."""
    b11 = arm.damping * arm.length_a * arm.length_a
    b12 = arm.damping * arm.length_a * arm.length_b * cos_difference(q)
    b22 = arm.damping * arm.length_b * arm.length_b
    a_x, a_y = -arm.length_a * q.sin_a, arm.length_a * q.cos_a
    b_x, b_y = -arm.length_b * q.sin_b, arm.length_b * q.cos_b
    on_a = directed(0.0, arm.damping_by, a_x, a_y)
    on_b = directed(0.0, arm.damping_by, b_x, b_y)
    return (
        b11 + a_x * on_a.x + a_y * on_a.y,
        b12 + a_x * on_b.x + a_y * on_b.y,
        b22 + b_x * on_b.x + b_y * on_b.y,
    )


@inlined
def damper_torque(arm: Linkage, q: Motion) -> tuple[float, float]:
    """Return JᵀBJ·ω [N·m], the torque against each link of the hand's damper."""
    b11, b12, b22 = damper_matrix(arm, q)
    return b11 * q.omega_a + b12 * q.omega_b, b12 * q.omega_a + b22 * q.omega_b


@inlined
def sin_difference(q: Motion) -> float:
    """Return sin(θA − θB)."""
    return q.sin_a * q.cos_b - q.cos_a * q.sin_b


@inlined
def velocity_torque(arm: Linkage, q: Motion) -> tuple[float, float]:
    """Return V(θ, θ̇) [N·m] (paper Eqs. 3 and 4)."""
    c_sin = arm.coupling * sin_difference(q)
    return c_sin * q.omega_b * q.omega_b, -c_sin * q.omega_a * q.omega_a


@inlined
def kinetic_energy(arm: Linkage, q: Motion) -> float:
    """Return ½·θ̇ᵀMθ̇ [J]."""
    m12 = arm.coupling * cos_difference(q)
    return (
        0.5 * (arm.m11 * q.omega_a * q.omega_a + arm.m22 * q.omega_b * q.omega_b)
        + m12 * q.omega_a * q.omega_b
    )


@inlined
def rotated(cos: float, sin: float, angle: float) -> tuple[float, float]:
    """Turn a unit vector by a small angle [rad]: series to order 7, then one renormalisation."""
    square = angle * angle
    cos_angle = 1.0 - square * (0.5 - square * (1.0 / 24.0 - square * (1.0 / 720.0)))
    sin_angle = angle * (
        1.0 - square * (1.0 / 6.0 - square * (1.0 / 120.0 - square * (1.0 / 5040.0)))
    )
    x = cos * cos_angle - sin * sin_angle
    y = sin * cos_angle + cos * sin_angle
    scale = 1.5 - 0.5 * (x * x + y * y)
    return x * scale, y * scale


@inlined
def advance_position(q: Motion, omega_a: float, omega_b: float, h: float) -> Motion:
    """Move the arm for a time h [s] at the new angular velocities [rad/s]."""
    turn_a = h * omega_a
    turn_b = h * omega_b
    cos_a, sin_a = rotated(q.cos_a, q.sin_a, turn_a)
    cos_b, sin_b = rotated(q.cos_b, q.sin_b, turn_b)
    return Motion(
        q.theta_a + turn_a, q.theta_b + turn_b, omega_a, omega_b, cos_a, sin_a, cos_b, sin_b
    )
