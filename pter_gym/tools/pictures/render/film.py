"""Videos: episodes side by side in frames at equal time intervals, written to a file or shown in a window."""

import io
import math
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from pter_gym._internal.files import write_bytes_atomic
from pter_gym.envs._size import HEIGHT, WIDTH, check_size
from pter_gym.errors import ParameterError, StorageError, needs_extra
from pter_gym.params import Machine
from pter_gym.tasks.path_following import COLUMN, PathFollowing
from pter_gym.tools.pictures.render.picture import Sheet, Subject, grid
from pter_gym.tools.pictures.render.window import Window

Array = NDArray[np.float64]
Progress = Callable[[], object]

SIDE_BY_SIDE = (480, 540)
"""Width and height of one of several pictures [px]."""

LARGEST = (1920, 1080)
"""Several pictures take no more than this together [px]."""

PAUSE = 1.0
"""Time for which the last frame is shown [s]."""

RATES = MappingProxyType({".mp4": 50, ".gif": 25, ".png": 50})
"""Endings of files, and frames per second of a film in one; a gif counts hundredths of a second."""

COLOURS = 64
"""Colours of a gif: more of them make the file larger and look no better."""


class Shot(NamedTuple):
    """An episode to show: its subject, and its telemetry from the reset on, (T + 1, len(TELEMETRY))."""

    subject: Subject
    telemetry: Array


class Film:
    """Frames of episodes that begin together; a finished one keeps showing its last state.

    Parameters
    ----------
    shots
        The episodes, at least one.
    rate
        Frames per second [1/s].
    speed
        Playback speed relative to real time: 0.5 is slow motion.
    size
        Width and height [px]; ``default_size`` by default.

    Raises
    ------
    ParameterError
        If the size is out of range.
    """

    def __init__(
        self, shots: Sequence[Shot], rate: float, speed: float = 1.0, size: tuple[int, int] | None = None
    ) -> None:
        self.size = check_size(*(size or default_size(len(shots))))
        self._sheet = Sheet(*self.size, [shot.subject for shot in shots])
        self._shots = shots
        self._step = speed / rate
        self._moving = 1 + math.ceil(max(shot.telemetry[-1, int(COLUMN.time)] for shot in shots) / self._step - 1e-9)
        self._frames = self._moving + round(PAUSE * rate)

    def __len__(self) -> int:
        """Return the number of frames."""
        return self._frames

    def pixels(self, frame: int) -> NDArray[np.uint8]:
        """Return a frame as a new array, shape (height, width, 3)."""
        time = min(frame, self._moving) * self._step
        return self._sheet.draw([_state(shot.telemetry, time) for shot in self._shots])


def film_of(
    machine: Machine,
    task: PathFollowing,
    episodes: Mapping[str, Array],
    rate: float,
    speed: float = 1.0,
    size: tuple[int, int] | None = None,
) -> Film:
    """Return a film of policies on one episode, side by side, from their names and telemetry; see ``Film``."""
    shots = [Shot(Subject(machine, task, name), telemetry) for name, telemetry in episodes.items()]
    return Film(shots, rate, speed, size)


def default_size(count: int) -> tuple[int, int]:
    """Return the size of that many pictures side by side [px]; a single one is as large as an environment's picture."""
    if count == 1:
        return WIDTH, HEIGHT
    rows, columns = grid(count)
    width, height = columns * SIDE_BY_SIDE[0], rows * SIDE_BY_SIDE[1]
    scale = min(1.0, LARGEST[0] / width, LARGEST[1] / height)
    return round(scale * width), round(scale * height)


def check_ending(path: Path) -> None:
    """Raise a ParameterError unless films can have this extension, a DependencyError if ffmpeg is missing for it."""
    if path.suffix.lower() not in RATES:
        raise ParameterError(f"out must end in {', '.join(RATES)}, got {str(path)!r}")
    if path.suffix.lower() == ".mp4":
        _load_imageio()


def frames_of(film: Film, path: Path) -> int:
    """Return how many frames are drawn for a file."""
    return 1 if path.suffix.lower() == ".png" else len(film)


