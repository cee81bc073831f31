"""One world's control step, from voltages to observation and reward, as scalar functions.

Each works on column ``i`` of an array ``w`` whose rows are named here. The kernels for CPU and GPU bring worlds into
such an array, call these functions in the same order and write the rows that change back.
"""

import math
from typing import Any

import numpy as np

from pter_gym._jit import device
from pter_gym._philox import uniform4
from pter_gym.operators import SINES, advance_sines, renew_sines, sum_of_sines, unit_vector
from pter_gym.physics.arm import Load, advance_position, kinetic_energy, tip_position, tip_velocity
from pter_gym.physics.clutch import PerClutch, relax, relax_torques, steady_torques
from pter_gym.physics.friction import between, generated_torques, mode_of, slip_velocities
from pter_gym.physics.model import (
    BREAKAWAY,
    LAGGED_VOLTS,
    SLIP_THRESHOLD,
    STATE_ROWS,
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
    ENTRIES,
    ERROR_MAX,
    PACE,
    PARAM_ROWS,
    PHASE,
    PUSH,
    RANDOM_PHASES,
    SINGULARITY_MARGIN,
    START_OFFSET,
    T_ACCELERATION,
    T_ARC_LENGTH,
    T_ENERGY,
    T_ERROR,
    T_FORCE,
    T_KINETIC,
    T_MODE,
    T_POWER,
    T_REWARD,
    T_SUCCESS,
    T_TERMINATED,
    T_THETA,
    T_TIME,
    T_TIP,
    T_TORQUE,
    T_VELOCITY,
    T_VOLTS,
    TURN,
    WEIGHT_FAILURE,
    left_workspace,
    line_of,
    observe,
    reached_end,
    reward_terms,
    situation,
    start_motion,
)

LANES = 64
"""Largest number of worlds in a block."""

COMMAND = STATE_ROWS
TORQUE = COMMAND + 4
SINE = TORQUE + 4
STEP = SINE + 2 * SINES
ALIVE = STEP + 1
CHANGING_ROWS = ALIVE + 1
"""Rows of a world that change.

Physical state, last command, last generated torques, unit vectors of the sines, step count, alive flag.
"""

PARAM = CHANGING_ROWS
"""First row of a world's parameters."""

WORLD_ROWS = PARAM + PARAM_ROWS
REPEATS = WORLD_ROWS
STORED_ROWS = REPEATS + 1
_TARGET = WORLD_ROWS
_IMPACT = _TARGET + 8
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

LOW, HIGH, SLACK, SUBSTEP, SUBSTEPS, LIMIT, HAS_LAW = range(7)
"""Entries of a kernel's configuration.

Bounds of an action and how far beyond them it is clipped, the substep [s], the substeps in a control step, the time
limit in control steps, and 1 for voltages from a law or 0 for given ones.
"""

INVERSE_SCALES = 7
"""Where the inverse scales of the observation, as many as it may have entries, begin in the configuration."""

SCALES = INVERSE_SCALES + ENTRIES
"""Where the scales of the observation begin in the configuration; a law's gains follow them."""

TERMINATED, TRUNCATED, SUCCESS = range(3)
"""Rows of the flags (FLAGS, N)."""

FLAGS = 3

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
def aim_torques(w: Any, i: int) -> None:
    """Find the torques that the clutches tend to, behind a lag of the voltage if there is one."""
    lagged = relax(load_four(w, LAGGED_VOLTS, i), load_four(w, COMMAND, i), w[PARAM + VOLTAGE_DECAY, i])
    store_four(w, LAGGED_VOLTS, i, lagged)
    store_torques(w, _TARGET, i, steady_torques(breakaway_curve(w, PARAM, i), dynamic_curve(w, PARAM, i), lagged))


