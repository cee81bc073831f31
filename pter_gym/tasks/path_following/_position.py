"""Where the tip is on its path, and how fast it moves along and across it."""

from typing import Annotated, NamedTuple

from pter_gym._compiled.compiler import inlined
from pter_gym._compiled.records import Entry
from pter_gym._physics.arm import UnitVector, Vector, components
from pter_gym._physics.scalars import clamp
from pter_gym.paths._projection import Foot


class PathVector(NamedTuple):
    """A vector by its components along and across the path."""

    along: Annotated[float, Entry("", "{} along the path")]
    across: Annotated[float, Entry("", "{} across the path, positive to its left")]


class FreeBand(NamedTuple):
    """The band along the path within which the tip is free: a virtual fixture.

    Without width it is the path.
    """

    right: Annotated[float, Entry("m", "width of the free band to the right of the path")]
    left: Annotated[float, Entry("m", "width of the free band to the left of the path")]


NO_BAND = FreeBand(0.0, 0.0)


class PathState(NamedTuple):
    """The tip relative to the path at a control instant [m, 1/m, m/s].

    ``offset`` is its distance from the path, ``normal_error`` that from the free band, both
    positive to the left.
    """

    arc_length: float
    offset: float
    normal_error: float
    heading: UnitVector
    curvature: float
    speed: PathVector


@inlined
def path_state(foot: Foot, v_x: float, v_y: float, free: FreeBand) -> PathState:
    """Return the tip's state relative to its path, from its projection and velocity [m/s]."""
    speed = to_path(Vector(v_x, v_y), foot.heading)
    beyond = beyond_band(foot.normal_error, free)
    return PathState(
        foot.arc_length, foot.normal_error, beyond, foot.heading, foot.curvature, speed
    )


@inlined
def beyond_band(offset: float, free: FreeBand) -> float:
    """Return how far the tip is beyond the free band [m], from its offset to the path's left."""
    return offset - clamp(offset, -free.right, free.left)


@inlined
def to_path(vector: Vector, heading: UnitVector) -> PathVector:
    """Return the components of a vector along and across a path with a heading."""
    along, across = components(vector, heading)
    return PathVector(along, across)


@inlined
def to_world(vector: PathVector, heading: UnitVector) -> Vector:
    """Return a vector given by its components along and across a path with a heading."""
    return Vector(
        vector.along * heading.cos - vector.across * heading.sin,
        vector.along * heading.sin + vector.across * heading.cos,
    )
