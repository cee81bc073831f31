"""Shared parts of the figures: remarks beside the data, and readable names of machines."""

from typing import Literal

from matplotlib.axes import Axes

from pter_gym.tools.figures import MUTED, SMALL
from pter_gym.tools.paper.experiments.claims import NAMES

FAINT = "#8b929c"
"""Colour of marks beside the data."""

MILLIMETRE = 1e-3


def mark(
    axes: Axes,
    text: str,
    position: tuple[float, float],
    offset: tuple[float, float] = (0.0, 0.0),
    *,
    aligned: Literal["left", "center"] = "left",
    colour: str = MUTED,
) -> None:
    """Write a remark at a position in the data, moved by an offset in points."""
    axes.annotate(
        text,
        position,
        offset,
        textcoords="offset points",
        ha=aligned,
        color=colour,
        fontsize=SMALL,
        annotation_clip=False,
    )


def mark_line(axes: Axes, text: str, x: float, *, top: bool) -> None:
    """Write a remark beside a vertical line, at the top or the bottom of the axes."""
    low, high = axes.get_ylim()
    mark(axes, text, (x, high if top else low), (4.0, -11.0 if top else 5.0))


def name_of(machine: str) -> str:
    """Return a machine's readable name."""
    return NAMES.get(machine, machine.replace("_", " ")).removeprefix("the ")
