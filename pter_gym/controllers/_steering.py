"""Steering by the tip's direction: what the single-DOF and velocity-ratio laws ask of clutches.

Both want the tip to move in a direction that leads back to the path: along
t + (lead·κ·v − approach·e)·n, with the path's tangent t, normal n and curvature κ at the tip's
foot, its distance e from it and its speed v along it. ``lead`` is a time: the clutches lag, so the
tip has to turn before the path does. The laws differ in how clutches turn the tip's velocity there.
Passive clutches cannot choose a speed, so the damper along the path has that for itself.
"""

import math
from typing import NamedTuple

from pter_gym._compiled.compiler import inlined
from pter_gym._compiled.records import entrywise
from pter_gym._physics.arm import Linkage, Motion, UnitVector, Vector, cos_difference, tip_velocity
from pter_gym._physics.arrangement import OptionalArrangement
from pter_gym._physics.clutch import PerClutch
from pter_gym._physics.friction import COUPLING, LINES
from pter_gym._physics.scalars import sign
from pter_gym.controllers._gains import Gains


class Tip(NamedTuple):
    """The arm and its position relative to the path as a law sees them, in SI.

    Attributes
    ----------
    arm, q
        Nominal arm, and its motion.
    velocity
        Velocity of the tip [m/s].
    heading, error, curvature
        Unit vector along the path, distance from it [m], and its curvature there [1/m].
    """

    arm: Linkage
    q: Motion
    velocity: Vector
    heading: UnitVector
    error: float
    curvature: float


@inlined
def speed_along(tip: Tip) -> float:
    """Return the speed of the tip along the path [m/s]."""
    return tip.velocity.x * tip.heading.cos + tip.velocity.y * tip.heading.sin


@inlined
def wanted_direction(g: Gains, tip: Tip) -> tuple[float, float]:
    """Return the unit vector in which the tip should move, (t + (lead·κ·v − approach·e)·n)/|…|."""
    back = g.lead * tip.curvature * speed_along(tip) - g.approach * tip.error
    size = math.sqrt(1.0 + back * back)
    return (
        (tip.heading.cos - back * tip.heading.sin) / size,
        (tip.heading.sin + back * tip.heading.cos) / size,
    )


@inlined
def turning_torques(g: Gains, tip: Tip) -> tuple[float, float]:
    """Return the joint torques [N·m] that turn the ratio of the joint velocities.

    r = J⁻¹u/|J⁻¹u| is the direction of joint velocities that moves the tip as desired, and n is
    normal to it. With σ = ω·n, the part of ω with the wrong ratio, the torques are
    −strength·σ/max(|ω|, slow)·n: proportional to the sine of the angle between ω and r, unless the
    arm is slower than ``slow``.
    """
    q = tip.q
    u_x, u_y = wanted_direction(g, tip)
    r_a = tip.arm.length_b * (q.cos_b * u_x + q.sin_b * u_y)
    r_b = -tip.arm.length_a * (q.cos_a * u_x + q.sin_a * u_y)
    size = math.sqrt(r_a * r_a + r_b * r_b)
    n_a = r_b / size
    n_b = -r_a / size
    speed = math.sqrt(q.omega_a * q.omega_a + q.omega_b * q.omega_b)
    sine = (q.omega_a * n_a + q.omega_b * n_b) / (speed if speed > g.slow else g.slow)
    return -g.strength * sine * n_a, -g.strength * sine * n_b


@inlined
def at_speed(q: Motion, omega_a: float, omega_b: float) -> Motion:
    """Return a motion in the same pose with other angular velocities [rad/s]."""
    return Motion(q.theta_a, q.theta_b, omega_a, omega_b, q.cos_a, q.sin_a, q.cos_b, q.sin_b)


@inlined
def matching(
    tip: Tip, u_x: float, u_y: float, turn: float, line: tuple[float, float], w: tuple[float, float]
) -> float:
    """Return cos² of the angle between a clutch's line and the desired direction, or −1.

    The tip moves along this line while the clutch is stuck, with joint velocities along ``line``.
    ``turn`` is positive if the tip should turn to the left; the clutch with the row w of W brakes
    its slip w·ω and so changes the joint velocities by −sign(w·ω)·M⁻¹w.
    """
    arm, q = tip.arm, tip.q
    line_x, line_y = tip_velocity(arm, at_speed(q, line[0], line[1]))
    along = line_x * u_x + line_y * u_y
    m12 = arm.coupling * cos_difference(q)
    # M⁻¹ without the factor 1/det M, which is positive
    drive = -sign(w[0] * q.omega_a + w[1] * q.omega_b)
    change = at_speed(
        q, drive * (arm.m22 * w[0] - m12 * w[1]), drive * (arm.m11 * w[1] - m12 * w[0])
    )
    change_x, change_y = tip_velocity(arm, change)
    helps = (tip.velocity.x * change_y - tip.velocity.y * change_x) * turn > 0.0
    return along * along / (line_x * line_x + line_y * line_y) if helps else -1.0


@inlined
def line_and_row(
    k: int, arrangement: OptionalArrangement
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the joint velocities at which a slot does not slip, and its row of W."""
    if arrangement is not None:
        return (-arrangement.b[k], arrangement.a[k]), (arrangement.a[k], arrangement.b[k])
    return LINES[k], COUPLING[k]


@inlined
def steered(
    g: Gains,
    tip: Tip,
    scale: PerClutch,
    wanted: PerClutch,
    last: float,
    arrangement: OptionalArrangement = None,
) -> tuple[PerClutch, float]:
    """Return the torques [N·m] with that of the best line's clutch added, and its number or 0.

    Of the clutches that turn the tip's velocity towards the desired direction, the one whose
    single-DOF line matches it best is engaged, with strength·|sin of the angle between velocity and
    desired direction|. Below the speed ``slow`` the torque is reduced in proportion to the speed.
    The clutch engaged last gets ``reluctance`` added to its cos². A clutch with ``scale`` 0 is
    missing.
    """
    u_x, u_y = wanted_direction(g, tip)
    speed = math.sqrt(tip.velocity.x * tip.velocity.x + tip.velocity.y * tip.velocity.y)
    turn = (tip.velocity.x * u_y - tip.velocity.y * u_x) / (speed if speed > g.slow else g.slow)
    chosen = 0.0
    best = 0.0
    for k in range(4):
        line, row = line_and_row(k, arrangement)
        match = matching(tip, u_x, u_y, turn, line, row) + (
            g.reluctance if last == k + 1.0 else 0.0
        )
        better = (scale[k] > 0.0) & (match >= 0.0 if chosen == 0.0 else match > best)
        chosen = k + 1.0 if better else chosen
        best = match if better else best
    return enlarged(wanted, PerClutch(1.0, 2.0, 3.0, 4.0), chosen, g.strength * abs(turn)), chosen


@entrywise
@inlined
def enlarged(wanted: float, number: float, chosen: float, torque: float) -> float:
    """Return a desired torque, larger for the chosen clutch; a brake's voltage has no sign."""
    more = torque if number == chosen else 0.0
    return wanted + more if wanted > 0.0 else wanted - more
