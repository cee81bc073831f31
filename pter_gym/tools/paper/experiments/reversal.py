"""Clutch 1 while the direction of motion changes (paper section IV-C.2, Fig. 9)."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pter_gym._physics.open_loop import Trajectory, initial_state, simulate
from pter_gym.params import BREAKAWAY_SMALL_VOLTAGE, Machine
from pter_gym.tools.paper.experiments.pose import POSE, resolved, tip_force
from pter_gym.tools.paper.experiments.setup import PAPER_MACHINES

Array = NDArray[np.float64]

OMEGA = -1.2
"""Angular velocity of link A at the start [rad/s]."""

FORCE_TIME = 0.05
"""When the force steps up [s]."""

DURATION = 0.25
"""Duration of a test [s]."""

MARGIN = 1.05
"""Torque of the tip force about clutch 1, relative to its largest holding torque among the machines.

The less it exceeds it, the longer the slip stays in the stick band, where the clutch exerts its breakaway torque.
"""

RESOLUTION = 1e-4
"""Longest substep [s]: about a third of the shortest time that the slip spends in the stick band."""

WINDOW = 0.05
"""Time from zero slip [s] within which the jump is looked for."""


@dataclass(frozen=True)
class Reversal:
    """One machine's slip-stick-slip transition.

    Attributes
    ----------
    trajectory
        The whole test.
    index
        Last substep before the slip of clutch 1 changes its sign; zero slip lies between it and the next slip.
    dynamic
        Dynamic torque of clutch 1 [N·m].
    jump
        Largest |torque| of clutch 1 within 50 ms of zero slip, relative to the dynamic torque, minus 1.
    """

    trajectory: Trajectory
    index: int
    dynamic: float
    jump: float

    @property
    def time(self) -> float:
        """When the slip last had its old sign [s]."""
        return float(self.trajectory.time[self.index])

    @property
    def torque(self) -> Array:
        """Generated torque of clutch 1 [N·m], shape (T,)."""
        return self.trajectory.torque[:, 0]


@dataclass(frozen=True)
class Reversals:
    """The transition of several machines under the same voltage and force.

    Attributes
    ----------
    volts
        Voltage of clutch 1 [V]; the other clutches are released.
    force
        Tip force after the step [N], shape (2,).
    machines
        By name.
    """

    volts: float
    force: Array
    machines: dict[str, Reversal]


def reversals(machines: Mapping[str, Machine] = PAPER_MACHINES, volts: float | None = None) -> Reversals:
    """Let a step force reverse link A, which slips in clutch 1 at a constant voltage.

    The arm moves at the start; the force, along link B, opposes that motion and is large enough to reverse it.

    Parameters
    ----------
    machines
        By name.
    volts
        Voltage of clutch 1 [V]; by default the one with the breakaway torque of Fig. 4 on the first machine.
    """
    first = next(iter(machines.values()))
    applied = first.clutch.breakaway.voltage(BREAKAWAY_SMALL_VOLTAGE) if volts is None else volts
    holding = max(
        max(machine.clutch.breakaway.torque(applied), machine.clutch.dynamic.torque(applied))
        for machine in machines.values()
    )
    force = tip_force(first, POSE, np.array([MARGIN * holding, 0.0]))
    tested = {name: _reversal(machine, applied, force) for name, machine in machines.items()}
    return Reversals(volts=applied, force=force, machines=tested)


def _reversal(machine: Machine, volts: float, force: Array) -> Reversal:
    machine, applied = resolved(machine, RESOLUTION), (volts, 0.0, 0.0, 0.0)
    steps = round(DURATION / machine.substep)
    forces = np.zeros((steps, 2))
    forces[round(FORCE_TIME / machine.substep) :] = force
    run = simulate(machine, initial_state(machine, POSE, (OMEGA, 0.0), applied), applied, forces)
    index = last_before_reversal(run.slip_velocity[:, 0])
    dynamic = machine.clutch.dynamic.torque(volts)
    near = np.abs(run.time - run.time[index]) <= WINDOW
    return Reversal(run, index, dynamic, float(np.abs(run.torque[near, 0]).max() / dynamic - 1.0))


def last_before_reversal(slip: Array) -> int:
    """Return the index of the last slip velocity before its sign changes for the first time; zeros have no sign."""
    moving = np.flatnonzero(slip)
    changes = np.flatnonzero(np.diff(np.sign(slip[moving])))
    return int(moving[changes[0]])
