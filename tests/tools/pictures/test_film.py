"""Films: their frames, and the files that hold them."""

import sys
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from pter_gym.errors import DependencyError
from pter_gym.params import BASELINE
from pter_gym.tasks.path_following import COLUMN, TELEMETRY, PathFollowing
from pter_gym.tools.pictures.film import PAUSE, RATES, ErrorStrip, Film, check_suffix, write_film

SIZE = (161, 121)
"""Odd: only an mp4 may change it."""

TASK = PathFollowing()


def telemetry(steps: int) -> np.ndarray:
    """An episode whose arm turns."""
    rows = np.zeros((steps + 1, len(TELEMETRY)))
    rows[:, COLUMN.time] = 0.01 * np.arange(steps + 1)
    rows[:, COLUMN.theta.a] = 0.4 + 0.5 * rows[:, COLUMN.time]
    rows[:, COLUMN.theta.b] = 2.2
    rows[-1, [COLUMN.terminated, COLUMN.is_success]] = 1.0
    return rows


@pytest.mark.parametrize(
    ("rate", "speed", "count"), [(50, 1.0, 11), (25, 1.0, 6), (50, 0.5, 21), (50, 3.0, 5)]
)
def test_frames_are_equally_spaced(rate: float, speed: float, count: int):
    film = Film(BASELINE, TASK, {"": telemetry(20)}, rate, speed, SIZE)
    assert len(film) == count
    frames = [film.pixels(k) for k in range(count)]
    assert frames[0].shape == (121, 161, 3)
    assert all((one != other).any() for one, other in pairwise(frames))
    np.testing.assert_array_equal(film.pixels(count + 3), frames[-1])


def test_an_episode_that_is_over_keeps_its_last_state():
    both = Film(BASELINE, TASK, {"a": telemetry(20), "b": telemetry(40)}, 50, 1.0, (322, 121))
    left, right = zip(*(np.split(both.pixels(k), 2, axis=1) for k in (10, 20)), strict=True)
    np.testing.assert_array_equal(*left)
    assert (right[0] != right[1]).any()


@pytest.mark.smoke
def test_a_webp_moves_and_repeats(tmp_path: Path):
    path, shares = tmp_path / "film.WEBP", list[float]()
    assert (
        write_film(BASELINE, TASK, {"a": telemetry(30)}, path, size=SIZE, on_progress=shares.append)
        == path
    )
    frames = 1 + round(0.3 * RATES[".webp"] + 0.49)
    assert len(shares) == frames
    assert shares[-1] == 1.0
    with Image.open(path) as film:
        assert (film.size, film.n_frames, film.info["loop"]) == (SIZE, frames, 0)
        film.seek(frames - 1)
        film.load()
        assert film.info["duration"] == 1000.0 * PAUSE


def test_a_png_is_the_last_frame(tmp_path: Path):
    write_film(BASELINE, TASK, {"a": telemetry(20)}, tmp_path / "end.png", size=SIZE)
    film = Film(BASELINE, TASK, {"a": telemetry(20)}, RATES[".png"], size=SIZE)
    with Image.open(tmp_path / "end.png") as png:
        np.testing.assert_array_equal(np.asarray(png), film.pixels(len(film) - 1))


def test_an_mp4_can_be_played(tmp_path: Path):
    ffmpeg = pytest.importorskip("imageio_ffmpeg")
    path = tmp_path / "film.mp4"
    write_film(BASELINE, TASK, {"a": telemetry(6)}, path, size=SIZE)
    frames, seconds = ffmpeg.count_frames_and_secs(str(path))
    assert frames == 4 + round(PAUSE * RATES[".mp4"])
    assert seconds == pytest.approx(frames / RATES[".mp4"], abs=0.03)
    assert list(tmp_path.iterdir()) == [path]


def test_an_interrupted_film_leaves_the_file_as_it_was(tmp_path: Path):
    path = tmp_path / "film.webp"
    path.write_text("older")

    def interrupt(_: float) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_film(BASELINE, TASK, {"a": telemetry(20)}, path, size=SIZE, on_progress=interrupt)
    assert [(file.name, file.read_text()) for file in tmp_path.iterdir()] == [
        ("film.webp", "older")
    ]


def test_a_missing_ffmpeg_is_told(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    check_suffix(Path("film.webp"))
    with pytest.raises(DependencyError):
        check_suffix(Path("film.mp4"))


def test_a_missing_program_is_not_told_as_a_missing_folder(monkeypatch: pytest.MonkeyPatch):
    pytest.importorskip("imageio_ffmpeg")
    monkeypatch.setenv("IMAGEIO_FFMPEG_EXE", "/no/ffmpeg")
    with pytest.raises(DependencyError, match="/no/ffmpeg"):
        write_film(BASELINE, TASK, {"a": telemetry(2)}, Path("film.mp4"), size=SIZE)


def test_a_film_of_two_arms_shows_the_errors_of_all():
    quiet, lost = telemetry(20), telemetry(20)
    lost[:, COLUMN.normal_error] = 0.1 * lost[:, COLUMN.time]
    shown = [{"a": quiet, "b": rows, "c": quiet} for rows in (quiet, lost)]
    one, other = (
        Film(BASELINE, TASK, each, 50, size=(360, 300), arms=("a", "c")).pixels(10)
        for each in shown
    )
    changed = (one != other).any(axis=(1, 2))
    assert changed.any()
    assert not changed[:200].any()


def test_the_errors_shown_are_distances_and_their_means():
    rows = telemetry(3)
    rows[:, COLUMN.normal_error] = [0.0, -0.02, 0.04, -0.06]
    strip = ErrorStrip(TASK, {"a": rows}, 720, 120)
    np.testing.assert_allclose(strip.errors["a"], [0.0, 20.0, 40.0, 60.0])
    np.testing.assert_allclose(strip.means["a"], [0.0, 10.0, 20.0, 30.0])
