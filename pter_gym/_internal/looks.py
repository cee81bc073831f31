"""How one of several things is drawn: a colour, a marker and dashes."""

from collections.abc import Iterable
from typing import Any, NamedTuple

from pter_gym._internal import palette

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


class Look(NamedTuple):
    """What a line or a point looks like.

    Attributes
    ----------
    colour
        As #rrggbb.
    marker
        Matplotlib's name of it, or corners, style and angle [°].
    dashes
        ``-``, or offset and lengths of dashes and gaps in widths of the line.
    """

    colour: str
    marker: Any
    dashes: Any


def numbered(k: int) -> Look:
    """Return the look of the k-th of several things, from 0 on: 15 colours and markers, then other pairs of them."""
    shift, place = divmod(k, len(COLOURS))
    return Look(COLOURS[place], MARKERS[(place + shift) % len(MARKERS)], DASHES[k % len(DASHES)])


def looks(names: Iterable[str]) -> dict[str, Look]:
    """Return a look for each name, by its place among the names in alphabetical order."""
    wanted = list(dict.fromkeys(names))
    found = {name: numbered(k) for k, name in enumerate(sorted(wanted))}
    return {name: found[name] for name in wanted}
