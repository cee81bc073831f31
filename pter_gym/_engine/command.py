"""From an action to the voltages of a control step."""

import numpy as np

from pter_gym._compiled.compiler import inlined
from pter_gym._compiled.records import Records, entrywise, load, store
from pter_gym._engine.world import REFUSE, ROW, SAME_STEP
from pter_gym._physics.arm import Vector, tip_velocity
from pter_gym._physics.clutch import PerClutch
from pter_gym._physics.scalars import clamp
from pter_gym._physics.step import Energy
from pter_gym.tasks.path_following._actions import volts_of_each


@entrywise
@inlined
def clipped(volts: float, voltage_max: float) -> float:
    """Return the voltage [V] that reaches the clutch: a float32 action within the bounds."""
    return clamp(float(np.float32(volts)), 0.0, voltage_max)


@inlined
def is_refused(
    alive: float, actions: Records, low: float, high: float, ended: int, world: int
) -> bool:
    """Return whether a world has ended and must not, or its action is not within the bounds."""
    refused = False
    for clutch in range(4):
        refused |= not ((actions[world, clutch] >= low) & (actions[world, clutch] <= high))
    return ((ended == REFUSE) | (ended == SAME_STEP)) if alive == 0.0 else refused


@inlined
def given_volts(
    actions: Records, world: int, low: float, high: float, voltage_max: float
) -> PerClutch:
    """Return the voltages [V] of an action."""
    given = PerClutch(actions[world, 0], actions[world, 1], actions[world, 2], actions[world, 3])
    return volts_of_each(given, low, high, voltage_max)


@inlined
def take_command(w: Records, i: int, volts: PerClutch) -> None:
    """Take the command of a control step, and keep from the one before what a reward needs."""
    store(w, ROW.command, i, clipped(volts, w[ROW.machine.voltage_max, i]))
    v_x, v_y = tip_velocity(load(w, ROW.machine.arm, i), load(w, ROW.motion, i))
    store(w, ROW.start_velocity, i, Vector(v_x, v_y))
    store(w, ROW.energy, i, Energy(0.0, 0.0, 0.0, 0.0))
