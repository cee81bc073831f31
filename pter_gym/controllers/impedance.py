"""The paper's two controllers: impedance (section III-A), and with torque feedback (section IV-B.3, Fig. 6)."""

from dataclasses import dataclass

from pter_gym.controllers.gains import Gains
from pter_gym.controllers.guided import Guided
from pter_gym.controllers.laws import IMPEDANCE
from pter_gym.params import preset, quantity, require_flag, require_number


@dataclass(frozen=True, kw_only=True)
class Impedance(Guided):
    """Spring and damper normal to the path, damper along it; allocation; piecewise-linear torque table."""

    stiffness: float = preset("controller", "stiffness")
    damping_normal: float = preset("controller", "damping_normal")
    tip_space: bool = quantity("1", "chosen: allocate for tip force, not joint torque", default=False)

    def __post_init__(self) -> None:
        """Check the gains."""
        super().__post_init__()
        for name in ("stiffness", "damping_normal"):
            require_number(self, name, at_least=0.0)
        require_flag(self, "tip_space")

    @property
    def kind(self) -> float:
        """Number of the law."""
        return IMPEDANCE

    def gains(self) -> Gains:
        """Return the gains as the law reads them."""
        return Gains(
            stiffness=self.stiffness,
            damping_normal=self.damping_normal,
            damping_tangential=self.damping_tangential,
            pace_fraction=self.pace_fraction,
            pace_integral=self.pace_integral,
            grip=self.grip,
            tip_space=float(self.tip_space),
            slip_threshold=self.slip_threshold,
        )


@dataclass(frozen=True, kw_only=True)
class TorqueFeedback(Impedance):
    """The impedance controller with a proportional torque loop around each clutch (Fig. 6)."""

    feedback: float = preset("controller", "feedback")
    hold_when_stuck: bool = quantity("1", "chosen: leave the loop out where it has no effect", default=False)

    def __post_init__(self) -> None:
        """Check the gain of the torque loop too."""
        super().__post_init__()
        require_number(self, "feedback", at_least=0.0)
        require_flag(self, "hold_when_stuck")

    def gains(self) -> Gains:
        """Return the gains as the law reads them."""
        return super().gains()._replace(feedback=self.feedback, hold_when_stuck=float(self.hold_when_stuck))
