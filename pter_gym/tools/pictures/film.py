"""Films: episodes side by side above their errors, written to a file or shown in a window."""

import io
import math
import tempfile
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
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
from pter_gym.tools.pictures.drawing import Array, Picture, Subject
from pter_gym.tools.pictures.size import HEIGHT, WIDTH, check_size
from pter_gym.tools.pictures.strip import MAX_SHARE, MIN_HEIGHT, ErrorStrip, strip_height
from pter_gym.tools.pictures.viewer import Window

TILE, MAX_SIZE = (360, 405), (1920, 1080)
"""Width and height [px] of one of several pictures, and the largest of all together."""

PAUSE = 1.0
"""Time for which the last frame is shown [s]."""

RATES = MappingProxyType({".webp": 12.5, ".mp4": 50.0, ".png": 50.0})
"""Endings of files, and frames per second of a film in one."""

WINDOW_RATE = 50.0


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
        self._strip = ErrorStrip(task, episodes, width, strip) if strip >= MIN_HEIGHT else None
        height -= strip if self._strip else 0
        self.rate = rate
        self._step = speed / rate
        self._episodes = [episodes[name] for name in names]
        rows, columns = grid(len(names))
        x = np.linspace(0, width, columns + 1).round().astype(int)
        y = np.linspace(0, height, rows + 1).round().astype(int)
        self._pictures: list[tuple[int, int, Picture]] = []
        for k, name in enumerate(names):
            row, column = divmod(k, columns)
            size = int(np.diff(x)[column]), int(np.diff(y)[row])
            picture = Picture(Subject(machine, task, name), *size)
            self._pictures.append((int(x[column]), int(y[row]), picture))
        duration = max(float(telemetry[-1, COLUMN.time]) for telemetry in episodes.values())
        self._count = 1 + math.ceil(duration / self._step - 1e-9)

    def __len__(self) -> int:
        """Return the number of frames; the last one stays for ``PAUSE``."""
        return self._count

    def pixels(self, frame: int) -> NDArray[np.uint8]:
        """Return a frame as a new array (height, width, 3); beyond the last, the last."""
        time = min(frame, self._count - 1) * self._step
        whole = np.full((*reversed(self.size), 3), 255, np.uint8)
        for (left, top, picture), telemetry in zip(self._pictures, self._episodes, strict=True):
            row = int(np.searchsorted(telemetry[:, COLUMN.time], time + 1e-9, side="right")) - 1
            pixels = picture.draw(telemetry[row], telemetry[: row + 1, [*COLUMN.tip]])
            pixels[: 1 if top else 0] = pixels[:, : 1 if left else 0] = 227
            whole[top : top + len(pixels), left : left + pixels.shape[1]] = pixels
        if self._strip:
            pixels = self._strip.draw(time)
            whole[-len(pixels) :] = pixels
        return whole


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
        Called with the share of the frames that have been drawn.

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
    window = Window(film.size, film.rate, title)
    count = len(film) + round(PAUSE * film.rate)
    frame = 0
    try:
        while window.is_open():
            window.show(film.pixels(frame))
            frame = (frame + 1) % count
    finally:
        window.close()


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
