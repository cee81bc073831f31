"""Telemetry and runs made by hand, so their scores are known."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pter_gym.benchmark.scores import SCORES, ScenarioRun, Scores
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


def run_of(policy: str, scores: Scores, seed: int = 0) -> ScenarioRun:
    count = len(scores["path_error_m"])
    return ScenarioRun("standard", "brisk", policy, seed, None, count * ("one",), scores)


def with_error(
    policy: str, error: float, count: int = 40, *, pace: str = "brisk", **others: float
) -> ScenarioRun:
    """A run that arrives at the pace, with path errors spread around a value [m]."""
    scores: Scores = {name: np.zeros(count) for name in SCORES}
    scores["completed"] = np.ones(count, np.bool_)
    scores["path_error_m"] = error * np.linspace(0.9, 1.1, count)
    scores |= {name: np.full(count, value) for name, value in others.items()}
    return replace(run_of(policy, scores), pace=pace)
