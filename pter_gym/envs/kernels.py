"""The block kernel: whole control steps of many worlds, from voltages to observation and reward.

Worlds are gathered 64 at a time into one scratch array, whose innermost loop over worlds is vectorised. A world that
ends is written back at once and takes no further part.
"""

from functools import cache
from typing import Any

import numpy as np

from pter_gym._jit import compile_kernel, device
from pter_gym._philox import uniform4
from pter_gym.controllers.laws import EXTERNAL, built_in
from pter_gym.operators import SINES, advance_sines, unit_vector
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

COMMAND = STATE_ROWS
SINE = COMMAND + 4
STEP = SINE + 2 * SINES
ALIVE = STEP + 1
WORLD_ROWS = ALIVE + 1
"""Rows of the state array: physical state, last command, unit vectors of the sines, step count, alive flag."""

_PARAM = WORLD_ROWS
_TARGET = _PARAM + PARAM_ROWS
_IMPACT = _TARGET + 8
_OMEGA = _IMPACT + 9
_LIMIT = _OMEGA + 2
_CROSSING = _LIMIT + 4
_ENERGY = _CROSSING + 1
_ACROSS = _ENERGY + 4
_FORCE = _ACROSS + 1
_START_VELOCITY = _FORCE + 2
_SCRATCH_ROWS = _START_VELOCITY + 2

_RESET_STREAM = np.uint64(0x5245534554)


@device
def _command(volts: float, voltage_max: float) -> float:
    """Return the voltage [V] that reaches the clutch: a float32 action within the bounds."""
    return between(float(np.float32(volts)), 0.0, voltage_max)


@device
def _commands(volts: PerClutch, voltage_max: float) -> PerClutch:
    return PerClutch(
        _command(volts.x1, voltage_max),
        _command(volts.x2, voltage_max),
        _command(volts.x3, voltage_max),
        _command(volts.x4, voltage_max),
    )


@device
def _refused(state: Any, actions: Any, low: float, high: float, skip_ended: bool, i: int) -> bool:
    """Tell whether world i has ended or its action is not a number within the bounds."""
    if state[ALIVE, i] == 0.0:
        return not skip_ended
    refused = False
    for clutch in range(4):
        refused |= not ((actions[i, clutch] >= low) & (actions[i, clutch] <= high))
    return refused


@device
def _gather(w: Any, state: Any, params: Any, first: int, lanes: int, padded: int) -> None:
    for row in range(WORLD_ROWS):
        for i in range(lanes):
            w[row, i] = state[row, first + i]
    for row in range(PARAM_ROWS):
        for i in range(lanes):
            w[_PARAM + row, i] = params[row, first + i]
    for row in range(_TARGET):
        for i in range(lanes, padded):
            w[row, i] = w[row, lanes - 1]


@device
def _scatter(w: Any, state: Any, i: int, world: int) -> None:
    for row in range(WORLD_ROWS):
        state[row, world] = w[row, i]


@device
def _scatter_running(w: Any, running: Any, lanes: int, first: int, state: Any) -> None:
    for i in range(lanes):
        if running[i]:
            _scatter(w, state, i, first + i)


@device
def _load_impact(w: Any, i: int) -> Impact:
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
def _store_impact(w: Any, i: int, impact: Impact) -> None:
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
def _begin(w: Any, i: int, volts: PerClutch) -> None:
    """Take the command of a control step, note the tip's velocity and clear the step's energies."""
    p = w[_PARAM:_TARGET]
    store_four(w, COMMAND, i, _commands(volts, p[VOLTAGE_MAX, i]))
    w[_START_VELOCITY, i], w[_START_VELOCITY + 1, i] = tip_velocity(linkage(p, i), load_motion(w, i))
    for term in range(4):
        w[_ENERGY + term, i] = 0.0


@device
def _pad_commands(w: Any, lanes: int, padded: int) -> None:
    for row in range(COMMAND, COMMAND + 4):
        for i in range(lanes, padded):
            w[row, i] = w[row, lanes - 1]