def write_film(film: Film, path: Path, on_frame: Progress = lambda: None) -> None:
    """Write a film to a file atomically.

    Parameters
    ----------
    film
        The film; it should have the rate of the extension in ``RATES``.
    path
        A file that ends in ``.mp4``, ``.gif`` or ``.png``, which holds only the last frame; its folder must exist.
    on_frame
        Called after each of its frames, see ``frames_of``.

    Raises
    ------
    StorageError
        If it cannot be written.
    """
    encode = {".mp4": _mp4, ".gif": _gif, ".png": _png}[path.suffix.lower()]
    write_bytes_atomic(path, encode(film, on_frame))


def show_film(film: Film, rate: float, title: str) -> None:
    """Show a film in a window, looping until it is closed; needs a display."""
    window = Window(film.size, rate, title)
    try:
        frame = 0
        while window.is_open():
            window.show(film.pixels(frame))
            frame = (frame + 1) % len(film)
    finally:
        window.close()


def _load_imageio() -> Any:
    try:
        import imageio.v2 as imageio
        import imageio_ffmpeg

        imageio_ffmpeg.get_ffmpeg_exe()
    except (ImportError, RuntimeError) as error:
        raise needs_extra("mp4 with ffmpeg", "render") from error
    return imageio


def _mp4(film: Film, on_frame: Progress) -> bytes:
    """Return H.264, whose width and height must be even: an odd edge loses its last pixels."""
    width, height = (length - length % 2 for length in film.size)
    options = ["-crf", "20", "-movflags", "+faststart"]
    imageio = _load_imageio()
    try:
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "film.mp4"
            with imageio.get_writer(
                file,
                fps=RATES[".mp4"],
                quality=None,
                macro_block_size=2,
                output_params=options,
                ffmpeg_log_level="error",
            ) as video:
                for frame in range(len(film)):
                    video.append_data(film.pixels(frame)[:height, :width])
                    on_frame()
            return file.read_bytes()
    except OSError as error:
        raise StorageError(f"the film cannot be made in the folder for temporary files: {error}") from error


def _gif(film: Film, on_frame: Progress) -> bytes:
    """Return a gif in the most frequent colours of the last frame; others become the nearest of them."""
    last, counts = np.unique(_codes(film.pixels(len(film) - 1)), return_counts=True)
    palette = _parts(last[np.argsort(-counts, kind="stable")[:COLOURS]])

    def frames() -> Iterator[Image.Image]:
        for frame in range(len(film)):
            codes, where = np.unique(_codes(film.pixels(frame)), return_inverse=True)
            nearest = ((_parts(codes)[:, None] - palette) ** 2).sum(axis=2).argmin(axis=1)
            image = Image.frombytes("P", film.size, nearest[where].astype(np.uint8).tobytes())
            image.putpalette(palette.astype(np.uint8).tobytes())
            yield image
            on_frame()

    drawn, content = frames(), io.BytesIO()
    duration = round(1000 / RATES[".gif"])
    next(drawn).save(content, "GIF", save_all=True, append_images=drawn, duration=duration, loop=0)
    return content.getvalue()


def _codes(picture: NDArray[np.uint8]) -> NDArray[np.int32]:
    """Return the colour of each pixel as one number."""
    return picture.reshape(-1, 3) @ np.array([65536, 256, 1], np.int32)


def _parts(codes: NDArray[np.int32]) -> NDArray[np.int32]:
    """Return colours as red, green and blue, (K, 3)."""
    return np.stack([codes >> 16, codes >> 8 & 255, codes & 255], axis=1)


def _png(film: Film, on_frame: Progress) -> bytes:
    content = io.BytesIO()
    Image.fromarray(film.pixels(len(film) - 1)).save(content, "PNG")
    on_frame()
    return content.getvalue()


def _state(telemetry: Any, time: float) -> tuple[Array, Array]:
    """Return the row at a time [s] or at the end, and the trail until then."""
    row = int(np.searchsorted(telemetry[:, COLUMN.time], time + 1e-9, side="right")) - 1
    return telemetry[row], telemetry[: row + 1, [*COLUMN.tip]]
