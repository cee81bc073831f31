"""Chains of circular arcs: a path as data, with a continuous heading and normal at each joint.

A straight segment is an arc of curvature 0. Chains represent lines, arcs and rounded corners
exactly and any smooth curve to a tolerance, by pairs of arcs with the curve's points and headings
at their ends (biarcs; Bolton 1975).
"""

import cmath
import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pter_gym._compiled.compiler import inlined
from pter_gym._compiled.records import Entry, rows
from pter_gym._internal.fields import Checked
from pter_gym.errors import ParameterError

Array = NDArray[np.float64]

TOLERANCE = 1e-5
"""Largest distance of a fitted chain from its curve [m], at the points looked at."""

MAX_TURN = 1.5
"""Largest turn of one arc [rad]; longer ones are cut, so angles about a centre are unique."""

_MIN_SPAN = 1e-4
_CHECKS = 5


class ArcSegment(NamedTuple):
    """One arc."""

    x: Annotated[float, Entry("m", "where it begins")]
    y: Annotated[float, Entry("m", "where it begins")]
    heading_cos: Annotated[float, Entry("1", "cosine of the heading there")]
    heading_sin: Annotated[float, Entry("1", "sine of the heading there")]
    curvature: Annotated[float, Entry("1/m", "positive to the left")]
    start: Annotated[float, Entry("m", "arc length before it")]
    length: Annotated[float, Entry("m", "its arc length")]


SEGMENT = rows(ArcSegment)
"""Columns of a table of arcs."""


@dataclass(frozen=True)
class Arcs:
    """A chain of arcs.

    Attributes
    ----------
    table
        One ``ArcSegment`` in each row, shape (S, 7).
    """

    table: Array

    @property
    def length(self) -> float:
        """Total arc length [m]."""
        *_, start, length = self.table[-1].tolist()
        return start + length

    @property
    def max_curvature(self) -> float:
        """Largest absolute curvature [1/m]."""
        return float(np.abs(self.table[:, int(SEGMENT.curvature)]).max())

    def at(self, s: ArrayLike) -> tuple[Array, Array, Array, Array]:
        """Return x, y [m], heading [rad] and curvature [1/m] at arc lengths [m], also outside."""
        lengths = np.asarray(s, np.float64)
        numbers = np.searchsorted(self.table[1:, int(SEGMENT.start)], lengths, side="right")
        x, y, cos, sin, curvature, start, _ = np.moveaxis(self.table[numbers], -1, 0)
        along = lengths - start
        half = 0.5 * curvature * along
        chord = along * np.sinc(half / np.pi)
        heading = np.arctan2(sin, cos)
        return (
            x + chord * np.cos(heading + half),
            y + chord * np.sin(heading + half),
            heading + 2.0 * half,
            curvature,
        )

    @cached_property
    def extremes(self) -> Array:
        """Points of the chain [m], (3 S + 1, 2), including those nearest to and farthest from 0.

        They are the joints, and the points of each arc on the line through its centre and the
        origin.
        """
        x, y, cos, sin, curvature, start, length = self.table.T
        begin, heading = x + 1j * y, cos + 1j * sin
        bent = curvature != 0.0
        bend = np.where(bent, curvature, 1.0)
        turn: Array = np.angle((begin + 1j * heading / bend) / (-1j * heading / bend))
        turns = np.stack([turn, turn - np.copysign(np.pi, turn)])
        lined = start + np.clip(np.where(bent, turns / bend, -(x * cos + y * sin)), 0.0, length)
        x, y, _, _ = self.at(np.concatenate([start, lined.ravel(), [self.length]]))
        return np.stack([x, y], axis=1)


class Path(Checked, ABC):
    """A planar curve over its arc length s [m]; normal errors are positive to its left.

    A kind of path is a frozen dataclass that returns its arcs from ``make_arcs``.
    """

    @abstractmethod
    def make_arcs(self) -> Arcs:
        """Return this path as a chain of arcs."""

    @cached_property
    def arcs(self) -> Arcs:
        """The chain of arcs.

        Raises
        ------
        ParameterError
            If arcs cannot follow the path because it doubles back on itself or has a kink.
        """
        try:
            return self.make_arcs()
        except (ArithmeticError, RecursionError):
            raise ParameterError(
                f"path must be a smooth curve that arcs can follow, got {self!r:.400}"
            ) from None

    @property
    def length(self) -> float:
        """Total arc length [m]."""
        return self.arcs.length

    @property
    def max_curvature(self) -> float:
        """Largest absolute curvature [1/m]."""
        return self.arcs.max_curvature

    def point(self, s: float) -> tuple[float, float]:
        """Return the point (x, y) [m] at an arc length [m]."""
        x, y, _, _ = self.arcs.at(s)
        return float(x), float(y)

    def sampled(self, count: int) -> Array:
        """Return points at evenly spaced arc lengths from start to end [m], shape (count, 2)."""
        x, y, _, _ = self.arcs.at(np.linspace(0.0, self.length, count))
        return np.stack([x, y], axis=1)

    def heading(self, s: float) -> float:
        """Return the direction of travel [rad] at an arc length [m]."""
        return float(self.arcs.at(s)[2])

    def curvature(self, s: float) -> float:
        """Return the curvature [1/m], positive to the left, at an arc length [m]."""
        return float(self.arcs.at(s)[3])


