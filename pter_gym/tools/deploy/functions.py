"""What a controller computes before its law acts: angles, and the observation of a path.

This Python is translated to C with the laws; so are the sine, cosine and arctangent that it needs.
"""

import math
from typing import Any, NamedTuple

from pter_gym._compiled.compiler import inlined
from pter_gym._compiled.records import entrywise, write
from pter_gym._engine.command import clipped
from pter_gym._physics.arm import Linkage
from pter_gym._physics.clutch import PerClutch
from pter_gym._physics.scalars import clamp
from pter_gym.paths._arcs import SEGMENT
from pter_gym.paths._projection import SEGMENT_WIDTH
from pter_gym.tasks.path_following._observation import (
    BOUND,
    OBS,
    Observation,
    Reading,
    measurement_of,
    observation,
)
from pter_gym.tasks.path_following._position import NO_BAND

HALF_PI, HALF_PI_REST = 1.5703125, 0.00048382679489661923
"""π/2 in two parts, the first of 8 bits, so small multiples of it are exact."""


class Encoder(NamedTuple):
    """A joint encoder's reading: angle [rad] and angular velocity [rad/s]."""

    theta: float
    omega: float


@inlined
def encoder(count: int, change: int, resolution: float, zero: float, period: float) -> Encoder:
    """Return angle and angular velocity from an encoder's count and its change in a period [s].

    ``resolution`` is the angle of a count and ``zero`` that of count 0 [rad].
    """
    return Encoder(zero + resolution * count, resolution * change / period)


@inlined
def series(x: float, first: float, start: int) -> float:
    """Return the sine (first = x, start = 1) or cosine (first = 1, start = 0) for |x| ≤ π/4."""
    found = first
    term = first
    for k in range(start + 1, start + 18, 2):
        term = -term * x * x / (k * (k + 1.0))
        found += term
    return found


@inlined
def sine_ahead(angle: float, quarters: int) -> float:
    """Return the sine of an angle [rad] of at most a few hundred turns, so many quarters ahead."""
    k = int(angle / (HALF_PI + HALF_PI_REST) + (0.5 if angle >= 0.0 else -0.5))
    x = angle - k * HALF_PI - k * HALF_PI_REST
    turn = ((k + quarters) % 4 + 4) % 4  # in C the remainder of a negative number is negative
    size = series(x, 1.0, 0) if turn % 2 != 0 else series(x, x, 1)
    return size if turn < 2 else -size


@inlined
def sine(angle: float) -> float:
    """Return the sine of an angle [rad]."""
    return sine_ahead(angle, 0)


@inlined
def cosine(angle: float) -> float:
    """Return the cosine of an angle [rad]."""
    return sine_ahead(angle, 1)


@inlined
def arctangent(y: float, x: float) -> float:
    """Return the angle of (x, y) [rad], halved three times before the series; 0 for (0, 0)."""
    turned = 0.0
    if x < 0.0:
        turned = (
            2.0 * HALF_PI + 2.0 * HALF_PI_REST if y >= 0.0 else -2.0 * HALF_PI - 2.0 * HALF_PI_REST
        )
        x = -x
        y = -y
    reach = x + math.sqrt(x * x + y * y)
    t = y / reach if reach > 0.0 else 0.0
    t = t / (1.0 + math.sqrt(1.0 + t * t))
    t = t / (1.0 + math.sqrt(1.0 + t * t))
    angle = 0.0
    for k in range(21, 0, -2):
        angle = 1.0 / k - t * t * angle
    return turned + 8.0 * t * angle


@entrywise
@inlined
def scaled(value: float, inverse_scale: float) -> float:
    """Return an entry of an observation as a policy sees it."""
    return clamp(value * inverse_scale, -BOUND, BOUND)


@inlined
def observe(
    reading: Reading,
    volts: PerClutch,
    arcs: Any,
    count: int,
    segment: int,
    pace: float,
    arm: Linkage,
    inverse_scale: Observation,
    out: Any,
) -> int:
    """Write the observation of a reading on a path, and return the arc that the tip is on.

    It is that of the simulator with sensors that are not ideal, for a path without a free band.
    ``segment`` is the arc that the tip was on before.
    """
    measured = measurement_of(reading, arm, arcs, 0, count, segment)
    last = (count - 1) * SEGMENT_WIDTH
    length = arcs[last + SEGMENT.start] + arcs[last + SEGMENT.length]
    observed = observation(measured, arm, NO_BAND, length, pace, volts)
    write(out, OBS, scaled(observed, inverse_scale))
    return int(measured.foot.segment)


@inlined
def command(
    law: Any, obs: Any, scales: Any, gains: Any, memory: Any, voltage_max: float
) -> PerClutch:
    """Return the voltages [V] for the clutches: those of a law, clipped to the bounds."""
    return clipped(law(obs, scales, gains, memory), voltage_max)
