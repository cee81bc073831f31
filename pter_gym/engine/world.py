"""One world's control step, from voltages to observation and reward, as scalar functions.

Each works on column ``i`` of an array ``w`` whose rows are named here. The kernels for CPU and GPU bring worlds into
such an array, call these functions in the same order and write the rows that change back.
"""

import math
from typing import Any

import numpy as np

from pter_gym.compiled.compiler import device, outlined
from pter_gym.compiled.philox import uniform4
from pter_gym.hands import SINES, advance_sines, intent_speed, renew_sines, sum_of_sines, unit_vector
from pter_gym.paths.projection import point_at, project
from pter_gym.physics.arm import Load, Motion, advance_position, kinetic_energy, tip_position, tip_velocity
from pter_gym.physics.clutch import PerClutch, relax, relax_torques, scaled, steady_torques
from pter_gym.physics.friction import between, generated_torques, mode_of, slip_velocities
from pter_gym.physics.model import (
    BREAKAWAY,
    DAMPING,
    LAGGED_VOLTS,
    SCALE,
    SLIP_THRESHOLD,
    STATE_ROWS,
    STIFFNESS,
    TORQUE_DECAY,
    VOLTAGE_DECAY,
    VOLTAGE_MAX,
    breakaway_curve,
    dynamic_curve,
    linkage,
    load_four,
    load_motion,
    load_torques,
    store_four,
    store_motion,
    store_torques,
)
from pter_gym.physics.step import Impact, clutch_load, energy_terms, first_velocity, free_motion, second_velocity
from pter_gym.tasks.path_following import (
    AMPLITUDE,
    ANGLE_RESOLUTION,
    CONTEXT_ROWS,
    DELAY,
    ENTRIES,
    ERROR_MAX,
    FORCE_NOISE,
    FRICTION_DRIFT,
    INTENT_LEAD,
    INTENT_RISE,
    INTENT_SPEED,
    MAX_DELAY,
    PACE,
    PARAM_ROWS,
    PATH_COUNT,
    PATH_FIRST,
    PATH_LENGTH,
    PHASE,
    PUSH,
    RANDOM_PHASES,
    RECORD_COUNT,
    RECORD_FIRST,
    SENSES_IDEALLY,
    SINGULARITY_MARGIN,
    START_OFFSET,
    T_ACCELERATION,
    T_ARC_LENGTH,
    T_CONTEXT,
    T_ENERGY,
    T_ERROR,
    T_FORCE,
    T_KINETIC,
    T_MODE,
    T_POWER,
    T_REACHED,
    T_REWARD,
    T_SUCCESS,
    T_TERMINATED,
    T_THETA,
    T_TIME,
    T_TIP,
    T_TOLD,
    T_TORQUE,
    T_VELOCITY,
    T_VOLTS,
    TOLD,
    TORQUE_NOISE,
    TURN,
    VELOCITY_NOISE,
    WEIGHT_FAILURE,
    Situation,
    left_workspace,
    motion_at,
    observe,
    reached_end,
    reward_terms,
    situation,
)

LANES = 64
"""Largest number of worlds in a block."""

COMMAND = STATE_ROWS
TORQUE = COMMAND + 4
SINE = TORQUE + 4
STEP = SINE + 2 * SINES
ALIVE = STEP + 1
ARC_LENGTH = ALIVE + 1
ERROR = ARC_LENGTH + 1
HEADING = ERROR + 1
CURVATURE = HEADING + 2
SEGMENT = CURVATURE + 1
REACHED = SEGMENT + 1
CONTEXT_AT = REACHED + 1
DRAWS_FROM = CONTEXT_AT + 1
DRAWS = DRAWS_FROM + 1
BASIC_ROWS = DRAWS + 1
"""Rows that every world stores.

Physical state, last command, last generated torques, unit vectors of the sines, step count, alive flag; projection of
the tip on the path (arc length, normal error, heading, curvature, number of the arc, largest arc length); where its
constants stand, and from where and how many it draws.
"""

