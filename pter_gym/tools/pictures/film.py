"""Films: episodes side by side above their errors, written to a file or shown in a window."""

import io
import math
import tempfile
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import closing
from itertools import cycle
from pathlib import Path
from shutil import which
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from pter_gym._internal.files import write_bytes_atomic
from pter_gym.errors import DependencyError, ParameterError, StorageError, needs_extra
from pter_gym.params import Machine
from pter_gym.tasks.path_following import COLUMN, PathFollowing
from pter_gym.tools.palette import tint
from pter_gym.tools.pictures.drawing import (
    GROOVE,
    INK,
    MUTED,
    SMALL,
    Array,
    Box,
    Canvas,
    Picture,
    Subject,
    aim,
    apart,
    has_band,
    policy_colours,
    shortened,
    text_width,
)
from pter_gym.tools.pictures.size import HEIGHT, WIDTH, check_size
from pter_gym.tools.pictures.viewer import Window

__all__ = ["Film", "show_film", "write_film"]

TILE, MAX_SIZE = (360, 405), (1920, 1080)
"""Width and height [px] of one of several pictures, and the largest of all together."""

PAUSE = 1.0
"""Time for which the last frame is shown [s]."""

RATES = MappingProxyType({".webp": 12.5, ".mp4": 50.0, ".png": 50.0})
"""Endings of files, and frames per second of a film in one."""

WINDOW_RATE = 50.0

STRIP_WIDTH, STRIP_HEIGHT, LINE = 720, 132, 15
"""Size [px] of a strip of errors whose text has its normal size; height of a line of text in it."""

MIN_STRIP, MAX_SHARE = 60, 0.3
"""Least height of a strip [px], and the largest share of a film's height."""

STEPS = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000)
"""Distances [mm] between the marks of the scale, of which there are three at most."""


class Film:
    """Frames of episodes that begin together; a finished one keeps showing its last state.

    Parameters
    ----------
    machine, task
        What the episodes have in common.
    episodes
        Telemetry of each policy by its name, from the reset on, (T + 1, len(TELEMETRY)); at least
        one.
    rate
        Frames per second [1/s].
    speed
        Playback speed relative to real time: 0.5 is slow motion.
    size
        Width and height [px]; ``default_size`` by default.
    arms
        Names of the episodes whose arms are drawn, all by default; the strip of errors below them
        has all.

    Raises
    ------
    ParameterError
        If the size is out of range.
    """

    def __init__(
        self,
        machine: Machine,
        task: PathFollowing,
        episodes: Mapping[str, Any],
        rate: float,
        speed: float = 1.0,
        size: tuple[int, int] | None = None,
        arms: Collection[str] | None = None,
    ) -> None:
        names = [name for name in episodes if arms is None or name in arms]
        self.size = width, height = check_size(*(size or default_size(len(names), len(episodes))))
        strip = min(strip_height(len(episodes)), round(MAX_SHARE * height))
        self._strip = ErrorStrip(task, episodes, width, strip) if strip >= MIN_STRIP else None
        height -= strip if self._strip else 0
        self.rate, self._step = rate, speed / rate
        rows, columns = grid(len(names))
        x, y = (
            np.linspace(0, length, count + 1).round().astype(int).tolist()
            for length, count in ((width, columns), (height, rows))
        )
        self._tiles: list[tuple[int, int, Picture, Any]] = []
        for (row, column), name in zip(np.ndindex(rows, columns), names, strict=False):
            extent = x[column + 1] - x[column], y[row + 1] - y[row]
            picture = Picture(Subject(machine, task, name), *extent)
            self._tiles.append((x[column], y[row], picture, episodes[name]))
        duration = max(float(telemetry[-1, COLUMN.time]) for telemetry in episodes.values())
        self._count = 1 + math.ceil(duration / self._step - 1e-9)

    def __len__(self) -> int:
        """Return the number of frames; the last one stays for ``PAUSE``."""
        return self._count

    def pixels(self, frame: int) -> NDArray[np.uint8]:
        """Return a frame as a new array (height, width, 3); beyond the last, the last."""
        time = min(frame, self._count - 1) * self._step
        whole = np.full((*reversed(self.size), 3), 255, np.uint8)
        for left, top, picture, telemetry in self._tiles:
            past = telemetry[: count_until(time, telemetry[:, COLUMN.time])]
            pixels = picture.draw(past[-1], past[:, [*COLUMN.tip]])
            pixels[: 1 if top else 0] = pixels[:, : 1 if left else 0] = 227
            whole[top : top + len(pixels), left : left + pixels.shape[1]] = pixels
        if self._strip:
            pixels = self._strip.draw(time)
            whole[-len(pixels) :] = pixels
        return whole


