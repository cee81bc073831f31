"""The observation: its entries, their units and scales, and how sensors' readings become one.

Control laws index it with ``OBS``.
"""

from functools import lru_cache
from typing import TYPE_CHECKING, Annotated, Any, Literal, NamedTuple, get_args

from pter_gym._compiled.compiler import inlined
from pter_gym._compiled.layout import Field, Layout
from pter_gym._compiled.records import Entry, joined, layout_of, rows, width
from pter_gym._physics.arm import Linkage, Motion, PerLink, UnitVector, tip_position, tip_velocity
from pter_gym._physics.clutch import PerClutch
from pter_gym._physics.scalars import clamp
from pter_gym.errors import ParameterError
from pter_gym.hands._model import unit_vector
from pter_gym.params import Machine, find_machine
from pter_gym.paths._projection import Foot, project
from pter_gym.tasks.path_following._position import FreeBand, PathVector, path_state

Sensors = Literal["encoders", "torque", "force"]
"""What is measured: each kind has the sensors of those before it, too."""

BOUND = 25.0
"""Entries are limited to ±BOUND; their scales are such that usual values are within ±1."""

ERROR_SCALE = 0.01
SPEED_SCALE = 0.2
OMEGA_SCALE = 0.5
TORQUE_SCALE = 20.0
FORCE_SCALE = 50.0
CURVATURE_SCALE = 5.0


def largest_voltage(machine: Machine) -> float:
    """Return the largest voltage of a machine's clutches [V]."""
    return machine.clutch.voltage_max


class EncoderEntries(NamedTuple):
    """Entries from joint encoders, and those that need no sensor."""

    cos_a: Annotated[float, Entry("1", "cosine of link A's angle")]
    sin_a: Annotated[float, Entry("1", "sine of link A's angle")]
    cos_b: Annotated[float, Entry("1", "cosine of link B's angle")]
    sin_b: Annotated[float, Entry("1", "sine of link B's angle")]
    omega_a: Annotated[float, Entry("rad/s", "angular velocity of link A", OMEGA_SCALE)]
    omega_b: Annotated[float, Entry("rad/s", "angular velocity of link B", OMEGA_SCALE)]
    normal_error: Annotated[
        float, Entry("m", "distance from the path's free band, positive to the left", ERROR_SCALE)
    ]
    near_error: Annotated[
        float, Entry("m", "distance from the path itself, limited to the scale", ERROR_SCALE)
    ]
    progress: Annotated[
        float, Entry("1", "arc length of the tip's projection on the path, over the path's length")
    ]
    heading: Annotated[UnitVector, Entry("1", "the path's heading at the tip's projection")]
    curvature: Annotated[
        float, Entry("1/m", "curvature of the path there, positive to the left", CURVATURE_SCALE)
    ]
    speed: Annotated[PathVector, Entry("m/s", "the tip's velocity", SPEED_SCALE)]
    pace: Annotated[float, Entry("m/s", "commanded mean speed along the path", SPEED_SCALE)]
    pace_error: Annotated[float, Entry("1", "speed along the path over the commanded pace, less 1")]
    volts: Annotated[PerClutch, Entry("V", "last voltage", largest_voltage)]


class TorqueEntries(NamedTuple):
    """Entries from torque sensors on the clutches."""

    torque: Annotated[PerClutch, Entry("N·m", "generated torque", TORQUE_SCALE)]


class ForceEntries(NamedTuple):
    """Entries from a force sensor at the handle."""

    force: Annotated[PathVector, Entry("N", "the hand's force", FORCE_SCALE)]


_OF_SENSORS = (EncoderEntries, TorqueEntries, ForceEntries)
"""Entries that each kind of ``Sensors`` adds to those of the kinds before it."""

if TYPE_CHECKING:

    class Observation(EncoderEntries, TorqueEntries, ForceEntries):  # pyright: ignore[reportGeneralTypeIssues]
        ...

else:
    Observation = joined("Observation", *_OF_SENSORS)
    Observation.__doc__ = "All possible entries of an observation, except those of the context."

OBS: Observation = rows(Observation)
"""Places of the entries in an observation."""

ENTRIES = width(Observation)
"""Largest number of entries of an observation without those of the context."""


def observation_layout(
    machine: Machine | str | None, sensors: Sensors, told: Layout | None = None
) -> Layout:
    """Return the layout of the observation; entries are stored by their scales, within ±BOUND.

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
    kinds = get_args(Sensors)
    if sensors not in kinds:
        raise ParameterError(f"sensors must be one of {', '.join(kinds)}, got {sensors!r}")
    fields = _fields(find_machine(machine), kinds.index(sensors) + 1)
    return Layout((*fields, *(told.fields if told else ())))


@lru_cache(maxsize=64)
def _fields(machine: Machine, kinds: int) -> tuple[Field, ...]:
    """Return the entries of the first kinds of sensors."""
    return layout_of(Observation, machine).fields[: sum(map(width, _OF_SENSORS[:kinds]))]


class Reading(NamedTuple):
    """What sensors read at an instant."""

    theta: Annotated[PerLink, Entry("rad", "angle{}")]
    omega: Annotated[PerLink, Entry("rad/s", "angular velocity{}")]
    torque: Annotated[PerClutch, Entry("N·m", "generated torque{}")]
    force: Annotated[PathVector, Entry("N", "the hand's force{}")]


class Measurement(NamedTuple):
    """What sensors measure: the arm's motion, the tip's projection, torques and force."""

    motion: Motion
    foot: Foot
    torque: PerClutch
    force: PathVector


@inlined
def measurement_of(
    reading: Reading, arm: Linkage, arcs: Any, first: int, count: int, segment: int
) -> Measurement:
    """Return the measurement of a reading, for the chain of ``count`` arcs from ``first`` on.

    ``segment`` is the arc at which the search for the tip's projection begins.
    """
    a, b = unit_vector(reading.theta.a), unit_vector(reading.theta.b)
    q = Motion(
        reading.theta.a,
        reading.theta.b,
        reading.omega.a,
        reading.omega.b,
        a.cos,
        a.sin,
        b.cos,
        b.sin,
    )
    x, y = tip_position(arm, q)
    foot = project(arcs, first, count, segment, x, y)
    return Measurement(q, foot, reading.torque, reading.force)


@inlined
def observation(
    measured: Measurement,
    arm: Linkage,
    free: FreeBand,
    path_length: float,
    pace: float,
    volts: PerClutch,
) -> Observation:
    """Return all entries in their units."""
    q = measured.motion
    v_x, v_y = tip_velocity(arm, q)
    at = path_state(measured.foot, v_x, v_y, free)
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
        torque=measured.torque,  # pyright: ignore[reportCallIssue]
        force=measured.force,  # pyright: ignore[reportCallIssue]
    )
