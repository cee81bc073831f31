"""What one telemetry row says, in the words of the picture."""

import math
from enum import StrEnum
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from pter_gym.physics.friction import ClutchMode
from pter_gym.tasks.path_following import COLUMN

Array = NDArray[np.float64]


class ClutchState(StrEnum):
    """What one clutch does."""

    STUCK = "stuck"
    SLIPPING = "slipping"
    RELEASED = "released"


MODE_NAMES = {
    ClutchMode.TWO_DOF: "two DOF",
    **{ClutchMode(x): f"one DOF ({x} stuck)" for x in range(1, 5)},
    ClutchMode.ZERO_DOF: "zero DOF",
}
"""The paper's dynamic modes (section III-A) as a reader meets them."""


class Snapshot(NamedTuple):
    """The part of a telemetry row that is drawn.

    Attributes
    ----------
    time
        Since the start of the episode [s].
    theta_a, theta_b
        Absolute link angles [rad].
    speed
        Of the tip [m/s].
    normal_error
        Distance from the path, positive to its left [m].
    force
        Of the hand on the tip, world frame [N], shape (2,).
    mode
        ClutchMode after the last substep.
    volts, torques
        Of the four clutches [V, N·m], shape (4,).
    end
        How the episode has ended, in words; empty while it goes on.
    """

    time: float
    theta_a: float
    theta_b: float
    speed: float
    normal_error: float
    force: Array
    mode: ClutchMode
    volts: Array
    torques: Array
    end: str = ""

    @classmethod
    def of(cls, row: Any) -> Self:
        """Read a telemetry row, shape (len(TELEMETRY),)."""
        return cls(
            time=float(row[COLUMN.time]),
            theta_a=float(row[COLUMN.theta.a]),
            theta_b=float(row[COLUMN.theta.b]),
            speed=math.hypot(*row[[*COLUMN.tip_velocity]]),
            normal_error=float(row[COLUMN.normal_error]),
            force=row[[*COLUMN.force]],
            mode=ClutchMode(int(row[COLUMN.mode])),
            volts=row[[*COLUMN.volts]],
            torques=row[[*COLUMN.torque]],
            end=_end(row),
        )

    def clutch_states(self) -> list[ClutchState]:
        """Return what each of the four clutches does; one without voltage and torque is released, even at rest."""
        return [self._clutch_state(x) for x in range(4)]

    def _clutch_state(self, index: int) -> ClutchState:
        if self.volts[index] == 0.0 and self.torques[index] == 0.0:
            return ClutchState.RELEASED
        held = self.mode == ClutchMode.ZERO_DOF or self.mode == index + 1
        return ClutchState.STUCK if held else ClutchState.SLIPPING


def _end(row: Any) -> str:
    """Return how the episode has ended, in words; empty while it goes on."""
    if row[COLUMN.terminated] == 0.0:
        return ""
    return "arrived" if row[COLUMN.is_success] else "left the workspace"