DRIVE = BASIC_ROWS
TARGET = DRIVE + 4
INTENT = TARGET + 4
READING = INTENT + 1
READINGS = 10
CHANGING_ROWS = READING + READINGS * (1 + MAX_DELAY)
"""Rows of a world that change.

Those behind ``BASIC_ROWS`` are stored where a hand or sensors need them: recorded forces along and across and their
change in a substep, the point that the hand means to be at and its velocity, the intent's arc length, and what the
sensors read now and earlier (angles, angular velocities, generated torques, force along and across).
"""

PARAM = CHANGING_ROWS
"""First row of a world's constants."""

WORLD_ROWS = PARAM + PARAM_ROWS
_STEADY = WORLD_ROWS
_IMPACT = _STEADY + 8
_OMEGA = _IMPACT + 9
_LIMIT = _OMEGA + 2
CROSSING = _LIMIT + 4
_ENERGY = CROSSING + 1
_FORCE = _ENERGY + 4
_START_VELOCITY = _FORCE + 2
_BEGAN = _START_VELOCITY + 2
_REWARD = _BEGAN + 1
_END = _REWARD + 6
_SEEN = _END + 3
SCRATCH_ROWS = _SEEN + ENTRIES

REFUSE, SKIP, NEXT_STEP, SAME_STEP = range(4)
"""What to do with a world that has ended: refuse to step, leave it out, reset it at the next step or at once.

With SAME_STEP no world stays ended, so that one which is not alive was never reset and is refused.
"""

LOW, HIGH, SLACK, SUBSTEP, SUBSTEPS, LIMIT, HAS_LAW, PLAIN_ENTRIES = range(8)
"""Entries of a kernel's configuration.

Bounds of an action and how far beyond them it is clipped, the substep [s], the substeps in a control step, the time
limit in control steps, 1 for voltages from a law or 0 for given ones, and the entries of an observation before those of
the context.
"""

INVERSE_SCALES = 8
"""Where the inverse scales of the observation, as many as it may have entries, begin in the configuration."""

SCALES = INVERSE_SCALES + ENTRIES
"""Where the scales of the observation begin in the configuration; a law's gains follow them."""

TERMINATED, TRUNCATED, SUCCESS = range(3)
"""Rows of the flags (FLAGS, N)."""

FLAGS = 3

_NOISE_STREAM = np.uint64(0x4E4F495345)
_RESET_STREAM = np.uint64(0x5245534554)
_FIRST_DRAWS = np.uint64(0)
_SECOND_DRAWS = np.uint64(1)
_ONE = np.uint64(1)


@device
def clipped(volts: float, voltage_max: float) -> float:
    """Return the voltage [V] that reaches the clutch: a float32 action within the bounds."""
    return between(float(np.float32(volts)), 0.0, voltage_max)


@device
def clipped_volts(volts: PerClutch, voltage_max: float) -> PerClutch:
    """Return the voltages [V] that reach the clutches."""
    return PerClutch(
        clipped(volts.x1, voltage_max),
        clipped(volts.x2, voltage_max),
        clipped(volts.x3, voltage_max),
        clipped(volts.x4, voltage_max),
    )


@device
def is_refused(alive: float, actions: Any, low: float, high: float, ended: int, world: int) -> bool:
    """Tell whether a world has ended and may not, or its action is not a number within the bounds."""
    refused = False
    for clutch in range(4):
        refused |= not ((actions[world, clutch] >= low) & (actions[world, clutch] <= high))
    return ((ended == REFUSE) | (ended == SAME_STEP)) if alive == 0.0 else refused


@device
def given_volts(actions: Any, world: int, low: float, volts_per_unit: float) -> PerClutch:
    """Return the voltages [V] of an action."""
    return PerClutch(
        (actions[world, 0] - low) * volts_per_unit,
        (actions[world, 1] - low) * volts_per_unit,
        (actions[world, 2] - low) * volts_per_unit,
        (actions[world, 3] - low) * volts_per_unit,
    )


@device
def load_impact(w: Any, i: int) -> Impact:
    """Read the velocity problem of the last substep."""
    return Impact(
        w[_IMPACT, i],
        w[_IMPACT + 1, i],
        w[_IMPACT + 2, i],
        w[_IMPACT + 3, i],
        w[_IMPACT + 4, i],
        w[_IMPACT + 5, i],
        w[_IMPACT + 6, i],
        w[_IMPACT + 7, i],
        w[_IMPACT + 8, i],
    )


