"""How a policy is drawn: colour, marker and dashes of its own, the same in every picture."""

import zlib
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, NamedTuple

from pter_gym.internal import palette

SOLID: Any = "-"
DASHED: Any = (0, (6, 1.5))
DOTTED: Any = (0, (1.5, 1.2))
DASH_DOTTED: Any = (0, (4, 1.5, 1, 1.5))
DASH_DOT_DOTTED: Any = (0, (4, 1.2, 1, 1.2, 1, 1.2))

_COLOURS = (
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
_FOUR_POINTS, _SIX_POINTS = (4, 1, 45), (6, 1, 0)
_MARKERS: tuple[Any, ...] = ("o", "s", "^", "D", "v", "P", "X", "<", ">", "p", "*", "d", "h", _FOUR_POINTS, _SIX_POINTS)
_DASHES = (SOLID, DASHED, DASH_DOTTED, DOTTED)


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
    shift, place = divmod(k, len(_COLOURS))
    return Look(_COLOURS[place], _MARKERS[(place + shift) % len(_MARKERS)], _DASHES[k % len(_DASHES)])


LEARNED, TUNED, OF_PAPER, PRIVILEGED, PLANS = SOLID, DASHED, DOTTED, DASH_DOTTED, DASH_DOT_DOTTED
"""Dashes of trained policies, tuned laws, those of the paper, those that know the future, and those that plan."""

LOOKS: Mapping[str, Look] = {
    name: numbered(place)._replace(dashes=dashes)
    for place, (name, dashes) in enumerate(
        {
            "ppo-standard": LEARNED,
            "torque-feedback-tuned": TUNED,
            "single-dof-tuned": TUNED,
            "residual": LEARNED,
            "impedance-tuned": TUNED,
            "predictive": PRIVILEGED,
            "velocity-ratio-tuned": TUNED,
            "predictive-honest": PLANS,
            "torque-feedback": OF_PAPER,
            "single-dof": OF_PAPER,
            "impedance": OF_PAPER,
            "locked": OF_PAPER,
            "velocity-ratio": OF_PAPER,
            "random": OF_PAPER,
            "free": OF_PAPER,
        }.items()
    )
}
"""Looks of the policies that have their own."""


def looks(names: Iterable[str]) -> dict[str, Look]:
    """Return the look of each policy; no two look the same, and up to 15 have neither colour nor marker in common.

    A name without a look of its own gets one that depends on the name alone, unless another one has it already.
    """
    wanted = list(dict.fromkeys(names))
    found = {name: LOOKS[name] for name in wanted if name in LOOKS}
    for name in sorted(set(wanted) - found.keys()):
        taken = {(look.colour, look.marker) for look in found.values()}
        found[name] = next(look for look in _candidates(name) if (look.colour, look.marker) not in taken)
    return {name: found[name] for name in wanted}


def _candidates(name: str) -> Iterator[Look]:
    """Yield all looks, the one that the name stands for first."""
    count = len(_COLOURS)
    first = zlib.adler32(name.encode()) % count
    for shift in range(count):
        for step in range(count):
            yield numbered(shift * count + (first + step) % count)
