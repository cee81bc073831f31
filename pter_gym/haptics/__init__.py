"""What a passive haptic device can render, and how well it did.

``force_region`` and its relatives say which forces at the handle the clutches of a machine can
make, from geometry and torque curves alone. The other functions are scores of time series, logged
or simulated.
"""

from pter_gym.haptics._region import (
    ForceExtremes,
    ForceRange,
    force_extremes,
    force_per_torque,
    force_range,
    force_region,
    link_angles,
    torque_limits,
)
from pter_gym.haptics._scores import (
    ForceError,
    apparent_stiffness,
    force_error,
    impedance,
    mean_resisting_force,
    spectral_arc_length,
    z_width,
)

__all__ = [
    "ForceError",
    "ForceExtremes",
    "ForceRange",
    "apparent_stiffness",
    "force_error",
    "force_extremes",
    "force_per_torque",
    "force_range",
    "force_region",
    "impedance",
    "link_angles",
    "mean_resisting_force",
    "spectral_arc_length",
    "torque_limits",
    "z_width",
]
