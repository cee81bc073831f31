"""What the hand does in a control step: its plan, its sines, and its force on the tip."""

from pter_gym._compiled.compiler import inlined, outlined
from pter_gym._compiled.records import Records, load, read, rows, store, width
from pter_gym._engine.world import ROW, Drive, Target
from pter_gym._physics.arm import Linkage, Motion, Vector, directed, tip_position, tip_velocity
from pter_gym.hands._model import advance_sines, intent_speed, sum_of_sines
from pter_gym.paths._projection import point_at
from pter_gym.tasks.path_following._position import PathVector, to_path, to_world

FORCES = rows(PathVector)
INSTANT = width(PathVector)
"""Numbers of a recording at a control instant."""


@inlined
def plans(w: Records, i: int) -> bool:
    """Return whether the hand of a world has a recording or an intent."""
    return (w[ROW.hand.record_count, i] > 0.0) | (w[ROW.hand.intent_speed, i] > 0.0)


@outlined
def plan_hand(w: Records, i: int, constants: Records, period: float, count: float) -> None:
    """Plan what the hand does by itself in the next control step of ``count`` substeps."""
    if w[ROW.hand.record_count, i] > 0.0:
        store(w, ROW.drive, i, recorded(w, i, constants, count))
    if w[ROW.hand.intent_speed, i] > 0.0:
        store(w, ROW.target, i, intended(w, i, constants, period))


@inlined
def recorded(w: Records, i: int, constants: Records, count: float) -> Drive:
    """Return the recorded forces of the next control step."""
    last = int(w[ROW.hand.record_count, i]) - 1
    now = int(w[ROW.step, i])
    begin = int(w[ROW.hand.record_first, i]) + INSTANT * (now if now < last else last)
    force = read(constants, FORCES, begin)
    then = read(constants, FORCES, begin + (INSTANT if now < last else 0))
    return Drive(
        force, PathVector((then.along - force.along) / count, (then.across - force.across) / count)
    )


@inlined
def intended(w: Records, i: int, constants: Records, period: float) -> Target:
    """Move the intended point on by a control step; return where it was, and its velocity."""
    hand = load(w, ROW.hand, i)
    path = load(w, ROW.task.path, i)
    at = w[ROW.intent, i]
    moved = at + period * intent_speed(
        period * (w[ROW.step, i] + 0.5), hand.intent_rise, hand.intent_speed
    )
    leash = w[ROW.foot.arc_length, i] + hand.intent_lead
    moved = moved if moved < leash else leash
    moved = moved if moved > at else at
    x, y = point_at(constants, int(path.first), int(path.arcs), at)
    to_x, to_y = point_at(constants, int(path.first), int(path.arcs), moved)
    w[ROW.intent, i] = moved
    return Target(Vector(x, y), Vector((to_x - x) / period, (to_y - y) / period))


@inlined
def move_hand(w: Records, i: int, h: float, whole: bool, guides: bool) -> None:
    """Advance what the hand does by itself by half a substep or a whole one."""
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


@inlined
def active_force(w: Records, i: int, guides: bool) -> PathVector:
    """Return the hand's push, disturbance and recorded force [N], without spring and damper."""
    along = w[ROW.hand.push, i]
    across = sum_of_sines(load(w, ROW.hand.amplitude, i), load(w, ROW.sines, i))
    if guides:
        along += w[ROW.drive.force.along, i]
        across += w[ROW.drive.force.across, i]
    return PathVector(along, across)


@inlined
def push_tip(w: Records, i: int, guides: bool) -> None:
    """Find the force on the tip [N] without the spring and without damping of the tip's velocity.

    The directions along and across the path are those at the control instant.
    """
    force = to_world(active_force(w, i, guides), load(w, ROW.foot.heading, i))
    if guides:
        arm, to = load(w, ROW.machine.arm, i), load(w, ROW.target.velocity, i)
        pull = directed(arm.damping, arm.damping_by, to.x, to.y)
        force = Vector(force.x + pull.x, force.y + pull.y)
    store(w, ROW.force, i, force)


@inlined
def passive_force(arm: Linkage, q: Motion, target: Target) -> Vector:
    """Return the force of the hand's spring and damper on the tip [N]."""
    x, y = tip_position(arm, q)
    v_x, v_y = tip_velocity(arm, q)
    spring = directed(arm.stiffness, arm.stiffness_by, target.position.x - x, target.position.y - y)
    damper = directed(arm.damping, arm.damping_by, target.velocity.x - v_x, target.velocity.y - v_y)
    return Vector(spring.x + damper.x, spring.y + damper.y)


@inlined
def hand_force(w: Records, i: int) -> PathVector:
    """Return the hand's force on the tip along and across the path at a control instant [N]."""
    arm = load(w, ROW.machine.arm, i)
    q = load(w, ROW.motion, i)
    pull = to_path(passive_force(arm, q, load(w, ROW.target, i)), load(w, ROW.foot.heading, i))
    active = active_force(w, i, True)
    return PathVector(active.along + pull.along, active.across + pull.across)