@device
def store_impact(w: Any, i: int, impact: Impact) -> None:
    """Write the velocity problem of a substep."""
    w[_IMPACT, i] = impact.m11
    w[_IMPACT + 1, i] = impact.m12
    w[_IMPACT + 2, i] = impact.m22
    w[_IMPACT + 3, i] = impact.p_a
    w[_IMPACT + 4, i] = impact.p_b
    w[_IMPACT + 5, i] = impact.hand_a
    w[_IMPACT + 6, i] = impact.hand_b
    w[_IMPACT + 7, i] = impact.fictitious_a
    w[_IMPACT + 8, i] = impact.fictitious_b


@device
def take_command(w: Any, i: int, volts: PerClutch) -> None:
    """Take the command of a control step, note the tip's velocity and clear the step's energies."""
    store_four(w, COMMAND, i, clipped_volts(volts, w[PARAM + VOLTAGE_MAX, i]))
    w[_START_VELOCITY, i], w[_START_VELOCITY + 1, i] = tip_velocity(linkage(w, PARAM, i), load_motion(w, i))
    for term in range(4):
        w[_ENERGY + term, i] = 0.0


@device
def aim_torques(w: Any, i: int, period: float) -> None:
    """Find the torques that the clutches tend to, behind a lag of the voltage if there is one."""
    lagged = relax(load_four(w, LAGGED_VOLTS, i), load_four(w, COMMAND, i), w[PARAM + VOLTAGE_DECAY, i])
    store_four(w, LAGGED_VOLTS, i, lagged)
    steady = steady_torques(breakaway_curve(w, PARAM, i), dynamic_curve(w, PARAM, i), lagged)
    drifted = between(1.0 + w[PARAM + FRICTION_DRIFT, i] * period * w[STEP, i], 0.1, 10.0)
    store_torques(w, _STEADY, i, scaled(steady, load_four(w, PARAM + SCALE, i), drifted))


@device
def push_tip(w: Any, i: int) -> None:
    """Find the hand's push and disturbance [N], and move its sines on by a substep.

    The directions along and across the path are those at the control instant.
    """
    along = w[PARAM + PUSH, i]
    across = sum_of_sines(w, SINE, PARAM + AMPLITUDE, i)
    advance_sines(w, SINE, PARAM + TURN, i)
    cos = w[HEADING, i]
    sin = w[HEADING + 1, i]
    w[_FORCE, i] = along * cos - across * sin
    w[_FORCE + 1, i] = along * sin + across * cos


@device
def guide_tip(w: Any, i: int, h: float) -> None:
    """Add recorded forces and the pull of the damper towards a moving target [N], and move both on by a substep."""
    along = w[DRIVE, i]
    across = w[DRIVE + 1, i]
    w[DRIVE, i] += w[DRIVE + 2, i]
    w[DRIVE + 1, i] += w[DRIVE + 3, i]
    cos = w[HEADING, i]
    sin = w[HEADING + 1, i]
    damping = w[PARAM + DAMPING, i]
    w[_FORCE, i] += along * cos - across * sin + damping * w[TARGET + 2, i]
    w[_FORCE + 1, i] += along * sin + across * cos + damping * w[TARGET + 3, i]
    w[TARGET, i] += h * w[TARGET + 2, i]
    w[TARGET + 1, i] += h * w[TARGET + 3, i]


@device
def find_velocity(w: Any, i: int, h: float) -> None:
    """Advance the torques' lag and find the velocities after friction."""
    torques = relax_torques(load_torques(w, BREAKAWAY, i), load_torques(w, _STEADY, i), w[PARAM + TORQUE_DECAY, i])
    store_torques(w, BREAKAWAY, i, torques)
    q = load_motion(w, i)
    load = Load(w[_FORCE, i], w[_FORCE + 1, i], 0.0, 0.0, w[TARGET, i], w[TARGET + 1, i])
    impact = free_motion(q, linkage(w, PARAM, i), load, h)
    omega_a, omega_b, limit, crossing = first_velocity(q, impact, torques, w[PARAM + SLIP_THRESHOLD, i], h)
    store_impact(w, i, impact)
    w[_OMEGA, i] = omega_a
    w[_OMEGA + 1, i] = omega_b
    store_four(w, _LIMIT, i, limit)
    w[CROSSING, i] = 1.0 if crossing else 0.0


