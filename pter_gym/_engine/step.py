"""How worlds move in a control step: functions on a column, or the first columns, of an array with the rows ``ROW``."""

import math
from typing import Any

import numpy as np

from pter_gym._compiled.compiler import device
from pter_gym._compiled.records import load, read, store
from pter_gym._engine.world import CONFIG, REFUSE, ROW, SAME_STEP
from pter_gym._physics.arm import Load, Vector, tip_velocity
from pter_gym._physics.clutch import PerClutch
from pter_gym._physics.friction import between
from pter_gym._physics.step import Energy, count_nonzero, declared_in, papers, substep_on, torques_at
from pter_gym.hands._model import advance_sines, renew_sines, sum_of_sines
from pter_gym.tasks.path_following._context import CONTEXT
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
def move_hand(w: Any, i: int, h: float, whole: bool, guides: bool) -> None:
    """Move what the hand does by itself on by half a substep or a whole one."""
    half_turn = load(w, ROW.hand.half_turn, i)
    sines = advance_sines(load(w, ROW.sines, i), half_turn)
    store(w, ROW.sines, i, advance_sines(sines, half_turn) if whole else sines)
    if guides:
        part = 1.0 if whole else 0.5
        drive = load(w, ROW.drive, i)
        target = load(w, ROW.target, i)
        w[ROW.drive.force.along, i] += part * drive.change.along
        w[ROW.drive.force.across, i] += part * drive.change.across
        w[ROW.target.position.x, i] += part * h * target.velocity.x
        w[ROW.target.position.y, i] += part * h * target.velocity.y


@device
def push_tip(w: Any, i: int, guides: bool) -> None:
    """Find what the hand does by itself [N]: push, disturbance, recorded force, its damper's pull to a moving target.

    The directions along and across the path are those at the control instant.
    """
    along = w[ROW.hand.push, i]
    across = sum_of_sines(load(w, ROW.hand.amplitude, i), load(w, ROW.sines, i))
    if guides:
        along += w[ROW.drive.force.along, i]
        across += w[ROW.drive.force.across, i]
    force = to_world(PathVector(along, across), load(w, ROW.foot.heading, i))
    if guides:
        damping = w[ROW.machine.arm.damping, i]
        pull = load(w, ROW.target.velocity, i)
        force = Vector(force.x + damping * pull.x, force.y + damping * pull.y)
    store(w, ROW.force, i, force)


@device
def load_on(w: Any, i: int) -> Load:
    """Return what the hand of a world does to the arm."""
    force = load(w, ROW.force, i)
    to = load(w, ROW.target.position, i)
    return Load(force.x, force.y, 0.0, 0.0, to.x, to.y)


_aim, _drift, _ = substep_on(ROW, load_on)


@device
def drift_worlds(w: Any, lanes: int, h: float, whole: bool, aims: bool, guides: bool) -> None:
    """Let worlds drift for half a substep or a whole one, towards new steady torques if ``aims``."""
    if aims:
        for i in range(lanes):
            _aim(w, i, whole)
    for i in range(lanes):
        _drift(w, i, h, whole)
    for i in range(lanes):
        move_hand(w, i, h, whole, guides)
    for i in range(lanes):
        push_tip(w, i, guides)


def _mover(own_in: Any) -> Any:
    """Return what moves worlds whose clutches ``own_in`` tells; see ``substep_on``."""
    _, _, kick = substep_on(ROW, load_on, own_in)

    @device
    def sense_torques(w: Any, i: int) -> None:
        """Find the torques [N·m] that the clutches generate now, and bring the sines' vectors back to unit length."""
        q = load(w, ROW.motion, i)
        arm = load(w, ROW.machine.arm, i)
        threshold = w[ROW.machine.slip_threshold, i]
        torques = load(w, ROW.torques, i)
        store(w, ROW.torque, i, torques_at(q, arm, load_on(w, i), torques, threshold, own_in(w, i)))
        store(w, ROW.sines, i, renew_sines(load(w, ROW.sines, i)))

    @device
    def move(w: Any, lanes: int, config: Any, guides: bool) -> None:
        """Move the worlds in the first ``lanes`` columns, which have taken their commands, through a control step.

        ``guides`` says that hands may have more than a push and sines.
        """
        h, count = config[CONFIG.substep], int(config[CONFIG.substeps])
        lags_voltage = count_nonzero(w, ROW.machine.voltage_decay, lanes) > 0
        for i in range(lanes):
            drift_torques(w, i, h * count)
        for k in range(count + 1):
            drift_worlds(w, lanes, h, (k > 0) & (k < count), lags_voltage | (k == 0), guides)
            if k < count:
                kick(w, lanes, h)
        for i in range(lanes):
            sense_torques(w, i)

    return move


move_worlds, move_declared = _mover(papers), _mover(declared_in(ROW))
"""What moves worlds with the paper's clutches, and with others."""


@device
def no_arrangements(w: Any, lanes: int, constants: Any) -> None:
    """Leave the paper's clutches as they are."""


@device
def take_arrangements(w: Any, lanes: int, constants: Any) -> None:
    """Read the arrangement of the first ``lanes`` worlds."""
    for i in range(lanes):
        store(w, ROW.arrangement, i, read(constants, CONTEXT.arrangement, int(w[ROW.context_at, i])))
