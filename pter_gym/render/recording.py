"""Films in files and on the screen: mp4 with ffmpeg, gif and png with Pillow."""

import tempfile
from collections.abc import Callable
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from pter_gym.errors import StorageError, needs_extra, unknown_name
from pter_gym.internal.files import write_bytes_atomic
from pter_gym.render.colours import Colours
from pter_gym.render.film import Film
from pter_gym.render.window import Window

Progress = Callable[[], object]

RATES = MappingProxyType({".mp4": 50, ".gif": 25, ".png": 50})
"""Endings of files, and frames for each second of a film in one; a gif counts hundredths of a second."""

SAMPLES = 5
"""Frames of which the colours of a gif are taken."""


def check_ending(path: Path) -> None:
    """Raise a ParameterError unless films have files of this ending, a DependencyError if ffmpeg is missing for it."""
    if path.suffix.lower() not in RATES:
        raise unknown_name("out's ending", path.suffix, RATES)
    if path.suffix.lower() == ".mp4":
        _load_ffmpeg()


def write_film(film: Film, path: Path, on_frame: Progress = lambda: None) -> None:
    """Write a film to a file, whole or not at all.

    Parameters
    ----------
    film
        What to write; it should have the rate of the ending in ``RATES``.
    path
        A file that ends in ``.mp4``, ``.gif`` or ``.png``, which holds the last frame alone; its folder must exist.
    on_frame
        Called after each of the ``frames_of`` it.

    Raises
    ------
    StorageError
        If it cannot be written.
    """
    write = {".mp4": _write_mp4, ".gif": _write_gif, ".png": _write_png}[path.suffix.lower()]
    try:
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / f"film{path.suffix.lower()}"
            write(film, file, on_frame)
            content = file.read_bytes()
    except OSError as error:
        raise StorageError(f"the film cannot be made in the folder for temporary files: {error}") from error
    write_bytes_atomic(path, content)


def frames_of(film: Film, path: Path) -> int:
    """Return how many frames are drawn for a file."""
    return 1 if path.suffix.lower() == ".png" else len(film)


def show_film(film: Film, rate: float, title: str) -> None:
    """Show a film in a window, again and again until it is closed; needs a display."""
    window = Window(film.size, rate, title)
    try:
        frame = 0
        while window.is_open():
            window.show(film.canvas(frame).surface())
            frame = (frame + 1) % len(film)
    finally:
        window.close()


def _load_ffmpeg() -> Any:
    try:
        import imageio_ffmpeg

        imageio_ffmpeg.get_ffmpeg_exe()
    except (ImportError, RuntimeError) as error:
        raise needs_extra("mp4 with ffmpeg", "render") from error
    return imageio_ffmpeg


def _write_mp4(film: Film, file: Path, on_frame: Progress) -> None:
    even = "pad=ceil(iw/2)*2:ceil(ih/2)*2:color=white"  # as its way to store colours needs
    video = _load_ffmpeg().write_frames(
        str(file),
        film.size,
        fps=RATES[".mp4"],
        codec="libx264",
        quality=None,
        macro_block_size=1,
        output_params=["-crf", "20", "-vf", even, "-movflags", "+faststart"],
        ffmpeg_log_level="error",
    )
    video.send(None)
    try:
        for frame in range(len(film)):
            video.send(film.pixels(frame))
            on_frame()
    finally:
        video.close()


def _write_gif(film: Film, file: Path, on_frame: Progress) -> None:
    colours = Colours([film.pixels(frame) for frame in np.linspace(0, len(film) - 1, SAMPLES).astype(int).tolist()])

    def drawn(frame: int) -> Any:
        image = colours.image(film.pixels(frame))
        on_frame()
        return image

    rest = (drawn(frame) for frame in range(1, len(film)))
    duration = round(1000 / RATES[".gif"])
    drawn(0).save(file, save_all=True, append_images=rest, duration=duration, loop=0)


def _write_png(film: Film, file: Path, on_frame: Progress) -> None:
    from PIL import Image

    Image.fromarray(film.pixels(len(film) - 1)).save(file)
    on_frame()
