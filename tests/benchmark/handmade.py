"""Telemetry made by hand, so its scores are known."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pter_gym.tasks.path_following import TELEMETRY, PathFollowing

TASK = PathFollowing()
LENGTH = TASK.path.length
PERIOD = TASK.control_period
Array = NDArray[np.float64]

METRE = replace(TASK, path=replace(TASK.path, length=1.0), pace=0.5)
"""A path of one metre: 2 s at the commanded pace."""


def episode(steps: int, **columns: Array | float) -> Array:
    """Telemetry (steps + 1, fields) with given columns, the rest zero, time running."""
    rows = np.zeros((steps + 1, len(TELEMETRY)))
    rows[:, TELEMETRY.index("time")] = PERIOD * np.arange(steps + 1)
    for name, values in columns.items():
        rows[:, TELEMETRY.index(name)] = values
    return rows


def travel(arc_length: Array, **columns: Array | float) -> Array:
    """Telemetry of an episode on METRE by its arc length at each control instant."""
    rows = episode(len(arc_length) - 1, arc_length=arc_length, **columns)
    rows[-1, TELEMETRY.index("is_success")] = float(arc_length[-1] >= 1.0)
    return rows


def padded(episodes: list[Array]) -> Array:
    longest = max(len(rows) for rows in episodes)
    telemetry = np.full((longest, len(episodes), len(TELEMETRY)), np.nan)
    for k, rows in enumerate(episodes):
        telemetry[: len(rows), k] = rows
    return telemetry
