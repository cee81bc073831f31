"""Paths against closed forms and the curves that they are fitted to; projections against where a
point was put."""

import math
from dataclasses import replace
from itertools import pairwise
from pathlib import Path as File
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings, strategies as st
from scipy import interpolate, optimize

from pter_gym._engine.batch import Batch
from pter_gym.errors import ParameterError
from pter_gym.params import BASELINE
from pter_gym.paths import Arc, Circle, Line, Path, Polyline, Sine, Spline, read_path
from pter_gym.paths._arcs import TOLERANCE
from pter_gym.paths._projection import point_at, project
from pter_gym.paths._shapes import smoothed
from pter_gym.tasks.path_following import PathFollowing

WAYPOINTS = ((-0.5, 0.7), (-0.2, 0.6), (0.1, 0.8), (0.3, 0.6))
KINDS = [
    Line(x=0.1, y=0.3, direction=2.0, length=0.4),
    Arc(x=-0.3, y=0.6, direction=0.4, radius=0.3, angle=-1.7),
    Arc(radius=0.2, angle=5.0),
    Circle(),
    Circle(radius=0.2, start=1.0, clockwise=True),
    Sine(amplitude=0.05, periods=1.5, direction=0.3),
    Spline(points=WAYPOINTS),
    Polyline(points=WAYPOINTS, radius=0.06),
]


def name_of(path: Path) -> str:
    return type(path).__name__


@pytest.mark.parametrize("path", KINDS, ids=name_of)
def test_arcs_join_with_one_point_and_one_heading(path: Path) -> None:
    table = path.arcs.table
    for row, following in pairwise(table):
        x, y, cos, sin, curvature, start, length = row
        turn = curvature * length
        chord = length * np.sinc(0.5 * turn / np.pi)
        end = complex(x, y) + complex(cos, sin) * np.exp(0.5j * turn) * chord
        assert abs(end - complex(*following[:2])) < 1e-12
        assert abs(complex(cos, sin) * np.exp(1j * turn) - complex(*following[2:4])) < 1e-9
        assert start + length == pytest.approx(following[5], abs=1e-14)
        assert abs(turn) <= 1.5


@pytest.mark.parametrize("path", KINDS, ids=name_of)
def test_arc_length_heading_and_curvature_belong_together(path: Path) -> None:
    """Central differences over 1e-6 m, away from joints, where the curvature may jump: second
    order, 1e-6 relative."""
    h = 1e-6
    joints = path.arcs.table[:, 5]
    for s in np.linspace(1e-4, path.length - 1e-4, 97):
        if np.abs(joints - s).min() < 2.0 * h:
            continue
        (x0, y0), (x1, y1) = path.point(s - h), path.point(s + h)
        assert math.hypot(x1 - x0, y1 - y0) == pytest.approx(2.0 * h, rel=1e-6)
        assert math.remainder(
            math.atan2(y1 - y0, x1 - x0) - path.heading(s), math.tau
        ) == pytest.approx(0.0, abs=1e-6)
        bend = math.remainder(path.heading(s + h) - path.heading(s - h), math.tau) / (2.0 * h)
        assert bend == pytest.approx(path.curvature(s), abs=1e-6)


def test_closed_forms() -> None:
    circle = Circle(center_x=0.1, center_y=0.5, radius=0.2, start=0.3)
    assert circle.length == pytest.approx(2.0 * math.pi * 0.2, rel=1e-15)
    for s in np.linspace(0.0, circle.length, 23):
        angle = 0.3 + s / 0.2
        assert circle.point(s) == pytest.approx(
            (0.1 + 0.2 * math.cos(angle), 0.5 + 0.2 * math.sin(angle)), abs=1e-14
        )
    arc = Arc(x=0.0, y=0.0, direction=0.0, radius=2.0, angle=-math.pi / 2.0)
    assert arc.point(arc.length) == pytest.approx((2.0, -2.0), abs=1e-14)
    corner = Polyline(points=((0.0, 0.0), (1.0, 0.0), (1.0, 1.0)), radius=0.25)
    assert corner.length == pytest.approx(2.0 * 0.75 + 0.25 * math.pi / 2.0, rel=1e-14)
    assert corner.point(corner.length) == pytest.approx((1.0, 1.0), abs=1e-14)
    straight = Spline(points=((0.0, 0.5), (0.3, 0.9)))
    assert straight.length == pytest.approx(0.5, rel=1e-14)


