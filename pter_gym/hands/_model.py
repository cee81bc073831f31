"""The hand as the kernels see it: its constants, and the sines that disturb the tip."""

import math
from typing import Annotated, NamedTuple

from pter_gym._compiled.compiler import inlined
from pter_gym._compiled.records import Entry
from pter_gym._physics.arm import UnitVector


class PerSine(NamedTuple):
    """One number for each sine."""

    n0: Annotated[float, Entry("", "{} of sine 0", name="0")]
    n1: Annotated[float, Entry("", "{} of sine 1", name="1")]
    n2: Annotated[float, Entry("", "{} of sine 2", name="2")]
    n3: Annotated[float, Entry("", "{} of sine 3", name="3")]
    n4: Annotated[float, Entry("", "{} of sine 4", name="4")]


class Sines(NamedTuple):
    """A unit vector for each sine."""

    n0: Annotated[UnitVector, Entry("", "{} of sine 0", name="0")]
    n1: Annotated[UnitVector, Entry("", "{} of sine 1", name="1")]
    n2: Annotated[UnitVector, Entry("", "{} of sine 2", name="2")]
    n3: Annotated[UnitVector, Entry("", "{} of sine 3", name="3")]
    n4: Annotated[UnitVector, Entry("", "{} of sine 4", name="4")]


class HandModel(NamedTuple):
    """Constants of one hand."""

    push: Annotated[float, Entry("N", "constant force along the path")]
    random_phases: Annotated[float, Entry("1", "1 if a reset draws the phases of the sines")]
    intent_speed: Annotated[float, Entry("m/s", "speed of the intended point, 0 for none")]
    intent_rise: Annotated[float, Entry("s", "time in which the intent gathers speed")]
    intent_lead: Annotated[float, Entry("m", "how far the intent may run ahead of the tip")]
    record_first: Annotated[float, Entry("1", "where the hand's recording begins in the constants")]
    record_count: Annotated[float, Entry("1", "instants of the hand's recording, 0 for none")]
    amplitude: Annotated[PerSine, Entry("N", "amplitude")]
    phase: Annotated[PerSine, Entry("rad", "starting phase")]
    half_turn: Annotated[Sines, Entry("1", "the turn in half a substep")]


SINES = len(PerSine._fields)
"""Number of sines in the disturbance (paper Eq. 5)."""

_NO_SINES = PerSine(0.0, 0.0, 0.0, 0.0, 0.0)
_STILL = Sines(*(UnitVector(1.0, 0.0),) * SINES)

NO_FORCE = HandModel(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, _NO_SINES, _NO_SINES, _STILL)
"""A hand that does nothing by itself."""


@inlined
def intent_speed(time: float, rise: float, speed: float) -> float:
    """Return the speed of the intended point [m/s]: from rest with minimum jerk, then constant."""
    u = time / rise
    return speed * (u * u * (3.0 - 2.0 * u) if u < 1.0 else 1.0)


@inlined
def unit_vector(angle: float) -> UnitVector:
    """Return cosine and sine of an angle [rad]."""
    return UnitVector(math.cos(angle), math.sin(angle))


@inlined
def turned(vector: UnitVector, by: UnitVector) -> UnitVector:
    """Turn a unit vector by another one."""
    return UnitVector(
        vector.cos * by.cos - vector.sin * by.sin, vector.sin * by.cos + vector.cos * by.sin
    )


@inlined
def renewed(vector: UnitVector) -> UnitVector:
    """Bring a unit vector back to unit length."""
    scale = 1.5 - 0.5 * (vector.cos * vector.cos + vector.sin * vector.sin)
    return UnitVector(vector.cos * scale, vector.sin * scale)


@inlined
def sum_of_sines(amplitude: PerSine, sines: Sines) -> float:
    """Return the disturbance [N] (paper Eq. 5)."""
    total = 0.0
    for k in range(SINES):
        total += amplitude[k] * sines[k].sin
    return total


@inlined
def advance_sines(sines: Sines, turn: Sines) -> Sines:
    """Advance sines by rotations."""
    return Sines(
        turned(sines.n0, turn.n0),
        turned(sines.n1, turn.n1),
        turned(sines.n2, turn.n2),
        turned(sines.n3, turn.n3),
        turned(sines.n4, turn.n4),
    )


@inlined
def renew_sines(sines: Sines) -> Sines:
    """Bring the unit vectors of sines back to unit length."""
    return Sines(
        renewed(sines.n0),
        renewed(sines.n1),
        renewed(sines.n2),
        renewed(sines.n3),
        renewed(sines.n4),
    )
