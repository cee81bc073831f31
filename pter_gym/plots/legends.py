"""Legends that are whole however many entries they have, marks of policies on their lines, and scale bars."""

from collections.abc import Mapping, Sequence
from math import ceil
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties
from matplotlib.lines import Line2D
from mpl_toolkits.axes_grid1.anchored_artists import AnchoredSizeBar

from pter_gym.internal.looks import Look
from pter_gym.plots.style import INK, SMALL
from pter_gym.units import to_inches

LONGEST = 60
"""Most characters of a name in a picture; longer ones lose their middle."""

MOST_COLUMNS = 6
MARGIN = 0.06  # in, between the legend and the edge of the figure


def shown(name: str, longest: int = LONGEST) -> str:
    """Return a policy's name as pictures show it: short enough, and without mathematics."""
    half = longest // 2
    return (name if len(name) <= longest else f"{name[: half - 1]}…{name[-half:]}").replace("$", r"\$")


def legend_below(figure: Figure, handles: Sequence[Any], names: Sequence[str], note: str | None = None) -> None:
    """Show a legend below all axes, in as many columns as fit, and make the figure higher by the legend's height.

    Parameters
    ----------
    figure
        With the axes as high as they shall be.
    handles, names
        Of the entries.
    note
        Above the entries; it may have several lines.
    """
    renderer = FigureCanvasAgg(figure).get_renderer()
    columns = min(len(names), MOST_COLUMNS)
    while True:
        legend = figure.legend(handles, names, loc="outside lower center", ncols=columns, title=note)
        box = legend.get_window_extent(renderer)
        if columns == 1 or box.width <= figure.bbox.width - 2.0 * MARGIN * figure.dpi:
            break
        legend.remove()
        columns = ceil(len(names) / ceil(len(names) / (columns - 1)))
    figure.set_figheight(figure.get_figheight() + box.height / figure.dpi)


def legend_of(figure: Figure, axes: Axes, note: str | None = None) -> None:
    """Show what has a label in one of several panels below all of them."""
    handles, names = axes.get_legend_handles_labels()
    legend_below(figure, handles, names, note)


def entries(looks: Mapping[str, Look]) -> list[Line2D]:
    """Return what stands for each policy in a legend."""
    return [
        Line2D([], [], color=look.colour, linestyle=look.dashes, marker=look.marker, markersize=5.5)
        for look in looks.values()
    ]


def dots(place: int, count: int) -> tuple[float, float]:
    """Return where the line of one of several policies has its markers: apart from those of the others."""
    return (0.03 + 0.22 * place / count, 0.22)


def scale_bar(axes: Axes) -> None:
    """Add a bar of a round length to axes in metres at equal scale, which have their limits."""
    longest = 0.3 * float(np.ptp(axes.get_xlim()))
    decade = 10.0 ** np.floor(np.log10(longest))
    length = max(step * decade for step in (1.0, 2.0, 5.0) if step * decade <= longest)
    text = f"{length:g} m ({to_inches(length):.2g} in)"
    font = FontProperties(size=SMALL)
    bar = AnchoredSizeBar(
        axes.transData, length, text, "lower left", frameon=False, color=INK, sep=2, pad=0.2, fontproperties=font
    )
    axes.add_artist(bar)
