"""Steering by the direction of the tip: what the single-DOF and the velocity-ratio law ask of the clutches.

Both want the tip to move in a direction that leads back to the path: along t + (lead·κ·v − approach·e)·n, with the
path's tangent t, normal n and curvature κ at the tip's foot, its distance e from it and its speed v along it. ``lead``
is a time: the clutches lag, so the tip has to turn before the path does. The laws differ in how clutches turn the tip's
velocity there. Passive clutches cannot choose a speed, so the damper along the path has that for itself.
"""

import math
from typing import Any, NamedTuple

from pter_gym.compiled.compiler import device
from pter_gym.controllers.gains import COUPLING, INERTIA_A, INERTIA_B, LENGTH_A, LENGTH_B, Gains
from pter_gym.physics.clutch import PerClutch
from pter_gym.physics.friction import sign


class Tip(NamedTuple):
    """Pose, velocities and place at the path as a law sees them, in SI."""

    cos_a: float
    sin_a: float
    cos_b: float
    sin_b: float
    omega_a: float
    omega_b: float
    v_x: float
    v_y: float
    heading_cos: float
    heading_sin: float
    error: float
    curvature: float


@device
def wanted_direction(g: Gains, tip: Tip) -> tuple[float, float]:
    """Return the unit vector in which the tip should move, (t + (lead·κ·v − approach·e)·n)/|…|."""
    speed = tip.v_x * tip.heading_cos + tip.v_y * tip.heading_sin
    back = g.lead * tip.curvature * speed - g.approach * tip.error
    size = math.sqrt(1.0 + back * back)
    return (
        (tip.heading_cos - back * tip.heading_sin) / size,
        (tip.heading_sin + back * tip.heading_cos) / size,
    )


@device
def turning_torques(gains: Any, g: Gains, tip: Tip) -> tuple[float, float]:
    """Return the joint torques [N·m] that turn the ratio of the joint velocities to the wanted one.

    r = J⁻¹u/|J⁻¹u| is the direction of joint velocities in which the tip moves as wanted, n is normal to it. With
    σ = ω·n, the part of ω that has the wrong ratio, the torques are −strength·σ/max(|ω|, slow)·n: proportional to the
    sine of the angle between ω and r, unless the arm is slower than ``slow``.
    """
    u_x, u_y = wanted_direction(g, tip)
    r_a = gains[LENGTH_B] * (tip.cos_b * u_x + tip.sin_b * u_y)
    r_b = -gains[LENGTH_A] * (tip.cos_a * u_x + tip.sin_a * u_y)
    size = math.sqrt(r_a * r_a + r_b * r_b)
    n_a = r_b / size
    n_b = -r_a / size
    speed = math.sqrt(tip.omega_a * tip.omega_a + tip.omega_b * tip.omega_b)
    sine = (tip.omega_a * n_a + tip.omega_b * n_b) / (speed if speed > g.slow else g.slow)
    return -g.strength * sine * n_a, -g.strength * sine * n_b


@device
def matching(
    gains: Any, tip: Tip, u_x: float, u_y: float, turn: float, d_a: float, d_b: float, w_a: float, w_b: float
) -> float:
    """Return cos² of the angle between a clutch's line and the wanted direction, −1 if the clutch turns away from it.

    The line is that in which the tip moves while the clutch is stuck, with joint velocities along d. ``turn`` is
    positive if the tip should turn to the left; the clutch with the row w of W brakes its slip w·ω and so changes the
    joint velocities by −sign(w·ω)·M⁻¹w.
    """
    length_a = gains[LENGTH_A]
    length_b = gains[LENGTH_B]
    line_x = -length_a * tip.sin_a * d_a - length_b * tip.sin_b * d_b
    line_y = length_a * tip.cos_a * d_a + length_b * tip.cos_b * d_b
    along = line_x * u_x + line_y * u_y
    m12 = gains[COUPLING] * (tip.cos_a * tip.cos_b + tip.sin_a * tip.sin_b)
    drive = -sign(w_a * tip.omega_a + w_b * tip.omega_b)  # M⁻¹ but for its determinant, which is positive
    change_a = drive * (gains[INERTIA_B] * w_a - m12 * w_b)
    change_b = drive * (gains[INERTIA_A] * w_b - m12 * w_a)
    change_x = -length_a * tip.sin_a * change_a - length_b * tip.sin_b * change_b
    change_y = length_a * tip.cos_a * change_a + length_b * tip.cos_b * change_b
    helps = (tip.v_x * change_y - tip.v_y * change_x) * turn > 0.0
    return along * along / (line_x * line_x + line_y * line_y) if helps else -1.0


@device
def steered(gains: Any, g: Gains, tip: Tip, wanted: PerClutch, memory: Any) -> PerClutch:
    """Return the clutch torques [N·m] with that of the best line's clutch added.

    Of the clutches that turn the tip's velocity towards the wanted direction, the one whose single-DOF line matches
    that direction best is engaged, with strength·|sin of the angle between velocity and wanted direction|; below
    ``slow`` with less, in proportion to the speed. The clutch engaged last has ``reluctance`` added to its cos².
    ``memory`` holds its number, 0 for none.
    """
    u_x, u_y = wanted_direction(g, tip)
    speed = math.sqrt(tip.v_x * tip.v_x + tip.v_y * tip.v_y)
    turn = (tip.v_x * u_y - tip.v_y * u_x) / (speed if speed > g.slow else g.slow)
    last = memory[0]
    match1 = matching(gains, tip, u_x, u_y, turn, 0.0, 1.0, 1.0, 0.0) + (g.reluctance if last == 1.0 else 0.0)
    match2 = matching(gains, tip, u_x, u_y, turn, 1.0, 0.0, 0.0, 1.0) + (g.reluctance if last == 2.0 else 0.0)
    match3 = matching(gains, tip, u_x, u_y, turn, 1.0, 1.0, 1.0, -1.0) + (g.reluctance if last == 3.0 else 0.0)
    match4 = matching(gains, tip, u_x, u_y, turn, 1.0, -1.0, 1.0, 1.0) + (g.reluctance if last == 4.0 else 0.0)
    best = match1
    chosen = 1.0
    chosen = 2.0 if match2 > best else chosen
    best = match2 if match2 > best else best
    chosen = 3.0 if match3 > best else chosen
    best = match3 if match3 > best else best
    chosen = 4.0 if match4 > best else chosen
    best = match4 if match4 > best else best
    chosen = chosen if best >= 0.0 else 0.0
    memory[0] = chosen
    torque = g.strength * abs(turn)
    return PerClutch(
        enlarged(wanted.x1, torque if chosen == 1.0 else 0.0),
        enlarged(wanted.x2, torque if chosen == 2.0 else 0.0),
        enlarged(wanted.x3, torque if chosen == 3.0 else 0.0),
        enlarged(wanted.x4, torque if chosen == 4.0 else 0.0),
    )


@device
def enlarged(wanted: float, torque: float) -> float:
    """Return a wanted torque with its magnitude enlarged; a brake's voltage knows no sign."""
    return wanted + torque if wanted > 0.0 else wanted - torque
