"""The kinds of path."""

import cmath
import math
from bisect import bisect_right
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import count, pairwise
from types import MappingProxyType
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from pter_gym._internal.checks import builtin, is_finite
from pter_gym._internal.fields import parameter, require
from pter_gym._internal.files import TABLE_ENDINGS, FilePath, has_ending
from pter_gym._internal.tables import read_table
from pter_gym.errors import ParameterError, unknown_name
from pter_gym.paths._arcs import (
    TOLERANCE,
    Arcs,
    ParametricCurve,
    Path,
    Piece,
    arc_between,
    chain,
    fit_arcs,
)
from pter_gym.paths._names import PATH_NAMES

Complexes = NDArray[np.complex128]
Points = tuple[tuple[float, float], ...]

MAX_POINTS = 4096
"""Most waypoints of a path."""

MAX_COORDINATE = 1e3
"""Largest coordinate and size of a path [m]; further away, rounding spoils arcs."""

_ACROSS = "fitted: across the workspace"

WITHIN: dict[str, Any] = {"at_least": -MAX_COORDINATE, "at_most": MAX_COORDINATE}
SIZE: dict[str, Any] = {"above": 0.0, "at_most": MAX_COORDINATE}

DISTANCES = TOLERANCE * 10.0 ** (0.1 * np.arange(81.0))
"""Distances from its waypoints that are tried for a smoothing spline [m]."""

WEIGHTS = (-90.0, 20.0)
"""Logarithms of the weights of curvature, for paths of length 1, with which a spline passes through
its points, and with which it is straight."""

MAX_EVALUATIONS = 1 << 18
"""Most evaluations of a curve until arcs fit it; a zigzag through 1,000 points takes 50,000."""


@dataclass(frozen=True, kw_only=True)
class _Directed(Path):
    """A path that a point and a direction there place."""

    x: float = parameter("m", _ACROSS, **WITHIN, default=-0.6064)
    y: float = parameter("m", _ACROSS, **WITHIN, default=0.7809)
    direction: float = parameter("rad", "chosen: along the x axis", default=0.0)

    @property
    def _start(self) -> tuple[complex, complex]:
        return complex(self.x, self.y), cmath.rect(1.0, self.direction)


@dataclass(frozen=True, kw_only=True)
class Line(_Directed):
    """A straight path (paper section IV-A: "spanning the width of the workspace")."""

    length: float = parameter("m", _ACROSS, **SIZE, default=0.9829)  # pyright: ignore[reportIncompatibleMethodOverride]

    def make_arcs(self) -> Arcs:
        """Return one straight segment."""
        return chain([(*self._start, 0.0, self.length)])


@dataclass(frozen=True, kw_only=True)
class Arc(_Directed):
    """A circular arc from a point in a direction; it turns left with a positive angle."""

    radius: float = parameter("m", "chosen", above=0.0, default=0.4)
    angle: float = parameter(
        "rad", "chosen", at_least=-2.0 * math.pi, at_most=2.0 * math.pi, default=-1.0
    )

    def __post_init__(self) -> None:
        """Check that it turns."""
        super().__post_init__()
        require(self.angle != 0.0, self, "angle", "a turn other than 0")

    def make_arcs(self) -> Arcs:
        """Return the chain of one arc."""
        curvature = math.copysign(1.0 / self.radius, self.angle)
        return chain([(*self._start, curvature, self.radius * abs(self.angle))])


@dataclass(frozen=True, kw_only=True)
class Circle(Path):
    """One lap of a circle, counter-clockwise by default; ``start`` is its first point's angle."""

    center_x: float = parameter("m", "chosen", **WITHIN, default=0.0)
    center_y: float = parameter("m", "chosen", **WITHIN, default=0.55)
    radius: float = parameter("m", "chosen", **SIZE, default=0.15)
    start: float = parameter("rad", "chosen", default=-0.5 * math.pi)
    clockwise: bool = parameter("1", "chosen", default=False)

    def make_arcs(self) -> Arcs:
        """Return the chain of one arc that closes."""
        turn = -1.0 if self.clockwise else 1.0
        outward = cmath.rect(1.0, self.start)
        begin = complex(self.center_x, self.center_y) + self.radius * outward
        return chain(
            [(begin, turn * 1j * outward, turn / self.radius, 2.0 * math.pi * self.radius)]
        )


@dataclass(frozen=True, kw_only=True)
class Sine(_Directed):
    """A sine about a straight axis: ``amplitude·sin(2π·periods·ξ/extent)`` to its left at ξ."""

    extent: float = parameter("m", _ACROSS, **SIZE, default=0.9829)
    amplitude: float = parameter("m", "chosen", **WITHIN, default=0.03)
    periods: float = parameter("1", "chosen", above=0.0, at_most=20.0, default=1.0)

    def make_arcs(self) -> Arcs:
        """Return arcs through points of the sine."""
        wave = 2.0 * math.pi * self.periods / self.extent
        begin, axis = self._start

        def curve(along: float) -> tuple[complex, complex]:
            angle = wave * along
            return (
                begin + axis * complex(along, self.amplitude * math.sin(angle)),
                axis * complex(1.0, self.amplitude * wave * math.cos(angle)),
            )

        knots = np.linspace(0.0, self.extent, math.ceil(4.0 * self.periods) + 1)
        return _fitted(self, curve, knots.tolist())