@outlined
def catch_crossing(w: Any, i: int, h: float) -> None:
    """Apply the crossing rule, if a slip velocity has jumped over the stick band."""
    if w[CROSSING, i] != 0.0:
        w[_OMEGA, i], w[_OMEGA + 1, i], limit = second_velocity(
            load_motion(w, i),
            load_impact(w, i),
            load_torques(w, BREAKAWAY, i),
            w[PARAM + SLIP_THRESHOLD, i],
            h,
            w[_OMEGA, i],
            w[_OMEGA + 1, i],
            load_four(w, _LIMIT, i),
        )
        store_four(w, _LIMIT, i, limit)


@device
def move_arm(w: Any, i: int, h: float) -> None:
    """Advance the position and add up the energies."""
    before = load_motion(w, i)
    arm = linkage(w, PARAM, i)
    after = advance_position(before, w[_OMEGA, i], w[_OMEGA + 1, i], h)
    energy = energy_terms(before, after, arm, load_impact(w, i), load_four(w, _LIMIT, i), h)
    store_motion(w, i, after)
    w[_ENERGY, i] += energy.hand_work
    w[_ENERGY + 1, i] += energy.dissipated
    w[_ENERGY + 2, i] += energy.numerical_loss
    w[_ENERGY + 3, i] += energy.residual


@outlined
def take_context(w: Any, i: int, constants: Any) -> None:
    """Read the constants of a world, where the world says that they stand."""
    first = int(w[CONTEXT_AT, i])
    for row in range(PARAM_ROWS):
        w[PARAM + row, i] = constants[first + row]


@device
def locate(w: Any, i: int, constants: Any) -> None:
    """Project the tip onto the path."""
    x, y = tip_position(linkage(w, PARAM, i), load_motion(w, i))
    foot = project(constants, int(w[PARAM + PATH_FIRST, i]), int(w[PARAM + PATH_COUNT, i]), int(w[SEGMENT, i]), x, y)
    w[ARC_LENGTH, i] = foot.arc_length
    w[ERROR, i] = foot.normal_error
    w[HEADING, i] = foot.heading_cos
    w[HEADING + 1, i] = foot.heading_sin
    w[CURVATURE, i] = foot.curvature
    w[SEGMENT, i] = foot.segment
    w[REACHED, i] = foot.arc_length if foot.arc_length > w[REACHED, i] else w[REACHED, i]


@device
def situated(w: Any, i: int) -> Situation:
    """Return where a world is with respect to its path."""
    v_x, v_y = tip_velocity(linkage(w, PARAM, i), load_motion(w, i))
    return situation(w[ARC_LENGTH, i], w[ERROR, i], w[HEADING, i], w[HEADING + 1, i], w[CURVATURE, i], v_x, v_y)


@device
def plans(w: Any, i: int) -> bool:
    """Tell whether the hand of a world has a recording or an intent."""
    return (w[PARAM + RECORD_COUNT, i] > 0.0) | (w[PARAM + INTENT_SPEED, i] > 0.0)


@outlined
def plan_hand(w: Any, i: int, constants: Any, period: float, count: float) -> None:
    """Say what the hand does by itself in the next control step of ``count`` substeps."""
    if w[PARAM + RECORD_COUNT, i] > 0.0:
        last = int(w[PARAM + RECORD_COUNT, i]) - 1
        now = int(w[STEP, i])
        begin = int(w[PARAM + RECORD_FIRST, i]) + 2 * (now if now < last else last)
        end = begin + (2 if now < last else 0)
        for part in range(2):
            w[DRIVE + part, i] = constants[begin + part]
            w[DRIVE + 2 + part, i] = (constants[end + part] - constants[begin + part]) / count
    speed = w[PARAM + INTENT_SPEED, i]
    if speed > 0.0:
        at = w[INTENT, i]
        moved = at + period * intent_speed(period * (w[STEP, i] + 0.5), w[PARAM + INTENT_RISE, i], speed)
        leash = w[ARC_LENGTH, i] + w[PARAM + INTENT_LEAD, i]
        moved = moved if moved < leash else leash
        moved = moved if moved > at else at
        first = int(w[PARAM + PATH_FIRST, i])
        arcs = int(w[PARAM + PATH_COUNT, i])
        x, y = point_at(constants, first, arcs, at)
        to_x, to_y = point_at(constants, first, arcs, moved)
        w[INTENT, i] = moved
        w[TARGET, i] = x
        w[TARGET + 1, i] = y
        w[TARGET + 2, i] = (to_x - x) / period
        w[TARGET + 3, i] = (to_y - y) / period


