"""Names and marks of policies, and scale bars."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties
from matplotlib.lines import Line2D
from mpl_toolkits.axes_grid1.anchored_artists import AnchoredSizeBar

from pter_gym.tools.figures import INK, SMALL, Look, legend_below
from pter_gym.units import to_inches

LONGEST = 60
"""Most characters of a name in a picture; longer ones lose their middle."""


def shown(name: str, longest: int = LONGEST) -> str:
    """Return a policy's name for pictures: short enough, and without mathematical markup."""
    half = longest // 2
    return (name if len(name) <= longest else f"{name[: half - 1]}…{name[-half:]}").replace("$", r"\$")


def entries(looks: Mapping[str, Look]) -> list[Line2D]:
    """Return the legend's handle of each policy."""
    return [
        Line2D([], [], color=look.colour, linestyle=look.dashes, marker=look.marker, markersize=5.5)
        for look in looks.values()
    ]


def name_policies(
    figure: Figure, looks: Mapping[str, Look], names: Sequence[str], note: str, scene: Mapping[str, Line2D]
) -> None:
    """Add the legend of policies below a figure, after its other entries; ``note`` goes above."""
    legend_below(figure, [*scene.values(), *entries(looks)], [*scene, *map(shown, names)], note)


def dots(place: int, count: int) -> tuple[float, float]:
    """Return the marker positions on one policy's line, apart from those of other policies."""
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
