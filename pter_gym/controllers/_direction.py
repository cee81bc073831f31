"""Two controllers that steer the tip's direction, after later work on PTER: single-DOF lines and velocity ratio.

They follow Swanson and Book, "Path-following control for dissipative passive haptic displays", Symposium on Haptic
Interfaces 2003, and Swanson's dissertation, Georgia Institute of Technology 2003, in their ideas. The laws are defined
here, and the gains chosen here; none of those works' results is reproduced.
"""

from dataclasses import dataclass

from pter_gym.controllers._guided import Guided
from pter_gym.controllers._laws import SINGLE_DOF, VELOCITY_RATIO
from pter_gym.params import quantity


@dataclass(frozen=True, kw_only=True)
class Steering(Guided):
    """A damper along the path for the pace, and a law that turns the tip's velocity u·t towards a desired direction.

    With the distance e from the path, its tangent t, normal n and curvature κ, and the speed v along it, the desired
    direction is t + (lead·κ·v − approach·e)·n. The torque loop is that of ``TorqueFeedback``.
    """

    approach: float = quantity("1/m", "chosen: this inverse distance turns the tip back by 45 degrees")
    strength: float = quantity("N·m", "chosen: torque against a velocity at right angles to the wanted direction")
    slow: float = quantity("m/s or rad/s", "chosen: a slower tip is turned less, in proportion to its speed")
    lead: float = quantity("s", "chosen: the wanted direction is turned so much ahead of the path", default=0.0)
    feedback: float = quantity("V/(N·m)", "chosen: gain of the torque loop", default=0.0)
    hold_when_stuck: bool = quantity("1", "chosen: leave the torque loop out where it has no effect", default=False)

    ranges = Guided.ranges | {"slow": {"above": 0.0}, "reluctance": {"at_least": 0.0, "below": 1.0}}


@dataclass(frozen=True, kw_only=True)
class SingleDof(Steering):
    """Single-DOF lines: engage the clutch whose line of motion is closest to the desired direction.

    While one clutch is stuck, the tip has a single degree of freedom, along a line that the pose and the clutch
    determine. Some clutches turn the tip's velocity towards the desired direction, by the nominal mass matrix. Of these
    the law engages the clutch with the largest cos² of the angle between its line and that direction. Its torque is
    ``strength·|sin δ|`` with the angle δ between velocity and desired direction, and adds to what the damper along the
    path asks of it. ``reluctance`` is added to the cos² of the clutch engaged last, against chatter.
    """

    kind = SINGLE_DOF

    approach: float = quantity("1/m", "chosen: this inverse distance turns the tip back by 45 degrees", default=8.0)
    strength: float = quantity(
        "N·m", "chosen: torque against a velocity at right angles to the wanted direction", default=40.0
    )
    slow: float = quantity("m/s", "chosen: a slower tip is turned less, in proportion to its speed", default=0.05)
    reluctance: float = quantity("1", "chosen: advantage of the clutch engaged last", default=0.05)


@dataclass(frozen=True, kw_only=True)
class VelocityRatio(Steering):
    """Velocity ratio: couple the axes so that the ratio of their velocities moves the tip in the desired direction.

    J⁻¹ turns the desired direction into a ratio of joint velocities. A joint torque normal to it, strength·sin δ with
    the angle δ between joint velocity and desired ratio, turns the joint velocity there; together with the damper along
    the path it goes through the allocation of the paper's controller.
    """

    kind = VELOCITY_RATIO

    approach: float = quantity("1/m", "chosen: this inverse distance turns the tip back by 45 degrees", default=8.0)
    strength: float = quantity(
        "N·m", "chosen: torque against a velocity at right angles to the wanted ratio", default=40.0
    )
    slow: float = quantity("rad/s", "chosen: a slower arm is turned less, in proportion to its speed", default=0.1)
    tip_space: bool = quantity("1", "chosen: allocate for tip force, not joint torque", default=False)
