"""How worlds move in a control step: functions on a column, or the first columns, of an array with the rows ``ROW``."""

import math
from typing import Any

import numpy as np

from pter_gym._compiled.compiler import device
from pter_gym._compiled.records import load, store
from pter_gym._engine.world import CONFIG, REFUSE, ROW, SAME_STEP
from pter_gym._physics.arm import Load, Vector, tip_velocity
from pter_gym._physics.clutch import PerClutch
from pter_gym._physics.friction import between, generated_torques
from pter_gym._physics.step import Energy, clutch_load, count_nonzero, substep_on
from pter_gym.hands._model import advance_sines, renew_sines, sum_of_sines
from pter_gym.tasks.path_following._situation import PathVector, to_world


@device
def clipped(volts: float, voltage_max: float) -> float:
    """Return the voltage [V] that reaches the clutch: a float32 action within the bounds."""
    return between(float(np.float32(volts)), 0.0, voltage_max)


@device
def is_refused(alive: float, actions: Any, low: float, high: float, ended: int, world: int) -> bool:
    """Tell whether a world has ended and may not, or its action is not a number within the bounds."""
    refused = False
    for clutch in range(4):
        refused |= not ((actions[world, clutch] >= low) & (actions[world, clutch] <= high))
    return ((ended == REFUSE) | (ended == SAME_STEP)) if alive == 0.0 else refused


@device
def scaled_volts(linear: float, low: float, voltage_max: float) -> float:
    """Return the voltage [V] of an action, from its share of the bounds times the largest voltage [V].

    A lower bound of 0 is that of a voltage. Of a normalised action, whose lower bound is negative, the square of the
    share counts: steps are fine where clutches slip, and exploring noise about 0 V brakes little.
    """
    return linear * (linear / voltage_max) if low < 0.0 else linear


@device
def given_volts(actions: Any, world: int, low: float, high: float, voltage_max: float) -> PerClutch:
    """Return the voltages [V] of an action."""
    per_unit = voltage_max / (high - low)
    return PerClutch(
        scaled_volts((actions[world, 0] - low) * per_unit, low, voltage_max),
        scaled_volts((actions[world, 1] - low) * per_unit, low, voltage_max),
        scaled_volts((actions[world, 2] - low) * per_unit, low, voltage_max),
        scaled_volts((actions[world, 3] - low) * per_unit, low, voltage_max),
    )


@device
def are_finite(volts: PerClutch) -> bool:
    """Tell whether all voltages are finite numbers."""
    return math.isfinite(volts.x1) & math.isfinite(volts.x2) & math.isfinite(volts.x3) & math.isfinite(volts.x4)


@device
def take_command(w: Any, i: int, volts: PerClutch) -> None:
    """Take the command of a control step, keep the last one and the tip's velocity, and clear the step's energies."""
    most = w[ROW.machine.voltage_max, i]
    store(w, ROW.last_command, i, load(w, ROW.command, i))
    store(
        w,
        ROW.command,
        i,
        PerClutch(clipped(volts.x1, most), clipped(volts.x2, most), clipped(volts.x3, most), clipped(volts.x4, most)),
    )
    v_x, v_y = tip_velocity(load(w, ROW.machine.arm, i), load(w, ROW.motion, i))
    store(w, ROW.start_velocity, i, Vector(v_x, v_y))
    store(w, ROW.energy, i, Energy(0.0, 0.0, 0.0, 0.0))


@device
def drift_torques(w: Any, i: int, period: float) -> None:
    """Find what the friction's drift has made of the clutch torques by the present control step."""
    w[ROW.drift, i] = between(1.0 + w[ROW.task.friction_drift, i] * period * w[ROW.step, i], 0.1, 10.0)


@device
def push_tip(w: Any, i: int) -> None:
    """Find the hand's push and disturbance [N], and move its sines on by a substep.

    The directions along and across the path are those at the control instant.
    """
    sines = load(w, ROW.sines, i)
    across = sum_of_sines(load(w, ROW.hand.amplitude, i), sines)
    store(w, ROW.sines, i, advance_sines(sines, load(w, ROW.hand.turn, i)))
    push = PathVector(w[ROW.hand.push, i], across)
    store(w, ROW.force, i, to_world(push, load(w, ROW.foot.heading, i)))


@device
def guide_tip(w: Any, i: int, h: float) -> None:
    """Add recorded forces and the pull of the damper towards a moving target [N], and move both on by a substep."""
    drive = load(w, ROW.drive, i)
    target = load(w, ROW.target, i)
    force = to_world(drive.force, load(w, ROW.foot.heading, i))
    damping = w[ROW.machine.arm.damping, i]
    w[ROW.force.x, i] += force.x + damping * target.velocity.x
    w[ROW.force.y, i] += force.y + damping * target.velocity.y
    w[ROW.drive.force.along, i] += drive.change.along
    w[ROW.drive.force.across, i] += drive.change.across
    w[ROW.target.position.x, i] += h * target.velocity.x
    w[ROW.target.position.y, i] += h * target.velocity.y


@device
def load_on(w: Any, i: int) -> Load:
    """Return what the hand of a world does to the arm."""
    force = load(w, ROW.force, i)
    to = load(w, ROW.target.position, i)
    return Load(force.x, force.y, 0.0, 0.0, to.x, to.y)


_aim, _substep = substep_on(ROW, load_on)


@device
def sense_torques(w: Any, i: int, h: float) -> None:
    """Find the generated torques [N·m] of the last substep, and bring the sines' vectors back to unit length."""
    q = load(w, ROW.motion, i)
    load_a, load_b = clutch_load(load(w, ROW.impact, i), q.omega_a, q.omega_b, h)
    store(w, ROW.torque, i, generated_torques(q.omega_a, q.omega_b, load_a, load_b, load(w, ROW.limit, i)))
    store(w, ROW.sines, i, renew_sines(load(w, ROW.sines, i)))


@device
def move_worlds(w: Any, lanes: int, config: Any, guides: bool) -> None:
    """Move the worlds in the first ``lanes`` columns, which have taken their commands, through a control step.

    ``guides`` says that hands may have more than a push and sines.
    """
    h, count = config[CONFIG.substep], int(config[CONFIG.substeps])
    lags_voltage = count_nonzero(w, ROW.machine.voltage_decay, lanes) > 0
    for i in range(lanes):
        drift_torques(w, i, h * count)
    for k in range(count):
        if lags_voltage | (k == 0):
            _aim(w, lanes)
        for i in range(lanes):
            push_tip(w, i)
        if guides:
            for i in range(lanes):
                guide_tip(w, i, h)
        _substep(w, lanes, h)
    for i in range(lanes):
        sense_torques(w, i, h)
