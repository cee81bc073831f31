"""The position of a world relative to its path, and when an episode ends."""

import math
from typing import Annotated, NamedTuple

from pter_gym._compiled.compiler import device
from pter_gym._compiled.records import Entry
from pter_gym._physics.arm import Linkage, Motion, UnitVector, Vector, sin_difference
from pter_gym.paths._projection import Foot


class PathVector(NamedTuple):
    """A vector by its components along and across the path."""

    along: Annotated[float, Entry("", "{} along the path")]
    across: Annotated[float, Entry("", "{} across the path, positive to its left")]


class Situation(NamedTuple):
    """The position of a world relative to its path at a control instant [m, 1/m, m/s]."""

    arc_length: float
    normal_error: float
    heading: UnitVector
    curvature: float
    speed: PathVector


@device
def situation(foot: Foot, v_x: float, v_y: float) -> Situation:
    """Return the situation of a world from the projection of its tip and the tip's velocity [m/s]."""
    return Situation(
        foot.arc_length, foot.normal_error, foot.heading, foot.curvature, to_path(Vector(v_x, v_y), foot.heading)
    )


@device
def to_path(vector: Vector, heading: UnitVector) -> PathVector:
    """Return the components of a vector along and across a path with a heading."""
    return PathVector(
        vector.x * heading.cos + vector.y * heading.sin,
        vector.y * heading.cos - vector.x * heading.sin,
    )


@device
def to_world(vector: PathVector, heading: UnitVector) -> Vector:
    """Return a vector given by its components along and across a path with a heading."""
    return Vector(
        vector.along * heading.cos - vector.across * heading.sin,
        vector.along * heading.sin + vector.across * heading.cos,
    )


@device
def reached_end(arc_length: float, path_length: float) -> bool:
    """Tell whether the tip has reached the end of the path."""
    return arc_length >= path_length


@device
def strayed(arc_length: float, normal_error: float, furthest: float) -> bool:
    """Tell whether the tip is further than ``furthest`` [m] from the path, or that far behind its start."""
    return (abs(normal_error) > furthest) | (arc_length < -furthest)


@device
def singular(q: Motion, margin: float) -> bool:
    """Tell whether |sin(θA − θB)| is below the margin or NaN."""
    return not abs(sin_difference(q)) >= margin


@device
def too_fast(kinetic_energy: float, energy_max: float) -> bool:
    """Tell whether the arm has more kinetic energy [J] than the integrator can hold, or NaN."""
    return not kinetic_energy <= energy_max


@device
def motion_at(arm: Linkage, x: float, y: float) -> Motion:
    """Return the arm at rest with the tip at (x, y) [m]; θB leads θA."""
    cos = (x * x + y * y - arm.length_a * arm.length_a - arm.length_b * arm.length_b) / (
        2.0 * arm.length_a * arm.length_b
    )
    sin = math.sqrt(1.0 - cos * cos)
    re = arm.length_a + arm.length_b * cos
    im = arm.length_b * sin
    square = x * x + y * y
    cos_a = (x * re + y * im) / square
    sin_a = (y * re - x * im) / square
    cos_b = cos_a * cos - sin_a * sin
    sin_b = sin_a * cos + cos_a * sin
    return Motion(math.atan2(sin_a, cos_a), math.atan2(sin_b, cos_b), 0.0, 0.0, cos_a, sin_a, cos_b, sin_b)
