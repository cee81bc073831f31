"""Projection of a moving point onto a chain of arcs, for the kernels.

The flat array of constants holds the chain, an ``ArcSegment`` for each arc. A point keeps its arc
and moves to a neighbour when its foot leaves that arc. Neighbours share a normal at their joint, so
the foot moves continuously while the point stays nearer to the path than its centre of curvature.
"""

import math
from typing import Annotated, NamedTuple

from pter_gym._compiled.compiler import inlined
from pter_gym._compiled.records import Entry, Records, read, width
from pter_gym._physics.arm import UnitVector
from pter_gym._physics.scalars import clamp
from pter_gym.paths._arcs import SEGMENT, ArcSegment

SEGMENT_WIDTH = width(ArcSegment)


class Foot(NamedTuple):
    """Projection of a point onto a path."""

    arc_length: Annotated[float, Entry("m", "arc length of the tip's projection on the path")]
    normal_error: Annotated[float, Entry("m", "distance from the path, positive to its left")]
    heading: Annotated[UnitVector, Entry("1", "the path's heading at the tip's projection")]
    curvature: Annotated[float, Entry("1/m", "curvature of the path there, positive to the left")]
    segment: Annotated[float, Entry("1", "number of the arc that holds the projection")]


@inlined
def segment_at(constants: Records, first: int, segment: int) -> ArcSegment:
    """Read an arc of the chain that begins at ``first`` in the constants."""
    return read(constants, SEGMENT, first + segment * SEGMENT_WIDTH)


@inlined
def foot_on(arc: ArcSegment, segment: int, x: float, y: float) -> Foot:
    """Return the projection of a point (x, y) [m] onto an arc that is extended beyond its ends."""
    from_x = x - arc.x
    from_y = y - arc.y
    along = from_x * arc.heading_cos + from_y * arc.heading_sin
    left = from_y * arc.heading_cos - from_x * arc.heading_sin
    k = arc.curvature
    if k == 0.0:
        return Foot(
            arc.start + along, left, UnitVector(arc.heading_cos, arc.heading_sin), k, segment
        )
    radial = 1.0 - k * left
    tangential = k * along
    reach = math.sqrt(radial * radial + tangential * tangential)
    cos = radial / reach if reach > 0.0 else 1.0
    sin = tangential / reach if reach > 0.0 else 0.0
    return Foot(
        arc.start + math.atan2(tangential, radial) / k,
        (2.0 * left - k * (along * along + left * left)) / (1.0 + reach),
        UnitVector(
            arc.heading_cos * cos - arc.heading_sin * sin,
            arc.heading_sin * cos + arc.heading_cos * sin,
        ),
        k,
        segment,
    )


@inlined
def neighbour(arc: ArcSegment, segment: int, count: int, s: float, direction: int) -> int:
    """Return 1 or −1 if a foot at the arc length s [m] leaves for the next or last arc, else 0.

    A foot that has gone in one ``direction`` does not turn back.
    """
    ahead = (s > arc.start + arc.length) & (segment < count - 1) & (direction >= 0)
    behind = (s < arc.start) & (segment > 0) & (direction <= 0)
    return 1 if ahead else -1 if behind else 0


@inlined
def project(constants: Records, first: int, count: int, segment: int, x: float, y: float) -> Foot:
    """Project a point (x, y) [m] onto a chain of ``count`` arcs, from the arc that it was on.

    Beyond the ends of the chain, its first and last arc are extended.
    """
    foot = foot_on(segment_at(constants, first, segment), segment, x, y)
    direction = 0
    for _ in range(count):
        arc = segment_at(constants, first, segment)
        direction = neighbour(arc, segment, count, foot.arc_length, direction)
        if direction == 0:
            break
        segment = int(clamp(segment + direction, 0, count - 1))  # no change; for proofs of C
        foot = foot_on(segment_at(constants, first, segment), segment, x, y)
    return foot


@inlined
def segment_of(constants: Records, first: int, count: int, s: float) -> int:
    """Return the number of the arc that contains an arc length [m]."""
    low = 0
    high = count - 1
    while low < high:
        middle = (low + high + 1) // 2
        if constants[first + middle * SEGMENT_WIDTH + SEGMENT.start] <= s:
            low = middle
        else:
            high = middle - 1
    return low


@inlined
def point_at(constants: Records, first: int, count: int, s: float) -> tuple[float, float]:
    """Return the point (x, y) [m] at an arc length [m]; first and last arc are extended."""
    arc = segment_at(constants, first, segment_of(constants, first, count, s))
    along = s - arc.start
    half = 0.5 * arc.curvature * along
    chord = along * (math.sin(half) / half if half != 0.0 else 1.0)
    cos = math.cos(half)
    sin = math.sin(half)
    return (
        arc.x + chord * (arc.heading_cos * cos - arc.heading_sin * sin),
        arc.y + chord * (arc.heading_sin * cos + arc.heading_cos * sin),
    )
