"""The geometry of arcs, each function against circles by their centres."""

import cmath
import math
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from pter_gym._physics.arm import UnitVector
from pter_gym.errors import ParameterError
from pter_gym.paths import Arc, Circle, Line, Polyline, Sine, Spline
from pter_gym.paths._arcs import (
    MAX_TURN,
    SEGMENT,
    ArcSegment,
    _distance_from_arc,
    arc_between,
    arcs_needed,
    biarc,
    chain,
    end_of,
    fit_arcs,
)
from pter_gym.paths._projection import foot_on, point_at, project, segment_of

DRAWS = range(12)


def circle(seed: int) -> tuple[complex, float, float, float]:
    """Centre, signed radius (positive to the left), the angle of a point from the centre, and a
    turn from there."""
    rng = np.random.default_rng([8, seed])
    side = 1.0 if seed % 2 else -1.0
    return (
        complex(*rng.normal(size=2)),
        side * rng.uniform(0.2, 3.0),
        rng.uniform(-3.0, 3.0),
        rng.uniform(0.1, 1.4),
    )


def on(centre: complex, radius: float, angle: float) -> tuple[complex, complex]:
    """Point and heading of the circle at an angle, that of its centre where the radius is
    positive."""
    outward = cmath.rect(1.0, angle)
    return centre + abs(radius) * outward, math.copysign(1.0, radius) * 1j * outward


@pytest.mark.parametrize("seed", DRAWS)
def test_an_arc_ends_on_its_circle(seed: int):
    centre, radius, angle, turn = circle(seed)
    begin, heading = on(centre, radius, angle)
    end, then = on(centre, radius, angle + math.copysign(turn, radius))
    assert end_of(begin, heading, 1.0 / radius, abs(radius) * turn) == pytest.approx((end, then))
    _, _, curvature, length = arc_between(begin, heading, end)
    assert (curvature, length) == pytest.approx((1.0 / radius, abs(radius) * turn))


@pytest.mark.parametrize("seed", DRAWS)
def test_the_nearest_and_the_farthest_point_are_among_the_extremes(seed: int):
    rng = np.random.default_rng([10, seed])
    curvatures = rng.permutation([0.0, 0.0, *rng.uniform(-4.0, 4.0, 3)])
    begin, heading = complex(*rng.normal(size=2)), cmath.rect(1.0, rng.uniform(-3.0, 3.0))
    pieces: list[tuple[complex, complex, float, float]] = []
    for curvature, length in zip(curvatures, rng.uniform(0.1, 1.5, 5), strict=True):
        pieces.append((begin, heading, curvature, length))
        begin, heading = end_of(begin, heading, curvature, length)
    arcs = chain(pieces)
    step = arcs.length / 50_000
    x, y, _, _ = arcs.at(np.linspace(0.0, arcs.length, 50_001))
    found, dense = np.hypot(*arcs.extremes.T), np.hypot(x, y)
    assert dense.min() - step / 2 < found.min() < dense.min() + 1e-12
    assert dense.max() - 1e-12 < found.max() < dense.max() + step / 2


def test_the_extremes_of_a_circle_about_the_origin_are_on_it():
    points = Circle(center_y=0.0, radius=0.3).arcs.extremes
    assert np.hypot(*points.T) == pytest.approx(0.3)


@pytest.mark.parametrize("seed", DRAWS)
def test_two_arcs_join_two_headings(seed: int):
    rng = np.random.default_rng([9, seed])
    begin, end = (complex(*rng.normal(size=2)) for _ in range(2))
    toward = (end - begin) / abs(end - begin)
    headings = [toward * cmath.rect(1.0, turn) for turn in rng.uniform(-1.2, 1.2, 2)]
    first, second = biarc(begin, headings[0], end, headings[1])
    assert (first[0], first[1]) == (begin, headings[0])
    joint, heading = end_of(*first)
    assert (second[0], second[1]) == pytest.approx((joint, heading))
    assert end_of(*second) == pytest.approx((end, headings[1]))


