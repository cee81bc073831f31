"""What a reader sees of a figure: the texts that are drawn, with their boxes, and how policies look."""

from itertools import combinations
from typing import Any
from unittest import mock

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.text import Text
from matplotlib.transforms import Bbox

TOUCH = 1.0  # px by which two boxes may overlap: they are whole pixels


def drawn_texts(figure: Figure) -> list[tuple[str, Bbox]]:
    """Return the texts that the renderer draws, and where [px]."""
    found: list[tuple[str, Bbox]] = []
    draw = Text.draw

    def recorded(self: Text, renderer: Any) -> None:
        draw(self, renderer)
        if self.get_visible() and self.get_text().strip():
            found.append((self.get_text(), Text.get_window_extent(self, renderer)))

    with mock.patch.object(Text, "draw", recorded):
        FigureCanvasAgg(figure).draw()
    return found


def faults(figure: Figure, texts: list[tuple[str, Bbox]] | None = None) -> list[str]:
    """Return which of the drawn texts leave the figure or overlap others, and which have fewer than 7 points."""
    texts, edge = drawn_texts(figure) if texts is None else texts, figure.bbox
    assert texts
    found = [
        f"{text!r} leaves the figure: {box}"
        for text, box in texts
        if box.x0 < edge.x0 - TOUCH or box.y0 < edge.y0 - TOUCH or box.x1 > edge.x1 + TOUCH or box.y1 > edge.y1 + TOUCH
    ]
    for (text, box), (other, beside) in combinations(texts, 2):
        both = Bbox.intersection(box, beside)
        if both is not None and both.width > TOUCH and both.height > TOUCH:
            found.append(f"{text!r} overlaps {other!r}")
    found += [f"{text.get_text()!r} is small" for text in figure.findobj(Text) if text.get_fontsize() < 7.0]
    return found