@device
def push_tip(w: Any, i: int) -> None:
    """Find the hand's force [N] and move its sines on by a substep."""
    across = force_across(w, i)
    advance_sines(w, SINE, PARAM + TURN, i)
    line = line_of(w, PARAM, i)
    w[_FORCE, i] = w[PARAM + PUSH, i] * line.heading_cos - across * line.heading_sin
    w[_FORCE + 1, i] = w[PARAM + PUSH, i] * line.heading_sin + across * line.heading_cos


@device
def find_velocity(w: Any, i: int, h: float) -> None:
    """Advance the torques' lag and find the velocities after friction."""
    torques = relax_torques(load_torques(w, BREAKAWAY, i), load_torques(w, _TARGET, i), w[PARAM + TORQUE_DECAY, i])
    store_torques(w, BREAKAWAY, i, torques)
    q = load_motion(w, i)
    impact = free_motion(q, linkage(w, PARAM, i), Load(w[_FORCE, i], w[_FORCE + 1, i], 0.0, 0.0, 0.0, 0.0), h)
    omega_a, omega_b, limit, crossing = first_velocity(q, impact, torques, w[PARAM + SLIP_THRESHOLD, i], h)
    store_impact(w, i, impact)
    w[_OMEGA, i] = omega_a
    w[_OMEGA + 1, i] = omega_b
    store_four(w, _LIMIT, i, limit)
    w[CROSSING, i] = 1.0 if crossing else 0.0


@device
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


@device
def force_across(w: Any, i: int) -> float:
    """Return the present disturbance [N] (paper Eq. 5)."""
    return sum_of_sines(w, SINE, PARAM + AMPLITUDE, i)


@device
def start_episode(w: Any, i: int, seed: np.uint64, episode: np.uint64) -> None:
    """Start an episode: the arm at rest at the start of the path, clutches released, draws from seed and episode."""
    for row in range(CHANGING_ROWS):
        w[row, i] = 0.0
    u0, u1, u2, u3 = uniform4(seed, _RESET_STREAM, _FIRST_DRAWS, episode)
    v0, v1, _, _ = uniform4(seed, _RESET_STREAM, _SECOND_DRAWS, episode)
    draws = (u1, u2, u3, v0, v1)
    for k in range(SINES):
        angle = 2.0 * np.pi * draws[k] if w[PARAM + RANDOM_PHASES, i] != 0.0 else w[PARAM + PHASE + k, i]
        w[SINE + 2 * k, i], w[SINE + 2 * k + 1, i] = unit_vector(angle)
    store_motion(
        w, i, start_motion(linkage(w, PARAM, i), line_of(w, PARAM, i), w[PARAM + START_OFFSET, i] * (2.0 * u0 - 1.0))
    )
    w[ALIVE, i] = 1.0


@device
def observe_world(w: Any, i: int, config: Any) -> None:
    """Find the present observation."""
    line = line_of(w, PARAM, i)
    q = load_motion(w, i)
    observe(
        w,
        _SEEN,
        i,
        q,
        situation(line, linkage(w, PARAM, i), q),
        line,
        w[PARAM + PACE, i],
        load_four(w, COMMAND, i),
        load_four(w, TORQUE, i),
        w[PARAM + PUSH, i],
        force_across(w, i),
    )
    for k in range(ENTRIES):
        w[_SEEN + k, i] = between(w[_SEEN + k, i] * config[INVERSE_SCALES + k], -1.0, 1.0)


@device
def write_observation(w: Any, i: int, obs: Any, world: int) -> None:
    """Write what ``observe_world`` found to a row of the observations (N, entries)."""
    for k in range(ENTRIES):  # not over the entries: compilers unroll what they can count
        if k < obs.shape[1]:
            obs[world, k] = w[_SEEN + k, i]


@device
def record_reset(w: Any, i: int, telemetry: Any, t: int, world: int) -> None:
    """Write the telemetry (T, N, K) of a world that is not stepping: its pose, the rest zero."""
    for column in range(telemetry.shape[2]):
        telemetry[t, world, column] = 0.0
    record_pose(w, i, telemetry, t, world, 0.0)