class ErrorStrip:
    """Draws distances from the path, thin, and their means so far, bold, with names and means.

    Parameters
    ----------
    task
        What the episodes have in common.
    episodes
        Telemetry of each policy by its name, as ``Film`` takes it.
    width, height
        Size of the strip [px].

    Attributes
    ----------
    errors, means
        Distance from the path and its mean so far [mm] of each episode, (T + 1,).
    """

    def __init__(
        self, task: PathFollowing, episodes: Mapping[str, Any], width: int, height: int
    ) -> None:
        self._unit = unit = min(width / STRIP_WIDTH, height / STRIP_HEIGHT, 2.0)
        self._colours = policy_colours(episodes)
        self._times = {name: rows[:, COLUMN.time] for name, rows in episodes.items()}
        self.errors = {
            name: 1e3 * np.abs(rows[:, COLUMN.normal_error]) for name, rows in episodes.items()
        }
        self.means = {
            name: np.cumsum(e) / np.arange(1, len(e) + 1) for name, e in self.errors.items()
        }
        duration = max(float(times[-1]) for times in self._times.values())
        self._top = 1.05 * max(1.0, *(float(errors.max()) for errors in self.errors.values()))
        low, high = 1.4 * LINE * unit, height - 1.3 * LINE * unit
        self._plot = plot = Box(44 * unit, low, width - 205 * unit, high)
        width_of_plot = plot.right - plot.left
        self._x = {
            name: plot.left + width_of_plot * times / max(duration, 1e-9)
            for name, times in self._times.items()
        }
        self._background = Canvas.blank(width, height)
        self._draw_scale(aim(task), np.inf if has_band(task) else 1e3 * task.error_max, duration)

    def draw(self, time: float) -> NDArray[np.uint8]:
        """Return the strip at a time [s] as pixels, shape (height, width, 3)."""
        canvas, plot, unit = self._background.copy(), self._plot, self._unit
        counts = {name: count_until(time, times) for name, times in self._times.items()}
        for thick, values, soften in ((1.3, self.errors, tint), (2.6, self.means, str)):
            for name, count in counts.items():
                points = np.column_stack([self._x[name], self._y(values[name])])[:count]
                canvas.line(points, soften(self._colours[name]), max(thick * unit, 1.0))
        ends = {name: float(self.means[name][count - 1]) for name, count in counts.items()}
        ranked = sorted(ends, key=ends.__getitem__, reverse=True)
        heights = apart(self._y(np.array([ends[name] for name in ranked])), LINE * unit, plot.high)
        x, right, size = plot.right + 8 * unit, plot.right + 199 * unit, SMALL * unit
        for name, y in zip(ranked, heights, strict=True):
            number = f"{ends[name]:.1f} mm"
            room = right - x - text_width(number, size) - 6 * unit
            label = shortened(name if len(ends) > 1 else "mean", size, room)
            canvas.text(label, x, y, size, self._colours[name])
            canvas.text(number, right, y, size, self._colours[name], "r")
        return canvas.pixels()

    def _draw_scale(self, aim: str, limit: float, duration: float) -> None:
        """Draw lines at round distances and, if an error exceeds it, at the workspace's edge."""
        canvas, plot, unit = self._background, self._plot, self._unit
        line, size = LINE * unit, SMALL * unit
        canvas.box(0.0, 0.0, plot.right + 205 * unit, 1.0, GROOVE)
        title = f"distance from {aim} [mm]; bold: its mean so far"
        canvas.text(title, plot.left, 0.7 * line, size, INK)
        step = next((step for step in STEPS if 3 * step > self._top), STEPS[-1])
        for value in np.arange(0.0, self._top, step):
            y = self._y(value)
            canvas.box(plot.left, y - 0.5, plot.right, y + 0.5, GROOVE if value else MUTED)
            canvas.text(f"{value:g}", plot.left - 6 * unit, y, size, MUTED, "r")
        if limit < self._top:
            y = self._y(limit)
            canvas.box(plot.left, y - 0.5, plot.right, y + 0.5, INK)
            text = f"edge of the workspace, {limit:.3g} mm"
            canvas.text(text, plot.left + 4, y + 0.5 * line, size, INK)
        y = plot.high + 0.65 * line
        canvas.text("0 s", plot.left, y, size, MUTED)
        canvas.text(f"{duration:.1f} s", plot.right, y, size, MUTED, "r")

    def _y(self, error: Array | float) -> Any:
        return self._plot.high - (self._plot.high - self._plot.low) * error / self._top


def count_until(time: float, times: Array) -> int:
    """Return how many of ascending times are not later than a time [s]."""
    return int(np.searchsorted(times, time + 1e-9, side="right"))


def strip_height(count: int) -> int:
    """Return the preferred height [px] of the strip of ``count`` policies."""
    return max(STRIP_HEIGHT, LINE * (count + 2))


