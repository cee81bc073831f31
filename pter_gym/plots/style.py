"""One style for all figures: sizes, Okabe and Ito's colours, units on every axis."""

import io
from collections.abc import Callable, Generator
from contextlib import contextmanager
from functools import wraps
from typing import Any, ParamSpec

import matplotlib as mpl
from cycler import cycler
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pter_gym.internal import palette
from pter_gym.internal.files import FilePath, write_bytes_atomic
from pter_gym.units import to_inch_pounds, to_inches

Arguments = ParamSpec("Arguments")

WIDTH = 7.5
"""Width of a figure [in]."""

DPI = 160

REFERENCE = "#3b4048"
"""Colour of what is desired, so no policy has it."""

COLOURS = (palette.BLUE, palette.VERMILLION, palette.GREEN, palette.PURPLE, palette.ORANGE, palette.SKY_BLUE)
DASHES = ("-", (0, (6, 1.5)), (0, (4, 1.5, 1, 1.5)), (0, (2, 1)))

STYLE: Any = {
    "axes.axisbelow": True,
    "axes.edgecolor": "#646b75",
    "axes.grid": True,
    "axes.labelcolor": "#1f2328",
    "axes.labelsize": 10.0,
    "axes.linewidth": 0.8,
    "axes.prop_cycle": cycler(color=2 * COLOURS, linestyle=3 * DASHES),
    "axes.titlelocation": "left",
    "axes.titlepad": 10.0,
    "axes.titlesize": 11.0,
    "figure.constrained_layout.use": True,
    "figure.dpi": DPI,
    "font.family": "DejaVu Sans",
    "font.size": 9.5,
    "grid.color": "#e3e5e9",
    "grid.linewidth": 0.8,
    "legend.edgecolor": "none",
    "legend.framealpha": 0.0,
    "lines.linewidth": 1.8,
    "text.color": "#1f2328",
    "xtick.color": "#646b75",
    "xtick.labelcolor": "#1f2328",
    "ytick.color": "#646b75",
    "ytick.labelcolor": "#1f2328",
}


@contextmanager
def in_force() -> Generator[None]:
    """Put the style in force, over Matplotlib's defaults; afterwards the user's settings are as they were."""
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

    ``per`` is what follows the inches in the unit, ``/s²`` for an acceleration.
    """
    axes.secondary_yaxis("right", functions=scaled(to_inches(unit))).set_ylabel(f"{name} [in{per}]")


def inch_pounds_right(axes: Axes, name: str = "torque") -> None:
    """Add an axis in the paper's in·lbf on the right of an axis in N·m."""
    axes.secondary_yaxis("right", functions=scaled(to_inch_pounds(1.0))).set_ylabel(f"{name} [in·lbf]")


def png(figure: Figure) -> bytes:
    """Return a figure as the content of a PNG file; the same figure gives the same bytes."""
    buffer = io.BytesIO()
    with in_force():
        figure.savefig(buffer, format="png", metadata={"Software": None})
    return buffer.getvalue()


def save(figure: Figure, path: FilePath) -> None:
    """Write a figure as a PNG file, whole or not at all."""
    write_bytes_atomic(path, png(figure))


def scaled(factor: float) -> tuple[Callable[[Any], Any], Callable[[Any], Any]]:
    """Return the functions of a second axis whose numbers are a factor times those of the first."""
    return lambda value: value * factor, lambda value: value / factor
