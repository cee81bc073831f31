"""What the hand of a world does by itself: its plan for a control step, and its force at a control instant."""

from typing import Any

from pter_gym._compiled.compiler import device, outlined
from pter_gym._compiled.records import load, read, rows, store, width
from pter_gym._engine.world import ROW, Drive, Target
from pter_gym._physics.arm import Vector, tip_position, tip_velocity
from pter_gym.hands._model import intent_speed, sum_of_sines
from pter_gym.paths._projection import point_at
from pter_gym.tasks.path_following._situation import PathVector, to_path

FORCES = rows(PathVector)
INSTANT = width(PathVector)
"""Numbers of a recording at a control instant."""


@device
def plans(w: Any, i: int) -> bool:
    """Tell whether the hand of a world has a recording or an intent."""
    return (w[ROW.hand.record_count, i] > 0.0) | (w[ROW.hand.intent_speed, i] > 0.0)


@outlined
def plan_hand(w: Any, i: int, constants: Any, period: float, count: float) -> None:
    """Say what the hand does by itself in the next control step of ``count`` substeps."""
    if w[ROW.hand.record_count, i] > 0.0:
        store(w, ROW.drive, i, recorded(w, i, constants, count))
    if w[ROW.hand.intent_speed, i] > 0.0:
        store(w, ROW.target, i, intended(w, i, constants, period))


@device
def recorded(w: Any, i: int, constants: Any, count: float) -> Drive:
    """Return the recorded forces of the next control step."""
    last = int(w[ROW.hand.record_count, i]) - 1
    now = int(w[ROW.step, i])
    begin = int(w[ROW.hand.record_first, i]) + INSTANT * (now if now < last else last)
    force = read(constants, FORCES, begin)
    then = read(constants, FORCES, begin + (INSTANT if now < last else 0))
    return Drive(force, PathVector((then.along - force.along) / count, (then.across - force.across) / count))


@device
def intended(w: Any, i: int, constants: Any, period: float) -> Target:
    """Move the intended point on by a control step; return where it was and the velocity at which it goes on."""
    hand = load(w, ROW.hand, i)
    path = load(w, ROW.task.path, i)
    at = w[ROW.intent, i]
    moved = at + period * intent_speed(period * (w[ROW.step, i] + 0.5), hand.intent_rise, hand.intent_speed)
    leash = w[ROW.foot.arc_length, i] + hand.intent_lead
    moved = moved if moved < leash else leash
    moved = moved if moved > at else at
    x, y = point_at(constants, int(path.first), int(path.arcs), at)
    to_x, to_y = point_at(constants, int(path.first), int(path.arcs), moved)
    w[ROW.intent, i] = moved
    return Target(Vector(x, y), Vector((to_x - x) / period, (to_y - y) / period))


@device
def hand_force(w: Any, i: int) -> PathVector:
    """Return the force of the hand on the tip along and across the path at a control instant [N]."""
    arm = load(w, ROW.machine.arm, i)
    q = load(w, ROW.motion, i)
    target = load(w, ROW.target, i)
    x, y = tip_position(arm, q)
    v_x, v_y = tip_velocity(arm, q)
    pull = to_path(
        Vector(
            arm.stiffness * (target.position.x - x) + arm.damping * (target.velocity.x - v_x),
            arm.stiffness * (target.position.y - y) + arm.damping * (target.velocity.y - v_y),
        ),
        load(w, ROW.foot.heading, i),
    )
    across = sum_of_sines(load(w, ROW.hand.amplitude, i), load(w, ROW.sines, i))
    return PathVector(
        w[ROW.hand.push, i] + w[ROW.drive.force.along, i] + pull.along,
        across + w[ROW.drive.force.across, i] + pull.across,
    )