@pytest.mark.parametrize("path", KINDS[5:7], ids=name_of)
def test_fitted_arcs_stay_with_their_curve(path: Path) -> None:
    """The fit looks at five points of each pair of arcs; between them a smooth distance can be a
    little larger."""
    from scipy.interpolate import CubicSpline

    t = np.linspace(0.0, 1.0, 3001)
    if isinstance(path, Sine):
        along = path.extent * t
        local = along + 1j * path.amplitude * np.sin(2.0 * math.pi * path.periods * t)
        points = complex(path.x, path.y) + np.exp(1j * path.direction) * local
    else:
        assert isinstance(path, Spline)
        given = np.array(path.points) @ [1.0, 1.0j]
        knots = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(given)))])
        points = CubicSpline(knots, given, bc_type="natural")(knots[-1] * t)
    table, segment, worst = path.arcs.table, 0, 0.0
    for point in points:
        foot = project(table.ravel(), 0, len(table), segment, point.real, point.imag)
        segment, worst = foot.segment, max(worst, abs(foot.normal_error))
    assert worst <= 1.5 * TOLERANCE
    assert path.length == pytest.approx(np.abs(np.diff(points)).sum(), rel=1e-5)


@pytest.mark.parametrize("path", KINDS, ids=name_of)
@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=15, deadline=None)
def test_the_foot_of_a_moving_point_is_the_nearest_one_nearby(path: Path, seed: int) -> None:
    """A point wanders within the tube; its foot moves continuously and gives back arc length and
    normal error."""
    rng = np.random.default_rng(seed)
    bound = 0.9 / max(path.max_curvature, 4.0)
    table, segment, s, e = path.arcs.table, 0, 0.0, 0.0
    constants = table.ravel()
    for _ in range(300):
        s = float(np.clip(s + rng.uniform(-0.02, 0.04), 0.0, path.length))
        e = float(np.clip(e + rng.uniform(-0.02, 0.02), -bound, bound))
        (x, y), heading = path.point(s), path.heading(s)
        foot = project(
            constants, 0, len(table), segment, x - e * math.sin(heading), y + e * math.cos(heading)
        )
        segment = foot.segment
        assert foot.arc_length == pytest.approx(s, abs=1e-10)
        assert foot.normal_error == pytest.approx(e, abs=1e-10)
        assert math.remainder(
            math.atan2(foot.heading.sin, foot.heading.cos) - heading, math.tau
        ) == pytest.approx(0.0, abs=1e-8)
        assert point_at(constants, 0, len(table), s) == pytest.approx((x, y), abs=1e-14)


@pytest.mark.parametrize(
    ("make", "field"),
    [
        (lambda: Line(length=0.0), "Line.length"),
        (lambda: Arc(radius=0.0), "Arc.radius"),
        (lambda: Arc(angle=0.0), "Arc.angle"),
        (lambda: Arc(angle=7.0), "Arc.angle"),
        (lambda: Circle(radius=-1.0), "Circle.radius"),
        (lambda: Circle(clockwise=1), "Circle.clockwise"),  # pyright: ignore[reportArgumentType]
        (lambda: Sine(extent=0.0), "Sine.extent"),
        (lambda: Sine(amplitude=math.nan), "Sine.amplitude"),
        (lambda: Spline(points=((0.0, 0.5),)), "Spline.points"),
        (lambda: Spline(points=((0.0, 0.5), (0.0, 0.5))), "Spline.points"),
        (lambda: Spline(points=((0.0, 0.5), (math.nan, 0.6))), "Spline.points"),
        (
            lambda: Polyline(points=((0.0, 0.5), (0.1, 0.5), (0.1, 0.6)), radius=0.2),
            "Polyline.radius",
        ),
        (lambda: Polyline(points=((0.0, 0.5), (0.1, 0.5), (0.0, 0.5))), "Polyline.radius"),
    ],
)
def test_bad_paths_are_named(make: object, field: str) -> None:
    with pytest.raises(ParameterError, match=field):
        make()  # pyright: ignore[reportCallIssue]