@device
def hand_force(w: Any, i: int) -> tuple[float, float]:
    """Return the force of the hand on the tip along and across the path at a control instant [N]."""
    arm = linkage(w, PARAM, i)
    q = load_motion(w, i)
    x, y = tip_position(arm, q)
    v_x, v_y = tip_velocity(arm, q)
    stiffness = w[PARAM + STIFFNESS, i]
    damping = w[PARAM + DAMPING, i]
    pull_x = stiffness * (w[TARGET, i] - x) + damping * (w[TARGET + 2, i] - v_x)
    pull_y = stiffness * (w[TARGET + 1, i] - y) + damping * (w[TARGET + 3, i] - v_y)
    cos = w[HEADING, i]
    sin = w[HEADING + 1, i]
    return (
        w[PARAM + PUSH, i] + w[DRIVE, i] + (pull_x * cos + pull_y * sin),
        sum_of_sines(w, SINE, PARAM + AMPLITUDE, i) + w[DRIVE + 1, i] + (pull_y * cos - pull_x * sin),
    )


@outlined
def start_episode(
    w: Any, i: int, seed: np.uint64, episode: np.uint64, constants: Any, period: float, count: float
) -> None:
    """Start an episode: the arm at rest at the start of the path, clutches released, draws from seed and episode."""
    for row in range(CONTEXT_AT):
        w[row, i] = 0.0
    for row in range(BASIC_ROWS, CHANGING_ROWS):
        w[row, i] = 0.0
    u0, u1, u2, u3 = uniform4(seed, _RESET_STREAM, _FIRST_DRAWS, episode)
    v0, v1, v2, _ = uniform4(seed, _RESET_STREAM, _SECOND_DRAWS, episode)
    w[CONTEXT_AT, i] = w[DRAWS_FROM, i] + CONTEXT_ROWS * math.floor(v2 * w[DRAWS, i])
    take_context(w, i, constants)
    draws = (u1, u2, u3, v0, v1)
    for k in range(SINES):
        angle = 2.0 * np.pi * draws[k] if w[PARAM + RANDOM_PHASES, i] != 0.0 else w[PARAM + PHASE + k, i]
        w[SINE + 2 * k, i], w[SINE + 2 * k + 1, i] = unit_vector(angle)
    first = int(w[PARAM + PATH_FIRST, i])
    offset = w[PARAM + START_OFFSET, i] * (2.0 * u0 - 1.0)
    x = constants[first] - offset * constants[first + 3]
    y = constants[first + 1] + offset * constants[first + 2]
    store_motion(w, i, motion_at(linkage(w, PARAM, i), x, y))
    w[ALIVE, i] = 1.0
    locate(w, i, constants)
    if plans(w, i):
        plan_hand(w, i, constants, period, count)
    if w[PARAM + SENSES_IDEALLY, i] == 0.0:
        for _ in range(1 + MAX_DELAY):
            take_reading(w, i, seed, episode)


@device
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


@outlined
def take_reading(w: Any, i: int, seed: np.uint64, episode: np.uint64) -> None:
    """Let the sensors of a world read, and keep what they read before."""
    for age in range(MAX_DELAY, 0, -1):
        for entry in range(READINGS):
            w[READING + READINGS * age + entry, i] = w[READING + READINGS * (age - 1) + entry, i]
    step = int(w[STEP, i])
    for angle in range(2):
        w[READING + angle, i] = quantised(w[angle, i], w[PARAM + ANGLE_RESOLUTION, i])
    g0, g1, g2, g3 = gaussians(seed, episode, 2 * step)
    n0, n1, n2, n3 = gaussians(seed, episode, 2 * step + 1)
    along, across = hand_force(w, i)
    w[READING + 2, i] = w[2, i] + w[PARAM + VELOCITY_NOISE, i] * g0
    w[READING + 3, i] = w[3, i] + w[PARAM + VELOCITY_NOISE, i] * g1
    w[READING + 4, i] = w[TORQUE, i] + w[PARAM + TORQUE_NOISE, i] * n0
    w[READING + 5, i] = w[TORQUE + 1, i] + w[PARAM + TORQUE_NOISE, i] * n1
    w[READING + 6, i] = w[TORQUE + 2, i] + w[PARAM + TORQUE_NOISE, i] * n2
    w[READING + 7, i] = w[TORQUE + 3, i] + w[PARAM + TORQUE_NOISE, i] * n3
    w[READING + 8, i] = along + w[PARAM + FORCE_NOISE, i] * g2
    w[READING + 9, i] = across + w[PARAM + FORCE_NOISE, i] * g3


