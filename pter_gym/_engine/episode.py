"""How an episode of one world begins and ends, and what a control step returns and records."""

import math

import numpy as np
from numpy.typing import NDArray

from pter_gym._compiled.compiler import inlined, outlined
from pter_gym._compiled.philox import uniform4
from pter_gym._compiled.records import Records, entrywise, load, read, store, write
from pter_gym._engine.command import clipped
from pter_gym._engine.hand import hand_force, passive_force, plan_hand, plans
from pter_gym._engine.judgement import locate, tip_acceleration, was_alive
from pter_gym._engine.motion import applied_volts, shares_left
from pter_gym._engine.sensors import observe, take_first_readings, write_observation
from pter_gym._engine.world import (
    CONFIG,
    CONSTANTS,
    EXTRAS,
    FLAGS,
    KEPT,
    NEXT_STEP,
    ROW,
    SAME_STEP,
    STORED_ROWS,
    Arrays,
    Span,
    Target,
)
from pter_gym._physics.arm import (
    PerLink,
    UnitVector,
    Vector,
    kinetic_energy,
    motion_at,
    moving,
    tip_position,
    tip_velocity,
)
from pter_gym._physics.clutch import PerClutch, product, scaled, sought, steady_torques
from pter_gym._physics.friction import mode_of, slip_velocities
from pter_gym.hands._model import SINES, unit_vector
from pter_gym.paths._projection import Foot, point_at, project, segment_at, segment_of
from pter_gym.tasks.path_following._context import CONTEXT, CONTEXT_WIDTH
from pter_gym.tasks.path_following._ending import singular, strayed
from pter_gym.tasks.path_following._position import PathVector, beyond_band, to_world
from pter_gym.tasks.path_following._specification import (
    MAX_START_SPEED_ACROSS,
    MAX_START_SPEED_ALONG,
)
from pter_gym.tasks.path_following._telemetry import COLUMN

_RESET_STREAM, _START_STREAM = np.uint64(0x5245534554), np.uint64(0x5354415254)
_FIRST_DRAWS, _SECOND_DRAWS = np.uint64(0), np.uint64(1)
_KIND, _GRIPS, _MOTION = np.uint64(0), np.uint64(1), np.uint64(2)
_ONE = np.uint64(1)

COVERED = 0.92
"""Episodes that begin moving do so within this share of the path."""

NO_VOLTS = PerClutch(0.0, 0.0, 0.0, 0.0)

RELEASED = 0.2
"""Share of the clutches that are released where an episode begins with settled ones."""

# --- from the blocks and back ---


