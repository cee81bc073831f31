"""Numbers that the paper prints and only its study needs."""

from pter_gym.params import Clutch
from pter_gym.units import from_inch_pounds

BREAKAWAY_SMALL_VOLTAGE = from_inch_pounds(63.5)
"""Breakaway torque of clutch 1 at the small voltage of Figs.

3 and 4 [N·m] (paper section III-B).
"""

TIME_CONSTANT = Clutch.time_constant
"""Time constant of the clutches by their manufacturer [s] (paper section IV-C.3)."""
