"""The strip below the scene of a small picture: the error, the mode, and for each clutch its state and its voltage."""

from pter_gym.params import Machine
from pter_gym.render import style
from pter_gym.render.arrangement import CELLS, GAP, ROW
from pter_gym.render.canvas import Canvas
from pter_gym.render.clutches import BADGES, Limits, draw_volts, readings
from pter_gym.render.geometry import Box
from pter_gym.render.snapshot import Snapshot

_CELLS = 4
_VALUE = 46


class Strip:
    """Draws the strip of one machine into a box of the canvas [px]; ``unit`` is that of its text."""

    def __init__(self, machine: Machine, box: Box, unit: float) -> None:
        self._box = box
        self._unit = unit
        self._limits = Limits.of(machine)

    def draw_still(self, canvas: Canvas) -> None:
        """Draw what never changes."""
        canvas.box(self._box, style.PANEL)

    def draw(self, canvas: Canvas, snapshot: Snapshot) -> None:
        """Draw one state."""
        u = self._unit
        found = readings(snapshot)
        y = self._box.low + (0.5 * GAP + 0.5 * ROW) * u
        canvas.text(f"error {found.error.value}", (self._box.left + GAP * u, y), style.BODY * u, style.INK)
        canvas.text(found.mode.value, (self._box.right - GAP * u, y), style.BODY * u, style.INK, "right")
        for index, state in enumerate(snapshot.clutch_states()):
            cell = self._cell(index)
            badge = BADGES[state]
            canvas.box(cell, style.CARD, 5 * u)
            badge_box = Box(cell.left + 3 * u, cell.low + 3 * u, cell.right - 3 * u, cell.low + 24 * u)
            canvas.box(badge_box, badge.fill, 4 * u)
            middle = 0.5 * (cell.left + cell.right)
            canvas.text(f"{index + 1} {state}", (middle, cell.low + 13.5 * u), style.SMALL * u, badge.ink, "centre")
            row = cell.low + 0.75 * CELLS * u
            volts = float(snapshot.volts[index])
            groove = Box(cell.left + 5 * u, row - 4 * u, cell.right - (_VALUE + 4) * u, row + 4 * u)
            draw_volts(canvas, groove, volts, self._limits)
            canvas.text(f"{volts:.1f} V", (cell.right - 5 * u, row), style.SMALL * u, style.INK, "right")

    def _cell(self, index: int) -> Box:
        u = self._unit
        width = (self._box.right - self._box.left - (_CELLS + 1) * GAP * u) / _CELLS
        left = self._box.left + GAP * u + index * (width + GAP * u)
        top = self._box.low + (ROW + GAP) * u
        return Box(left, top, left + width, top + CELLS * u)
