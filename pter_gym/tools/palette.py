"""Colours, #rrggbb, distinct with any common colour vision: Okabe and Ito's, and eight more."""

BLACK = "#000000"
ORANGE = "#e69f00"
SKY_BLUE = "#56b4e9"
GREEN = "#009e73"
BLUE = "#0072b2"
VERMILLION = "#d55e00"
PURPLE = "#cc79a7"

PLUM = "#4b005a"
MAROON = "#5a0f0f"
NAVY = "#0000b4"
BRICK = "#962d00"
CORNFLOWER = "#5a87ff"
SLATE = "#4b4b69"
SAGE = "#a5c3a5"
ULTRAMARINE = "#002dff"

PICTURE = {"link-a": BLUE, "link-b": "#c97b00", "force": "#00845f", "trail": "#b5508c"}
"""Colours of an arm's picture, by their CSS names; the web page has the same ones on white."""

LINE_PALETTE = (
    *(BLUE, VERMILLION, GREEN, PURPLE, ORANGE, SKY_BLUE, BLACK, NAVY),
    *(BRICK, SAGE, MAROON, PLUM, SLATE, CORNFLOWER, ULTRAMARINE),
)
"""Colours of lines of data, in this order."""

POLICY_PALETTE = (
    *(BLACK, BRICK, CORNFLOWER, SAGE, PLUM, SLATE, NAVY, MAROON, ULTRAMARINE),
    *(VERMILLION, PURPLE, SKY_BLUE, ORANGE, GREEN, BLUE),
)
"""Colours of policies; the first nine are not those of a link or a force in an arm's picture."""


def clutch_name(row: tuple[float, float]) -> str:
    """Return the CSS name of a clutch's colour: of the link that it brakes, or of its coupling.

    The clutch slips at row·ω. Clutches 3 and 4 of the paper have the colours of force and trail.
    """
    a, b = row
    if a == 0.0 or b == 0.0:
        return "link-a" if a else "link-b"
    return "difference" if a * b < 0.0 else "sum"


def clutch_colour(row: tuple[float, float]) -> str:
    """Return the colour of a clutch that slips at row·ω."""
    return (PICTURE | {"difference": PICTURE["force"], "sum": PICTURE["trail"]})[clutch_name(row)]


def tint(colour: str) -> str:
    """Return a colour halfway to white."""
    return "#" + "".join(f"{(int(colour[k : k + 2], 16) + 256) // 2:02x}" for k in (1, 3, 5))
