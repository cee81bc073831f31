"""The panel: readings, and for each clutch its voltage, its torque and whether it sticks."""

from typing import NamedTuple

from pter_gym.params import Machine
from pter_gym.render import style
from pter_gym.render.canvas import Canvas
from pter_gym.render.geometry import Box
from pter_gym.render.snapshot import MODE_NAMES, ClutchState, Snapshot

CLUTCH_NAMES = ("A to ground", "B to ground", "A to B", "A to B, inverted")

_PAD = 14
_READINGS_TOP = 14
_LINE = 24
_CARDS_TOP = 122
_CARD_HEIGHT = 110
_CARD_GAP = 8
_BAR_LEFT = 26
_BAR_RIGHT = 150


class Panel:
    """Draws the panel of one machine into a box of the canvas [px]."""

    def __init__(self, machine: Machine, box: Box) -> None:
        clutch = machine.clutch
        self._box = box
        self._volts_max = clutch.voltage_max
        self._torque_max = max(curve.torque(clutch.voltage_max) for curve in (clutch.breakaway, clutch.dynamic))

    def draw_still(self, canvas: Canvas) -> None:
        """Draw what never changes."""
        canvas.box(self._box, style.PANEL)
        for index, name in enumerate(CLUTCH_NAMES):
            card = self._card(index)
            canvas.box(card, style.CARD, 6)
            canvas.text(f"{index + 1}", (card.left + 12, card.low + 18), style.TITLE, style.INK)
            canvas.text(name, (card.left + 30, card.low + 18), style.BODY, style.INK)

    def draw(self, canvas: Canvas, snapshot: Snapshot) -> None:
        """Draw one state."""
        for line, (name, value) in enumerate(readings(snapshot)):
            y = _READINGS_TOP + (line + 0.5) * _LINE
            canvas.text(name, (self._box.left + _PAD, y), style.BODY, style.MUTED)
            canvas.text(value, (self._box.right - _PAD, y), style.BODY, style.INK, "right")
        for index, state in enumerate(snapshot.clutch_states()):
            card = self._card(index)
            draw_state(canvas, card, state)
            self._draw_volts(canvas, card, float(snapshot.volts[index]))
            self._draw_torque(canvas, card, float(snapshot.torques[index]))

    def _card(self, index: int) -> Box:
        top = _CARDS_TOP + index * (_CARD_HEIGHT + _CARD_GAP)
        return Box(self._box.left + _PAD, top, self._box.right - _PAD, top + _CARD_HEIGHT)

    def _draw_volts(self, canvas: Canvas, card: Box, volts: float) -> None:
        groove = Box(card.left + 12, card.low + 42, card.left + _BAR_RIGHT, card.low + 52)
        width = groove.right - groove.left
        canvas.box(groove, style.GROOVE)
        canvas.box(groove._replace(right=groove.left + width * min(volts / self._volts_max, 1.0)), style.VOLTS)
        canvas.text(f"{volts:.1f} V", (card.right - 12, card.low + 47), style.BODY, style.INK, "right")

    def _draw_torque(self, canvas: Canvas, card: Box, torque: float) -> None:
        groove = Box(card.left + 12, card.low + 74, card.left + _BAR_RIGHT, card.low + 84)
        middle = 0.5 * (groove.left + groove.right)
        end = middle + 0.5 * (groove.right - groove.left) * max(-1.0, min(torque / self._torque_max, 1.0))
        canvas.box(groove, style.GROOVE)
        canvas.box(groove._replace(left=min(middle, end), right=max(middle, end)), style.TORQUE)
        canvas.text(f"{torque:+.1f} N·m", (card.right - 12, card.low + 79), style.BODY, style.INK, "right")


class Badge(NamedTuple):
    """Colours of a clutch's state: they differ in lightness, so that they need no colour vision."""

    fill: str
    ink: str


BADGES = {
    ClutchState.STUCK: Badge(style.INK, "#ffffff"),
    ClutchState.SLIPPING: Badge("#f6d7a0", style.INK),
    ClutchState.RELEASED: Badge(style.PANEL, style.MUTED),
}


def draw_state(canvas: Canvas, card: Box, state: ClutchState) -> None:
    """Draw a clutch's state as a badge into the card's upper right corner."""
    badge = Box(card.right - 80, card.low + 8, card.right - 10, card.low + 28)
    canvas.box(badge, BADGES[state].fill, 10)
    canvas.text(
        state,
        (0.5 * (badge.left + badge.right), 0.5 * (badge.low + badge.high)),
        style.SMALL,
        BADGES[state].ink,
        "centre",
    )


def readings(snapshot: Snapshot) -> list[tuple[str, str]]:
    """Return names and values of the readings."""
    return [
        ("time", f"{snapshot.time:.2f} s"),
        ("normal error", f"{1e3 * snapshot.normal_error:+.1f} mm"),
        ("tip speed", f"{snapshot.speed:.2f} m/s"),
        ("mode", MODE_NAMES[snapshot.mode]),
    ]