@pytest.mark.parametrize("radius", [0.1, -0.1])
def test_an_arc_is_fitted_by_two_however_its_parameter_runs(radius: float):
    def curve(t: float) -> tuple[complex, complex]:
        # a sixth of the way is 6 µm
        angle = 0.5 * math.pi * math.expm1(12.0 * t) / math.expm1(12.0)
        return on(0.2 + 0.5j, radius, math.copysign(angle, radius))

    table = fit_arcs(curve, [0.0, 1.0]).table
    assert table[:, SEGMENT.curvature] == pytest.approx([1.0 / radius] * 2)
    assert table[:, SEGMENT.length].sum() == pytest.approx(0.05 * math.pi)


@pytest.mark.parametrize("curvature", [0.0, 1.5, -2.0])
@pytest.mark.parametrize("off", [0.2, -0.3])
def test_distance_from_a_point_to_an_arc(curvature: float, off: float):
    begin, heading, place = 0.3 - 0.8j, cmath.rect(1.0, 2.2), 0.45
    turned = cmath.exp(1j * curvature * place)
    foot = begin + heading * ((turned - 1.0) / (1j * curvature) if curvature else place)
    arc = (begin, heading, curvature, 0.7)
    assert _distance_from_arc(arc, foot + off * 1j * heading * turned) == pytest.approx(abs(off))
    assert _distance_from_arc(arc, begin - 1e-3 * heading) == math.inf


@pytest.mark.parametrize("place", [0.2, 0.5, 0.8])
def test_a_bump_is_followed_at_any_place_of_the_path(place: float):
    def curve(t: float) -> tuple[complex, complex]:
        bump = 0.01 * math.exp(-(((t - place) / 0.06) ** 2))
        return complex(t, bump), complex(1.0, -2.0 * (t - place) / 0.06**2 * bump)

    assert fit_arcs(curve, [0.0, 1.0]).at(np.linspace(0.0, 1.0, 401))[1].max() == pytest.approx(
        0.01, 1e-3
    )


def test_a_sine_is_as_symmetrical_as_its_curve():
    """By pairs of arcs between its zeros and crests; a quarter of a gentle one takes one pair."""
    lengths = Sine(amplitude=0.03, periods=3.0).arcs.table[:, SEGMENT.length].reshape(12, -1)
    for quarter, following in pairwise(lengths):
        assert quarter[::-1] == pytest.approx(following, rel=1e-9)
    assert len(Sine(amplitude=1e-4, periods=0.25).arcs.table) == 2


def test_points_of_a_path_are_sampled_from_its_start_to_its_end():
    line = Line(x=0.1, y=0.2, direction=0.5 * math.pi, length=0.4)
    assert line.sampled(3) == pytest.approx(np.array([[0.1, 0.2], [0.1, 0.4], [0.1, 0.6]]))


def test_number_of_parts_of_an_arc():
    assert [arcs_needed(k, MAX_TURN) for k in (0.0, 1.0, -1.0, 1.001, -1.001, 2.0, 3.0)] == [
        1,
        1,
        1,
        2,
        2,
        2,
        3,
    ]
    table = chain([(0j, 1 + 0j, -1.0, 2.0 * MAX_TURN), (5j, 1j, 0.0, 4.0)]).table
    assert table[:, SEGMENT.length].tolist() == [MAX_TURN, MAX_TURN, 4.0]
    assert table[:, SEGMENT.start].tolist() == [0.0, MAX_TURN, 2.0 * MAX_TURN]


def test_the_largest_curvature_of_a_path():
    assert Arc(radius=0.4, angle=-1.0).max_curvature == pytest.approx(2.5)
    corner = Polyline(points=((0.0, 0.5), (0.3, 0.5), (0.3, 0.8)), radius=0.1)
    assert corner.max_curvature == pytest.approx(10.0)
    amplitude, extent = 0.02, 1.0
    sine = Sine(x=-0.5, y=0.6, direction=0.0, extent=extent, amplitude=amplitude, periods=1.0)
    assert sine.max_curvature == pytest.approx(amplitude * (math.tau / extent) ** 2, rel=0.02)


