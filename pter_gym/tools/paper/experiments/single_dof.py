"""Single degree-of-freedom tests (paper section III-B, Figs. 3 and 4), for each of the four clutches."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pter_gym._physics.friction import LINES
from pter_gym._physics.open_loop import Trajectory, initial_state, simulate
from pter_gym.params import BREAKAWAY_SMALL_VOLTAGE, Machine, find_machine
from pter_gym.tools.paper.experiments.pose import POSE, resolved, slip_rows, tip

Array = NDArray[np.float64]

LOCKED_WITH = {1: 2, 2: 1, 3: 4, 4: 3}
"""Clutch that gets the large voltage while another one is tested; clutch 2 for clutch 1 is the paper's."""

BREAKAWAY_TIME = 0.5
"""When the ramp reaches the breakaway torque [s]."""

LARGEST_TURN = 0.6
"""Turn of a link [rad] at which a test ends."""

LINE_SPAN = (-0.4, 0.74)
"""Part of the single-DOF line that is returned, as turns of the driven link [rad]; the elbow stays bent."""

LONGEST = 2.0
"""Time after which a test ends in any case [s]."""

_LINE_SAMPLES = 181


@dataclass(frozen=True)
class SingleDofTest:
    """One clutch under a ramped torque while another one is locked.

    Attributes
    ----------
    clutch, locked
        Numbers of the clutch under test and of the locked one, 1 to 4.
    link
        Link that the ramp acts on: 0 for A, 1 for B.
    volts
        Constant voltages of the clutches [V], shape (4,).
    input_torque
        Ramp in the middle of each substep [N·m], shape (T,).
    share
        Torque that the clutch under test carries per unit of the ramp while nothing moves.
    trajectory
        T substeps.
    line
        Points of the single-DOF line that the tip can move on [m], shape (K, 2).
    deviation
        Distance of the tip from its position allowed by the line [m], shape (T,).
    """

    clutch: int
    locked: int
    link: int
    volts: Array
    input_torque: Array
    share: float
    trajectory: Trajectory
    line: Array
    deviation: Array

    @property
    def torque(self) -> Array:
        """Torque of the clutch under test, opposing the ramp [N·m], shape (T,)."""
        return np.abs(self.trajectory.torque[:, self.clutch - 1])

    @property
    def locked_torque(self) -> Array:
        """Torque of the locked clutch [N·m], shape (T,)."""
        return self.trajectory.torque[:, self.locked - 1]

    @property
    def breakaway(self) -> int:
        """Index of the first substep with motion."""
        return int(np.flatnonzero(self.trajectory.omega.any(axis=1))[0])


@dataclass(frozen=True)
class SingleDof:
    """The tests of all four clutches.

    Attributes
    ----------
    machine
        Machine of the tests, with its substep.
    breakaway
        Breakaway torque of the clutch under test [N·m].
    tests
        In the order of the clutches.
    """

    machine: Machine
    breakaway: float
    tests: tuple[SingleDofTest, ...]


def single_dof(machine: Machine | str | None = None, breakaway: float = BREAKAWAY_SMALL_VOLTAGE) -> SingleDof:
    """Ramp up a torque against each clutch in turn while another clutch leaves the arm one degree of freedom.

    The voltages have settled beforehand. The ramp acts on link A, or on link B where link A is locked.

    Parameters
    ----------
    machine
        The machine or its name; PTER as it is by default.
    breakaway
        Breakaway torque [N·m] that the small voltage on the clutch under test gives; 63.5 in·lbf in the paper.
    """
    machine = resolved(find_machine(machine))
    return SingleDof(machine, breakaway, tuple(_test(machine, clutch, breakaway) for clutch in LOCKED_WITH))


def _test(machine: Machine, clutch: int, breakaway: float) -> SingleDofTest:
    locked = LOCKED_WITH[clutch]
    link = 1 if locked == 1 else 0
    volts = np.zeros(4)
    volts[clutch - 1] = machine.clutch.breakaway.voltage(breakaway)
    volts[locked - 1] = machine.clutch.voltage_max
    engaged = slip_rows()[[clutch - 1, locked - 1]]
    driven = np.zeros(2)
    driven[link] = 1.0
    share = abs(float(np.linalg.solve(engaged.T, driven)[0]))
    time = machine.substep * (np.arange(float(round(LONGEST / machine.substep))) + 0.5)
    ramp = breakaway / share / BREAKAWAY_TIME * time
    torque = np.zeros((len(ramp), 2))
    torque[:, link] = ramp
    start = initial_state(machine, POSE, volts=volts)
    turned: Array = np.abs(simulate(machine, start, volts, (0.0, 0.0), torque).theta - POSE).max(axis=1)
    end = int(np.searchsorted(turned, LARGEST_TURN))
    run = simulate(machine, start, volts, (0.0, 0.0), torque[:end])
    allowed = _line(machine, locked, run.theta[:, link] - POSE[link])
    return SingleDofTest(
        clutch=clutch,
        locked=locked,
        link=link,
        volts=volts,
        input_torque=ramp[:end],
        share=share,
        trajectory=run,
        line=_line(machine, locked, np.linspace(*LINE_SPAN, _LINE_SAMPLES)),
        deviation=np.linalg.norm(run.tip_position - allowed, axis=1),
    )


def _line(machine: Machine, locked: int, turns: Array) -> Array:
    """Return tip positions [m], shape (K, 2), with one clutch locked and the driven link turned by angles [rad]."""
    return np.array([tip(machine, np.add(POSE, np.multiply(turn, LINES[locked - 1]))) for turn in turns])