def grid(count: int) -> tuple[int, int]:
    """Return rows and columns for so many pictures: up to three in a row, then about square."""
    columns = count if count <= 3 else math.ceil(math.sqrt(count))
    return -(-count // columns), columns


def default_size(arms: int, policies: int) -> tuple[int, int]:
    """Return a film's size [px]: pictures of ``arms`` above the errors of ``policies``."""
    rows, columns = grid(arms)
    width, height = (WIDTH, HEIGHT) if arms == 1 else (columns * TILE[0], rows * TILE[1])
    height += strip_height(policies)
    scale = min(1.0, MAX_SIZE[0] / width, MAX_SIZE[1] / height)
    return round(scale * width), round(scale * height)


def check_suffix(path: Path) -> None:
    """Raise a ParameterError for other extensions, a DependencyError if ffmpeg is missing."""
    if path.suffix.lower() not in RATES:
        raise ParameterError(f"out must end in {', '.join(RATES)}, got {str(path)!r}")
    if path.suffix.lower() == ".mp4":
        _load_imageio()


def write_film(
    machine: Machine,
    task: PathFollowing,
    episodes: Mapping[str, Array],
    path: Path,
    *,
    speed: float = 1.0,
    size: tuple[int, int] | None = None,
    arms: Collection[str] | None = None,
    on_progress: Callable[[float], object] = lambda _: None,
) -> Path:
    """Write a film of policies side by side on one episode atomically, and return its path.

    Parameters
    ----------
    machine, task, episodes, speed, size, arms
        As for ``Film``.
    path
        A file that ends in ``.webp``, ``.mp4`` or ``.png``, which holds only the last frame; its
        folder must exist.
    on_progress
        Called with the fraction of the frames that have been drawn.

    Raises
    ------
    DependencyError
        If ffmpeg is missing for an ``.mp4``.
    ParameterError
        If the path has another extension, or the size is out of range.
    StorageError
        If the file cannot be written.
    """
    check_suffix(path)
    suffix = path.suffix.lower()
    film = Film(machine, task, episodes, RATES[suffix], speed, size, arms)

    def frames(count: int) -> Iterator[NDArray[np.uint8]]:
        for frame in range(count):
            yield film.pixels(frame)
            on_progress((frame + 1) / count)

    if suffix == ".webp":
        durations = [round(1000.0 / film.rate)] * (len(film) - 1) + [round(1000.0 * PAUSE)]
        content = encode_webp(frames(len(film)), durations)
    elif suffix == ".mp4":
        content = _encode_mp4(frames(len(film) + round(PAUSE * film.rate)), film.rate)
    else:
        content = _encoded(Image.fromarray(film.pixels(len(film) - 1)), "PNG")
    write_bytes_atomic(path, content)
    return path


def show_film(film: Film, title: str) -> None:
    """Show a film in a window, looping until it is closed; needs a display."""
    frames = cycle(range(len(film) + round(PAUSE * film.rate)))
    with closing(Window(film.size, film.rate, title)) as window:
        while window.is_open():
            window.show(film.pixels(next(frames)))


def encode_webp(
    frames: Iterable[NDArray[np.uint8]], durations: list[int], *, quality: int = 70, method: int = 0
) -> bytes:
    """Return frames as a WebP that repeats, each shown for its duration [ms]; one stands still.

    No frame but the first is whole (``kmax``): a film only plays from its start.
    """
    images = (Image.fromarray(frame) for frame in frames)
    settings = {"duration": durations, "loop": 0, "quality": quality, "method": method, "kmax": 0}
    return _encoded(next(images), "WEBP", save_all=True, append_images=images, **settings)


def _encoded(image: Image.Image, kind: str, **settings: Any) -> bytes:
    content = io.BytesIO()
    image.save(content, kind, **settings)
    return content.getvalue()


def _encode_mp4(frames: Iterator[NDArray[np.uint8]], rate: float) -> bytes:
    """Return H.264, whose width and height must be even: an odd edge loses its last pixels."""
    imageio = _load_imageio()
    options = ["-crf", "20", "-movflags", "+faststart"]
    settings = {"fps": rate, "quality": None, "macro_block_size": 2, "ffmpeg_log_level": "error"}
    try:
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "film.mp4"
            with imageio.get_writer(file, output_params=options, **settings) as video:
                for frame in frames:
                    video.append_data(frame[: frame.shape[0] // 2 * 2, : frame.shape[1] // 2 * 2])
            return file.read_bytes()
    except OSError as error:
        raise StorageError(
            f"the film cannot be made in the folder for temporary files: {error}"
        ) from error


def _load_imageio() -> Any:
    try:
        import imageio.v2 as imageio
        import imageio_ffmpeg

        program = imageio_ffmpeg.get_ffmpeg_exe()
    except (ImportError, RuntimeError) as error:
        raise needs_extra("mp4 with ffmpeg", "render") from error
    if not which(program):
        raise DependencyError(f"mp4 needs ffmpeg, there is no program {program!r}")
    return imageio