@device
def _substep(w: Any, lanes: int, h: float, aims: bool) -> None:
    """Advance all lanes by one substep; ``aims`` says that the steady torques may have changed."""
    p = w[_PARAM:_TARGET]
    if aims:
        for i in range(lanes):
            lagged = relax(load_four(w, LAGGED_VOLTS, i), load_four(w, COMMAND, i), p[VOLTAGE_DECAY, i])
            store_four(w, LAGGED_VOLTS, i, lagged)
            store_torques(w, _TARGET, i, steady_torques(breakaway_curve(p, i), dynamic_curve(p, i), lagged))
    advance_sines(w, SINE, _PARAM + TURN, _PARAM + AMPLITUDE, _ACROSS, lanes)
    for i in range(lanes):
        torques = relax_torques(load_torques(w, BREAKAWAY, i), load_torques(w, _TARGET, i), p[TORQUE_DECAY, i])
        store_torques(w, BREAKAWAY, i, torques)
        line = line_of(p, i)
        force_x = p[PUSH, i] * line.heading_cos - w[_ACROSS, i] * line.heading_sin
        force_y = p[PUSH, i] * line.heading_sin + w[_ACROSS, i] * line.heading_cos
        w[_FORCE, i] = force_x
        w[_FORCE + 1, i] = force_y
        q = load_motion(w, i)
        impact = free_motion(q, linkage(p, i), Load(force_x, force_y, 0.0, 0.0, 0.0, 0.0), h)
        omega_a, omega_b, limit, crossing = first_velocity(q, impact, torques, p[SLIP_THRESHOLD, i], h)
        _store_impact(w, i, impact)
        w[_OMEGA, i] = omega_a
        w[_OMEGA + 1, i] = omega_b
        store_four(w, _LIMIT, i, limit)
        w[_CROSSING, i] = 1.0 if crossing else 0.0
    for i in range(lanes):
        if w[_CROSSING, i] != 0.0:
            w[_OMEGA, i], w[_OMEGA + 1, i], limit = second_velocity(
                load_motion(w, i),
                _load_impact(w, i),
                load_torques(w, BREAKAWAY, i),
                p[SLIP_THRESHOLD, i],
                h,
                w[_OMEGA, i],
                w[_OMEGA + 1, i],
                load_four(w, _LIMIT, i),
            )
            store_four(w, _LIMIT, i, limit)
    for i in range(lanes):
        before = load_motion(w, i)
        after = advance_position(before, w[_OMEGA, i], w[_OMEGA + 1, i], h)
        energy = energy_terms(before, after, linkage(p, i), _load_impact(w, i), load_four(w, _LIMIT, i), h)
        store_motion(w, i, after)
        w[_ENERGY, i] += energy.hand_work
        w[_ENERGY + 1, i] += energy.dissipated
        w[_ENERGY + 2, i] += energy.numerical_loss
        w[_ENERGY + 3, i] += energy.residual


@device
def _unit_sines(w: Any, i: int) -> None:
    """Bring the sines' unit vectors back to unit length."""
    for k in range(SINES):
        cos = w[SINE + 2 * k, i]
        sin = w[SINE + 2 * k + 1, i]
        scale = 1.5 - 0.5 * (cos * cos + sin * sin)
        w[SINE + 2 * k, i] = cos * scale
        w[SINE + 2 * k + 1, i] = sin * scale


@device
def _finish(w: Any, i: int, inverse_scales: Any, obs: Any, row: Any, h: float, period: float) -> bool:
    """End a control step: write its observation and telemetry row, and tell whether the episode goes on."""
    _unit_sines(w, i)
    p = w[_PARAM:_TARGET]
    arm = linkage(p, i)
    line = line_of(p, i)
    q = load_motion(w, i)
    at = situation(line, arm, q)
    volts = load_four(w, COMMAND, i)
    load_a, load_b = clutch_load(_load_impact(w, i), q.omega_a, q.omega_b, h)
    torques = generated_torques(q.omega_a, q.omega_b, load_a, load_b, load_four(w, _LIMIT, i))
    slip = slip_velocities(q.omega_a, q.omega_b)
    v_x, v_y = tip_velocity(arm, q)
    a_x = (v_x - w[_START_VELOCITY, i]) / period
    a_y = (v_y - w[_START_VELOCITY + 1, i]) / period
    w[STEP, i] += 1.0
    observe(obs, inverse_scales, q, at, line, p[PACE, i], volts, torques, p[PUSH, i], w[_ACROSS, i])

    success = reached_end(line, at)
    failure = (not success) & left_workspace(at, q, p[ERROR_MAX, i], p[SINGULARITY_MARGIN, i])
    error, pace, acceleration, effort = reward_terms(
        p, i, at, np.sqrt(a_x * a_x + a_y * a_y), volts, p[VOLTAGE_MAX, i], period
    )
    penalty = -p[WEIGHT_FAILURE, i] if failure else 0.0
    _write_pose(w, i, row, w[STEP, i] * period)
    row[T_ACCELERATION] = a_x
    row[T_ACCELERATION + 1] = a_y
    row[T_FORCE] = w[_FORCE, i]
    row[T_FORCE + 1] = w[_FORCE + 1, i]
    row[T_TORQUE] = torques.x1
    row[T_TORQUE + 1] = torques.x2
    row[T_TORQUE + 2] = torques.x3
    row[T_TORQUE + 3] = torques.x4
    row[T_POWER] = torques.x1 * slip.x1
    row[T_POWER + 1] = torques.x2 * slip.x2
    row[T_POWER + 2] = torques.x3 * slip.x3
    row[T_POWER + 3] = torques.x4 * slip.x4
    for term in range(4):
        row[T_ENERGY + term] = w[_ENERGY + term, i]
    row[T_REWARD] = error
    row[T_REWARD + 1] = pace
    row[T_REWARD + 2] = acceleration
    row[T_REWARD + 3] = effort
    row[T_REWARD + 4] = penalty
    row[T_REWARD + 5] = error + pace + acceleration + effort + penalty
    row[T_SUCCESS] = 1.0 if success else 0.0
    row[T_TERMINATED] = 1.0 if success | failure else 0.0
    w[ALIVE, i] = 0.0 if success | failure else 1.0
    return not (success | failure)


