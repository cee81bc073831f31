"""What the hand will do, from what it did: its force along the path stays, that across it dies away.

Across the path a hand disturbs, and what it does now says little of what it does later. On training draws of
``standard`` a force that dies away within 50 ms was a better guess than one that stays, and than none.
"""

import numpy as np

from pter_gym.controllers.predictive.planner import Array

SMOOTHING = 0.3
"""Part of the way that the smoothed force along the path goes to the measured one in a control step."""

MEMORY = 0.05
"""Time constant in which the force across the path dies away [s]."""


class HandModel:
    """A guess at the coming forces of the hand.

    Parameters
    ----------
    period
        Of the control steps [s].
    count
        Number of control instants to look ahead, the present one included.
    """

    def __init__(self, period: float, count: int) -> None:
        self.fading = np.exp(-period / MEMORY * np.arange(count))
        self.along: float | None = None

    def forecast(self, along: float, across: float) -> Array:
        """Take the forces measured now and return those of the coming instants, along and across, (count, 2) [N]."""
        self.along = along if self.along is None else self.along + SMOOTHING * (along - self.along)
        return np.stack([np.full(len(self.fading), self.along), across * self.fading], axis=1)
