"""The style of all figures: sizes, colours, units on every axis, legends, and files."""

import io
from collections.abc import Callable, Generator, Iterable
from contextlib import contextmanager
from math import ceil
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.text import Text
from matplotlib.transforms import Bbox
from numpy.typing import NDArray

from pter_gym._internal.files import FilePath, expand_path, write_bytes_atomic
from pter_gym.errors import ParameterError
from pter_gym.tools import palette as p
from pter_gym.units import to_inch_pounds, to_inches

Array = NDArray[np.float64]

WIDTH, SMALL = 7.16, 7.5
"""Width of a figure [in], that of two columns of a journal; size of the smallest text [pt]."""

MILLIMETRE = 1e-3
INK, MUTED, REFERENCE = "#1f2328", "#646b75", "#3b4048"
CLUTCH_COLOURS = tuple(map(p.clutch_colour, ((1, 0), (0, 1), (1, -1), (1, 1))))
COLOURS = p.LINE_PALETTE
Marker = str | tuple[int, int, int]
Dashes = str | tuple[int, tuple[float, ...]]

MARKERS: tuple[Marker, ...] = (*"os^DvPX<>p*dh", (4, 1, 45), (6, 1, 0))
DASHES: tuple[Dashes, ...] = ("-", (0, (6, 1.5)), (0, (4, 1.5, 1, 1.5)), (0, (1.5, 1.2)))


SIDES = np.array([(x, y) for x in (0.0, -1.0, 1.0) for y in (1.0, -1.0, 0.0)])
"""Where a name may stand, seen from a point of its line: above, below, beside it."""


class Look(NamedTuple):
    """The look of a line or marker, in Matplotlib's terms."""

    colour: str
    marker: Marker
    dashes: Dashes


def numbered(k: int) -> Look:
    """Return the look of item k from 0: 15 colours and markers, then other combinations of them."""
    shift, place = divmod(k, len(COLOURS))
    return Look(COLOURS[place], MARKERS[(place + shift) % len(MARKERS)], DASHES[k % len(DASHES)])


def looks(names: Iterable[str]) -> dict[str, Look]:
    """Return a look for each name, in order; up to 15 share neither colour nor marker."""
    return {name: numbered(k) for k, name in enumerate(dict.fromkeys(names))}


STYLE = Path(__file__).with_suffix(".mplstyle")
"""Matplotlib's settings; ``matplotlib.style.use(STYLE)`` applies them to your own figures."""


@contextmanager
def _style() -> Generator[None]:
    """Apply the style to Matplotlib's defaults, and restore the user's settings afterwards."""
    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update(mpl.rc_params_from_file(STYLE, use_default_template=False))
        yield


styled = _style()
"""Decorator of functions that make a figure in the style; in a ``with`` statement, once only."""


def label(axes: Axes, x: str, y: str) -> None:
    """Name both axes, each with its unit, as in ``time [s]``."""
    axes.set(xlabel=x, ylabel=y)


def inches_above(axes: Axes, name: str, unit: float = 1.0) -> None:
    """Add an axis in inches above; ``unit`` is the length in metres of one on the axis below."""
    axes.secondary_xaxis("top", functions=scaled(to_inches(unit))).set_xlabel(f"{name} [in]")


def inches_right(axes: Axes, name: str, unit: float = 1.0, per: str = "") -> None:
    """Add an axis in inches on the right; ``per`` ends its unit: ``/s²`` for an acceleration."""
    axes.secondary_yaxis("right", functions=scaled(to_inches(unit))).set_ylabel(f"{name} [in{per}]")


def inch_pounds_right(axes: Axes, name: str = "torque") -> None:
    """Add an axis in the paper's in·lbf on the right of an axis in N·m."""
    axes.secondary_yaxis("right", functions=scaled(to_inch_pounds(1.0))).set_ylabel(
        f"{name} [in·lbf]"
    )


def scaled(factor: float) -> tuple[Callable[[Any], Any], Callable[[Any], Any]]:
    """Return the functions of a second axis whose numbers are a factor times those of the first."""
    return lambda value: value * factor, lambda value: value / factor


def legend_of(figure: Figure, axes: Axes, note: str | None = None) -> None:
    """Add a legend below all panels, in as many columns as fit, and make room for it.

    It has everything with a label in one panel; the note is written above its entries.
    """
    handles, names = axes.get_legend_handles_labels()
    renderer, columns = FigureCanvasAgg(figure).get_renderer(), min(len(names), 6)
    while True:
        legend = figure.legend(
            handles, names, loc="outside lower center", ncols=columns, title=note
        )
        box = legend.get_window_extent(renderer)
        if columns == 1 or box.width <= 0.98 * figure.bbox.width:
            break
        legend.remove()
        columns = ceil(len(names) / ceil(len(names) / (columns - 1)))
    figure.set_figheight(figure.get_figheight() + box.height / figure.dpi)