@device
def _write_pose(w: Any, i: int, row: Any, time: float) -> None:
    """Write what a telemetry row says of the pose, at a reset too; the rest of the row stays as it is."""
    p = w[_PARAM:_TARGET]
    arm = linkage(p, i)
    q = load_motion(w, i)
    at = situation(line_of(p, i), arm, q)
    row[T_TIME] = time
    row[T_THETA] = q.theta_a
    row[T_THETA + 1] = q.theta_b
    row[T_TIP], row[T_TIP + 1] = tip_position(arm, q)
    row[T_VELOCITY], row[T_VELOCITY + 1] = tip_velocity(arm, q)
    row[T_ARC_LENGTH] = at.arc_length
    row[T_ERROR] = at.normal_error
    row[T_MODE] = mode_of(q.omega_a, q.omega_b)
    row[T_KINETIC] = kinetic_energy(arm, q)
    for clutch in range(4):
        row[T_VOLTS + clutch] = w[COMMAND + clutch, i]


law: Any = built_in
"""The law that the kernel below inlines; ``compile_kernel`` binds this name to another one."""


@device
def _first_refused(
    state: Any, actions: Any, low: float, high: float, slack: float, skip_ended: bool, begin: int, end: int
) -> int:
    """Return the first world whose step is refused, or −1."""
    for world in range(begin, end):
        if _refused(state, actions, low - slack, high + slack, skip_ended, world):
            return world
    return -1


@device
def _given(actions: Any, world: int, low: float, volts_per_unit: float) -> PerClutch:
    """Return the voltages [V] of an action."""
    return PerClutch(
        (actions[world, 0] - low) * volts_per_unit,
        (actions[world, 1] - low) * volts_per_unit,
        (actions[world, 2] - low) * volts_per_unit,
        (actions[world, 3] - low) * volts_per_unit,
    )


@device
def _open(w: Any, running: Any, lanes: int) -> tuple[int, bool]:
    """Note which lanes are running; return their number and whether any clutch lags its voltage."""
    left = 0
    lags_voltage = False
    for i in range(lanes):
        running[i] = w[ALIVE, i] != 0.0
        left += 1 if running[i] else 0
        lags_voltage |= w[_PARAM + VOLTAGE_DECAY, i] != 0.0
    return left, lags_voltage


@device
def _close(
    w: Any,
    running: Any,
    lanes: int,
    first: int,
    state: Any,
    scales: Any,
    obs: Any,
    telemetry: Any,
    h: float,
    period: float,
) -> int:
    """End the control step of all running lanes, write back those that have ended, and return their number."""
    ended = 0
    for i in range(lanes):
        if running[i] and not _finish(w, i, scales[1], obs[first + i], telemetry[first + i], h, period):
            _scatter(w, state, i, first + i)
            running[i] = False
            ended += 1
    return ended


