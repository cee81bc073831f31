"""What a preset makes of the paper where it is ambiguous: machines, task, controller and Table I of each reading."""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pter_gym.benchmark._measures import column, low_pass, vector
from pter_gym.benchmark._recorded import START_UP
from pter_gym.benchmark._standard import TIME_CONSTANTS, Run
from pter_gym.controllers import TorqueFeedback
from pter_gym.hands import eq5
from pter_gym.params import (
    MU_DYNAMIC_DELRIN,
    MU_STATIC_DELRIN,
    MU_STATIC_PRESENT,
    Arm,
    Clutch,
    Lag,
    Machine,
    TorqueCurve,
    with_friction,
)
from pter_gym.params._preset import ArmValues, ControllerValues, PathValues, Preset
from pter_gym.paths import Line
from pter_gym.tasks.path_following import PathFollowing
from pter_gym.tools.paper.experiments.setup import ErrorAverage, Setup
from pter_gym.tools.paper.experiments.time_constants import PAPER_TABLE, standard_runs
from pter_gym.units import INCH

Array = NDArray[np.float64]

DelrinRule = Literal["coefficients", "static"]

SUBSTEP = 1e-3
"""Substep of the machines [s]: the usual one is too long for some arms of the search space."""


@dataclass(frozen=True, kw_only=True)
class Reading:
    """Where the paper is ambiguous: one choice of each.

    Attributes
    ----------
    error_average
        Average |error| over time or over the path.
    control_period
        Of the controller [s].
    filtered
        Whether accelerations pass the first-order low-pass.
    start_up
        Time at the start that accelerations leave out [s].
    delrin_rule
        Theoretical Delrin scales T_k by its μk over the present clutches' μk (``"coefficients"``), or over their μs,
        the only one that is printed (``"static"``).
    own_table
        Whether a Delrin machine's controller has that machine's torque table.
    tip_space
        Whether torques are allocated for tip force rather than joint torque.
    lag
        What lags behind the voltage.
    """

    error_average: ErrorAverage = "time"
    control_period: float = 0.01
    filtered: bool = True
    start_up: float = START_UP
    delrin_rule: DelrinRule = "coefficients"
    own_table: bool = False
    tip_space: bool = False
    lag: Lag = "normal_force"


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
}
"""The named options, each with one choice changed."""


def setup_of(preset: Preset, reading: Reading | None = None) -> Setup:
    """Return the machines, the task and the controller of a preset under a reading of the paper."""
    reading = Reading() if reading is None else reading
    arm = Arm(**{name: getattr(preset.arm, name) for name in ArmValues.__dataclass_fields__})
    dynamic = TorqueCurve(slope=preset.clutch.slope, knee=preset.clutch.knee, curvature=preset.clutch.curvature)
    ratio = preset.clutch.breakaway_ratio
    present = Clutch(
        breakaway=dynamic.scaled(ratio),
        dynamic=dynamic,
        time_constant=preset.clutch.time_constant,
        voltage_max=preset.clutch.voltage_max,
        lag=reading.lag,
    )
    mu_dynamic = MU_STATIC_PRESENT / ratio if reading.delrin_rule == "coefficients" else MU_STATIC_PRESENT
    scale = preset.delrin.dynamic_scale
    clutches = (
        present,
        with_friction(present, scale * preset.delrin.breakaway_ratio / ratio, scale),
        with_friction(present, MU_STATIC_DELRIN / MU_STATIC_PRESENT, MU_DYNAMIC_DELRIN / mu_dynamic),
    )
    return Setup(
        machines={
            name: Machine(arm=arm, clutch=clutch, substep=SUBSTEP)
            for name, clutch in zip(PAPER_TABLE, clutches, strict=True)
        },
        task=PathFollowing(
            path=Line(**{name: getattr(preset.path, name) for name in PathValues.__dataclass_fields__}),
            hand=eq5(preset.hand.force_max, preset.hand.push),
            control_period=reading.control_period,
        ),
        controller=TorqueFeedback(
            tip_space=reading.tip_space,
            **{name: getattr(preset.controller, name) for name in ControllerValues.__dataclass_fields__},
        ),
        own_table=reading.own_table,
        error_average=reading.error_average,
    )


def table_of(preset: Preset, reading: Reading | None = None, parts: int = 1) -> Array:
    """Return Table I in inches, in/s and in/s², shape (3, 3), of a preset under a reading, with substeps in parts."""
    reading = Reading() if reading is None else reading
    setup = setup_of(preset, reading)
    rows: list[Array] = []
    for machine in setup.machines.values():
        runs = standard_runs(setup, replace(machine, substep=machine.substep / parts), 0.0, TIME_CONSTANTS)
        rows.append(np.mean([_entries(run, setup, reading) for run in runs], axis=0))
    return np.array(rows)


def _entries(run: Run, setup: Setup, reading: Reading) -> Array:
    """Return error, mean speed and mean acceleration of a run in the paper's units, (3,)."""
    acceleration = vector(run.telemetry, "acceleration")[1:]
    if reading.filtered:
        acceleration = low_pass(acceleration, reading.control_period)
    settled = np.linalg.norm(acceleration, axis=1)[column(run.telemetry, "time")[1:] > reading.start_up]
    return np.array([setup.position_error(run.score), run.score.mean_speed_m_s, settled.mean()]) / INCH
