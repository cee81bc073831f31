"""What panel and strip share: a clutch's state in colours, bars, numbers."""

from typing import NamedTuple

from pter_gym.params import Machine
from pter_gym.render import style
from pter_gym.render.canvas import Canvas
from pter_gym.render.geometry import Box
from pter_gym.render.snapshot import MODE_NAMES, ClutchState, Snapshot

CLUTCH_NAMES = ("A to ground", "B to ground", "A to B", "A to B, inverted")


class Badge(NamedTuple):
    """Colours of a clutch's state: they differ in lightness, so they need no colour vision."""

    fill: str
    ink: str


BADGES = {
    ClutchState.STUCK: Badge(style.INK, "#ffffff"),
    ClutchState.SLIPPING: Badge("#f6d7a0", style.INK),
    ClutchState.RELEASED: Badge(style.GROOVE, "#565d67"),
}


class Limits(NamedTuple):
    """What full bars stand for [V, N·m]."""

    volts: float
    torque: float

    @classmethod
    def of(cls, machine: Machine) -> "Limits":
        """Return the largest voltage of a machine's clutches and their largest torque."""
        clutch = machine.clutch
        curves = (clutch.breakaway, clutch.dynamic)
        return cls(clutch.voltage_max, max(curve.torque(clutch.voltage_max) for curve in curves))


def draw_bar(canvas: Canvas, groove: Box, zero: float, length: float, colour: str) -> None:
    """Draw a bar of a signed length [px] from its zero, in its groove."""
    canvas.box(groove, style.GROOVE)
    canvas.box(groove._replace(left=zero + min(length, 0.0), right=zero + max(length, 0.0)), colour)


def draw_volts(canvas: Canvas, groove: Box, volts: float, limits: Limits) -> None:
    """Draw a voltage into a groove."""
    share = min(max(volts / limits.volts, 0.0), 1.0)
    draw_bar(canvas, groove, groove.left, share * (groove.right - groove.left), style.VOLTS)


def draw_torque(canvas: Canvas, groove: Box, torque: float, limits: Limits, unit: float) -> None:
    """Draw a torque into a groove with its zero in the middle."""
    zero = 0.5 * (groove.left + groove.right)
    share = min(max(torque / limits.torque, -1.0), 1.0)
    draw_bar(canvas, groove, zero, share * (groove.right - zero), style.TORQUE)
    mark = Box(zero - 0.5 * unit, groove.low - 3 * unit, zero + 0.5 * unit, groove.high + 3 * unit)
    canvas.box(mark, style.MUTED)


def signed(value: float, digits: int) -> str:
    """Return a number with its sign, or 0 without one."""
    rounded = round(value, digits)
    return f"{rounded:+.{digits}f}".replace("-", "−") if rounded else f"{0.0:.{digits}f}"


class Reading(NamedTuple):
    """A reading: what it is called, and its value with its unit."""

    name: str
    value: str


class Readings(NamedTuple):
    """What is read of a state beside its clutches."""

    time: Reading
    error: Reading
    speed: Reading
    mode: Reading


def readings(snapshot: Snapshot) -> Readings:
    """Return names and values of the readings; how an episode has ended takes the place of the mode."""
    return Readings(
        Reading("time", f"{snapshot.time:.2f} s"),
        Reading("normal error", f"{signed(1e3 * snapshot.normal_error, 1)} mm"),
        Reading("tip speed", f"{snapshot.speed:.2f} m/s"),
        Reading("end", snapshot.end) if snapshot.end else Reading("mode", MODE_NAMES[snapshot.mode]),
    )
