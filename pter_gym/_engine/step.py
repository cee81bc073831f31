"""One control step of a world: functions on column ``i``, or the first ones, of rows ``ROW``.

``take_command`` takes an action, ``move_worlds`` moves hand and arm through the substeps, and
``conclude_step`` judges and observes the result. The last two functions of this file list the
stages in order. Each loads what it needs from a world, calls the physics or the task's rules, and
stores the result.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pter_gym._compiled.compiler import inlined, outlined
from pter_gym._compiled.philox import uniform4
from pter_gym._compiled.records import Records, entrywise, load, read, rows, store, width
from pter_gym._engine.world import (
    CONFIG,
    CONFIG_WIDTH,
    REFUSE,
    ROW,
    SAME_STEP,
    Drive,
    Flags,
    Target,
)
from pter_gym._physics.arm import (
    Linkage,
    Load,
    Motion,
    PerLink,
    Vector,
    directed,
    kinetic_energy,
    tip_position,
    tip_velocity,
)
from pter_gym._physics.clutch import PerClutch, faded, heated, product
from pter_gym._physics.friction import slip_velocities
from pter_gym._physics.scalars import clamp
from pter_gym._physics.step import (
    Energy,
    arrangement_from,
    control_step_on,
    count_nonzero,
    paper_clutches,
    torques_at,
)
from pter_gym.hands._model import advance_sines, intent_speed, renew_sines, sum_of_sines
from pter_gym.paths._projection import point_at, project
from pter_gym.tasks.path_following._actions import volts_of_each
from pter_gym.tasks.path_following._context import CONTEXT
from pter_gym.tasks.path_following._ending import ending, has_failed, is_astray
from pter_gym.tasks.path_following._observation import (
    BOUND,
    ENTRIES,
    Measurement,
    Reading,
    measurement_of,
    observation,
)
from pter_gym.tasks.path_following._pace import recent_pace
from pter_gym.tasks.path_following._position import (
    PathState,
    PathVector,
    path_state,
    to_path,
    to_world,
)
from pter_gym.tasks.path_following._reward import Outcome, reward_terms, total
from pter_gym.tasks.path_following._specification import MAX_DELAY

FORCES = rows(PathVector)
INSTANT = width(PathVector)
"""Numbers of a recording at a control instant."""

_NOISE_STREAM = np.uint64(0x4E4F495345)

_FIRST_SEEN = ROW.seen.cos_a
_FIRST_TOLD = CONTEXT.told.time_constant
_FIRST_INVERSE_SCALE = CONFIG.inverse_scale.cos_a


# --- the command ---


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


# --- the hand ---


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


# --- the motion ---


@inlined
def set_strengths(w: Records, i: int, period: float) -> None:
    """Find what friction drift and heat have made of the clutches' torques by now."""
    factor = clamp(1.0 + w[ROW.task.friction_drift, i] * period * w[ROW.step, i], 0.1, 10.0)
    store(w, ROW.strength, i, faded(load(w, ROW.heat, i), w[ROW.machine.fade, i], factor))


@inlined
def load_on(w: Records, i: int) -> Load:
    """Return what the hand of a world does to the arm."""
    force = load(w, ROW.force, i)
    to = load(w, ROW.target.position, i)
    return Load(force.x, force.y, 0.0, 0.0, to.x, to.y)


@inlined
def move_hands(w: Records, lanes: int, h: float, whole: bool, guides: bool) -> None:
    """Advance the hands of the first ``lanes`` worlds, and find their forces for the next kick."""
    for i in range(lanes):
        move_hand(w, i, h, whole, guides)
    for i in range(lanes):
        push_tip(w, i, guides)


@inlined
def no_arrangements(w: Records, lanes: int, constants: Records) -> None:
    """Leave the paper's clutches as they are."""


@inlined
def take_arrangements(w: Records, lanes: int, constants: Records) -> None:
    """Read the arrangement of the first ``lanes`` worlds."""
    for i in range(lanes):
        store(
            w, ROW.arrangement, i, read(constants, CONTEXT.arrangement, int(w[ROW.context_at, i]))
        )


# --- the judgement ---


