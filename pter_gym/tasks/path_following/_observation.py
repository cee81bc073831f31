"""The observation: its entries, their units and scales, the sensors they need, and how each is
computed.

Control laws index it with ``OBS``.
"""

from dataclasses import dataclass
from typing import Annotated, Literal, NamedTuple, get_args

from pter_gym._compiled.compiler import device
from pter_gym._compiled.layout import Layout
from pter_gym._compiled.records import Entry, layout_of, leaves, rows, width
from pter_gym._physics.arm import Motion, UnitVector
from pter_gym._physics.clutch import PerClutch
from pter_gym._physics.scalars import clamp
from pter_gym.errors import ParameterError
from pter_gym.params import Machine, find_machine
from pter_gym.tasks.path_following._rules import PathState, PathVector

Sensors = Literal["encoders", "torque", "force"]

BOUND = 25.0
"""Entries are limited to ±BOUND; their scales are such that usual values are within ±1."""

ERROR_SCALE = 0.01
SPEED_SCALE = 0.2
OMEGA_SCALE = 0.5
TORQUE_SCALE = 20.0
FORCE_SCALE = 50.0
CURVATURE_SCALE = 5.0


@dataclass(frozen=True)
class ObsEntry(Entry):
    """The declaration of an observation entry, and the ``sensors`` that it needs."""

    sensors: tuple[Sensors, ...] = get_args(Sensors)


def largest_voltage(machine: Machine) -> float:
    """Return the largest voltage of a machine's clutches [V]."""
    return machine.clutch.voltage_max


class Observation(NamedTuple):
    """All possible entries of an observation, except those of the context.

    Entries that only some sensors provide come last, so the positions of the others do not depend
    on the sensors.
    """

    cos_a: Annotated[float, ObsEntry("1", "cosine of link A's angle")]
    sin_a: Annotated[float, ObsEntry("1", "sine of link A's angle")]
    cos_b: Annotated[float, ObsEntry("1", "cosine of link B's angle")]
    sin_b: Annotated[float, ObsEntry("1", "sine of link B's angle")]
    omega_a: Annotated[float, ObsEntry("rad/s", "angular velocity of link A", OMEGA_SCALE)]
    omega_b: Annotated[float, ObsEntry("rad/s", "angular velocity of link B", OMEGA_SCALE)]
    normal_error: Annotated[
        float,
        ObsEntry("m", "distance from the path's free band, positive to the left", ERROR_SCALE),
    ]
    near_error: Annotated[
        float, ObsEntry("m", "distance from the path itself, limited to the scale", ERROR_SCALE)
    ]
    progress: Annotated[
        float,
        ObsEntry("1", "arc length of the tip's projection on the path, over the path's length"),
    ]
    heading: Annotated[UnitVector, ObsEntry("1", "the path's heading at the tip's projection")]
    curvature: Annotated[
        float, ObsEntry("1/m", "curvature of the path there, positive to the left", CURVATURE_SCALE)
    ]
    speed: Annotated[PathVector, ObsEntry("m/s", "the tip's velocity", SPEED_SCALE)]
    pace: Annotated[float, ObsEntry("m/s", "commanded mean speed along the path", SPEED_SCALE)]
    pace_error: Annotated[
        float, ObsEntry("1", "speed along the path over the commanded pace, less 1")
    ]
    volts: Annotated[PerClutch, ObsEntry("V", "last voltage", largest_voltage)]
    torque: Annotated[
        PerClutch, ObsEntry("N·m", "generated torque", TORQUE_SCALE, sensors=("torque", "force"))
    ]
    force: Annotated[PathVector, ObsEntry("N", "the hand's force", FORCE_SCALE, sensors=("force",))]


OBS = rows(Observation)
"""Places of the entries in an observation."""

ENTRIES = width(Observation)
"""Largest number of entries of an observation without those of the context."""


def observation_layout(
    machine: Machine | str | None, sensors: Sensors, told: Layout | None = None
) -> Layout:
    """Return the layout of the observation; each entry is stored relative to its scale, within
    ±BOUND.

    Parameters
    ----------
    machine
        The machine or its name, None for the default PTER; some scales depend on it.
    sensors
        What is measured.
    told
        Entries of the context at the end of the observation.

    Raises
    ------
    ParameterError
        If there is no such machine, or there are no such sensors.
    """
    machine = find_machine(machine)
    if sensors not in get_args(Sensors):
        raise ParameterError(
            f"sensors must be one of {', '.join(get_args(Sensors))}, got {sensors!r}"
        )
    brought = (
        field
        for leaf, field in zip(
            leaves(Observation), layout_of(Observation, machine).fields, strict=True
        )
        if isinstance(leaf.entries[0], ObsEntry) and sensors in leaf.entries[0].sensors
    )
    return Layout((*brought, *(told.fields if told else ())))


@device
def observation(
    q: Motion,
    at: PathState,
    path_length: float,
    pace: float,
    volts: PerClutch,
    torque: PerClutch,
    force: PathVector,
) -> Observation:
    """Return all entries in their units, from the sensor readings and the task."""
    return Observation(
        cos_a=q.cos_a,
        sin_a=q.sin_a,
        cos_b=q.cos_b,
        sin_b=q.sin_b,
        omega_a=q.omega_a,
        omega_b=q.omega_b,
        normal_error=at.normal_error,
        near_error=clamp(at.offset, -ERROR_SCALE, ERROR_SCALE),
        progress=at.arc_length / path_length,
        heading=at.heading,
        curvature=at.curvature,
        speed=at.speed,
        pace=pace,
        pace_error=at.speed.along / pace - 1.0,
        volts=volts,
        torque=torque,
        force=force,
    )
