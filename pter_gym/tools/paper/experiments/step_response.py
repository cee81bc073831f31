"""Step response of a clutch (paper sections II-B and III-B): constant tip force, step of one clutch's voltage."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pter_gym._physics.open_loop import initial_state, simulate
from pter_gym.params import Machine, find_machine
from pter_gym.tools.paper.experiments.pose import POSE, resolved, slip_rows, tip_force

Array = NDArray[np.float64]

VOLTS = 4.0
"""Voltage after the step [V]: low, so the arm stays slow."""

LEAD = 0.02
"""Time before the step [s]."""

TIME_CONSTANTS_SHOWN = 3.0
"""Time after the step, in time constants."""

MARGIN = 1.2
"""Torque of the tip force about the clutch, relative to the dynamic torque that the clutch settles to."""


@dataclass(frozen=True)
class StepResponse:
    """Generated torque of each clutch after a step of its voltage, one test each.

    Attributes
    ----------
    machine
        Machine of the tests, with its substep.
    volts
        Voltage after the step [V].
    time
        Time from the step to the middle of each substep, where torques act [s], shape (T,).
    torque
        Magnitude of the generated torque [N·m], shape (4, T).
    slipping
        Whether the clutch slipped, shape (4, T).
    final
        Torque to which the clutch settles [N·m].
    first_order
        First-order response [N·m], shape (T,).
    """

    machine: Machine
    volts: float
    time: Array
    torque: Array
    slipping: NDArray[np.bool_]
    final: float
    first_order: Array


def step_response(machine: Machine | str | None = None, volts: float = VOLTS) -> StepResponse:
    """Step each clutch's voltage while a constant tip force keeps it slipping.

    Parameters
    ----------
    machine
        The machine or its name; PTER as it is by default.
    volts
        Voltage after the step [V].
    """
    machine = resolved(find_machine(machine))
    clutch = machine.clutch
    lead = round(LEAD / machine.substep)
    steps = lead + round(TIME_CONSTANTS_SHOWN * clutch.time_constant / machine.substep)
    final = clutch.dynamic.torque(volts)
    torques: list[Array] = []
    slipping: list[NDArray[np.bool_]] = []
    for x in range(4):
        rows = np.zeros((steps, 4))
        rows[lead:, x] = volts
        force = tip_force(machine, POSE, MARGIN * final * slip_rows()[x])
        run = simulate(machine, initial_state(machine, POSE), rows, force)
        torques.append(np.abs(run.torque[:, x]))
        slipping.append(np.abs(run.slip_velocity[:, x]) >= machine.slip_threshold)
    time = machine.substep * (np.arange(float(steps)) + 0.5 - lead)
    return StepResponse(
        machine=machine,
        volts=volts,
        time=time,
        torque=np.array(torques),
        slipping=np.array(slipping),
        final=final,
        first_order=np.where(time > 0.0, -final * np.expm1(-np.maximum(time, 0.0) / clutch.time_constant), 0.0),
    )
