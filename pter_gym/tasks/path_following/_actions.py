"""How actions stand for voltages, and voltages for actions."""

from typing import Any

import numpy as np

from pter_gym._compiled.compiler import inlined
from pter_gym._compiled.records import entrywise


@inlined
def volts_of(action: float, low: float, high: float, voltage_max: float) -> float:
    """Return the voltage [V] of an action within its bounds.

    A lower bound of 0 is that of a voltage. Of a normalised action, whose lower bound is negative,
    the square of its share of the bounds counts: steps are fine where clutches slip, and exploring
    noise about 0 V brakes little.
    """
    linear = (action - low) * (voltage_max / (high - low))
    return linear * (linear / voltage_max) if low < 0.0 else linear


volts_of_each: Any = entrywise(volts_of)
"""The same for the actions of all clutches."""


def action_of(volts: Any, low: float, high: float, voltage_max: float) -> Any:
    """Return the actions, float32, whose voltages [V] these are: what undoes ``volts_of``."""
    share = np.asarray(volts, np.float64) / voltage_max
    linear = np.sqrt(share) if low < 0.0 else share
    return (low + (high - low) * linear).astype(np.float32)
