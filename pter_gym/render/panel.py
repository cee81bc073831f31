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
_INSET = 14
_TITLE_ROW = 22
_VOLTS_ROW = 56
_TORQUE_ROW = 84
_BAR_LEFT = 70
_BAR_RIGHT = 184


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
            canvas.text(f"{index + 1}", (card.left + _INSET, card.low + _TITLE_ROW), style.TITLE, style.INK)
            canvas.text(name, (card.left + _INSET + 18, card.low + _TITLE_ROW), style.BODY, style.INK)
            canvas.text("voltage", (card.left + _INSET, card.low + _VOLTS_ROW), style.SMALL, style.MUTED)
            canvas.text("torque", (card.left + _INSET, card.low + _TORQUE_ROW), style.SMALL, style.MUTED)

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
        groove = bar_groove(card, _VOLTS_ROW)
        share = min(max(volts / self._volts_max, 0.0), 1.0)
        draw_bar(canvas, groove, groove.left, share * (groove.right - groove.left), style.VOLTS)
        draw_value(canvas, card, _VOLTS_ROW, f"{volts:.1f} V")

    def _draw_torque(self, canvas: Canvas, card: Box, torque: float) -> None:
        groove = bar_groove(card, _TORQUE_ROW)
        zero = 0.5 * (groove.left + groove.right)
        share = min(max(torque / self._torque_max, -1.0), 1.0)
        draw_bar(canvas, groove, zero, share * (groove.right - zero), style.TORQUE)
        canvas.box(Box(zero - 0.5, groove.low - 3, zero + 0.5, groove.high + 3), style.MUTED)
        draw_value(canvas, card, _TORQUE_ROW, f"{signed(torque, 1)} N·m")


def bar_groove(card: Box, row: float) -> Box:
    """Return where a bar of a card lies [px]."""
    return Box(card.left + _BAR_LEFT, card.low + row - 5, card.left + _BAR_RIGHT, card.low + row + 5)


def draw_bar(canvas: Canvas, groove: Box, zero: float, length: float, colour: str) -> None:
    """Draw a bar of a signed length [px] from its zero, in its groove."""
    canvas.box(groove, style.GROOVE)
    canvas.box(groove._replace(left=zero + min(length, 0.0), right=zero + max(length, 0.0)), colour)


def draw_value(canvas: Canvas, card: Box, row: float, value: str) -> None:
    """Write a value at the right end of a card's row."""
    canvas.text(value, (card.right - _INSET, card.low + row), style.BODY, style.INK, "right")


def signed(value: float, digits: int) -> str:
    """Return a number with its sign, or 0 without one."""
    rounded = round(value, digits)
    return f"{rounded:+.{digits}f}".replace("-", "−") if rounded else f"{0.0:.{digits}f}"


class Badge(NamedTuple):
    """Colours of a clutch's state: they differ in lightness, so they need no colour vision."""

    fill: str
    ink: str


BADGES = {
    ClutchState.STUCK: Badge(style.INK, "#ffffff"),
    ClutchState.SLIPPING: Badge("#f6d7a0", style.INK),
    ClutchState.RELEASED: Badge(style.PANEL, style.MUTED),
}


def draw_state(canvas: Canvas, card: Box, state: ClutchState) -> None:
    """Draw a clutch's state as a badge into the card's upper right corner."""
    badge = Box(card.right - _INSET - 70, card.low + _TITLE_ROW - 10, card.right - _INSET, card.low + _TITLE_ROW + 10)
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
        ("normal error", f"{signed(1e3 * snapshot.normal_error, 1)} mm"),
        ("tip speed", f"{snapshot.speed:.2f} m/s"),
        ("mode", MODE_NAMES[snapshot.mode]),
    ]