Piece = tuple[complex, complex, float, float]
"""An arc without its place in a chain: start, unit heading, curvature [1/m], length [m]."""


def chain(pieces: Sequence[Piece]) -> Arcs:
    """Return a chain of consecutive arcs; those that turn too far are cut."""
    rows: list[ArcSegment] = []
    start = 0.0
    for begin, direction, curvature, length in pieces:
        point, heading = begin, direction
        count = arcs_needed(curvature, length)
        step = length / count
        for _ in range(count):
            place = point.real, point.imag, heading.real, heading.imag
            rows.append(ArcSegment(*place, curvature, start, step))
            point, heading = end_of(point, heading, curvature, step)
            start += step
    return Arcs(np.array(rows))


@inlined
def arcs_needed(curvature: float, length: float) -> int:
    """Return the number of arcs into which one is cut."""
    return max(1, math.ceil(abs(curvature) * length / MAX_TURN))


@inlined
def end_of(
    point: complex, heading: complex, curvature: float, length: float
) -> tuple[complex, complex]:
    """Return the end point and end heading of an arc from a point with a unit heading."""
    half = cmath.exp(0.5j * curvature * length)
    return point + heading * half * length * _sinc(0.5 * curvature * length), heading * (
        half * half
    )


@inlined
def _sinc(x: float) -> float:
    return math.sin(x) / x if x != 0.0 else 1.0


@inlined
def arc_between(begin: complex, heading: complex, end: complex) -> Piece:
    """Return the arc that leaves ``begin`` with a unit heading and ends in ``end``."""
    chord = (end - begin) * heading.conjugate()
    half = cmath.phase(chord)
    return begin, heading, 2.0 * math.sin(half) / abs(chord), abs(chord) / _sinc(half)


@inlined
def biarc(
    begin: complex, from_heading: complex, end: complex, to_heading: complex
) -> tuple[Piece, Piece]:
    """Return two arcs with a common heading between two points with unit headings.

    The control arms have equal lengths d, which solve 2d²(1 − h₀·h₁) + 2d·c·(h₀ + h₁) = c², where c
    is the chord.
    """
    chord = end - begin
    across = chord * (from_heading + to_heading).conjugate()
    square = abs(chord) ** 2
    bend = 2.0 * (1.0 - (from_heading * to_heading.conjugate()).real)
    arm = square / (across.real + math.sqrt(across.real**2 + bend * square))
    joint = 0.5 * (begin + end + arm * (from_heading - to_heading))
    first = arc_between(begin, from_heading, joint)
    _, _, curvature, length = first
    return first, arc_between(joint, from_heading * cmath.exp(1j * curvature * length), end)


ParametricCurve = Callable[[float], tuple[complex, complex]]
"""A smooth curve: parameter to point [m] and derivative."""


def fit_arcs(curve: ParametricCurve, knots: Sequence[float], sharpest: float = math.inf) -> Arcs:
    """Return arcs within ``TOLERANCE`` of a smooth curve whose parameter runs through the knots.

    Raises
    ------
    ArithmeticError
        If an arc has at least the curvature ``sharpest`` [1/m].
    """
    pieces: list[Piece] = []
    samples = ((knot, *curve(knot)) for knot in knots)
    for begin, end in pairwise(samples):
        _fit(curve, begin, end, sharpest, pieces)
    return chain(pieces)


Sample = tuple[float, complex, complex]
"""A parameter with the point [m] and the derivative of a curve there."""


def _fit(
    curve: ParametricCurve, begin: Sample, end: Sample, sharpest: float, pieces: list[Piece]
) -> None:
    """Append arcs along a part of a curve."""
    (t, p, dp), (u, q, dq) = begin, end
    pair = biarc(p, dp / abs(dp), q, dq / abs(dq))
    if abs(q - p) < _MIN_SPAN or _follows(pair, curve, t, u):
        for piece in pair:
            if abs(piece[2]) >= sharpest:
                raise ArithmeticError(f"it bends by {piece[2]:g} 1/m")
            pieces.append(piece)
    else:
        middle = 0.5 * (t + u)
        between = (middle, *curve(middle))
        _fit(curve, begin, between, sharpest, pieces)
        _fit(curve, between, end, sharpest, pieces)


def _follows(pair: tuple[Piece, Piece], curve: ParametricCurve, t: float, u: float) -> bool:
    """Return whether points of a curve between two parameters are all near one of two arcs."""
    first, second = pair
    for k in range(1, _CHECKS + 1):
        point, _ = curve(t + (u - t) * k / (_CHECKS + 1))
        if (
            _distance_from_arc(first, point) > TOLERANCE
            and _distance_from_arc(second, point) > TOLERANCE
        ):
            return False
    return True


def _distance_from_arc(piece: Piece, point: complex) -> float:
    """Return the distance of a point from a short arc, infinite where its foot is beyond it."""
    begin, heading, curvature, length = piece
    local = (point - begin) * heading.conjugate()
    radial = abs(1.0 - curvature * local.imag + 1j * curvature * local.real)
    turn = math.atan2(curvature * local.real, 1.0 - curvature * local.imag)
    along = turn / curvature if curvature != 0.0 else local.real
    if not -TOLERANCE <= along <= length + TOLERANCE:
        return math.inf
    return abs((2.0 * local.imag - curvature * abs(local) ** 2) / (1.0 + radial))
