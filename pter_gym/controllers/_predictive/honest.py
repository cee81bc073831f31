"""A predictive controller that uses only what can be known: the nominal machine and the observations.

It knows the commanded path and pace and the nominal machine. It takes pose and velocities from the observation, clutch
torques from the voltages that it sent and from the torque sensors, and predicts the hand from the forces measured so
far.
"""

import math
from typing import Any

import numpy as np

from pter_gym._compiled.layout import Layout
from pter_gym._compiled.records import write
from pter_gym._engine.batch import Batch
from pter_gym._engine.world import ROW, Drive
from pter_gym._physics.arm import Motion, UnitVector
from pter_gym._physics.clutch import PerClutch, Torques
from pter_gym._physics.friction import slip_velocities
from pter_gym._physics.model import own_arrangement
from pter_gym.controllers import Controller
from pter_gym.controllers._predictive.planner import Array, Observations, Planner, Settings
from pter_gym.hands import RecordedForces
from pter_gym.params import Machine
from pter_gym.paths._projection import Foot
from pter_gym.tasks.path_following import PathFollowing, substeps
from pter_gym.tasks.path_following._rules import PathVector

SLIPPING = 0.05
"""Slip velocity [rad/s] from which on a clutch's sensor tells its dynamic torque."""


SMOOTHING = 0.3
"""Part of the way that the smoothed force along the path goes to the measured one in a control step."""

FADING_TIME = 0.05
"""Time constant in which the force across the path dies away [s]."""


class ForceForecast:
    """A forecast of the hand's force: along the path it stays, across the path it decays.

    Across the path the hand is a disturbance that soon changes. On training draws of ``standard``, a force that decays
    within 50 ms was a better forecast than a constant force or none.

    Parameters
    ----------
    period
        Control period [s].
    count
        Number of control instants to look ahead, the present one included.
    """

    def __init__(self, period: float, count: int) -> None:
        self.fading = np.exp(-period / FADING_TIME * np.arange(count))
        self.along: float | None = None

    def forecast(self, along: float, across: float) -> Array:
        """Take the forces measured now; return a forecast for the next instants, along and across, (count, 2) [N]."""
        self.along = along if self.along is None else self.along + SMOOTHING * (along - self.along)
        return np.stack([np.full(len(self.fading), self.along), across * self.fading], axis=1)


def known_part(task: PathFollowing, horizon: int) -> PathFollowing:
    """Return what a controller may know of a task: path, pace and workspace; the hand is a recording to be filled."""
    times = tuple(task.control_period * k for k in range(horizon + 1))
    nothing = (0.0,) * len(times)
    return PathFollowing(
        path=task.path,
        pace=task.pace,
        control_period=task.control_period,
        error_max=task.error_max,
        singularity_margin=task.singularity_margin,
        hand=RecordedForces(times=times, along=nothing, across=nothing),
    )


def motion_seen(see: dict[str, float]) -> Motion:
    """Return the arm's motion from an observation's entries in their units; unit vectors are renormalised."""
    size_a = math.hypot(see["cos_a"], see["sin_a"])
    size_b = math.hypot(see["cos_b"], see["sin_b"])
    return Motion(
        math.atan2(see["sin_a"], see["cos_a"]),
        math.atan2(see["sin_b"], see["cos_b"]),
        see["omega_a"],
        see["omega_b"],
        see["cos_a"] / size_a,
        see["sin_a"] / size_a,
        see["cos_b"] / size_b,
        see["sin_b"] / size_b,
    )


class Belief:
    """The state of a world as estimated by an observer.

    Parameters
    ----------
    task
        From ``known_part``.
    machine
        The nominal machine.
    layout
        Of the observations, with force sensors.
    """

    def __init__(self, task: PathFollowing, machine: Machine, layout: Layout) -> None:
        self.layout = layout
        self.task = task
        self.arcs = task.path.arcs
        model = Batch(machine, task, 1)
        model.reset([0])
        self.rows: Array = model.get_state()["worlds"][0, :, 0]
        self.decay = float(np.exp(-task.control_period / machine.clutch.time_constant))
        self.count = substeps(task, machine)
        self.curve = machine.clutch.dynamic
        self.scale = np.array(machine.slot_scale)
        self.own = own_arrangement(machine)
        self.ratio = machine.clutch.breakaway.slope / machine.clutch.dynamic.slope
        self.dynamic = np.zeros(4)
        self.reached = 0.0

    def update(self, obs: Observations) -> None:
        """Take the observation of a control instant, (entries,), into ``rows``."""
        see = {name: float(self.layout.physical(obs, name)) for name in self.layout.names}
        volts = np.array([see[f"volts_{x}"] for x in range(1, 5)])
        torques = np.array([see[f"torque_{x}"] for x in range(1, 5)])
        steady = self.scale * [self.curve.torque(v) for v in volts]
        self.dynamic = steady + (self.dynamic - steady) * self.decay
        slips = np.abs(slip_velocities(see["omega_a"], see["omega_b"], self.own)) > SLIPPING
        self.dynamic[slips] = np.abs(torques[slips])
        arc_length = see["progress"] * self.task.path.length
        self.reached = max(self.reached, arc_length)
        rows: Any = self.rows
        write(rows, ROW.motion, motion_seen(see))
        write(rows, ROW.torques, Torques(PerClutch(*(self.ratio * self.dynamic)), PerClutch(*self.dynamic)))
        write(rows, ROW.command, PerClutch(*volts))
        write(rows, ROW.torque, PerClutch(*torques))
        rows[ROW.alive] = 1.0
        heading = UnitVector(see["heading_cos"], see["heading_sin"])
        segment = float(self.arcs.numbers_at(arc_length))
        write(rows, ROW.foot, Foot(arc_length, see["normal_error"], heading, see["curvature"], segment))
        rows[ROW.reached] = self.reached

    def expect(self, forces: Array) -> None:
        """Take the forces that the hand will exert, (T, 2) [N]: the row of what drives the first control step."""
        change = (forces[1] - forces[0]) / self.count
        write(self.rows, ROW.drive, Drive(PathVector(*forces[0]), PathVector(*change)))


class HonestPlanner:
    """A planner for one world that uses only its observations.

    Parameters
    ----------
    settings
        Of the method.
    task
        Only its path, pace and workspace are used.
    guide, nominal
        As for ``Planner``.
    layout
        Of the observations, with force sensors.
    """

    def __init__(
        self, settings: Settings, task: PathFollowing, guide: Controller, nominal: Machine, layout: Layout
    ) -> None:
        known = known_part(task, settings.horizon)
        self.belief = Belief(known, nominal, layout)
        self.hand = ForceForecast(task.control_period, settings.horizon + 1)
        self.planner = Planner(settings, nominal, known, guide, nominal)

    def decide(self, obs: Observations) -> Array:
        """Return the voltages of the next control step, (4,), from an observation with force sensors, (entries,)."""
        self.belief.update(obs)
        layout = self.belief.layout
        forces = self.hand.forecast(
            float(layout.physical(obs, "force_along")), float(layout.physical(obs, "force_across"))
        )
        self.belief.expect(forces)
        self.planner.record_forces(forces)
        return self.planner.decide(self.belief.rows, obs)