def _build_advance(digest: str) -> Any:
    def advance(
        params: Any,
        state: Any,
        actions: Any,
        gains: Any,
        memory: Any,
        scales: Any,
        obs: Any,
        telemetry: Any,
        low: float,
        high: float,
        slack: float,
        skip_ended: bool,
        h: float,
        count: int,
        begin: int,
        end: int,
    ) -> int:
        _ = digest
        external = gains[0] == EXTERNAL
        refused = _first_refused(state, actions, low, high, slack, skip_ended, begin, end) if external else -1
        if refused >= 0:
            return refused
        w = np.empty((_SCRATCH_ROWS, LANES))
        running = np.empty(LANES, np.bool_)
        for first in range(begin, end, LANES):
            lanes = min(LANES, end - first)
            padded = (lanes + 7) // 8 * 8
            _gather(w, state, params, first, lanes, padded)
            left, lags_voltage = _open(w, running, lanes)
            t = 0
            while left > 0 and t < telemetry.shape[0]:
                for i in range(lanes):
                    world = first + i
                    if running[i] and external:
                        _begin(w, i, _given(actions, world, low, params[VOLTAGE_MAX, world] / (high - low)))
                    elif running[i]:
                        _begin(w, i, law(obs[world], scales[0], gains, memory[world]))
                _pad_commands(w, lanes, padded)
                for k in range(count):
                    _substep(w, padded, h, lags_voltage | (k == 0))
                left -= _close(w, running, lanes, first, state, scales, obs, telemetry[t], h, h * count)
                t += 1
            _scatter_running(w, running, lanes, first, state)
        return -1

    return advance


def _build_reset(digest: str) -> Any:
    def reset(params: Any, state: Any, words: Any, chosen: Any, scales: Any, obs: Any, telemetry: Any) -> None:
        _ = digest
        w = np.zeros((_SCRATCH_ROWS, 1))
        none = PerClutch(0.0, 0.0, 0.0, 0.0)
        for world in range(chosen.shape[0]):
            if not chosen[world]:
                continue
            for row in range(WORLD_ROWS):
                w[row, 0] = 0.0
            for row in range(PARAM_ROWS):
                w[_PARAM + row, 0] = params[row, world]
            p = w[_PARAM:_TARGET]
            seed = words[world, 0]
            episode = words[world, 1]
            u0, u1, u2, u3 = uniform4(seed, _RESET_STREAM, np.uint64(0), episode)
            v0, v1, _, _ = uniform4(seed, _RESET_STREAM, np.uint64(1), episode)
            draws = (u1, u2, u3, v0, v1)
            for k in range(SINES):
                angle = 2.0 * np.pi * draws[k] if p[RANDOM_PHASES, 0] != 0.0 else p[PHASE + k, 0]
                w[SINE + 2 * k, 0], w[SINE + 2 * k + 1, 0] = unit_vector(angle)
            line = line_of(p, 0)
            arm = linkage(p, 0)
            q = start_motion(arm, line, p[START_OFFSET, 0] * (2.0 * u0 - 1.0))
            store_motion(w, 0, q)
            w[ALIVE, 0] = 1.0
            across = 0.0
            for k in range(SINES):
                across += p[AMPLITUDE + k, 0] * w[SINE + 2 * k + 1, 0]
            at = situation(line, arm, q)
            observe(obs[world], scales[1], q, at, line, p[PACE, 0], none, none, p[PUSH, 0], across)
            for column in range(telemetry.shape[1]):
                telemetry[world, column] = 0.0
            _write_pose(w, 0, telemetry[world], 0.0)
            _scatter(w, state, 0, world)

    return reset


@cache
def advance_kernel(law: Any = built_in) -> Any:
    """Return the compiled ``advance`` with a control law inside.

    ``advance(params (PARAM_ROWS, N), state (WORLD_ROWS, N), actions (N, 4), gains, memory (N, M), scales (2, OBS),
    obs (N, OBS), telemetry (T, N, len(TELEMETRY)), low, high, slack, skip_ended, h, count, begin, end)`` runs T control
    steps of ``count`` substeps for worlds begin … end − 1.

    With ``gains[0] == EXTERNAL`` the voltages come from ``actions``, [low, high] standing for [0, voltage_max]. The
    number of the first refused world is returned before anything is touched: one with an action that is not a number
    within the bounds, give or take ``slack``, or one that has ended, unless ``skip_ended``. Otherwise the voltages come
    from the law. Returns −1 when all went well. A world that ends leaves its later telemetry rows as they are.
    """
    return compile_kernel(_build_advance, law=law)


@cache
def reset_kernel() -> Any:
    """Return the compiled ``reset``; ``words`` (N, 2) holds the seed and the episode of each world."""
    return compile_kernel(_build_reset)