def test_a_path_that_bends_within_the_workspace_is_refused() -> None:
    task = PathFollowing(path=Circle(radius=0.15), error_max=0.136)
    with pytest.raises(ParameterError, match="error_max"):
        Batch(BASELINE, task)
    Batch(BASELINE, replace(task, error_max=0.134))


def test_a_path_out_of_reach_is_refused_with_the_point() -> None:
    with pytest.raises(ParameterError, match="path"):
        Batch(
            BASELINE,
            PathFollowing(
                path=Spline(points=((-0.5, 0.7), (0.0, 1.4), (0.4, 0.7))), error_max=0.05
            ),
        )


def test_paths_from_csv(tmp_path: File) -> None:
    file = tmp_path / "path.csv"
    file.write_text("y, x ,note\n0.7,-0.5,a\n0.6,-0.2,b\n0.8,0.1,c\n0.6,0.3,d\n")
    assert read_path(file) == Spline(points=WAYPOINTS)


@pytest.mark.parametrize(
    "text",
    [
        "# x_m, y_m, w_m\n-0.5,0.7,1\n-0.2,0.6,1\n0.1,0.8,1\n0.3,0.6,1\n",
        "-0.5, 0.7\n-0.2, 0.6\n0.1, 0.8\n0.3, 0.6\n",
        "# a\n# s; X [m]; Y [m]; psi\n0; -.5; .7; 0\n1; -.2; .6; 0\n2; .1; .8; 0\n3; .3; .6; 0\n",
        "x;y\n-0,5;0,7\n-0,2;0,6\n0,1;0,8\n0,3;0,6\n",
        "# drawn by hand; in metres\nx,y\n-0.5,0.7\n-0.2,0.6\n0.1,0.8\n0.3,0.6\n",
        "-0,5;0,7\n-0,2;0,6\n0,1;0,8\n0,3;0,6\n",
    ],
    ids=[
        *("# x_m", "no names", "semicolons", "decimal commas"),
        *("a semicolon in a comment", "decimal commas without names"),
    ],
)
def test_paths_from_files_as_people_have_them(text: str, tmp_path: File) -> None:
    (tmp_path / "path.csv").write_text(text)
    assert read_path(tmp_path / "path.csv") == Spline(points=WAYPOINTS)


def test_points_may_be_lists_and_arrays_and_a_path_may_close_and_cross() -> None:
    for points in ([list(point) for point in WAYPOINTS], np.array(WAYPOINTS)):
        assert Spline(points=points) == Spline(points=WAYPOINTS)  # pyright: ignore[reportArgumentType]
    t = np.linspace(0.0, 2.0 * np.pi, 60)
    eight: Any = np.column_stack([0.2 * np.sin(t), 0.6 + 0.08 * np.sin(2.0 * t)])
    path = Spline(points=eight)
    assert path.point(path.length) == pytest.approx(path.point(0.0), abs=1e-9)


