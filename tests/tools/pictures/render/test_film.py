"""Films: their frames, and the files that hold them."""

import sys
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from pter_gym.tools.pictures.render.film import PAUSE, Film, Shot, check_ending, frames_of, write_film
from pter_gym.tools.pictures.render.picture import Subject

from pter_gym.errors import DependencyError, ParameterError
from pter_gym.params import BASELINE
from pter_gym.tasks.path_following import COLUMN, TELEMETRY, PathFollowing

SIZE = (161, 121)
"""Odd: no way to store a film may change it."""


def shot(steps: int, name: str = "") -> Shot:
    """An episode whose arm turns."""
    telemetry = np.zeros((steps + 1, len(TELEMETRY)))
    telemetry[:, COLUMN.time] = 0.01 * np.arange(steps + 1)
    telemetry[:, COLUMN.theta.a] = 0.4 + 0.5 * telemetry[:, COLUMN.time]
    telemetry[:, COLUMN.theta.b] = 2.2
    telemetry[-1, [COLUMN.terminated, COLUMN.is_success]] = 1.0
    return Shot(Subject(BASELINE, PathFollowing(), name), telemetry)


def film(rate: float = 50, speed: float = 1.0, steps: tuple[int, ...] = (20,)) -> Film:
    return Film([shot(each) for each in steps], rate, speed, SIZE)


@pytest.mark.parametrize(("rate", "speed", "moving"), [(50, 1.0, 11), (25, 1.0, 6), (50, 0.5, 21), (50, 3.0, 5)])
def test_frames_are_as_far_apart_as_asked(rate: float, speed: float, moving: int):
    found = film(rate, speed)
    assert len(found) == moving + round(PAUSE * rate)
    frames = [found.pixels(k) for k in range(len(found))]
    assert frames[0].shape == (121, 161, 3)
    assert all((one != other).any() for one, other in pairwise(frames[:moving]))
    for still in frames[moving:]:
        np.testing.assert_array_equal(still, frames[moving - 1])


def test_an_episode_that_is_over_stays_at_its_end():
    both = Film([shot(20), shot(40)], 50, 1.0, (322, 121))
    left, right = zip(*(np.split(both.pixels(k), 2, axis=1) for k in (10, 20)), strict=True)
    np.testing.assert_array_equal(*left)
    assert (right[0] != right[1]).any()


def test_a_gif_has_the_frames_and_the_colours(tmp_path: Path):
    found, path = film(25), tmp_path / "film.GIF"
    drawn: list[int] = []
    write_film(found, path, lambda: drawn.append(1))
    assert len(drawn) == frames_of(found, path) == len(found)
    with Image.open(path) as gif:
        assert gif.size == SIZE
        assert gif.info["loop"] == 0
        seconds = 0.0
        for k in range(gif.n_frames):
            gif.seek(k)
            seconds += 1e-3 * gif.info["duration"]
        last = np.asarray(gif.convert("RGB"))
    assert seconds == pytest.approx(len(found) / 25)
    same = (last == found.pixels(len(found) - 1)).all(axis=-1)
    assert same.mean() > 0.9


def test_a_png_is_the_last_frame(tmp_path: Path):
    found, path = film(), tmp_path / "end.png"
    write_film(found, path)
    assert frames_of(found, path) == 1
    with Image.open(path) as png:
        np.testing.assert_array_equal(np.asarray(png), found.pixels(len(found) - 1))


def test_an_mp4_can_be_played(tmp_path: Path):
    ffmpeg = pytest.importorskip("imageio_ffmpeg")
    found, path = film(steps=(6,)), tmp_path / "film.mp4"
    check_ending(path)
    write_film(found, path)
    frames, seconds = ffmpeg.count_frames_and_secs(str(path))
    assert frames == len(found)
    assert seconds == pytest.approx(len(found) / 50, abs=0.03)
    assert list(tmp_path.iterdir()) == [path]


def test_what_fails_leaves_the_file_as_it_was(tmp_path: Path):
    path = tmp_path / "film.gif"
    path.write_text("older")

    def fail() -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_film(film(), path, fail)
    assert [(file.name, file.read_text()) for file in tmp_path.iterdir()] == [("film.gif", "older")]


@pytest.mark.parametrize("name", ["film.avi", "film", "film.mp3"])
def test_another_ending_is_refused(name: str):
    with pytest.raises(ParameterError, match=r"out must end in \.mp4, \.gif, \.png"):
        check_ending(Path(name))


def test_missing_ffmpeg_is_named(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    check_ending(Path("film.gif"))
    with pytest.raises(DependencyError, match=r"ffmpeg .*pip install -e '\.\[render\]'"):
        check_ending(Path("film.mp4"))
