"""Pictures of any size: parts have room, text can be read, and no text covers another or leaves the picture."""

from itertools import combinations
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pter_gym.errors import ParameterError
from pter_gym.params import BASELINE
from pter_gym.physics.friction import ClutchMode
from pter_gym.render.arrangement import arrange, cells, check_size, grid
from pter_gym.render.canvas import SMALLEST_TEXT, Written
from pter_gym.render.geometry import Box
from pter_gym.render.picture import Sheet, Subject
from pter_gym.render.snapshot import Snapshot
from pter_gym.tasks.path_following import TELEMETRY, PathFollowing

SIZES = [(320, 240), (480, 540), (640, 480), (840, 600), (1280, 720), (1920, 1080), (600, 1000)]
LONGEST = {"theta_a": 0.4, "theta_b": 2.2, "time": 12.34, "normal_error": -0.1234, "mode": ClutchMode.STUCK_4}

sides = st.integers(32, 4096)


def inside(inner: Box, outer: Box) -> bool:
    across = outer.left <= inner.left < inner.right <= outer.right
    return across and outer.low <= inner.low < inner.high <= outer.high


def state(**values: float) -> tuple[Snapshot, np.ndarray]:
    row = np.zeros(len(TELEMETRY))
    for name, value in {**LONGEST, **values}.items():
        row[TELEMETRY.index(name)] = value
    return Snapshot.of(row), np.zeros((0, 2))


def busy() -> tuple[Snapshot, np.ndarray]:
    """A state of which every reading is long."""
    clutches = {f"{what}_{x}": value for x in range(1, 5) for what, value in (("volts", 24.0), ("torque", -33.3))}
    return state(**clutches)


def written(width: int, height: int, name: str = "torque-feedback-tuned", count: int = 1) -> list[Written]:
    sheet = Sheet(width, height, [Subject(BASELINE, PathFollowing(), name)] * count)
    return sheet.draw([busy()] * count)._texts


def box_of(text: Written) -> Box:
    (left, top), (width, height) = text.corner, text.image.get_size()
    return Box(left, top, left + width, top + height)


@settings(max_examples=60, deadline=None)
@given(sides, sides)
def test_the_parts_have_room_in_any_size(width: int, height: int):
    box = Box(0, 0, width, height)
    parts = arrange(box)
    assert inside(parts.drawing, parts.scene)
    assert inside(parts.scene, box)
    assert inside(parts.readings, box)
    assert parts.kind == "none" or parts.readings.left >= parts.scene.right or parts.readings.low >= parts.scene.high
    assert parts.stroke > 0.0


@settings(max_examples=60, deadline=None)
@given(st.integers(1, 40), sides, sides)
def test_a_grid_fills_the_picture_without_overlaps(count: int, width: int, height: int):
    rows, columns = grid(count)
    boxes = cells(width, height, count)
    assert rows * columns >= count == len(boxes)
    assert (rows - 1) * columns < count
    assert boxes[0][:2] == (0, 0)
    assert max(box.right for box in boxes) == width
    assert boxes[-1].high == height
    for one, other in combinations(boxes, 2):
        assert one.right <= other.left or other.right <= one.left or one.high <= other.low or other.high <= one.low


@pytest.mark.parametrize(("count", "expected"), [(1, (1, 1)), (2, (1, 2)), (3, (1, 3)), (4, (2, 2)), (5, (2, 3))])
def test_few_pictures_are_side_by_side(count: int, expected: tuple[int, int]):
    assert grid(count) == expected


@pytest.mark.parametrize("bad", [0, 31, -5, 8193, 2.5, "wide", True, None])
def test_a_bad_size_is_named(bad: Any):
    with pytest.raises(ParameterError, match="width must be a whole number"):
        check_size(bad, 100)
    with pytest.raises(ParameterError, match="height must be a whole number"):
        check_size(100, bad)


@pytest.mark.parametrize(("width", "height"), SIZES)
def test_text_can_be_read_and_stays_apart(width: int, height: int):
    pytest.importorskip("pygame")
    texts = written(width, height)
    assert len(texts) > 12
    for text in texts:
        assert inside(box_of(text), Box(0, 0, width, height))
        assert text.image.get_height() >= 0.6 * SMALLEST_TEXT
    for one, other in combinations([box_of(text) for text in texts], 2):
        assert (
            one.right <= other.left or other.right <= one.left or one.high <= other.low + 2 or other.high <= one.low + 2
        )


def test_tiny_pictures_have_no_text():
    pytest.importorskip("pygame")
    assert not written(160, 120)


def test_a_long_name_is_cut_at_its_front():
    pytest.importorskip("pygame")
    (name, _) = sorted(written(320, 240, "/home/anybody/runs/2026/policies/mine" * 3), key=lambda text: text.corner[1])[
        :2
    ]
    assert box_of(name).right < 320


def test_pictures_on_a_sheet_are_those_of_their_subjects():
    pytest.importorskip("pygame")
    task = PathFollowing()
    sheet = Sheet(640, 240, [Subject(BASELINE, task, "a"), Subject(BASELINE, task, "b")])
    one, other = state(), state(theta_a=0.9)
    left, right = np.split(sheet.draw([one, other]).pixels(), 2, axis=1)
    again_left, again_right = np.split(sheet.draw([one, one]).pixels(), 2, axis=1)
    np.testing.assert_array_equal(left, again_left)
    assert (right != again_right).any()


def test_the_end_of_an_episode_is_said():
    assert state()[0].end == ""
    assert state(terminated=1.0)[0].end == "left the workspace"
    assert state(terminated=1.0, is_success=1.0)[0].end == "arrived"
