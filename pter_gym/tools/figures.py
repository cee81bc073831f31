"""One style for all figures: sizes, colours, units on every axis, legends, and how a figure becomes files."""

import io
from collections.abc import Callable, Generator, Iterable, Sequence
from contextlib import contextmanager
from functools import wraps
from math import ceil
from pathlib import Path
from typing import Any, NamedTuple, ParamSpec

import matplotlib as mpl
from cycler import cycler
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from pter_gym._internal import palette
from pter_gym._internal.files import FilePath, find_path, write_bytes_atomic
from pter_gym.errors import ParameterError
from pter_gym.units import to_inch_pounds, to_inches

Arguments = ParamSpec("Arguments")

WIDTH = 7.16
"""Width of a figure [in], that of two columns of a journal."""

DPI = 200

SMALL = 7.5
"""Size of the smallest text [pt]."""

INK = "#1f2328"
MUTED = "#646b75"

REFERENCE = "#3b4048"
"""Colour of what is desired, so no policy has it."""

CLUTCH_COLOURS = (palette.BLUE, palette.ORANGE, palette.GREEN, palette.PURPLE)

MILLIMETRE = 1e-3

COLOURS = (
    palette.BLUE,
    palette.VERMILLION,
    palette.GREEN,
    palette.PURPLE,
    palette.ORANGE,
    palette.SKY_BLUE,
    palette.BLACK,
    palette.NAVY,
    palette.BRICK,
    palette.SAGE,
    palette.MAROON,
    palette.PLUM,
    palette.SLATE,
    palette.CORNFLOWER,
    palette.ULTRAMARINE,
)
MARKERS: tuple[Any, ...] = ("o", "s", "^", "D", "v", "P", "X", "<", ">", "p", "*", "d", "h", (4, 1, 45), (6, 1, 0))
DASHES: tuple[Any, ...] = ("-", (0, (6, 1.5)), (0, (4, 1.5, 1, 1.5)), (0, (1.5, 1.2)))
"""Solid, dashed, dash-dotted and dotted: lengths in widths of the line."""


class Look(NamedTuple):
    """The look of a line or marker, in Matplotlib's terms."""

    colour: str
    marker: Any
    dashes: Any


def numbered(k: int) -> Look:
    """Return the look of item k, counted from 0: 15 colours and markers, then other combinations of them."""
    shift, place = divmod(k, len(COLOURS))
    return Look(COLOURS[place], MARKERS[(place + shift) % len(MARKERS)], DASHES[k % len(DASHES)])


def looks(names: Iterable[str]) -> dict[str, Look]:
    """Return a look for each name, in order; up to 15 share neither colour nor marker."""
    return {name: numbered(k) for k, name in enumerate(dict.fromkeys(names))}


STYLE: Any = {
    "axes.axisbelow": True,
    "axes.edgecolor": MUTED,
    "axes.grid": True,
    "axes.labelcolor": INK,
    "axes.labelsize": 9.0,
    "axes.linewidth": 0.8,
    "axes.prop_cycle": cycler(color=COLOURS, linestyle=[numbered(k).dashes for k in range(len(COLOURS))]),
    "axes.titlelocation": "left",
    "axes.titlepad": 6.0,
    "axes.titlesize": 9.0,
    "errorbar.capsize": 2.5,
    "figure.constrained_layout.h_pad": 0.07,
    "figure.constrained_layout.use": True,
    "figure.constrained_layout.w_pad": 0.07,
    "figure.dpi": DPI,
    "figure.figsize": (WIDTH, 4.0),
    "font.family": "DejaVu Sans",
    "font.size": 8.5,
    "grid.color": "#e3e5e9",
    "grid.linewidth": 0.8,
    "legend.edgecolor": "none",
    "legend.fontsize": 8.5,
    "legend.framealpha": 0.0,
    "legend.title_fontsize": 8.5,
    "lines.linewidth": 1.5,
    "lines.markersize": 5.0,
    "pdf.fonttype": 42,
    "text.color": INK,
    "xtick.color": MUTED,
    "xtick.labelcolor": INK,
    "xtick.labelsize": 8.5,
    "ytick.color": MUTED,
    "ytick.labelcolor": INK,
    "ytick.labelsize": 8.5,
}
"""Matplotlib's settings; ``matplotlib.style.use(STYLE)`` puts them in force for figures of your own."""


@contextmanager
def in_force() -> Generator[None]:
    """Apply the style on top of Matplotlib's defaults; afterwards the user's settings are restored."""
    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update(STYLE)
        yield