@inlined
def locate(w: Records, i: int, constants: Records) -> None:
    """Project the tip onto the path."""
    x, y = tip_position(load(w, ROW.machine.arm, i), load(w, ROW.motion, i))
    path = load(w, ROW.task.path, i)
    foot = project(constants, int(path.first), int(path.arcs), int(w[ROW.foot.segment, i]), x, y)
    w[ROW.travel, i] = foot.arc_length - w[ROW.foot.arc_length, i]
    store(w, ROW.foot, i, foot)
    advance = foot.arc_length - w[ROW.reached, i]
    w[ROW.advance, i] = advance if advance > 0.0 else 0.0
    w[ROW.reached, i] = foot.arc_length if advance > 0.0 else w[ROW.reached, i]


@inlined
def present_state(w: Records, i: int) -> PathState:
    """Return the state of a world's tip relative to its path."""
    v_x, v_y = tip_velocity(load(w, ROW.machine.arm, i), load(w, ROW.motion, i))
    return path_state(load(w, ROW.foot, i), v_x, v_y, load(w, ROW.task.free, i))


@inlined
def tip_acceleration(w: Records, i: int, period: float) -> Vector:
    """Return the mean acceleration of the tip over a control step [m/s²]."""
    v_x, v_y = tip_velocity(load(w, ROW.machine.arm, i), load(w, ROW.motion, i))
    return Vector(
        (v_x - w[ROW.start_velocity.x, i]) / period, (v_y - w[ROW.start_velocity.y, i]) / period
    )


@inlined
def judge_step(w: Records, i: int, period: float, max_steps: float) -> None:
    """Count the step, and find the reward and whether the episode ends.

    A world that had ended stays so.
    """
    w[ROW.began, i] = w[ROW.alive, i]
    w[ROW.step, i] += 1.0
    task, q, step = load(w, ROW.task, i), load(w, ROW.motion, i), w[ROW.step, i]
    at, reached = present_state(w, i), w[ROW.reached, i]
    ratio = recent_pace(
        w[ROW.pace_ratio, i], w[ROW.travel, i], reached, step * period, period, task
    )
    end = ending(at, q, kinetic_energy(load(w, ROW.machine.arm, i), q), task)
    failed = has_failed(end)
    terminated = end.arrived | failed
    acceleration = tip_acceleration(w, i, period)
    outcome = Outcome(
        at=at,
        advance=w[ROW.advance, i],
        earned=w[ROW.earned, i],
        path_length=task.path.length,
        pace=task.pace,
        pace_ratio=ratio,
        acceleration=math.sqrt(acceleration.x * acceleration.x + acceleration.y * acceleration.y),
        volts=load(w, ROW.command, i),
        voltage_max=w[ROW.machine.voltage_max, i],
        failed=failed,
    )
    terms = reward_terms(task.weight, outcome, period)
    truncated = is_astray(at, terminated, task) | (step >= max_steps)
    w[ROW.pace_ratio, i] = ratio
    w[ROW.earned, i] += terms.tracking + terms.precision
    store(w, ROW.terms, i, terms)
    w[ROW.reward, i] = total(terms)
    w[ROW.alive, i] = 1.0 if (w[ROW.began, i] != 0.0) & (not terminated) & (not truncated) else 0.0
    flags = Flags(
        1.0 if terminated else 0.0, 1.0 if truncated else 0.0, 1.0 if end.arrived else 0.0
    )
    store(w, ROW.end, i, flags)


@inlined
def was_alive(w: Records, i: int) -> bool:
    """Return whether a world that ``judge_step`` has judged was alive before the step."""
    return w[ROW.began, i] != 0.0


# --- the sensors ---


@inlined
def gaussians(seed: np.uint64, episode: np.uint64, draw: int) -> tuple[float, float, float, float]:
    """Return four independent standard normal numbers (Box and Muller)."""
    u0, u1, u2, u3 = uniform4(seed, _NOISE_STREAM, np.uint64(draw), episode)
    r = math.sqrt(-2.0 * math.log(1.0 - u0))
    s = math.sqrt(-2.0 * math.log(1.0 - u2))
    return (
        r * math.cos(2.0 * np.pi * u1),
        r * math.sin(2.0 * np.pi * u1),
        s * math.cos(2.0 * np.pi * u3),
        s * math.sin(2.0 * np.pi * u3),
    )


@entrywise
@inlined
def quantised(value: float, resolution: float) -> float:
    """Return the nearest multiple of a resolution, or the value where there is none."""
    return resolution * math.floor(value / resolution + 0.5) if resolution > 0.0 else value


