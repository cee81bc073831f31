"""The paper's two controllers: impedance (section III-A), and with torque feedback (section IV-B.3, Fig. 6)."""

from dataclasses import dataclass

from pter_gym.controllers._guided import Guided
from pter_gym.controllers._laws import IMPEDANCE
from pter_gym.params import preset, quantity


@dataclass(frozen=True, kw_only=True)
class Impedance(Guided):
    """Spring and damper normal to the path, damper along it; allocation; piecewise-linear torque table."""

    kind = IMPEDANCE

    stiffness: float = preset("controller", "stiffness")
    damping_normal: float = preset("controller", "damping_normal")
    tip_space: bool = quantity("1", "chosen: allocate for tip force, not joint torque", default=False)


@dataclass(frozen=True, kw_only=True)
class TorqueFeedback(Impedance):
    """The impedance controller with a proportional torque loop around each clutch (Fig. 6)."""

    feedback: float = preset("controller", "feedback")
    hold_when_stuck: bool = quantity("1", "chosen: leave the loop out where it has no effect", default=False)
