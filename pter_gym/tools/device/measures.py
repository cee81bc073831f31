"""What a device can render, without learning: forces, drag, and the stiffness of a wall."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from pter_gym._physics.open_loop import initial_state, simulate
from pter_gym.benchmark.rollout import record_episode
from pter_gym.controllers import AnyPolicy
from pter_gym.haptics import apparent_stiffness, force_extremes, impedance, link_angles, z_width
from pter_gym.params import Machine
from pter_gym.paths import Line
from pter_gym.scenarios import find_scenario
from pter_gym.tasks.path_following._telemetry import COLUMN

FREQUENCY = 5.0
"""Frequency at which impedances are compared [Hz]."""

SHAKE, SETTLING, PERIODS = 10.0, 2, 5
"""Force that shakes the free device [N], and the periods before and during the measurement."""

WALLS = 8
"""Episodes from which the stiffness of the wall is estimated."""


@dataclass(frozen=True)
class Rendering:
    """What a device can render.

    Attributes
    ----------
    least_steering_n, largest_steering_n
        Steering force over all directions of motion in the middle of the paper's line [N]; see
        ``force_extremes``.
    least_resisting_n, largest_resisting_n
        The same of the force against the motion [N].
    free_impedance
        ``|F/V|`` across the line at ``FREQUENCY`` without voltage [N·s/m]; infinite where 10 N do
        not move the arm.
    apparent_stiffness
        Stiffness [N/m] of the wall of the scenario ``wall`` with the law that was given; NaN if
        nothing touched it.
    z_width_db
        Impedance of that wall at ``FREQUENCY`` over ``free_impedance`` [dB]; NaN where one of them
        is not a number.
    """

    least_steering_n: float
    largest_steering_n: float
    least_resisting_n: float
    largest_resisting_n: float
    free_impedance: float
    apparent_stiffness: float
    z_width_db: float


def measure_rendering(own: Machine, law: AnyPolicy, pace: str) -> Rendering:
    """Return what a machine can render; ``law`` guards the wall at a named commanded pace."""
    line = Line()
    theta = link_angles(own.arm, line.point(0.5 * line.length))
    forces = force_extremes(own, theta)
    free, stiff = _free_impedance(own, theta), _stiffness_of_wall(own, law, pace)
    wide = math.isfinite(free) and stiff > 0.0
    return Rendering(
        **{f"{name}_n": float(force) for name, force in forces._asdict().items()},
        free_impedance=free,
        apparent_stiffness=stiff,
        z_width_db=z_width(stiff, free, FREQUENCY) if wide else math.nan,
    )


def _free_impedance(machine: Machine, theta: Any) -> float:
    """Return ``|F/V|`` across the paper's line of the arm without voltage [N·s/m]."""
    period = 1.0 / FREQUENCY
    time = np.arange(round((SETTLING + PERIODS) * period / machine.substep)) * machine.substep
    push = np.stack([0.0 * time, SHAKE * np.cos(2.0 * math.pi * FREQUENCY * time)], axis=1)
    moved = simulate(machine, initial_state(machine, theta), [0.0] * 4, push)
    last = slice(-round(PERIODS * period / machine.substep), None)
    across = moved.tip_velocity[last, 1]
    if not np.abs(across).max() > machine.slip_threshold:
        return math.inf
    return impedance(push[last, 1], across, machine.substep, FREQUENCY)


def _stiffness_of_wall(own: Machine, law: AnyPolicy, pace: str) -> float:
    """Return the stiffness of the wall that a law renders [N/m], from draws of ``wall``."""
    forces, depths = [np.empty(0)], [np.empty(0)]
    scenario = find_scenario("wall", own)
    for seed, (machine, task) in enumerate(scenario.draws.pairs(WALLS, 0, pace)):
        rows: Any = record_episode(law, machine, task, seed, nominal=own).telemetry[1:]
        into = np.array([[math.sin(task.path.heading(0.0))], [-math.cos(task.path.heading(0.0))]])
        forces.append((rows[:, [*COLUMN.force]] @ into)[:, 0])
        depths.append(-rows[:, COLUMN.normal_error])
    return apparent_stiffness(np.concatenate(forces), np.concatenate(depths))