@entrywise
@inlined
def noisy(value: float, deviation: float, draw: float) -> float:
    """Return a value with noise of a standard deviation, from a standard normal draw."""
    return value + deviation * draw


@entrywise
@inlined
def coasted(theta: float, omega: float, time: float) -> float:
    """Return an angle a time ago at the present angular velocity."""
    return theta - omega * time


@entrywise
@inlined
def measured_velocity(
    theta: float, before: float, omega: float, period: float, differs: bool
) -> float:
    """Return what a velocity sensor reads, or the mean velocity between two angle readings."""
    return (theta - before) / period if differs else omega


@outlined
def take_first_readings(
    w: Records, i: int, seed: np.uint64, episode: np.uint64, period: float
) -> None:
    """Read the sensors where an episode begins, as if the arm had coasted there."""
    q, resolution = load(w, ROW.motion, i), w[ROW.task.sensing.angle_resolution, i]
    before = coasted(PerLink(q.theta_a, q.theta_b), PerLink(q.omega_a, q.omega_b), period)
    for _ in range(1 + MAX_DELAY):
        store(w, ROW.readings.now.theta, i, quantised(before, resolution))
        take_reading(w, i, seed, episode, period)


@outlined
def take_reading(w: Records, i: int, seed: np.uint64, episode: np.uint64, period: float) -> None:
    """Read the sensors of a world, and keep the readings before."""
    for age in range(MAX_DELAY, 0, -1):
        store(w, ROW.readings[age], i, load(w, ROW.readings[age - 1], i))
    step = int(w[ROW.step, i])
    sensing = load(w, ROW.task.sensing, i)
    q = load(w, ROW.motion, i)
    g0, g1, g2, g3 = gaussians(seed, episode, 2 * step)
    n0, n1, n2, n3 = gaussians(seed, episode, 2 * step + 1)
    theta = quantised(PerLink(q.theta_a, q.theta_b), sensing.angle_resolution)
    before, differs = load(w, ROW.readings.one_ago.theta, i), sensing.encoder_velocity != 0.0
    omega = measured_velocity(theta, before, PerLink(q.omega_a, q.omega_b), period, differs)
    reading = Reading(
        theta=theta,
        omega=noisy(omega, sensing.velocity_noise, PerLink(g0, g1)),
        torque=noisy(load(w, ROW.torque, i), sensing.torque_noise, PerClutch(n0, n1, n2, n3)),
        force=noisy(hand_force(w, i), sensing.force_noise, PathVector(g2, g3)),
    )
    store(w, ROW.readings.now, i, reading)


@inlined
def store_observation(w: Records, i: int, measured: Measurement) -> None:
    """Store the present observation that a measurement gives, in SI units."""
    seen = observation(
        measured,
        load(w, ROW.machine.arm, i),
        load(w, ROW.task.free, i),
        w[ROW.task.path.length, i],
        w[ROW.task.pace, i],
        load(w, ROW.command, i),
    )
    store(w, ROW.seen, i, seen)


@inlined
def observe_world(w: Records, i: int) -> None:
    """Find the present observation as ideal sensors see it."""
    store_observation(
        w,
        i,
        Measurement(
            load(w, ROW.motion, i), load(w, ROW.foot, i), load(w, ROW.torque, i), hand_force(w, i)
        ),
    )


@outlined
def observe_reading(w: Records, i: int, constants: Records) -> None:
    """Find the present observation from what the sensors read, now or earlier."""
    reading = load(w, ROW.readings[int(w[ROW.task.sensing.delay, i])], i)
    arm, path = load(w, ROW.machine.arm, i), load(w, ROW.task.path, i)
    segment = int(w[ROW.foot.segment, i])
    first, count = int(path.first), int(path.arcs)
    store_observation(w, i, measurement_of(reading, arm, constants, first, count, segment))


@inlined
def scale_entries(w: Records, first: int, last: int, config: Records) -> None:
    """Bring the observations in columns ``first`` … ``last`` − 1 to their scales, within ±BOUND.

    Each passes here once a control step, and once at a reset.
    """
    for k in range(ENTRIES):
        inverse_scale = config[_FIRST_INVERSE_SCALE + k]
        for i in range(first, last):
            w[_FIRST_SEEN + k, i] = clamp(w[_FIRST_SEEN + k, i] * inverse_scale, -BOUND, BOUND)


