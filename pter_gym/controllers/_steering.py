"""Steering by the tip's direction: how the single-DOF and velocity-ratio laws use the clutches.

Both want the tip to move in a direction that leads back to the path: along
t + (lead·κ·v − approach·e)·n, with the path's tangent t, normal n and curvature κ at the tip's
foot, its distance e from it and its speed v along it. ``lead`` is a time: the clutches lag, so the
tip has to turn before the path does. The laws differ in how clutches turn the tip's velocity there.
Passive clutches cannot choose a speed, so only the damper along the path controls it.
"""

import math
from dataclasses import dataclass
from typing import Any

from pter_gym._compiled.compiler import inlined
from pter_gym._compiled.records import entrywise
from pter_gym._internal.fields import parameter
from pter_gym._physics.arm import Motion, PerLink, cos_difference, tip_velocity
from pter_gym._physics.arrangement import OptionalArrangement
from pter_gym._physics.clutch import PerClutch
from pter_gym._physics.friction import COUPLING, LINES
from pter_gym._physics.scalars import sign
from pter_gym.controllers._allocation import passive_torques
from pter_gym.controllers._gains import MEMORY, Entries, Nominal
from pter_gym.controllers._guided import LOOP, Guided
from pter_gym.controllers._laws import Tip, speed_along


@inlined
def wanted_direction(g: Any, tip: Tip) -> tuple[float, float]:
    """Return the unit vector in which the tip should move, (t + (lead·κ·v − approach·e)·n)/|…|."""
    back = g.lead * tip.curvature * speed_along(tip) - g.approach * tip.error
    size = math.sqrt(1.0 + back * back)
    return (
        (tip.heading.cos - back * tip.heading.sin) / size,
        (tip.heading.sin + back * tip.heading.cos) / size,
    )


@inlined
def turning_torques(g: Any, tip: Tip) -> tuple[float, float]:
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
    g: Any,
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


@inlined
def engage_line(
    g: Any,
    tip: Tip,
    nominal: Nominal,
    want: PerLink,
    memory: Entries,
    arrangement: OptionalArrangement,
) -> PerClutch:
    """Return the clutch torques [N·m] of the single-DOF law."""
    braking = passive_torques(g, tip, nominal, want, arrangement)
    wanted, memory[MEMORY.kept] = steered(
        g, tip, nominal.scale, braking, memory[MEMORY.kept], arrangement
    )
    return wanted


@inlined
def turn_ratio(
    g: Any,
    tip: Tip,
    nominal: Nominal,
    want: PerLink,
    memory: Entries,  # noqa: ARG001
    arrangement: OptionalArrangement,
) -> PerClutch:
    """Return the clutch torques [N·m] of the velocity-ratio law."""
    turn_a, turn_b = turning_torques(g, tip)
    return passive_torques(g, tip, nominal, PerLink(want.a + turn_a, want.b + turn_b), arrangement)


@dataclass(frozen=True, kw_only=True)
class Steering(Guided):
    """A damper along the path for the pace, and a law that turns the tip's velocity.

    With the distance e from the path, its tangent t, normal n and curvature κ, and the speed v
    along it, the desired direction is t + (lead·κ·v − approach·e)·n. The torque loop is that of
    ``TorqueFeedback``.
    """

    search = (
        Guided.search
        | LOOP
        | {
            "approach": (1.0, 100.0),
            "lead": (0.0, 0.4),
            "strength": (3.0, 300.0),
            "release": (0.0, 0.02),
        }
    )

    needs = Guided.needs | {"lead": "curvature"}

    approach: float = parameter(
        "1/m", "chosen: this inverse distance turns the tip back by 45 degrees", default=8.0
    )
    strength: float = parameter(
        "N·m",
        "chosen: torque against a velocity at right angles to the wanted direction",
        default=40.0,
    )
    slow: float = parameter(
        "m/s or rad/s", "chosen: a slower tip is turned less, in proportion to its speed"
    )
    lead: float = parameter(
        "s", "chosen: the wanted direction is turned so much ahead of the path", default=0.0
    )
    feedback: float = parameter("V/(N·m)", "chosen: gain of the torque loop", default=0.0)
    hold_when_stuck: bool = parameter(
        "1", "chosen: leave the torque loop out where it has no effect", default=False
    )
    release: float = parameter(
        "m",
        "chosen: beyond it a clutch that sticks while the tip leaves the path gets 0 V; 0: never",
        default=0.0,
        later=True,
    )

    ranges = Guided.ranges | {"slow": {"above": 0.0}, "reluctance": {"at_least": 0.0, "below": 1.0}}

    def gains(self) -> Any:
        """Return the gains as the law reads them, with the inverse of ``release``."""
        release = self.release
        return super().gains()._replace(release=1.0 / release if release > 0.0 else 0.0)


@dataclass(frozen=True, kw_only=True)
class SingleDof(Steering):
    """Single-DOF lines: engage the clutch whose line of motion is closest to the desired direction.

    While one clutch is stuck, the tip has a single degree of freedom, along a line that the pose
    and the clutch determine. Of the clutches that turn the tip's velocity towards the desired
    direction, by the nominal mass matrix, the law engages the one with the largest cos² of the
    angle between its line and that direction. Its torque is ``strength·|sin δ|`` with the angle δ
    between velocity and desired direction, in addition to that for the damper along the path.
    ``reluctance`` is added to the cos² of the clutch engaged last, to prevent chatter.
    """

    steering = engage_line
    search = Steering.search | {"slow": (0.01, 1.0), "reluctance": (0.0, 0.5)}

    slow: float = parameter(
        "m/s", "chosen: a slower tip is turned less, in proportion to its speed", default=0.05
    )
    reluctance: float = parameter("1", "chosen: advantage of the clutch engaged last", default=0.05)


@dataclass(frozen=True, kw_only=True)
class VelocityRatio(Steering):
    """Velocity ratio: couple the axes so that the tip moves in the desired direction.

    J⁻¹ turns the desired direction into a ratio of joint velocities. A joint torque normal to it,
    strength·sin δ with the angle δ between joint velocity and desired ratio, turns the joint
    velocity towards it. The sum of this torque and the damper's goes through the allocation of the
    paper's controller.
    """

    steering = turn_ratio
    search = Steering.search | {"slow": (0.02, 2.0), "tip_space": (False, True)}

    slow: float = parameter(
        "rad/s", "chosen: a slower arm is turned less, in proportion to its speed", default=0.1
    )
    tip_space: bool = parameter(
        "1", "chosen: allocate for tip force, not joint torque", default=False
    )
