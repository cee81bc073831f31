"""The strip below a film: how far each policy is from the path over time, and its mean so far."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pter_gym._internal import palette
from pter_gym.tasks.path_following import COLUMN, PathFollowing
from pter_gym.tools.pictures.drawing import (
    GROOVE,
    INK,
    MUTED,
    SMALL,
    Array,
    Box,
    Canvas,
    aim,
    has_band,
    shortened,
    text_width,
)

WIDTH, HEIGHT, LINE = 720, 132, 15
"""Size [px] of a strip whose text has its normal size, and the height of a line of text in it."""

MIN_HEIGHT, MAX_SHARE = 60, 0.3
"""Least height of a strip [px], and the largest share of a film's height."""

STEPS = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000)
"""Distances [mm] between the marks of the scale, of which there are three at most."""


def strip_height(count: int) -> int:
    """Return the preferred height [px] of the strip of ``count`` policies."""
    return max(HEIGHT, LINE * (count + 2))


def apart(places: Array, line: float, most: float) -> Array:
    """Return ascending places of labels, moved a ``line`` apart and, if they fit, to ``most``."""
    lines = line * np.arange(len(places))
    return np.minimum(np.maximum.accumulate(places - lines) + lines, most + lines - lines[-1])


class ErrorStrip:
    """Draws |normal error| of episodes, thin, and its mean so far, bold, with names and means.

    Parameters
    ----------
    task
        What the episodes have in common.
    episodes
        Telemetry of each policy by its name, as ``Film`` takes it.
    width, height
        Size of the strip [px].

    Attributes
    ----------
    errors, means
        Distance from the path and its mean so far [mm] of each episode, (T + 1,).
    """

    def __init__(
        self, task: PathFollowing, episodes: Mapping[str, Any], width: int, height: int
    ) -> None:
        self._unit = unit = min(width / WIDTH, height / HEIGHT, 2.0)
        self._names = list(episodes) if len(episodes) > 1 else ["mean"]
        self._colours = [
            palette.BESIDE_ARM[sorted(episodes).index(name) % len(palette.BESIDE_ARM)]
            for name in episodes
        ]
        self._times = [rows[:, COLUMN.time] for rows in episodes.values()]
        self.errors = {
            name: 1e3 * np.abs(rows[:, COLUMN.normal_error]) for name, rows in episodes.items()
        }
        self.means = {
            name: np.cumsum(e) / np.arange(1, len(e) + 1) for name, e in self.errors.items()
        }
        self._duration = max(float(times[-1]) for times in self._times)
        self._top = 1.05 * max(1.0, *(float(errors.max()) for errors in self.errors.values()))
        low, high = 1.4 * LINE * unit, height - 1.3 * LINE * unit
        self._plot = Box(44 * unit, low, width - 205 * unit, high)
        self._background = Canvas.blank(width, height)
        self._draw_scale(aim(task), np.inf if has_band(task) else 1e3 * task.error_max)

    def draw(self, time: float) -> NDArray[np.uint8]:
        """Return the strip at a time [s] as pixels, shape (height, width, 3)."""
        canvas, unit = self._background.copy(), self._unit
        counts = [int(np.searchsorted(times, time + 1e-9, side="right")) for times in self._times]
        tints = [palette.tint(colour) for colour in self._colours]
        for thick, values, colours in ((1.3, self.errors, tints), (2.6, self.means, self._colours)):
            for times, errors, colour, count in zip(
                self._times, values.values(), colours, counts, strict=True
            ):
                points = np.stack([self._x(times[:count]), self._y(errors[:count])], axis=1)
                canvas.line(points, colour, max(thick * unit, 1.0))
        ends = np.array(
            [means[count - 1] for means, count in zip(self.means.values(), counts, strict=True)]
        )
        x, right, size = self._plot.right + 8 * unit, self._plot.right + 199 * unit, SMALL * unit
        heights = apart(np.sort(self._y(ends)), LINE * unit, self._plot.high)
        for k, y in zip(map(int, np.argsort(-ends)), heights, strict=True):
            number = f"{ends[k]:.1f} mm"
            name = shortened(self._names[k], size, right - x - text_width(number, size) - 6 * unit)
            canvas.text(name, x, y, size, self._colours[k])
            canvas.text(number, right, y, size, self._colours[k], "r")
        return canvas.pixels()

    def _draw_scale(self, aim: str, limit: float) -> None:
        """Draw lines at round distances and, if an error exceeds it, at the workspace's edge."""
        canvas, plot, size = self._background, self._plot, SMALL * self._unit
        canvas.box(0.0, 0.0, self._plot.right + 205 * self._unit, 1.0, GROOVE)
        title = f"distance from {aim} [mm]; bold: its mean so far"
        canvas.text(title, plot.left, 0.7 * LINE * self._unit, size, INK)
        step = next((step for step in STEPS if 3 * step > self._top), STEPS[-1])
        for value in np.arange(0.0, self._top, step):
            y = float(self._y(value))
            canvas.box(plot.left, y - 0.5, plot.right, y + 0.5, GROOVE if value else MUTED)
            canvas.text(f"{value:g}", plot.left - 6 * self._unit, y, size, MUTED, "r")
        if limit < self._top:
            y = float(self._y(limit))
            canvas.box(plot.left, y - 0.5, plot.right, y + 0.5, INK)
            below = y + 0.5 * LINE * self._unit
            canvas.text(f"edge of the workspace, {limit:.3g} mm", plot.left + 4, below, size, INK)
        y = plot.high + 0.65 * LINE * self._unit
        canvas.text("0 s", plot.left, y, size, MUTED)
        canvas.text(f"{self._duration:.1f} s", plot.right, y, size, MUTED, "r")

    def _x(self, time: Array) -> Array:
        width = self._plot.right - self._plot.left
        return self._plot.left + width * time / max(self._duration, 1e-9)

    def _y(self, error: Array | float) -> Array:
        return self._plot.high - (self._plot.high - self._plot.low) * np.asarray(error) / self._top
