"""Why an episode ended, from its last telemetry row."""

from enum import StrEnum
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from pter_gym.errors import ParameterError
from pter_gym.params import Machine, find_machine
from pter_gym.tasks.path_following._context import context_of
from pter_gym.tasks.path_following._situation import reached_end, strayed, too_fast
from pter_gym.tasks.path_following._specification import PathFollowing
from pter_gym.tasks.path_following._telemetry import COLUMN, COLUMNS


class Reason(StrEnum):
    """What has terminated an episode."""

    ARRIVED = "arrived"
    MISSED = "the end of the path was missed"
    STRAYED = "the tip left the workspace"
    SINGULAR = "the arm came near a singular pose"
    TOO_FAST = "the arm was faster than the simulator can hold"


def reason_of(telemetry: ArrayLike, machine: Machine | str | None, task: PathFollowing) -> Reason | None:
    """Return why an episode was terminated, or None if it continues or was truncated.

    Parameters
    ----------
    telemetry
        The last row of the episode's telemetry, (len(TELEMETRY),).
    machine, task
        The episode's machine or its name, and its task.

    Raises
    ------
    ParameterError
        If the row has another shape, or there is no such machine.
    """
    given = np.asarray(telemetry, np.float64)
    if given.shape != (COLUMNS,):
        raise ParameterError(f"telemetry must have the shape ({COLUMNS},), got {given.shape}")
    row: Any = given
    limits = context_of(task, find_machine(machine), (0, 0), (0, 0)).task
    if row[COLUMN.terminated] == 0.0:
        return None
    if row[COLUMN.is_success] != 0.0:
        return Reason.ARRIVED
    if too_fast(row[COLUMN.kinetic_energy], limits.energy_max):
        return Reason.TOO_FAST
    if reached_end(row[COLUMN.arc_length], limits.path.length):
        return Reason.MISSED
    if strayed(row[COLUMN.arc_length], row[COLUMN.normal_error], limits.error_max):
        return Reason.STRAYED
    return Reason.SINGULAR
