"""Where the parts of a picture are, for any size. It draws nothing."""

from typing import Literal, NamedTuple

from pter_gym.errors import ParameterError
from pter_gym.internal.checks import whole_number
from pter_gym.render import style
from pter_gym.render.geometry import Box

Kind = Literal["panel", "strip", "none"]

SMALLEST, LARGEST = 32, 8192
"""Limits of the width and of the height of a picture [px]."""

PANEL_FROM = 0.75
"""Size at which the panel can still be read, relative to the default picture."""

LANDSCAPE = 1.15
"""Width over height from which the panel is beside the scene."""

STRIP_FROM = (240, 160)
"""Width and height [px] below which there is no room for text."""

STRIP_TEXT = 14.0 / style.BODY
"""Size of text in a tile of ``style.TILE_WIDTH`` × ``style.TILE_HEIGHT``, relative to that of the default picture."""

TEXT_GROWTH, STROKE_GROWTH = 0.75, 0.7
"""Powers of the size by which text of a tile and strokes of a scene grow: small pictures need large ones."""

HEADER, ROW, CELLS, GAP = 26, 24, 48, 8
"""Heights of a tile's header, of its row of readings and of its cells, and the distance between them, in text units."""

SCENE_WIDTH = style.WIDTH - style.PANEL_WIDTH - 2 * style.MARGIN
LEGEND = 52
LEGEND_WIDTH = 400
LEGEND_FROM = 340
"""Height [px] from which a tile has a legend."""

SCENE_HEIGHT = style.HEIGHT - LEGEND - style.MARGIN


class Arrangement(NamedTuple):
    """The parts of a picture; boxes in px.

    Attributes
    ----------
    scene
        Where arm and path are.
    drawing
        What the world fills of it.
    readings
        The panel or the strip.
    kind
        Which of the two it is.
    text, stroke
        Sizes of text, and of strokes of the scene, relative to those of the default picture.
    legend
        Size of the legend's text in the same unit; 0 where there is no room for it.
    """

    scene: Box
    drawing: Box
    readings: Box
    kind: Kind
    text: float
    stroke: float
    legend: float


def check_size(width: object, height: object) -> tuple[int, int]:
    """Return the size of a picture [px], or raise a ParameterError that names what is wrong with it."""
    found: list[int] = []
    for name, value in (("width", width), ("height", height)):
        number = whole_number(name, value, at_least=SMALLEST)
        if number > LARGEST:
            raise ParameterError(f"{name} must be a whole number within [{SMALLEST}, {LARGEST}], got {value!r}")
        found.append(number)
    return found[0], found[1]


def arrange(box: Box) -> Arrangement:
    """Return the parts of a picture in a box of the screen: a panel beside the scene, or a strip below it."""
    width, height = box.right - box.left, box.high - box.low
    unit = min(width / style.WIDTH, height / style.HEIGHT)
    if unit >= PANEL_FROM and width >= LANDSCAPE * height:
        return _with_panel(box, unit)
    text = STRIP_TEXT * min(width / style.TILE_WIDTH, height / style.TILE_HEIGHT) ** TEXT_GROWTH
    if width < STRIP_FROM[0] or height < STRIP_FROM[1]:
        margin = 0.03 * min(width, height)
        drawing = Box(box.left + margin, box.low + margin, box.right - margin, box.high - margin)
        return Arrangement(box, drawing, box, "none", text, _stroke(drawing), 0.0)
    return _with_strip(box, text)


def grid(count: int) -> tuple[int, int]:
    """Return rows and columns of a grid for so many pictures, up to three side by side, then about as many as rows."""
    columns = count if count <= 3 else next(c for c in range(2, count) if c * c >= count)
    return -(-count // columns), columns


def cells(width: int, height: int, count: int) -> list[Box]:
    """Return the boxes of so many pictures in a grid that fills a size [px], row by row."""
    rows, columns = grid(count)
    return [
        Box(
            round(width * (k % columns) / columns),
            round(height * (k // columns) / rows),
            round(width * (k % columns + 1) / columns),
            round(height * (k // columns + 1) / rows),
        )
        for k in range(count)
    ]


def _with_panel(box: Box, unit: float) -> Arrangement:
    edge = box.right - style.PANEL_WIDTH * unit
    margin = style.MARGIN * unit
    drawing = Box(box.left + margin, box.low + LEGEND * unit, edge - margin, box.high - margin)
    panel = box._replace(left=edge)
    return Arrangement(box._replace(right=edge), drawing, panel, "panel", unit, _stroke(drawing), unit)


def _with_strip(box: Box, text: float) -> Arrangement:
    edge = box.high - (ROW + CELLS + 2 * GAP) * text
    margin = style.MARGIN * text
    width = box.right - box.left - 2 * margin
    legend = min(text, width / LEGEND_WIDTH) if box.high - box.low >= LEGEND_FROM else 0.0
    top = box.low + HEADER * text + 2 * style.MARGIN * legend
    drawing = Box(box.left + margin, top, box.right - margin, edge - 0.5 * margin)
    strip = box._replace(low=edge)
    return Arrangement(box._replace(high=edge), drawing, strip, "strip", text, _stroke(drawing), legend)


def _stroke(drawing: Box) -> float:
    size = min((drawing.right - drawing.left) / SCENE_WIDTH, (drawing.high - drawing.low) / SCENE_HEIGHT)
    return size**STROKE_GROWTH
