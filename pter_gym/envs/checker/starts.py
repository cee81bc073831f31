"""What observations of starts look like."""

from collections.abc import Callable
from contextlib import closing
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pter_gym.envs.checker.bits import leaves_of, parts_of
from pter_gym.envs.checker.playing import Subject, reset

START_SAMPLES = 16
"""Resets of all worlds from which the range of start observations is taken."""


def start_range(subject: Subject) -> Callable[[Any], bool]:
    """Return a function that tells whether an observation looks like that of a reset."""
    with closing(subject.build()) as env:
        first = subject.seed + 1000
        resets = [reset(env, first + k * subject.worlds) for k in range(START_SAMPLES)]
        table = np.array([_flat(row) for returned in resets for row in returned.rows()])
    low, high = table.min(axis=0), table.max(axis=0)
    margin = (high - low) + 1e-6 * (1.0 + np.abs(high))
    return lambda row: bool(np.all(np.abs(_flat(row) - 0.5 * (low + high)) <= 0.5 * (high - low) + margin))


def _flat(row: Any) -> NDArray[np.float64]:
    leaves = [row] if parts_of(row) is None else list(leaves_of(row))
    return np.concatenate([np.ravel(leaf).astype(np.float64) for leaf in leaves])