@device
def quantised(value: float, resolution: float) -> float:
    """Return the nearest multiple of a resolution, or the value where there is none."""
    return resolution * math.floor(value / resolution + 0.5) if resolution > 0.0 else value


@device
def observe_world(w: Any, i: int, config: Any) -> None:
    """Find the present observation as ideal sensors see it."""
    along, across = hand_force(w, i)
    observe(
        w,
        _SEEN,
        i,
        load_motion(w, i),
        situated(w, i),
        w[PARAM + PATH_LENGTH, i],
        w[PARAM + PACE, i],
        load_four(w, COMMAND, i),
        load_four(w, TORQUE, i),
        along,
        across,
    )
    scale_entries(w, i, config)


@outlined
def observe_reading(w: Any, i: int, config: Any, constants: Any) -> None:
    """Find the present observation from what the sensors read, now or earlier."""
    row = READING + READINGS * int(w[PARAM + DELAY, i])
    cos_a, sin_a = unit_vector(w[row, i])
    cos_b, sin_b = unit_vector(w[row + 1, i])
    q = Motion(w[row, i], w[row + 1, i], w[row + 2, i], w[row + 3, i], cos_a, sin_a, cos_b, sin_b)
    arm = linkage(w, PARAM, i)
    x, y = tip_position(arm, q)
    v_x, v_y = tip_velocity(arm, q)
    foot = project(constants, int(w[PARAM + PATH_FIRST, i]), int(w[PARAM + PATH_COUNT, i]), int(w[SEGMENT, i]), x, y)
    observe(
        w,
        _SEEN,
        i,
        q,
        situation(foot.arc_length, foot.normal_error, foot.heading_cos, foot.heading_sin, foot.curvature, v_x, v_y),
        w[PARAM + PATH_LENGTH, i],
        w[PARAM + PACE, i],
        load_four(w, COMMAND, i),
        load_four(w, row + 4, i),
        w[row + 8, i],
        w[row + 9, i],
    )
    scale_entries(w, i, config)


@device
def scale_entries(w: Any, i: int, config: Any) -> None:
    """Bring the entries of an observation from their units into [−1, 1]."""
    for k in range(ENTRIES):
        w[_SEEN + k, i] = between(w[_SEEN + k, i] * config[INVERSE_SCALES + k], -1.0, 1.0)


@device
def write_observation(w: Any, i: int, obs: Any, world: int, config: Any, constants: Any) -> None:
    """Write what was observed, and what is told of the context, to a row of the observations (N, entries)."""
    plain = int(config[PLAIN_ENTRIES])
    for k in range(ENTRIES):  # not over the entries: compilers unroll what they can count
        if k < plain:
            obs[world, k] = w[_SEEN + k, i]
    told = int(w[CONTEXT_AT, i]) + PARAM_ROWS - plain
    for k in range(plain, obs.shape[1]):
        obs[world, k] = between(constants[told + k] / config[SCALES + k], -1.0, 1.0)


@device
def see(w: Any, i: int, config: Any, constants: Any) -> None:
    """Find the present observation of a world with any sensors."""
    if w[PARAM + SENSES_IDEALLY, i] != 0.0:
        observe_world(w, i, config)
    else:
        observe_reading(w, i, config, constants)


@outlined
def record_reset(w: Any, i: int, telemetry: Any, t: int, world: int, constants: Any) -> None:
    """Write the telemetry (T, N, K) of a world that is not stepping: its pose, the rest zero."""
    for column in range(telemetry.shape[2]):
        telemetry[t, world, column] = 0.0
    record_pose(w, i, telemetry, t, world, 0.0, constants)