def name_lines(figure: Figure, axes: Axes, note: str | None = None) -> None:
    """Write the name of each line beside it, or show a legend if there is no room for one.

    A note goes below all panels.
    """
    figure.draw_without_rendering()  # lays out the panels
    frame, gap = axes.get_window_extent(), 0.055 * figure.dpi
    low, high = np.array(frame.min) + gap, np.array(frame.max) - gap
    lines = {line: points for line in axes.lines if len(points := _drawn(line))}
    occupied = [_spread(text.get_window_extent()) for text in axes.texts]
    labels = list[Text]()
    handles: Any = axes.get_legend_handles_labels()
    for line, name in zip(*handles, strict=True):
        colour = line.get_color()
        text = axes.text(0.0, 0.0, name, color=colour, fontsize=SMALL, ha="center", va="center")
        labels.append(text)
        box = text.get_window_extent()
        half: Array = np.array(box.size) / 2.0
        others = [points for other, points in lines.items() if other is not line]
        places = (lines[line][::-1, None] + SIDES * (half + 1.5 * gap)).reshape(-1, 2)
        inside = np.all((places - half > low) & (places + half < high), axis=1)
        own, rest = _room(places, half, lines[line]), _room(places, half, *others, *occupied)
        room = np.where(inside & (own > gap), rest - own, 0.0).clip(max=6.0 * gap)
        best = int(room.argmax())
        if room[best] < 0.3 * gap:
            for text in labels:
                text.remove()
            return legend_of(figure, axes, note)
        text.set_position(tuple(axes.transData.inverted().transform(places[best])))
        occupied.append(_spread(box) - box.min + places[best] - half)
    figure.supxlabel(note or "", fontsize=SMALL)
    return None


def _drawn(line: Line2D) -> Array:
    """Return points along a line, equally far apart [px]."""
    corners: Array = line.get_transform().transform(line.get_xydata())
    corners = corners[np.isfinite(corners).all(axis=1)]
    if not len(corners):
        return corners
    way = np.cumsum(np.hypot(*np.diff(corners, axis=0, prepend=corners[:1]).T))
    even = np.linspace(0.0, float(way[-1]), 200)
    return np.column_stack([np.interp(even, way, corners[:, k]) for k in (0, 1)])


def _spread(box: Bbox) -> Array:
    """Return points on the long edges of a box [px]."""
    return np.array([(box.x0 + k / 8 * box.width, y) for y in (box.y0, box.y1) for k in range(9)])


def _room(places: Array, half: Array, *points: Array) -> Array:
    """Return the distances of boxes, at their places, from points [px]."""
    near = [np.max(np.abs(places[:, None] - line) - half, axis=2).min(axis=1) for line in points]
    return np.min([np.full(len(places), np.inf), *near], axis=0)


def rounded_percent(share: float, digits: int = 0, *, signed: bool = False) -> str:
    """Return a share in percent with a typographic minus sign, and no sign if it rounds to zero."""
    return f"{100.0 * share:{'+' if signed else ''}z.{digits}f}".replace("-", "−") + " %"


METADATA: dict[str, dict[str, None]] = {
    ".png": {"Software": None},
    ".pdf": {"Creator": None, "Producer": None, "CreationDate": None},
}
"""What files do not hold, by their endings, so that the same figure gives the same bytes."""


def png(figure: Figure) -> bytes:
    """Return a figure as the content of a PNG file."""
    return encoded(figure, ".png")


def encoded(figure: Figure, suffix: str) -> bytes:
    """Return a figure as the content of a file that ends in a key of ``METADATA``."""
    buffer = io.BytesIO()
    with _style():
        figure.savefig(buffer, format=suffix[1:], metadata=METADATA[suffix])
    return buffer.getvalue()


def save(figure: Figure, path: FilePath) -> Path:
    """Write a figure atomically, as PNG or, in vectors, as PDF, and return its path.

    Raises
    ------
    ParameterError
        If the path ends in neither ``.png`` nor ``.pdf``.
    """
    file = expand_path("path", path)
    if (suffix := file.suffix.lower()) not in METADATA:
        raise ParameterError(f"path must end in .png or .pdf, got {str(path)!r}")
    write_bytes_atomic(file, encoded(figure, suffix))
    return file