def test_a_recorded_path_is_smoothed() -> None:
    """0.8 mm of noise on a circle of radius 150 mm: smoothed, its curvature is the circle's within
    a tenth, and its place within 2 mm but for the ends, which are free to straighten."""
    t = np.linspace(0.0, 2.0 * np.pi, 300)
    noise = 0.0008 * np.random.default_rng(0).standard_normal((300, 2))
    points: Any = np.column_stack([0.15 * np.cos(t), 0.6 + 0.15 * np.sin(t)]) + noise
    rough, smooth = Spline(points=points), Spline(points=points, smooth=0.0008)
    assert rough.max_curvature > 1000.0
    assert smooth.max_curvature < 1.1 / 0.15
    gaps = np.abs(np.hypot(*(smooth.sampled(2000) - [0.0, 0.6]).T) - 0.15)
    assert gaps[50:-50].max() < 0.002
    assert gaps.max() < 0.005


@settings(max_examples=20)
@given(
    seed=st.integers(0, 2**32),
    count=st.integers(3, 80),
    width=st.floats(0.003, 0.15),
    turns=st.floats(0.3, 1.0),
    noise=st.sampled_from([0.0, 1e-5, 5e-4, 2e-3]),
    distances=st.lists(st.floats(0.0, 0.02), min_size=4, max_size=4),
)
@example(0, 300, 0.12, 1.0, 8e-4, [0.0, 1e-5, 1e-4, 4e-4, 8e-4, 1.2e-3, 2e-3, 4e-3])
@example(0, 300, 0.003, 0.8, 0.0, [0.0, 0.001, 0.004])
def test_more_smoothing_never_makes_the_sharpest_bend_sharper(
    seed: int, count: int, width: float, turns: float, noise: float, distances: list[float]
) -> None:
    """Ellipses, whole or in part, through points at uneven distances; thin ones are hairpins."""
    rng = np.random.default_rng(seed)
    t = 2.0 * np.pi * turns * np.cumsum(rng.uniform(0.2, 1.0, count)) / count
    points = np.column_stack([0.25 * np.cos(t), 0.6 + width * np.sin(t)])
    points += noise * rng.standard_normal((count, 2))
    bends = [
        Spline(points=points, smooth=distance).max_curvature  # pyright: ignore[reportArgumentType]
        for distance in sorted(distances)
    ]
    assert bends == sorted(bends, reverse=True)


def test_noise_is_smoothed_away() -> None:
    """0.8 mm of noise on an ellipse whose smallest radius is 57.6 mm."""
    t = np.linspace(0.0, 2.0 * np.pi, 300, endpoint=False)
    noise = 0.0008 * np.random.default_rng(0).standard_normal((300, 2))
    points: Any = np.column_stack([0.25 * np.cos(t), 0.6 + 0.12 * np.sin(t)]) + noise
    assert 0.05 < 1.0 / Spline(points=points, smooth=8e-4).max_curvature < 0.065


@pytest.mark.parametrize("count", [5, 60])
def test_a_smoothed_path_is_that_of_scipy_at_the_distance_asked_for(count: int) -> None:
    t = np.linspace(0.0, 1.0, count)
    rng = np.random.default_rng(1)
    points = np.column_stack([0.8 * t - 0.4, 0.6 + 0.1 * np.sin(6.0 * t)])
    points += 0.002 * rng.standard_normal(points.shape)
    knots = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    complex_points = points @ [1.0, 1.0j]
    moved = smoothed(knots.tolist(), complex_points, 0.001)
    off = moved - complex_points
    assert np.sqrt((np.abs(off) ** 2).mean() / 2.0) == pytest.approx(0.001, rel=1e-6)

    def fitted(weight: float) -> Any:
        fit: Any = interpolate.make_smoothing_spline(knots, points, lam=weight)
        return fit(knots) @ [1.0, 1.0j]

    def excess(log_weight: float) -> float:
        return float(
            np.linalg.norm(fitted(np.exp(log_weight)) - complex_points) - np.linalg.norm(off)
        )

    weight: Any = optimize.brentq(excess, -40.0, 5.0, xtol=1e-12)
    np.testing.assert_allclose(moved, fitted(np.exp(weight)), atol=1e-8)


