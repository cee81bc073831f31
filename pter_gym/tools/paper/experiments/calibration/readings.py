"""Readings of the paper where it is ambiguous: a preset's machines, task, controller and Table I under each."""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pter_gym.benchmark._measures import column, low_pass, vector
from pter_gym.benchmark._recorded import START_UP
from pter_gym.params import MU_STATIC_PRESENT, Lag, paper_machines_of
from pter_gym.params._preset import Preset
from pter_gym.tools.paper.experiments.setup import TIME_CONSTANTS, ErrorAverage, Setup, controller_of, task_of
from pter_gym.tools.paper.experiments.time_constants import standard_runs
from pter_gym.tools.paper.standard_test import TIME_CONSTANTS as SIX
from pter_gym.tools.paper.standard_test import Run
from pter_gym.units import INCH

Array = NDArray[np.float64]

DelrinRule = Literal["coefficients", "static"]


@dataclass(frozen=True, kw_only=True)
class Reading:
    """One choice for each ambiguity of the paper.

    Attributes
    ----------
    error_average
        Average |error| over time or over the path.
    control_period
        Control period [s].
    filtered
        Whether accelerations pass the first-order low-pass.
    start_up
        Time at the start that is left out of accelerations [s].
    delrin_rule
        Theoretical Delrin scales T_k by its μk over the present clutches' μk, which is fitted (``"coefficients"``), or
        over their μs, the only coefficient that is printed (``"static"``).
    own_table
        Whether a Delrin machine's controller uses that machine's torque table.
    tip_space
        Whether torques are allocated for tip force rather than joint torque.
    lag
        The quantity that lags behind the voltage.
    time_constants
        Time constants of the runs averaged in Table I [s]: those of Figs. 7 and 8, or the six of the standard test.
    """

    error_average: ErrorAverage = "time"
    control_period: float = 0.01
    filtered: bool = True
    start_up: float = START_UP
    delrin_rule: DelrinRule = "coefficients"
    own_table: bool = False
    tip_space: bool = False
    lag: Lag = "normal_force"
    time_constants: tuple[float, ...] = TIME_CONSTANTS


READINGS: dict[str, Reading] = {
    "as calibrated": Reading(),
    "error averaged over the path": Reading(error_average="path"),
    "control every 5 ms": Reading(control_period=0.005),
    "acceleration not filtered": Reading(filtered=False),
    "acceleration with the start-up": Reading(start_up=0.0),
    "theoretical Delrin: T_k by 0.35/0.45": Reading(delrin_rule="static"),
    "Delrin with its own torque table": Reading(own_table=True),
    "allocation in tip space": Reading(tip_space=True),
    "lag of the voltage": Reading(lag="voltage"),
    "averages over six time constants": Reading(time_constants=SIX),
}
"""The named options, each with one choice changed."""


def setup_of(preset: Preset, reading: Reading | None = None) -> Setup:
    """Return the machines, the task and the controller of a preset under a reading of the paper."""
    reading = Reading() if reading is None else reading
    if reading.delrin_rule == "static":
        preset = replace(preset, delrin={**preset.delrin, "mu_dynamic_present": MU_STATIC_PRESENT})
    return Setup(
        machines={
            name: replace(machine, clutch=replace(machine.clutch, lag=reading.lag))
            for name, machine in paper_machines_of(preset).items()
        },
        task=replace(task_of(preset), control_period=reading.control_period),
        controller=replace(controller_of(preset), tip_space=reading.tip_space),
        own_table=reading.own_table,
        error_average=reading.error_average,
        time_constants=reading.time_constants,
    )


def table_of(preset: Preset, reading: Reading | None = None, parts: int = 1) -> Array:
    """Return Table I in inches, in/s and in/s², shape (3, 3), of a preset under a reading, with substeps in parts."""
    reading = Reading() if reading is None else reading
    setup = setup_of(preset, reading)
    rows: list[Array] = []
    for machine in setup.machines.values():
        runs = standard_runs(setup, replace(machine, substep=machine.substep / parts), 0.0, setup.time_constants)
        rows.append(np.mean([_entries(run, setup, reading) for run in runs], axis=0))
    return np.array(rows)


def _entries(run: Run, setup: Setup, reading: Reading) -> Array:
    """Return error, mean speed and mean acceleration of a run in the paper's units, (3,)."""
    acceleration = vector(run.telemetry, "acceleration")[1:]
    if reading.filtered:
        acceleration = low_pass(acceleration, reading.control_period)
    settled = np.linalg.norm(acceleration, axis=1)[column(run.telemetry, "time")[1:] > reading.start_up]
    return np.array([setup.position_error(run.score), run.score.mean_speed_m_s, settled.mean()]) / INCH
