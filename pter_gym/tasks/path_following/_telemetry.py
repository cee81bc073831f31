"""The telemetry: the record of each control step, for people, scores and plots. All entries are in their units."""

from dataclasses import replace
from typing import Annotated, NamedTuple

from pter_gym._compiled.layout import Layout
from pter_gym._compiled.records import Entry, layout_of, rows, width
from pter_gym._physics.arm import PerLink, Vector
from pter_gym._physics.clutch import PerClutch
from pter_gym._physics.step import Energy
from pter_gym.tasks.path_following._context import Told
from pter_gym.tasks.path_following._reward import Terms


class Telemetry(NamedTuple):
    """What a control step records."""

    time: Annotated[float, Entry("s", "time since the start of the episode")]
    theta: Annotated[PerLink, Entry("rad", "angle")]
    tip: Annotated[Vector, Entry("m", "the tip's position")]
    tip_velocity: Annotated[Vector, Entry("m/s", "the tip's velocity")]
    acceleration: Annotated[Vector, Entry("m/s²", "the tip's acceleration, mean over the control period")]
    arc_length: Annotated[float, Entry("m", "arc length of the tip's projection on the path")]
    reached: Annotated[float, Entry("m", "largest arc length so far")]
    normal_error: Annotated[float, Entry("m", "distance from the path, positive to its left")]
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
    context: Annotated[float, Entry("1", "number of the drawn machine and task, 0 where none is drawn")]
    terminated: Annotated[float, Entry("1", "1 at the end of the path and on leaving the workspace")]
    told: Told


COLUMN = rows(Telemetry)
"""Columns of the telemetry: ``rows[..., COLUMN.time]``, ``rows[..., [*COLUMN.tip]]``."""

COLUMNS = width(Telemetry)
"""Numbers that a control step records."""

TELEMETRY = Layout(tuple(replace(field, scale=1.0) for field in layout_of(Telemetry).fields))
"""Layout of the telemetry."""
