"""The tip force that an impedance law wants, for whole episodes; ``wanted_force`` is that of one control step."""

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pter_gym.benchmark.measures import column, headings, vector
from pter_gym.controllers._base import BoundPolicy, Policy
from pter_gym.controllers._gains import Gains, read_gains
from pter_gym.controllers._laws import BRAKE_LIMIT, IMPEDANCE, built_in, built_in_declared
from pter_gym.tasks.path_following import PathFollowing

Array = NDArray[np.float64]


def wanted_forces(
    policy: BoundPolicy, telemetry: Array, tasks: Sequence[PathFollowing]
) -> Array | None:
    """Return the force of the device on the hand that a policy wants at each control instant, (R,
    N, 2) [N].

    None for one that wants no force: all but the impedance laws. What sensors add, noise and delay,
    is left out.

    Parameters
    ----------
    policy, telemetry, tasks
        A bound policy, its episodes from the reset on, (R, N, len(TELEMETRY)), and their tasks, N.
    """
    if not isinstance(policy, Policy) or policy.law not in (built_in, built_in_declared):
        return None
    if policy.gains[0] != IMPEDANCE:
        return None
    g: Any = Gains(*np.transpose([read_gains(policy.gains, task.pace) for task in tasks]))
    pace = np.array([task.pace for task in tasks])
    x, y = np.moveaxis(vector(telemetry, "tip_velocity"), -1, 0)
    error = column(telemetry, "normal_error")
    heading = headings(telemetry, tasks)
    cos, sin = np.cos(heading), np.sin(heading)
    speed, drift = x * cos + y * sin, y * cos - x * sin
    gripping = g.grip - np.arange(len(telemetry))[:, None] >= 0.5
    integral = np.where(gripping, 0.0, g.pace_integral * (speed - pace))
    for before, after in pairwise(integral):
        after[:] = np.clip(before + after, -BRAKE_LIMIT, BRAKE_LIMIT)
    brake = np.maximum(g.damping_tangential * (speed - g.pace_fraction * pace) + integral, 0.0)
    forward = speed > 0.0
    along = -(forward * brake + ~forward * g.damping_tangential * speed)
    across = -g.stiffness * error - g.damping_normal * drift
    return np.stack([along * cos - across * sin, along * sin + across * cos], axis=-1)