@inlined
def observe(w: Records, i: int, config: Records, constants: Records) -> None:
    """Find the present observation of a world with any sensors."""
    if w[ROW.task.sensing.is_ideal, i] != 0.0:
        observe_world(w, i)
    else:
        observe_reading(w, i, constants)
    scale_entries(w, i, i + 1, config)


@inlined
def write_observation(
    w: Records, i: int, obs: Records, world: int, config: Records, constants: Records
) -> None:
    """Write the observation, and the context if that is observed, to a row of ``obs``."""
    plain = int(config[CONFIG.entries])
    for k in range(ENTRIES):  # not over the entries: compilers unroll what they can count
        if k < plain:
            obs[world, k] = w[_FIRST_SEEN + k, i]
    told = int(w[ROW.context_at, i]) + _FIRST_TOLD - plain
    for k in range(plain, obs.shape[1]):
        obs[world, k] = clamp(constants[told + k] / config[CONFIG_WIDTH + k], -BOUND, BOUND)


# --- the stages of a control step, in their order ---


def _mover(arrangement_at: Any) -> Any:
    """Return what moves worlds with the clutches of ``arrangement_at``; see ``substep_on``."""
    control_step = control_step_on(ROW, load_on, arrangement_at, move_hands)

    @inlined
    def heat_clutches(w: Records, i: int, period: float) -> None:
        """Add the heat of a control step, from torques and slip velocities at its end."""
        q, heat, cooling = load(w, ROW.motion, i), load(w, ROW.heat, i), w[ROW.machine.cooling, i]
        slip = slip_velocities(q.omega_a, q.omega_b, arrangement_at(w, i))
        store(w, ROW.heat, i, heated(heat, product(load(w, ROW.torque, i), slip), period, cooling))

    @inlined
    def sense_torques(w: Records, i: int) -> None:
        """Find the torques [N·m] that the clutches generate now."""
        q, machine, torques = (
            load(w, ROW.motion, i),
            load(w, ROW.machine, i),
            load(w, ROW.torques, i),
        )
        store(
            w, ROW.torque, i, torques_at(q, machine, load_on(w, i), torques, arrangement_at(w, i))
        )

    @inlined
    def move(w: Records, lanes: int, config: Records, guides: bool) -> None:
        """Move the worlds in the first ``lanes`` columns through a control step.

        ``guides`` says that hands may have more than a push and sines, and that clutches may fade.
        """
        h, count = config[CONFIG.substep], int(config[CONFIG.substeps])
        for i in range(lanes):
            set_strengths(w, i, h * count)
        control_step(
            w, lanes, h, count, count_nonzero(w, ROW.machine.voltage_decay.rise, lanes) > 0, guides
        )
        for i in range(lanes):
            sense_torques(w, i)
            store(w, ROW.sines, i, renew_sines(load(w, ROW.sines, i)))
        if guides:
            for i in range(lanes):
                if w[ROW.machine.fade, i] > 0.0:
                    heat_clutches(w, i, h * count)

    return move


move_worlds, move_declared = _mover(paper_clutches), _mover(arrangement_from(ROW))
"""What moves worlds with the paper's clutches, and with others."""


@inlined
def conclude_step(
    w: Records,
    width: int,
    lanes: int,
    words: NDArray[np.uint64],
    first: int,
    config: Records,
    constants: Records,
    with_extras: bool,
) -> None:
    """Find the result of a control step: place, reward, end, the hand's next plan, observation.

    Parameters
    ----------
    w, width, lanes
        The first ``width`` columns are looked at; the first ``lanes`` of them are worlds.
    words, first
        Seed and episode count of all worlds (N, 2), and the number of the world in the first
        column.
    with_extras
        Whether there may be hands that plan or sensors that are not ideal.
    """
    period = config[CONFIG.substep] * config[CONFIG.substeps]
    for i in range(width):
        locate(w, i, constants)
    for i in range(width):
        judge_step(w, i, period, config[CONFIG.max_steps])
    if with_extras:
        for i in range(lanes):
            if plans(w, i):
                plan_hand(w, i, constants, period, config[CONFIG.substeps])
    for i in range(width):
        observe_world(w, i)
    if with_extras:
        for i in range(lanes):
            if w[ROW.task.sensing.is_ideal, i] == 0.0:
                take_reading(w, i, words[first + i, 0], words[first + i, 1], period)
                observe_reading(w, i, constants)
    scale_entries(w, 0, width, config)
