"""The paper's figures from the results of ``pter_gym.tools.paper.experiments``: one function per figure."""

from pter_gym.tools.paper.plots.clutches import (
    clutch_step,
    reversal_torques,
    single_dof_paths,
    single_dof_torques,
    torque_over_voltage,
)
from pter_gym.tools.paper.plots.standard_test import (
    error_over_gain,
    error_over_time_constant,
    followed_lines,
    peak_acceleration_over_time_constant,
    table_comparison,
    way_and_speed_over_time_constant,
)

__all__ = [
    "clutch_step",
    "error_over_gain",
    "error_over_time_constant",
    "followed_lines",
    "peak_acceleration_over_time_constant",
    "reversal_torques",
    "single_dof_paths",
    "single_dof_torques",
    "table_comparison",
    "torque_over_voltage",
    "way_and_speed_over_time_constant",
]
