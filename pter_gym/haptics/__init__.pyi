from .forces import (
    ForceExtremes as ForceExtremes,
    ForceRange as ForceRange,
    force_extremes as force_extremes,
    force_per_torque as force_per_torque,
    force_range as force_range,
    force_region as force_region,
    link_angles as link_angles,
    torque_limits as torque_limits,
)
from .scores import (
    ForceError as ForceError,
    apparent_stiffness as apparent_stiffness,
    force_error as force_error,
    impedance as impedance,
    mean_resisting_force as mean_resisting_force,
    spectral_arc_length as spectral_arc_length,
    z_width as z_width,
)