@dataclass(frozen=True, kw_only=True)
class Spline(Path):
    """A natural cubic spline through waypoints (x, y) [m], parametrised by chord length.

    With ``smooth`` it may deviate from the waypoints by up to that many metres (root mean square)
    in x and in y, to remove the noise of a recorded path. Of the natural smoothing splines within
    that distance it is the one whose sharpest bend is widest, as narrow hairpins get sharper at
    larger distances.
    """

    points: Points = parameter("m", "chosen")
    smooth: float = parameter(
        "m", "chosen: 0 passes through all", at_least=0.0, default=0.0, later=True
    )

    def __post_init__(self) -> None:
        """Check that there are two different finite points or more, and none twice in a row."""
        super().__post_init__()
        check_points(self)

    def make_arcs(self) -> Arcs:
        """Return arcs through points of the spline."""
        from scipy import interpolate

        points = np.array(self.points) @ [1.0, 1.0j]
        knots = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(points)))]).tolist()
        if len(knots) == 2:
            return chain([arc_between(points[0], (points[1] - points[0]) / knots[1], points[1])])

        def curve(t: float) -> tuple[complex, complex]:
            piece = min(bisect_right(knots, t), len(knots) - 1) - 1
            a, b, c, d = coefficients[piece]
            u = t - knots[piece]
            return ((a * u + b) * u + c) * u + d, (3.0 * a * u + 2.0 * b) * u + c

        found: list[Arcs] = []
        for distance in (*DISTANCES[self.smooth >= DISTANCES][::-1].tolist(), 0.0):
            near = smoothed(knots, points, distance) if distance else points
            coefficients: Any = interpolate.CubicSpline(knots, near, bc_type="natural").c.T.tolist()
            try:
                sharpest = found[-1].max_curvature if found else math.inf
                found.append(_fitted(self, curve, knots, sharpest))
            except ParameterError:
                if not distance and not found:
                    raise
        return found[-1]


def smoothed(knots: Sequence[float], points: Complexes, distance: float) -> Complexes:
    """Return waypoints x + iy, (N,), moved by a root mean square distance in x and in y [m].

    A natural cubic spline through them has the smallest integral of squared second derivatives
    (Reinsch 1967); where the distance is beyond that of the straight line that fits best, they are
    on this line.
    """
    from scipy import linalg, optimize

    steps = np.diff(knots) / knots[-1]
    left, right = 1.0 / steps[:-1], 1.0 / steps[1:]
    middle = -(left + right)
    bends = np.diff(np.diff(points) / steps)
    spline, squares = np.zeros((2, 3, len(bends)))  # three diagonals, the main one last
    spline[2], spline[1, 1:] = (steps[:-1] + steps[1:]) / 3.0, steps[1:-1] / 6.0
    squares[2] = left**2 + middle**2 + right**2
    squares[1, 1:] = middle[:-1] * left[1:] + right[:-1] * middle[1:]
    squares[0, 2:] = right[:-2] * left[2:]

    def moves(log_weight: float) -> Complexes:
        weight = math.exp(log_weight)
        second = cast("Complexes", linalg.solveh_banded(spline + weight * squares, weight * bends))
        moved = np.zeros_like(points)
        for k, factor in enumerate((left, middle, right)):
            moved[k : k + len(second)] += factor * second
        return moved

    def excess(log_weight: float) -> float:
        return float(np.linalg.norm(moves(log_weight))) / math.sqrt(2 * len(points)) - distance

    if excess(WEIGHTS[0]) >= 0.0:
        return points
    if excess(WEIGHTS[1]) <= 0.0:
        return points - moves(WEIGHTS[1])
    return points - moves(cast("float", optimize.brentq(excess, *WEIGHTS, xtol=1e-9)))


@dataclass(frozen=True, kw_only=True)
class Polyline(Path):
    """Straight lines between points (x, y) [m], with corners rounded by arcs of one radius [m]."""

    points: Points = parameter("m", "chosen")
    radius: float = parameter("m", "chosen", above=0.0, default=0.05)

    def __post_init__(self) -> None:
        """Check the points, and that the rounded corners fit between them."""
        super().__post_init__()
        check_points(self)
        self.make_arcs()

    def make_arcs(self) -> Arcs:
        """Return alternating lines and arcs."""
        corners = [complex(*point) for point in self.points]
        headings = [(b - a) / abs(b - a) for a, b in pairwise(corners)]
        turns = [*(cmath.phase(b / a) for a, b in pairwise(headings)), 0.0]
        ends = zip(corners[1:], headings, [*headings[1:], headings[-1]], turns, strict=True)
        pieces: list[Piece] = []
        begin = corners[0]
        for corner, heading, following, turn in ends:
            cut = self.radius * math.tan(0.5 * abs(turn))
            straight = ((corner - begin) * heading.conjugate()).real - cut
            require(
                straight >= 0.0 and abs(turn) < math.pi - 1e-6,
                self,
                "radius",
                "small enough for the rounded corners to fit between the points",
            )
            pieces.append((begin, heading, 0.0, straight))
            curvature = math.copysign(1.0 / self.radius, turn)
            pieces.append((corner - cut * heading, heading, curvature, self.radius * abs(turn)))
            begin = corner + cut * following
        return chain([piece for piece in pieces if piece[3] > 0.0])