def test_smoothing_ends_at_the_straight_line_that_fits_best_and_begins_at_the_points() -> None:
    points = ((-0.2, 0.5), (0.0, 0.56), (0.2, 0.5))
    straight = Spline(points=points, smooth=1.0)
    assert straight.max_curvature < 1e-6
    assert straight.point(0.0) == pytest.approx((-0.2, 0.52), abs=1e-6)
    as_given, near = Spline(points=points), Spline(points=points, smooth=1e-300)
    assert near.max_curvature == as_given.max_curvature


TURNING_BACK = [
    ((0.0, 0.5), (0.1, 0.5), (0.0, 0.5)),
    ((0.0, 0.5), (0.1, 0.5), (0.05, 0.5)),
    ((0.0, 0.5), (0.1, 0.5), (0.0, 0.5), (0.1, 0.5)),
]


@pytest.mark.parametrize("points", TURNING_BACK)
def test_a_spline_that_turns_back_on_itself_is_refused(points: Any, tmp_path: File) -> None:
    with pytest.raises(ParameterError, match="Spline"):
        Batch(BASELINE, PathFollowing(path=Spline(points=points)))
    file = tmp_path / "path.csv"
    file.write_text("x,y\n" + "".join(f"{x},{y}\n" for x, y in points))
    with pytest.raises(ParameterError, match=r"path\.csv"):
        read_path(file)


def test_evaluations_of_a_curve_are_limited(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pter_gym.paths._shapes.MAX_EVALUATIONS", 20)
    with pytest.raises(ParameterError, match="20"):
        _ = Spline(points=WAYPOINTS).arcs


@pytest.mark.parametrize("point", [(10**400, 0.0), (1e300, 0.0), (True, 0.0), (0.0, float("nan"))])
def test_a_waypoint_is_of_numbers_that_a_path_can_have(point: Any) -> None:
    with pytest.raises(ParameterError, match=r"Spline\.points"):
        Spline(points=(point, (0.5, 0.5)))


def test_a_row_of_ones_states_no_units(tmp_path: File) -> None:
    file = tmp_path / "path.csv"
    file.write_text("x,y\n1,1\n0.5,0.6\n")
    assert read_path(file) == Spline(points=((1.0, 1.0), (0.5, 0.6)))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "columns x, y"),
        ("x\n1\n2\n", "column y"),
        ("x_inch,y_inch\n1,2\n2,3\n", "x_inch must be in m"),
        ("1,2,3,4\n2,3,4,5\n", "columns x, y"),
        ("-0.5, 0.7, 2\n-0.2, 0.6, 2\n0.1, 0.8, 2\n", "columns x, y"),
        ("x,y\n0.1,0.5\n\n2000,0.5\n", "line 4"),
        ("x,y\n0.1,0.5\n", "points"),
        ("x,y\n0.1,0.5\n0.1,0.5\n", "line 3"),
        ("x,y\n0.1,0.5\n0.2,nan\n", "line 3.*y"),
        ("x,y\n0.1,0.5\n0.2\n", "line 3 has 1 entries"),
        ("x,y\n0.1,0.5\nleft,0.5\n", "line 3.*x"),
    ],
)
def test_bad_csv_paths_are_refused(tmp_path: File, text: str, message: str) -> None:
    file = tmp_path / "path.csv"
    file.write_text(text)
    with pytest.raises(ParameterError, match=message):
        read_path(file)
    with pytest.raises(ParameterError, match="path"):
        read_path(tmp_path / "missing.csv")


@pytest.mark.parametrize("far", [1000.5, -1000.5])
def test_paths_lie_within_a_kilometre(far: float) -> None:
    near = Polyline(points=((0.0, 0.0), (math.copysign(1000.0, far), 0.0)))
    assert near.length == 1000.0
    for make in (
        lambda: Polyline(points=((0.0, 0.0), (far, 0.0))),
        lambda: Polyline(points=((0.0, far), (0.0, 0.0))),
        lambda: Circle(center_x=far),
        lambda: Circle(center_y=far),
    ):
        with pytest.raises(ParameterError):
            make()
