"""The telemetry: the record of each control step, for people, scores and plots.

All entries are in their units.
"""

from dataclasses import replace
from enum import StrEnum
from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from pter_gym._compiled.layout import Layout
from pter_gym._compiled.records import Entry, layout_of, rows, width
from pter_gym._physics.arm import PerLink, UnitVector, Vector, motion_of
from pter_gym._physics.clutch import PerClutch
from pter_gym._physics.step import Energy
from pter_gym.errors import ParameterError
from pter_gym.params import Machine, find_machine
from pter_gym.tasks.path_following._context import ObservedContext, context_of
from pter_gym.tasks.path_following._ending import Ending, ending
from pter_gym.tasks.path_following._position import PathState, PathVector
from pter_gym.tasks.path_following._reward import Terms
from pter_gym.tasks.path_following._specification import PathFollowing


class Telemetry(NamedTuple):
    """What a control step records."""

    time: Annotated[float, Entry("s", "time since the start of the episode")]
    theta: Annotated[PerLink, Entry("rad", "angle")]
    tip: Annotated[Vector, Entry("m", "the tip's position")]
    tip_velocity: Annotated[Vector, Entry("m/s", "the tip's velocity")]
    acceleration: Annotated[
        Vector, Entry("m/s²", "the tip's acceleration, mean over the control period")
    ]
    arc_length: Annotated[float, Entry("m", "arc length of the tip's projection on the path")]
    reached: Annotated[float, Entry("m", "largest arc length so far")]
    normal_error: Annotated[
        float, Entry("m", "distance from the path's free band, positive to the left")
    ]
    force: Annotated[Vector, Entry("N", "the hand's force at the control instant")]
    mode: Annotated[float, Entry("1", "ClutchMode")]
    volts: Annotated[PerClutch, Entry("V", "voltage")]
    torque: Annotated[PerClutch, Entry("N·m", "generated torque at the control instant")]
    power: Annotated[PerClutch, Entry("W", "power on the arm at the control instant")]
    kinetic_energy: Annotated[float, Entry("J", "kinetic energy of the arm with the hand's mass")]
    energy: Energy
    terms: Annotated[Terms, Entry("1", "reward term", name="reward")]
    reward: Annotated[float, Entry("1", "sum of the reward terms")]
    is_success: Annotated[float, Entry("1", "1 once the end of the path is reached")]
    context: Annotated[
        float, Entry("1", "number of the drawn machine and task, 0 where none is drawn")
    ]
    terminated: Annotated[
        float, Entry("1", "1 at the end of the path and on leaving the workspace")
    ]
    told: ObservedContext


COLUMN = rows(Telemetry)
"""Columns of the telemetry: ``rows[..., COLUMN.time]``, ``rows[..., [*COLUMN.tip]]``."""

COLUMNS = width(Telemetry)
"""Numbers that a control step records."""

TELEMETRY = Layout(tuple(replace(field, scale=1.0) for field in layout_of(Telemetry).fields))
"""Layout of the telemetry."""


class Reason(StrEnum):
    """Why an episode was terminated."""

    ARRIVED = "arrived"
    MISSED = "the end of the path was missed"
    STRAYED = "the tip left the workspace"
    SINGULAR = "the arm came near a singular pose"
    TOO_FAST = "the arm was faster than the simulator can hold"


def reason_of(
    telemetry: ArrayLike, machine: Machine | str | None, task: PathFollowing
) -> Reason | None:
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
    array = np.asarray(telemetry, np.float64)
    if array.shape != (COLUMNS,):
        raise ParameterError(f"telemetry must have the shape ({COLUMNS},), got {array.shape}")
    row: Any = array
    limits = context_of(task, find_machine(machine), (0, 0), (0, 0)).task
    if row[COLUMN.terminated] == 0.0:
        return None
    error, standing = row[COLUMN.normal_error], PathVector(0.0, 0.0)
    at = PathState(row[COLUMN.arc_length], error, error, UnitVector(1.0, 0.0), 0.0, standing)
    end = ending(at, motion_of(row[[*COLUMN.theta]]), row[COLUMN.kinetic_energy], limits)
    return first_reason(end) or Reason.SINGULAR


def first_reason(end: Ending) -> Reason | None:
    """Return what has terminated an episode, or None if nothing has."""
    order = (
        (Reason.ARRIVED, end.arrived),
        (Reason.TOO_FAST, end.too_fast),
        (Reason.MISSED, end.missed),
        (Reason.STRAYED, end.strayed),
        (Reason.SINGULAR, end.singular),
    )
    return next((reason for reason, holds in order if holds), None)