def _fitted(
    path: Path, curve: ParametricCurve, knots: Sequence[float], sharpest: float = math.inf
) -> Arcs:
    """Return arcs along a curve, or raise a ParameterError if it turns back or needs too many."""
    looks = count(1)

    def counted(t: float) -> tuple[complex, complex]:
        if next(looks) > MAX_EVALUATIONS:
            raise ArithmeticError(f"it takes more than {MAX_EVALUATIONS} evaluations of the curve")
        return curve(t)

    try:
        return fit_arcs(counted, knots, sharpest)
    except (ArithmeticError, ValueError) as error:
        raise ParameterError(
            f"{type(path).__name__} must be a smooth curve that never turns back on itself, of "
            f"numbers neither too large nor too small ({error}), got {path!r:.400}"
        ) from None


def check_points(path: "Spline | Polyline") -> None:
    """Turn points into tuples; raise a ParameterError unless they can be waypoints of a path."""
    plain = cast(object, _plain(path.points))
    points = cast("tuple[Any, ...]", plain if isinstance(plain, tuple) else ())
    object.__setattr__(path, "points", points)
    accepted = (
        f"2 to {MAX_POINTS} points (x, y) of finite numbers up to {MAX_COORDINATE:g} m, "
        "none twice in a row"
    )
    require(2 <= len(points) <= MAX_POINTS, path, "points", accepted)
    if fault := fault_in(points, lambda k: f"point {k}"):
        raise ParameterError(f"{type(path).__name__}.points must be {accepted}: {fault}")


def _plain(value: Any) -> Any:
    """Return points as tuples of Python's numbers: they may be lists, arrays, NumPy's numbers."""
    rows = value.tolist() if isinstance(value, np.ndarray) else value
    several = isinstance(rows, list | tuple)
    return tuple(map(_plain, cast("list[Any]", rows))) if several else builtin(rows)


def fault_in(points: Sequence[Any], label: Callable[[int], str]) -> str | None:
    """Describe the first point that a path cannot have, or return None; ``label`` names points."""
    for k, point in enumerate(points):
        pair = cast("tuple[Any, ...]", point) if isinstance(point, tuple) else ()
        if len(pair) != 2 or not all(map(is_finite, pair)):
            return f"{label(k)} must be a pair of finite numbers, got {point!r:.100}"
        for name, value in zip("xy", pair, strict=True):
            if abs(value) > MAX_COORDINATE:
                return f"{label(k)} is too far away: {name} = {value:g} m"
        if k > 0 and math.dist(points[k - 1], pair) <= 1e-9:
            return f"{label(k)} repeats {label(k - 1)}"
    return None


def read_path(file: FilePath, *, smooth: float = 0.0) -> Spline:
    """Return the spline through the points of a CSV file with the columns ``x`` and ``y`` [m].

    Files may have names such as ``x_m`` or none, in a comment or not, columns separated by commas
    or semicolons, decimal commas with semicolons, and further columns.

    Parameters
    ----------
    file
        The file.
    smooth
        Distance by which the path may deviate from the points [m], see ``Spline``.

    Raises
    ------
    ParameterError
        If the file cannot be read, a column is missing, a number is not finite, there are fewer
        than two points, a point occurs twice in a row, or the spline turns back on itself; it names
        the line.
    """
    columns, lines, _ = read_table(file, ("x", "y"), unit="m")
    points = tuple(zip(columns["x"].tolist(), columns["y"].tolist(), strict=True))
    if fault := fault_in(points, lambda k: f"line {lines[k]}"):
        raise ParameterError(f"{file}, {fault}")
    try:
        path = Spline(points=points, smooth=smooth)
        _ = path.arcs  # raises where there are none
        return path
    except ParameterError as error:
        raise ParameterError(f"{file}: {error}") from None


PATHS: Mapping[str, Path] = MappingProxyType(
    dict(zip(PATH_NAMES, (Line(), Arc(), Circle(), Sine()), strict=True))
)
"""Paths by name."""


def find_path(path: Path | FilePath) -> Path:
    """Return a path, given as an object, a name in ``PATHS``, or a file for ``read_path``.

    If there is none, raise a ParameterError that lists the names.
    """
    shape = builtin(path)
    if isinstance(shape, Path):
        return shape
    if isinstance(shape, str) and has_ending(shape, *TABLE_ENDINGS):
        return read_path(shape)
    if not isinstance(shape, str) or shape not in PATHS:
        raise unknown_name("path", shape, (*PATHS, "FILE.csv"))
    return PATHS[shape]