def styled(draw: Callable[Arguments, Figure]) -> Callable[Arguments, Figure]:
    """Let a function that makes a figure use the style."""

    @wraps(draw)
    def in_style(*args: Arguments.args, **kwargs: Arguments.kwargs) -> Figure:
        with in_force():
            return draw(*args, **kwargs)

    return in_style


def label(axes: Axes, x: str, y: str) -> None:
    """Name both axes, each with its unit, as in ``time [s]``."""
    axes.set_xlabel(x)
    axes.set_ylabel(y)


def inches_above(axes: Axes, name: str, unit: float = 1.0) -> None:
    """Add an axis in the paper's inches above; ``unit`` is the length in metres of one on the axis below."""
    axes.secondary_xaxis("top", functions=scaled(to_inches(unit))).set_xlabel(f"{name} [in]")


def inches_right(axes: Axes, name: str, unit: float = 1.0, per: str = "") -> None:
    """Add an axis in the paper's inches on the right; ``unit`` is the length in metres of one on the left axis.

    ``per`` follows the inches in the unit: ``/s²`` for an acceleration.
    """
    axes.secondary_yaxis("right", functions=scaled(to_inches(unit))).set_ylabel(f"{name} [in{per}]")


def inch_pounds_right(axes: Axes, name: str = "torque") -> None:
    """Add an axis in the paper's in·lbf on the right of an axis in N·m."""
    axes.secondary_yaxis("right", functions=scaled(to_inch_pounds(1.0))).set_ylabel(f"{name} [in·lbf]")


def scaled(factor: float) -> tuple[Callable[[Any], Any], Callable[[Any], Any]]:
    """Return the functions of a second axis whose numbers are a factor times those of the first."""
    return lambda value: value * factor, lambda value: value / factor


def legend_below(figure: Figure, handles: Sequence[Any], names: Sequence[str], note: str | None = None) -> None:
    """Show a legend below all axes, in as many columns as fit, and make the figure higher by the legend's height.

    ``note`` goes above the entries; it may have several lines.
    """
    renderer = FigureCanvasAgg(figure).get_renderer()
    columns = min(len(names), 6)
    while True:
        legend = figure.legend(handles, names, loc="outside lower center", ncols=columns, title=note)
        box = legend.get_window_extent(renderer)
        if columns == 1 or box.width <= 0.98 * figure.bbox.width:
            break
        legend.remove()
        columns = ceil(len(names) / ceil(len(names) / (columns - 1)))
    figure.set_figheight(figure.get_figheight() + box.height / figure.dpi)


def legend_of(figure: Figure, axes: Axes, note: str | None = None) -> None:
    """Show a legend below all panels, with everything that has a label in one of them."""
    handles, names = axes.get_legend_handles_labels()
    legend_below(figure, handles, names, note)


def percent(share: float, digits: int = 0, *, signed: bool = False) -> str:
    """Return a share in percent with a typographic minus sign, and no sign if it rounds to zero."""
    value = f"{100.0 * share:{'+' if signed else ''}z.{digits}f}".replace("-", "−")
    return f"{value} %"


def png(figure: Figure) -> bytes:
    """Return a figure as the content of a PNG file; the same figure gives the same bytes."""
    return _content(figure, "png", {"Software": None})


def pdf(figure: Figure) -> bytes:
    """Return a figure as the content of a PDF file, in vectors; the same figure gives the same bytes."""
    return _content(figure, "pdf", {"Creator": None, "Producer": None, "CreationDate": None})


def _content(figure: Figure, kind: str, metadata: dict[str, None]) -> bytes:
    buffer = io.BytesIO()
    with in_force():
        figure.savefig(buffer, format=kind, metadata=metadata)
    return buffer.getvalue()


def save(figure: Figure, path: FilePath) -> tuple[Path, Path]:
    """Write a figure as a PNG file and, in vectors, as a PDF file beside it, each atomically.

    Parameters
    ----------
    figure
        The figure.
    path
        Path of the PNG file.

    Returns
    -------
    tuple of Path
        The PNG and the PDF file.

    Raises
    ------
    ParameterError
        If the path does not end in ``.png``.
    """
    first = find_path("path", path)
    if first.suffix != ".png":
        raise ParameterError(f"path must end in .png, got {str(path)!r}")
    second = first.with_suffix(".pdf")
    contents = {first: png(figure), second: pdf(figure)}
    for each, content in contents.items():
        write_bytes_atomic(each, content)
    return first, second
