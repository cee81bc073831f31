"""The panel beside the scene: readings, and for each clutch its voltage, its torque and whether it sticks."""

from pter_gym.params import Machine
from pter_gym.render import style
from pter_gym.render.canvas import Canvas
from pter_gym.render.clutches import BADGES, CLUTCH_NAMES, Limits, draw_torque, draw_volts, readings, signed
from pter_gym.render.geometry import Box
from pter_gym.render.snapshot import ClutchState, Snapshot

_PAD = 14
_READINGS_TOP = 14
_LINE = 24
_CARDS_TOP = 122
_CARD_HEIGHT = 110
_CARD_GAP = 8
_INSET = 14
_TITLE_ROW = 22
_VOLTS_ROW = 56
_TORQUE_ROW = 84
_BAR_LEFT = 70
_BAR_RIGHT = 184


class Panel:
    """Draws the panel of one machine into a box of the canvas [px]; ``unit`` is 1 in the default picture."""

    def __init__(self, machine: Machine, box: Box, unit: float) -> None:
        self._box = box
        self._unit = unit
        self._limits = Limits.of(machine)

    def draw_still(self, canvas: Canvas) -> None:
        """Draw what never changes."""
        u = self._unit
        canvas.box(self._box, style.PANEL)
        for index, name in enumerate(CLUTCH_NAMES):
            card = self._card(index)
            left = card.left + _INSET * u
            canvas.box(card, style.CARD, 6 * u)
            canvas.text(f"{index + 1}", (left, card.low + _TITLE_ROW * u), style.TITLE * u, style.INK)
            canvas.text(name, (left + 18 * u, card.low + _TITLE_ROW * u), style.BODY * u, style.INK)
            canvas.text("voltage", (left, card.low + _VOLTS_ROW * u), style.SMALL * u, style.MUTED)
            canvas.text("torque", (left, card.low + _TORQUE_ROW * u), style.SMALL * u, style.MUTED)

    def draw(self, canvas: Canvas, snapshot: Snapshot) -> None:
        """Draw one state."""
        u = self._unit
        for line, (name, value) in enumerate(readings(snapshot)):
            y = self._box.low + (_READINGS_TOP + (line + 0.5) * _LINE) * u
            canvas.text(name, (self._box.left + _PAD * u, y), style.BODY * u, style.MUTED)
            canvas.text(value, (self._box.right - _PAD * u, y), style.BODY * u, style.INK, "right")
        for index, state in enumerate(snapshot.clutch_states()):
            card = self._card(index)
            volts, torque = float(snapshot.volts[index]), float(snapshot.torques[index])
            self._draw_state(canvas, card, state)
            draw_volts(canvas, self._groove(card, _VOLTS_ROW), volts, self._limits)
            self._draw_value(canvas, card, _VOLTS_ROW, f"{volts:.1f} V")
            draw_torque(canvas, self._groove(card, _TORQUE_ROW), torque, self._limits, u)
            self._draw_value(canvas, card, _TORQUE_ROW, f"{signed(torque, 1)} N·m")

    def _card(self, index: int) -> Box:
        u = self._unit
        top = self._box.low + (_CARDS_TOP + index * (_CARD_HEIGHT + _CARD_GAP)) * u
        return Box(self._box.left + _PAD * u, top, self._box.right - _PAD * u, top + _CARD_HEIGHT * u)

    def _groove(self, card: Box, row: float) -> Box:
        """Return where a bar of a card lies [px]."""
        u = self._unit
        y = card.low + row * u
        return Box(card.left + _BAR_LEFT * u, y - 5 * u, card.left + _BAR_RIGHT * u, y + 5 * u)

    def _draw_value(self, canvas: Canvas, card: Box, row: float, value: str) -> None:
        """Write a value at the right end of a card's row."""
        u = self._unit
        canvas.text(value, (card.right - _INSET * u, card.low + row * u), style.BODY * u, style.INK, "right")

    def _draw_state(self, canvas: Canvas, card: Box, state: ClutchState) -> None:
        """Draw a clutch's state as a badge into the card's upper right corner."""
        u = self._unit
        right, y = card.right - _INSET * u, card.low + _TITLE_ROW * u
        canvas.box(Box(right - 70 * u, y - 10 * u, right, y + 10 * u), BADGES[state].fill, 10 * u)
        canvas.text(state, (right - 35 * u, y), style.SMALL * u, BADGES[state].ink, "centre")