@inlined
def fetch_world(w: Records, i: int, worlds: Records, world: int) -> None:
    """Read what changes of a world into column ``i``, zero for what its block does not store."""
    width = worlds.shape[2]
    for row in range(STORED_ROWS):
        w[row, i] = worlds[world // width, row, world % width] if row < worlds.shape[1] else 0.0


@inlined
def put_back(w: Records, i: int, worlds: Records, world: int) -> None:
    """Write column ``i`` to the block of a world."""
    width = worlds.shape[2]
    for row in range(worlds.shape[1]):
        worlds[world // width, row, world % width] = w[row, i]


@outlined
def take_context(w: Records, i: int, constants: Records) -> None:
    """Read the constants of a world, where the world says that they begin."""
    first = int(w[ROW.context_at, i])
    for row in range(CONSTANTS.first, CONSTANTS.end):
        w[row, i] = constants[first + row - CONSTANTS.first]


# --- how an episode begins ---


@outlined
def start_episode(
    w: Records, i: int, seed: np.uint64, episode: np.uint64, config: Records, constants: Records
) -> None:
    """Start an episode: at rest at the path's start unless the task says otherwise.

    What is drawn depends on seed and episode alone.
    """
    clear(w, i, KEPT)
    clear(w, i, EXTRAS)
    u0, u1, u2, u3 = uniform4(seed, _RESET_STREAM, _FIRST_DRAWS, episode)
    v0, v1, v2, _ = uniform4(seed, _RESET_STREAM, _SECOND_DRAWS, episode)
    w[ROW.context_at, i] = w[ROW.draws_from, i] + CONTEXT_WIDTH * math.floor(v2 * w[ROW.draws, i])
    take_context(w, i, constants)
    draws = (u1, u2, u3, v0, v1)
    for k in range(SINES):
        angle = (
            2.0 * np.pi * draws[k]
            if w[ROW.hand.random_phases, i] != 0.0
            else w[ROW.hand.phase[k], i]
        )
        store(w, ROW.sines[k], i, unit_vector(angle))
    arc = segment_at(constants, int(w[ROW.task.path.first, i]), 0)
    place(
        w,
        i,
        Vector(arc.x, arc.y),
        UnitVector(arc.heading_cos, arc.heading_sin),
        spread(u0, w[ROW.task.start_offset, i]),
    )
    w[ROW.pace_ratio, i] = 1.0
    settle(w, i, NO_VOLTS)
    if w[ROW.task.starts.moving, i] + w[ROW.task.starts.gripped, i] > 0.0:
        explore(w, i, seed, episode, constants)
    w[ROW.alive, i] = 1.0
    locate(w, i, constants)
    if plans(w, i):
        plan_hand(
            w,
            i,
            constants,
            config[CONFIG.substep] * config[CONFIG.substeps],
            config[CONFIG.substeps],
        )
    if w[ROW.task.sensing.is_ideal, i] == 0.0:
        take_first_readings(w, i, seed, episode, config[CONFIG.substep] * config[CONFIG.substeps])


@inlined
def clear(w: Records, i: int, span: Span) -> None:
    """Set the rows of a record to zero."""
    for row in range(span.first, span.end):
        w[row, i] = 0.0


@inlined
def spread(draw: float, half_range: float) -> float:
    """Return an even draw from ±half_range for one from [0, 1)."""
    return half_range * (2.0 * draw - 1.0)


@inlined
def place(w: Records, i: int, point: Vector, heading: UnitVector, offset: float) -> None:
    """Put the arm at rest with the tip ``offset`` [m] to the left of a point of the path."""
    x = point.x - offset * heading.sin
    y = point.y + offset * heading.cos
    store(w, ROW.motion, i, motion_at(load(w, ROW.machine.arm, i), x, y))


@outlined
def explore(w: Records, i: int, seed: np.uint64, episode: np.uint64, constants: Records) -> None:
    """Begin an episode as ``Starts`` says: some moving, some gripped, the others as they are."""
    kind, along, aside, speed = uniform4(seed, _START_STREAM, _KIND, episode)
    grips = uniform4(seed, _START_STREAM, _GRIPS, episode)
    across, _, _, _ = uniform4(seed, _START_STREAM, _MOTION, episode)
    starts = load(w, ROW.task.starts, i)
    if kind < starts.moving:
        foot = beside(w, i, along, spread(aside, starts.offset), constants)
        set_going(
            w,
            i,
            foot,
            PathVector(MAX_START_SPEED_ALONG * speed, spread(across, MAX_START_SPEED_ACROSS)),
        )
    if kind < starts.moving + starts.gripped:
        grip(w, i, gripping(PerClutch(grips[0], grips[1], grips[2], grips[3])))


@inlined
def beside(w: Records, i: int, along: float, offset: float, constants: Records) -> Foot:
    """Put the tip at rest beside the path and return its projection.

    ``along`` is a share of ``COVERED`` of the path, ``offset`` the distance from it [m], taken as 0
    where the workspace has no such place.
    """
    path = load(w, ROW.task.path, i)
    first, count = int(path.first), int(path.arcs)
    s = COVERED * along * path.length
    x, y = point_at(constants, first, count, s)
    foot = project(constants, first, count, segment_of(constants, first, count, s), x, y)
    place(w, i, Vector(x, y), foot.heading, offset)
    width = min(w[ROW.task.error_max, i], w[ROW.task.truncation_error, i])
    if strayed(s, offset, width) | singular(
        load(w, ROW.motion, i), w[ROW.task.singularity_margin, i]
    ):
        place(w, i, Vector(x, y), foot.heading, 0.0)
    w[ROW.foot.segment, i] = foot.segment
    w[ROW.reached, i] = s
    w[ROW.intent, i] = s
    return foot


@inlined
def set_going(w: Records, i: int, foot: Foot, speed: PathVector) -> None:
    """Give the tip a speed relative to the commanded pace."""
    pace = w[ROW.task.pace, i]
    velocity = to_world(PathVector(pace * speed.along, pace * speed.across), foot.heading)
    store(w, ROW.motion, i, moving(load(w, ROW.machine.arm, i), load(w, ROW.motion, i), velocity))
    w[ROW.pace_ratio, i] = speed.along


@inlined
def grip(w: Records, i: int, shares: PerClutch) -> None:
    """Set the clutches as if settled at fractions of the largest voltage."""
    most = w[ROW.machine.voltage_max, i]
    settle(w, i, clipped(product(shares, most), most))


@inlined
def settle(w: Records, i: int, volts: PerClutch) -> None:
    """Set the clutches as if settled at a command [V] that has risen."""
    machine = load(w, ROW.machine, i)
    store(w, ROW.command, i, volts)
    settled = sought(NO_VOLTS, applied_volts(w, i), machine.hysteresis)
    store(w, ROW.lagged_volts, i, settled)
    steady = steady_torques(machine.breakaway, machine.dynamic, settled)
    store(w, ROW.torques, i, scaled(steady, machine.scale, shares_left(w, i)))


@entrywise
@inlined
def gripping(draw: float) -> float:
    """Return a share of the largest voltage: 0 for a share ``RELEASED`` of draws, else even."""
    return (draw - RELEASED) / (1.0 - RELEASED) if draw > RELEASED else 0.0


# --- what is recorded ---


@outlined
def record_reset(
    w: Records, i: int, telemetry: NDArray[np.float64], t: int, world: int, constants: Records
) -> None:
    """Write the telemetry (T, N, K) of a world that is not stepping, 0 but for pose and force."""
    for column in range(telemetry.shape[2]):
        telemetry[t, world, column] = 0.0
    row = telemetry[t, world]
    record_pose(w, i, row, 0.0, constants)
    write(row, COLUMN.force, to_world(hand_force(w, i), load(w, ROW.foot.heading, i)))


@inlined
def record_pose(w: Records, i: int, row: Records, time: float, constants: Records) -> None:
    """Write what the telemetry of a world, (K,), says of the pose, of machine and task."""
    arm = load(w, ROW.machine.arm, i)
    q = load(w, ROW.motion, i)
    x, y = tip_position(arm, q)
    v_x, v_y = tip_velocity(arm, q)
    context_at = w[ROW.context_at, i]
    row[COLUMN.time] = time
    write(row, COLUMN.theta, PerLink(q.theta_a, q.theta_b))
    write(row, COLUMN.tip, Vector(x, y))
    write(row, COLUMN.tip_velocity, Vector(v_x, v_y))
    row[COLUMN.arc_length] = w[ROW.foot.arc_length, i]
    row[COLUMN.reached] = w[ROW.reached, i]
    row[COLUMN.normal_error] = beyond_band(w[ROW.foot.normal_error, i], load(w, ROW.task.free, i))
    row[COLUMN.context] = (context_at - w[ROW.draws_from, i]) / CONTEXT_WIDTH
    arrangement = read(constants, CONTEXT.arrangement, int(w[ROW.context_at, i]))
    paper_clutches = arrangement.number == 0.0
    row[COLUMN.mode] = (
        mode_of(q.omega_a, q.omega_b)
        if paper_clutches
        else mode_of(q.omega_a, q.omega_b, arrangement)
    )
    row[COLUMN.kinetic_energy] = kinetic_energy(arm, q)
    write(row, COLUMN.volts, load(w, ROW.command, i))
    write(row, COLUMN.told, read(constants, CONTEXT.told, int(context_at)))


@outlined
def record_step(
    w: Records,
    i: int,
    telemetry: NDArray[np.float64],
    t: int,
    world: int,
    period: float,
    constants: Records,
) -> None:
    """Write the telemetry (T, N, K) of a control step."""
    row = telemetry[t, world]
    record_pose(w, i, row, w[ROW.step, i] * period, constants)
    q = load(w, ROW.motion, i)
    arrangement = read(constants, CONTEXT.arrangement, int(w[ROW.context_at, i]))
    paper_clutches = arrangement.number == 0.0
    slip = (
        slip_velocities(q.omega_a, q.omega_b)
        if paper_clutches
        else slip_velocities(q.omega_a, q.omega_b, arrangement)
    )
    torque = load(w, ROW.torque, i)
    write(row, COLUMN.acceleration, tip_acceleration(w, i, period))
    write(row, COLUMN.force, total_force(w, i))
    write(row, COLUMN.torque, torque)
    write(row, COLUMN.power, product(torque, slip))
    write(row, COLUMN.energy, load(w, ROW.energy, i))
    write(row, COLUMN.terms, load(w, ROW.terms, i))
    row[COLUMN.reward] = w[ROW.reward, i]
    row[COLUMN.is_success] = w[ROW.end.success, i]
    row[COLUMN.terminated] = w[ROW.end.terminated, i]


@inlined
def total_force(w: Records, i: int) -> Vector:
    """Return the whole force of the hand on the tip at a control instant [N]."""
    arm = load(w, ROW.machine.arm, i)
    q = load(w, ROW.motion, i)
    force = load(w, ROW.force, i)
    to = load(w, ROW.target.position, i)
    # the target's velocity is in ``force``
    pull = passive_force(arm, q, Target(to, Vector(0.0, 0.0)))
    return Vector(force.x + pull.x, force.y + pull.y)


# --- how a step ends ---


@inlined
def next_episode(w: Records, i: int, world: int, a: Arrays) -> None:
    """Start the next episode of a world's seed, and write its first observation and telemetry."""
    a.words[world, 1] += _ONE
    start_episode(w, i, a.words[world, 0], a.words[world, 1], a.config, a.constants)
    observe(w, i, a.config, a.constants)
    write_observation(w, i, a.obs, world, a.config, a.constants)
    if a.telemetry.shape[0] > 0:
        record_reset(w, i, a.telemetry, 0, world, a.constants)


@inlined
def end_step(w: Records, i: int, world: int, a: Arrays, ended: int) -> None:
    """Write what a control step of one world returns, and begin its next episode as ``ended`` says.

    The world was judged and observed. Its rows of the arrays are written; with SAME_STEP the final
    observations and the second layer of the telemetry get the last ones of a world that has ended.
    """
    records = a.telemetry.shape[0] > 0
    period = a.config[CONFIG.substep] * a.config[CONFIG.substeps]
    begins = ended == NEXT_STEP
    if was_alive(w, i):
        write_observation(w, i, a.obs, world, a.config, a.constants)
        a.rewards[world] = w[ROW.reward, i]
        for flag in range(FLAGS):
            a.flags[flag, world] = w[ROW.end[flag], i] != 0.0
        if records:
            record_step(w, i, a.telemetry, 0, world, period, a.constants)
        begins = w[ROW.alive, i] == 0.0 and ended == SAME_STEP
        if begins:
            write_observation(w, i, a.final_obs, world, a.config, a.constants)
            if records:
                record_step(w, i, a.telemetry, 1, world, period, a.constants)
    elif begins:
        a.rewards[world] = 0.0
        for flag in range(FLAGS):
            a.flags[flag, world] = False
    if begins:
        next_episode(w, i, world, a)