@device
def record_pose(w: Any, i: int, telemetry: Any, t: int, world: int, time: float, constants: Any) -> None:
    """Write what the telemetry (T, N, K) says of the pose, of machine and task."""
    arm = linkage(w, PARAM, i)
    q = load_motion(w, i)
    x, y = tip_position(arm, q)
    v_x, v_y = tip_velocity(arm, q)
    telemetry[t, world, T_TIME] = time
    telemetry[t, world, T_THETA] = q.theta_a
    telemetry[t, world, T_THETA + 1] = q.theta_b
    telemetry[t, world, T_TIP] = x
    telemetry[t, world, T_TIP + 1] = y
    telemetry[t, world, T_VELOCITY] = v_x
    telemetry[t, world, T_VELOCITY + 1] = v_y
    telemetry[t, world, T_ARC_LENGTH] = w[ARC_LENGTH, i]
    telemetry[t, world, T_REACHED] = w[REACHED, i]
    telemetry[t, world, T_ERROR] = w[ERROR, i]
    telemetry[t, world, T_CONTEXT] = (w[CONTEXT_AT, i] - w[DRAWS_FROM, i]) / CONTEXT_ROWS
    telemetry[t, world, T_MODE] = mode_of(q.omega_a, q.omega_b)
    telemetry[t, world, T_KINETIC] = kinetic_energy(arm, q)
    for clutch in range(4):
        telemetry[t, world, T_VOLTS + clutch] = w[COMMAND + clutch, i]
    told = int(w[CONTEXT_AT, i]) + PARAM_ROWS
    for entry in range(TOLD):
        telemetry[t, world, T_TOLD + entry] = constants[told + entry]


@device
def sense_torques(w: Any, i: int, h: float) -> None:
    """Find the generated torques [N·m] of the last substep, and bring the sines' vectors back to unit length."""
    q = load_motion(w, i)
    load_a, load_b = clutch_load(load_impact(w, i), q.omega_a, q.omega_b, h)
    store_four(w, TORQUE, i, generated_torques(q.omega_a, q.omega_b, load_a, load_b, load_four(w, _LIMIT, i)))
    renew_sines(w, SINE, i)


@device
def tip_acceleration(w: Any, i: int, period: float) -> tuple[float, float]:
    """Return the mean acceleration of the tip over a control step [m/s²]."""
    v_x, v_y = tip_velocity(linkage(w, PARAM, i), load_motion(w, i))
    return (v_x - w[_START_VELOCITY, i]) / period, (v_y - w[_START_VELOCITY + 1, i]) / period


@device
def judge_step(w: Any, i: int, period: float, limit: float) -> None:
    """Count the step, and find the reward and whether the episode ends. A world that had ended stays so."""
    began = w[ALIVE, i] != 0.0
    w[_BEGAN, i] = w[ALIVE, i]
    w[STEP, i] += 1.0
    at = situated(w, i)
    success = reached_end(at.arc_length, w[PARAM + PATH_LENGTH, i])
    failure = (not success) & left_workspace(
        at.arc_length, at.normal_error, load_motion(w, i), w[PARAM + ERROR_MAX, i], w[PARAM + SINGULARITY_MARGIN, i]
    )
    a_x, a_y = tip_acceleration(w, i, period)
    error, pace, acceleration, effort = reward_terms(
        w,
        PARAM,
        i,
        at,
        math.sqrt(a_x * a_x + a_y * a_y),
        load_four(w, COMMAND, i),
        w[PARAM + VOLTAGE_MAX, i],
        period,
    )
    penalty = -w[PARAM + WEIGHT_FAILURE, i] if failure else 0.0
    terminated = success | failure
    truncated = w[STEP, i] >= limit
    w[ALIVE, i] = 1.0 if began & (not terminated) & (not truncated) else 0.0
    w[_REWARD, i] = error
    w[_REWARD + 1, i] = pace
    w[_REWARD + 2, i] = acceleration
    w[_REWARD + 3, i] = effort
    w[_REWARD + 4, i] = penalty
    w[_REWARD + 5, i] = error + pace + acceleration + effort + penalty
    w[_END + TERMINATED, i] = 1.0 if terminated else 0.0
    w[_END + TRUNCATED, i] = 1.0 if truncated else 0.0
    w[_END + SUCCESS, i] = 1.0 if success else 0.0