def test_a_foot_on_an_arc_and_at_its_centre():
    arc = ArcSegment(
        x=0.0, y=0.0, heading_cos=0.6, heading_sin=0.8, curvature=2.0, start=3.0, length=0.5
    )
    centre = 0.5j * complex(0.6, 0.8)
    for turn, left in ((0.4, 0.1), (-0.3, -0.2), (0.9, 0.3)):
        heading = complex(0.6, 0.8) * cmath.rect(1.0, turn)
        point = centre + (0.5 - left) * heading * -1j
        foot = foot_on(arc, 7, point.real, point.imag)
        assert (foot.arc_length, foot.normal_error) == pytest.approx((3.0 + 0.5 * turn, left))
        assert foot.heading == pytest.approx((heading.real, heading.imag))
        assert (foot.curvature, foot.segment) == (2.0, 7)
    foot = foot_on(arc._replace(heading_cos=1.0, heading_sin=0.0), 7, 0.0, 0.5)
    assert (foot.arc_length, foot.normal_error, foot.heading) == (3.0, 0.5, UnitVector(1.0, 0.0))


def straight() -> tuple[np.ndarray, int]:
    """Three segments of 1 m in a row, as the kernels have them, behind another number."""
    pieces = [(complex(k), 1 + 0j, 0.0, 1.0) for k in range(3)]
    return np.concatenate([[-7.0], chain(pieces).table.ravel()]), 3


def test_a_projection_is_found_from_any_segment():
    constants, count = straight()
    for segment in range(count):
        for x, found in ((-0.5, 0), (0.3, 0), (1.2, 1), (2.7, 2), (5.0, 2)):
            foot = project(constants, 1, count, segment, x, -0.2)
            assert foot.segment == found
            assert (foot.arc_length, foot.normal_error) == pytest.approx((x, -0.2))


def test_a_walk_never_turns_back():
    """Outside a sharp corner each of two segments sends a foot to the other one."""
    table = chain([(0j, 1 + 0j, 0.0, 1.0), (1 + 0j, 1j, 0.0, 1.0)]).table
    assert [project(table.ravel(), 0, 2, segment, 1.5, -0.5).segment for segment in (0, 1)] == [
        1,
        0,
    ]


def test_segments_and_points_by_arc_length():
    constants, count = straight()
    lengths = (-0.5, 0.0, 0.5, 1.0, 1.999, 2.0, 9.0)
    assert [segment_of(constants, 1, count, s) for s in lengths] == [0, 0, 0, 1, 1, 2, 2]
    assert [point_at(constants, 1, count, s) for s in lengths] == [(s, 0.0) for s in lengths]


def test_a_circle_begins_at_its_lowest_point():
    path = Circle(center_x=0.1, center_y=0.5, radius=0.2)
    assert path.point(0.0) == pytest.approx((0.1, 0.3))
    assert path.heading(0.0) == pytest.approx(0.0)
    assert abs(Circle(clockwise=True).heading(0.0)) == pytest.approx(math.pi)


BAD_POINTS: tuple[Any, ...] = (
    ((0.0, 0.5), (0.0, 0.5), (0.1, 0.5)),
    ((0.0, 0.5), (0.1, 0.5), (0.1, 0.5)),
    ((0.0, 0.5), "12"),
    ((0.0, 0.5), (0.1, 0.5, 0.2)),
    ((0.0, 0.5), (1001.0, 0.5)),
)


def test_points_that_no_path_accepts():
    for points in BAD_POINTS:
        for kind in (Spline, Polyline):
            with pytest.raises(ParameterError, match="points"):
                kind(points=points)


@pytest.mark.parametrize("name", ["x", "y"])
def test_a_path_is_within_a_kilometre(name: str):
    for far in (1000.0, -1000.0):
        Line(**{name: far})
    for far in (1000.1, -1000.1, math.nan):
        with pytest.raises(ParameterError, match=f"Line.{name}"):
            Line(**{name: far})


def test_corners_may_take_all_of_a_straight_segment():
    side = math.tan(0.25 * math.pi)  # as it is rounded
    square = ((0.0, 0.0), (side, 0.0), (side, side))
    assert Polyline(points=square, radius=1.0).length == pytest.approx(0.5 * math.pi)
    with pytest.raises(ParameterError, match=r"Polyline\.radius"):
        Polyline(points=square, radius=1.0 + 1e-9)
    for turn, fits in ((math.pi - 1e-5, True), (math.pi - 1e-7, False)):
        back = cmath.rect(1.0, turn)
        points = ((0.0, 0.0), (1.0, 0.0), (1.0 + back.real, back.imag))
        if fits:
            Polyline(points=points, radius=1e-9)
        else:
            with pytest.raises(ParameterError, match=r"Polyline\.radius"):
                Polyline(points=points, radius=1e-9)
