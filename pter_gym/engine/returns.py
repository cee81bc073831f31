"""What a step of many worlds returns."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Observations = NDArray[np.float32]


class Returns(NamedTuple):
    """What a step returns: fresh arrays, except ``final_obs``.

    Attributes
    ----------
    obs
        Observations, float32 (N, len(layout)).
    final_obs
        With ``SAME_STEP``, the last observations of the worlds that ended and were reset in this step, float32
        (N, len(layout)); other rows hold anything, and the next step changes all.
    rewards
        float64 (N,).
    flags
        bool (FLAGS, N): terminated, truncated, success.
    telemetry
        float64 (1, N, len(TELEMETRY)), or (0, …) without telemetry; with ``SAME_STEP`` a second layer holds the last
        ones of the worlds that ended.
    """

    obs: Observations
    final_obs: Observations
    rewards: NDArray[np.float64]
    flags: NDArray[np.bool_]
    telemetry: NDArray[np.float64]
