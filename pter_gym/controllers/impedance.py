"""The paper's two controllers: impedance (section III-A), and with torque feedback (section IV-B.3, Fig. 6)."""

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from pter_gym.controllers.base import Policy
from pter_gym.controllers.laws import IMPEDANCE, TORQUE, ImpedanceGains
from pter_gym.errors import ParameterError
from pter_gym.layout import Layout
from pter_gym.params import Machine, preset, quantity, require, require_flag, require_number, require_numbers


@dataclass(frozen=True, kw_only=True)
class Impedance:
    """Spring and damper normal to the path, damper along it; allocation; piecewise-linear torque table.

    The controller knows the nominal machine that it is bound to: its link lengths, and the dynamic torque curve at
    ``table_volts``. Between these it interpolates, so that its table is not the plant's curve. Below 4 V, where the
    paper could not measure, the table is extrapolated to (0 V, 0 N·m).
    """

    stiffness: float = preset("controller", "stiffness")
    damping_normal: float = preset("controller", "damping_normal")
    damping_tangential: float = preset("controller", "damping_tangential")
    table_volts: tuple[float, ...] = preset("controller", "table_volts")
    slip_threshold: float = preset("controller", "slip_threshold")
    tip_space: bool = quantity("1", "chosen: allocate for tip force, not joint torque", default=False)

    def __post_init__(self) -> None:
        """Check gains and table."""
        for name in ("stiffness", "damping_normal", "damping_tangential", "slip_threshold"):
            require_number(self, name, at_least=0.0)
        accepted = "a tuple of rising voltages from 0"
        require_numbers(self, "table_volts", accepted)
        rising = all(a < b for a, b in pairwise(self.table_volts))
        require(rising and self.table_volts[:1] == (0.0,), self, "table_volts", self.table_volts, accepted)
        require_flag(self, "tip_space")

    def bind(self, machine: Machine, layout: Layout) -> Policy:
        """Return the policy for a nominal machine.

        Raises
        ------
        ParameterError
            If the table does not end at the machine's largest voltage.
        """
        return Policy(self._gains(machine, feedback=0.0, hold_when_stuck=False), layout)

    def _gains(self, machine: Machine, *, feedback: float, hold_when_stuck: bool) -> Any:
        top = machine.clutch.voltage_max
        require(
            self.table_volts[-1:] == (top,), self, "table_volts", self.table_volts, f"up to voltage_max = {top:g} V"
        )
        torques = [machine.clutch.dynamic.torque(volts) for volts in self.table_volts]
        gains = ImpedanceGains(
            kind=IMPEDANCE,
            stiffness=self.stiffness,
            damping_normal=self.damping_normal,
            damping_tangential=self.damping_tangential,
            feedback=feedback,
            hold_when_stuck=float(hold_when_stuck),
            tip_space=float(self.tip_space),
            length_a=machine.arm.length_a,
            length_b=machine.arm.length_b,
            slip_threshold=self.slip_threshold,
            torque_limit=torques[-1],
            voltage_max=top,
        )
        return np.array([*gains, *self.table_volts, *torques])


@dataclass(frozen=True, kw_only=True)
class TorqueFeedback(Impedance):
    """The impedance controller with a proportional torque loop around each clutch (Fig. 6)."""

    feedback: float = preset("controller", "feedback")
    hold_when_stuck: bool = quantity("1", "chosen: leave the loop out where it has no effect", default=False)

    def __post_init__(self) -> None:
        """Check the loop besides the rest."""
        super().__post_init__()
        require_number(self, "feedback", at_least=0.0)
        require_flag(self, "hold_when_stuck")

    def bind(self, machine: Machine, layout: Layout) -> Policy:
        """Return the policy for a nominal machine.

        Raises
        ------
        ParameterError
            If the table does not end at the machine's largest voltage, or the observation has no torque sensors.
        """
        if "torque_1" not in layout.names or layout.index("torque_1") != TORQUE:
            raise ParameterError('torque feedback needs torque sensors: sensors="torque" or sensors="force"')
        return Policy(self._gains(machine, feedback=self.feedback, hold_when_stuck=self.hold_when_stuck), layout)