@device
def record_pose(w: Any, i: int, telemetry: Any, t: int, world: int, time: float) -> None:
    """Write what the telemetry (T, N, K) says of the pose."""
    arm = linkage(w, PARAM, i)
    q = load_motion(w, i)
    at = situation(line_of(w, PARAM, i), arm, q)
    x, y = tip_position(arm, q)
    v_x, v_y = tip_velocity(arm, q)
    telemetry[t, world, T_TIME] = time
    telemetry[t, world, T_THETA] = q.theta_a
    telemetry[t, world, T_THETA + 1] = q.theta_b
    telemetry[t, world, T_TIP] = x
    telemetry[t, world, T_TIP + 1] = y
    telemetry[t, world, T_VELOCITY] = v_x
    telemetry[t, world, T_VELOCITY + 1] = v_y
    telemetry[t, world, T_ARC_LENGTH] = at.arc_length
    telemetry[t, world, T_ERROR] = at.normal_error
    telemetry[t, world, T_MODE] = mode_of(q.omega_a, q.omega_b)
    telemetry[t, world, T_KINETIC] = kinetic_energy(arm, q)
    for clutch in range(4):
        telemetry[t, world, T_VOLTS + clutch] = w[COMMAND + clutch, i]


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
    line = line_of(w, PARAM, i)
    q = load_motion(w, i)
    at = situation(line, linkage(w, PARAM, i), q)
    success = reached_end(line, at)
    failure = (not success) & left_workspace(at, q, w[PARAM + ERROR_MAX, i], w[PARAM + SINGULARITY_MARGIN, i])
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


@device
def record_step(w: Any, i: int, telemetry: Any, t: int, world: int, period: float) -> None:
    """Write the telemetry (T, N, K) of a control step."""
    q = load_motion(w, i)
    slip = slip_velocities(q.omega_a, q.omega_b)
    record_pose(w, i, telemetry, t, world, w[STEP, i] * period)
    a_x, a_y = tip_acceleration(w, i, period)
    telemetry[t, world, T_ACCELERATION] = a_x
    telemetry[t, world, T_ACCELERATION + 1] = a_y
    telemetry[t, world, T_FORCE] = w[_FORCE, i]
    telemetry[t, world, T_FORCE + 1] = w[_FORCE + 1, i]
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
def next_episode(w: Any, i: int, world: int, words: Any, obs: Any, telemetry: Any, t: int, config: Any) -> None:
    """Start the next episode of a world's seed, and write its first observation and telemetry."""
    words[world, 1] += _ONE
    start_episode(w, i, words[world, 0], words[world, 1])
    observe_world(w, i, config)
    write_observation(w, i, obs, world)
    if telemetry.shape[0] > 0:
        record_reset(w, i, telemetry, t, world)


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
) -> None:
    """Write what a control step of one world returns, and begin its next episode as ``ended`` says.

    The world was judged and observed. Its row of the observations (N, entries), the rewards (N,), the flags (FLAGS, N)
    and row (t, world) of the telemetry (T, N, K) are written, where T may be 0. With SAME_STEP the final observations
    and the second layer of the telemetry get the last ones of a world that has ended.
    """
    records = telemetry.shape[0] > 0
    if has_begun(w, i):
        write_observation(w, i, obs, world)
        rewards[world] = w[_REWARD + 5, i]
        for flag in range(FLAGS):
            flags[flag, world] = w[_END + flag, i] != 0.0
        if records:
            record_step(w, i, telemetry, t, world, period)
        if w[ALIVE, i] == 0.0 and ended == SAME_STEP:
            write_observation(w, i, final_obs, world)
            if records:
                record_step(w, i, telemetry, t + 1, world, period)
            next_episode(w, i, world, words, obs, telemetry, t, config)
    elif ended == NEXT_STEP:
        next_episode(w, i, world, words, obs, telemetry, t, config)
        rewards[world] = 0.0
        for flag in range(FLAGS):
            flags[flag, world] = False