@device
def has_begun(w: Any, i: int) -> bool:
    """Tell whether a world that ``judge_step`` has judged was alive before the step."""
    return w[_BEGAN, i] != 0.0


@outlined
def record_step(w: Any, i: int, telemetry: Any, t: int, world: int, period: float, constants: Any) -> None:
    """Write the telemetry (T, N, K) of a control step."""
    q = load_motion(w, i)
    slip = slip_velocities(q.omega_a, q.omega_b)
    record_pose(w, i, telemetry, t, world, w[STEP, i] * period, constants)
    a_x, a_y = tip_acceleration(w, i, period)
    telemetry[t, world, T_ACCELERATION] = a_x
    telemetry[t, world, T_ACCELERATION + 1] = a_y
    x, y = tip_position(linkage(w, PARAM, i), q)
    v_x, v_y = tip_velocity(linkage(w, PARAM, i), q)
    stiffness = w[PARAM + STIFFNESS, i]
    damping = w[PARAM + DAMPING, i]
    telemetry[t, world, T_FORCE] = w[_FORCE, i] + stiffness * (w[TARGET, i] - x) - damping * v_x
    telemetry[t, world, T_FORCE + 1] = w[_FORCE + 1, i] + stiffness * (w[TARGET + 1, i] - y) - damping * v_y
    for clutch in range(4):
        telemetry[t, world, T_TORQUE + clutch] = w[TORQUE + clutch, i]
        telemetry[t, world, T_POWER + clutch] = w[TORQUE + clutch, i] * slip[clutch]
    for term in range(4):
        telemetry[t, world, T_ENERGY + term] = w[_ENERGY + term, i]
    for term in range(6):
        telemetry[t, world, T_REWARD + term] = w[_REWARD + term, i]
    telemetry[t, world, T_SUCCESS] = w[_END + SUCCESS, i]
    telemetry[t, world, T_TERMINATED] = w[_END + TERMINATED, i]


@device
def next_episode(
    w: Any, i: int, world: int, words: Any, obs: Any, telemetry: Any, t: int, config: Any, constants: Any
) -> None:
    """Start the next episode of a world's seed, and write its first observation and telemetry."""
    words[world, 1] += _ONE
    period = config[SUBSTEP] * config[SUBSTEPS]
    start_episode(w, i, words[world, 0], words[world, 1], constants, period, config[SUBSTEPS])
    see(w, i, config, constants)
    write_observation(w, i, obs, world, config, constants)
    if telemetry.shape[0] > 0:
        record_reset(w, i, telemetry, t, world, constants)


@device
def end_step(
    w: Any,
    i: int,
    world: int,
    words: Any,
    obs: Any,
    final_obs: Any,
    rewards: Any,
    flags: Any,
    telemetry: Any,
    t: int,
    period: float,
    ended: int,
    config: Any,
    constants: Any,
) -> None:
    """Write what a control step of one world returns, and begin its next episode as ``ended`` says.

    The world was judged and observed. Its row of the observations (N, entries), the rewards (N,), the flags (FLAGS, N)
    and row (t, world) of the telemetry (T, N, K) are written, where T may be 0. With SAME_STEP the final observations
    and the second layer of the telemetry get the last ones of a world that has ended.
    """
    records = telemetry.shape[0] > 0
    begins = ended == NEXT_STEP
    if has_begun(w, i):
        write_observation(w, i, obs, world, config, constants)
        rewards[world] = w[_REWARD + 5, i]
        for flag in range(FLAGS):
            flags[flag, world] = w[_END + flag, i] != 0.0
        if records:
            record_step(w, i, telemetry, t, world, period, constants)
        begins = w[ALIVE, i] == 0.0 and ended == SAME_STEP
        if begins:
            write_observation(w, i, final_obs, world, config, constants)
            if records:
                record_step(w, i, telemetry, t + 1, world, period, constants)
    elif begins:
        rewards[world] = 0.0
        for flag in range(FLAGS):
            flags[flag, world] = False
    if begins:
        next_episode(w, i, world, words, obs, telemetry, t, config, constants)
