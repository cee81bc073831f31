"""Readings of a telemetry row below the scene: the mode, and a card for each clutch."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pter_gym._physics.friction import ClutchMode
from pter_gym.params import PAPER_CLUTCHES, Machine
from pter_gym.tasks.path_following import COLUMN
from pter_gym.tools.pictures.render import style
from pter_gym.tools.pictures.render.canvas import Canvas
from pter_gym.tools.pictures.render.geometry import Box

Array = NDArray[np.float64]

Rows = tuple[tuple[float, float] | None, ...]

PAPER_ROWS: Rows = tuple(each.row for each in PAPER_CLUTCHES)

MODE_NAMES = {
    ClutchMode.TWO_DOF: "two DOF",
    **{ClutchMode(x): f"one DOF ({x} stuck)" for x in range(1, 5)},
    ClutchMode.ZERO_DOF: "zero DOF",
}
"""The paper's dynamic modes (section III-A) as a reader meets them."""

BADGES = {
    "stuck": (style.INK, "#ffffff"),
    "slipping": ("#f6d7a0", style.INK),
    "released": (style.GROOVE, "#565d67"),
    "absent": (style.CARD, "#565d67"),
}
"""Colours of a clutch's states and of their names: they differ in lightness, so they need no colour vision."""


class Limits(NamedTuple):
    """Values of full bars [V, N·m], and the row of W of each clutch, None for a missing one."""

    volts: float
    torque: float
    rows: Rows = PAPER_ROWS

    @classmethod
    def of(cls, machine: Machine) -> "Limits":
        """Return the largest voltage of a machine's clutches, their largest torque and their rows of W."""
        slots = zip(machine.slot_rows, machine.slot_scale, strict=True)
        clutch = machine.clutch
        curves = (clutch.breakaway, clutch.dynamic)
        torque = max(curve.torque(clutch.voltage_max) for curve in curves)
        return cls(clutch.voltage_max, torque, tuple(row if scale > 0.0 else None for row, scale in slots))


def outcome(row: Any) -> str:
    """Return the dynamic mode, or how the episode ended."""
    if row[COLUMN.terminated]:
        return "arrived" if row[COLUMN.is_success] else "left the workspace"
    return MODE_NAMES[ClutchMode(int(row[COLUMN.mode]))]


def clutch_states(row: Any, rows: Rows = PAPER_ROWS) -> list[str]:
    """Return the state of each of the four clutches; one without voltage and torque is released, even at rest."""
    idle = (row[[*COLUMN.volts]] == 0.0) & (row[[*COLUMN.torque]] == 0.0)
    mode = int(row[COLUMN.mode])
    stuck = rows[mode - 1] if ClutchMode.TWO_DOF < mode < ClutchMode.ZERO_DOF else None
    held = [mode == ClutchMode.ZERO_DOF or each == stuck for each in rows]
    states = ["released" if idle[x] else "stuck" if held[x] else "slipping" for x in range(4)]
    return ["absent" if each is None else state for each, state in zip(rows, states, strict=True)]


def signed(value: float) -> str:
    """Return a number with one digit and its sign, or 0.0 without one."""
    return f"{value:+.1f}".replace("-", "−") if round(value, 1) else "0.0"


def draw_card(canvas: Canvas, box: Box, clutch: int, row: Any, limits: Limits, unit: float) -> None:
    """Draw a clutch's state, and voltage and torque as bars and numbers."""
    volts, torque = float(row[COLUMN.volts[clutch]]), float(row[COLUMN.torque[clutch]])
    state = clutch_states(row, limits.rows)[clutch]
    fill, ink = BADGES[state]
    canvas.box(box, style.CARD, 5 * unit)
    left, right, line = box.left + 4 * unit, box.right - 4 * unit, box.height / 3
    canvas.box(Box(left, box.low + 0.2 * line, right, box.low + 0.95 * line), fill, 4 * unit)
    canvas.text(f"{clutch + 1} {state}", 0.5 * (left + right), box.low + 0.58 * line, style.SMALL * unit, ink, "m")
    bars = (
        (0.0, volts / limits.volts, style.VOLTS, f"{volts:.1f} V"),
        (0.5, torque / limits.torque, style.TORQUE, f"{signed(torque)} N·m"),
    )
    for place, (zero, share, colour, text) in enumerate(bars):
        y = box.low + (1.45 + 0.9 * place) * line
        canvas.text(text, right, y, style.SMALL * unit, style.INK, "r")
        groove = Box(left, y - 4 * unit, right - 60 * unit, y + 4 * unit)
        canvas.box(groove, style.GROOVE)
        ends = [groove.left + part * groove.width for part in (zero, zero + (1.0 - zero) * min(max(share, -1.0), 1.0))]
        canvas.box(groove._replace(left=min(ends), right=max(ends)), colour)
        canvas.box(Box(ends[0] - 0.5, groove.low - 2 * unit, ends[0] + 0.5, groove.high + 2 * unit), style.MUTED)
