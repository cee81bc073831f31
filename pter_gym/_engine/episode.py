"""How an episode of one world begins, is judged after each control step, and ends."""

import math
from typing import Any

import numpy as np

from pter_gym._compiled.compiler import device, outlined
from pter_gym._compiled.philox import uniform4
from pter_gym._compiled.records import load, store
from pter_gym._engine.hand import plan_hand, plans
from pter_gym._engine.recording import record_reset, record_step, tip_acceleration
from pter_gym._engine.sensing import (
    observe_reading,
    observe_world,
    scale_entries,
    see,
    situated,
    take_reading,
    write_observation,
)
from pter_gym._engine.starts import explore, place, spread
from pter_gym._engine.world import (
    BASIC_ROWS,
    CONFIG,
    CONSTANT_ROWS,
    FLAGS,
    NEXT_STEP,
    ROW,
    SAME_STEP,
    STORED_ROWS,
    Arrays,
    Flags,
)
from pter_gym._physics.arm import UnitVector, Vector, kinetic_energy, tip_position
from pter_gym.hands._model import SINES, unit_vector
from pter_gym.paths._projection import project, segment_at
from pter_gym.tasks.path_following._allowance import in_start_up
from pter_gym.tasks.path_following._context import CONTEXT_WIDTH
from pter_gym.tasks.path_following._reward import Outcome, reward_terms, total
from pter_gym.tasks.path_following._situation import reached_end, singular, strayed, too_fast
from pter_gym.tasks.path_following._specification import MAX_DELAY

_RESET_STREAM = np.uint64(0x5245534554)
_FIRST_DRAWS = np.uint64(0)
_SECOND_DRAWS = np.uint64(1)
_ONE = np.uint64(1)


@device
def fetch_world(w: Any, i: int, worlds: Any, world: int) -> None:
    """Read what changes of a world into column ``i``, zero for what its block does not store."""
    width = worlds.shape[2]
    for row in range(STORED_ROWS):
        w[row, i] = worlds[world // width, row, world % width] if row < worlds.shape[1] else 0.0


@device
def put_back(w: Any, i: int, worlds: Any, world: int) -> None:
    """Write column ``i`` to the block of a world."""
    width = worlds.shape[2]
    for row in range(worlds.shape[1]):
        worlds[world // width, row, world % width] = w[row, i]


@outlined
def take_context(w: Any, i: int, constants: Any) -> None:
    """Read the constants of a world, where the world says that they begin."""
    first = int(w[ROW.context_at, i])
    for row in range(CONSTANT_ROWS):
        w[STORED_ROWS + row, i] = constants[first + row]


@device
def locate(w: Any, i: int, constants: Any) -> None:
    """Project the tip onto the path."""
    x, y = tip_position(load(w, ROW.machine.arm, i), load(w, ROW.motion, i))
    path = load(w, ROW.task.path, i)
    foot = project(constants, int(path.first), int(path.arcs), int(w[ROW.foot.segment, i]), x, y)
    w[ROW.travel, i] = foot.arc_length - w[ROW.foot.arc_length, i]
    store(w, ROW.foot, i, foot)
    advance = foot.arc_length - w[ROW.reached, i]
    w[ROW.advance, i] = advance if advance > 0.0 else 0.0
    w[ROW.reached, i] = foot.arc_length if advance > 0.0 else w[ROW.reached, i]


@outlined
def start_episode(w: Any, i: int, seed: np.uint64, episode: np.uint64, config: Any, constants: Any) -> None:
    """Start an episode: the arm at rest at the start of the path, clutches released, draws from seed and episode."""
    for row in range(int(ROW.context_at)):
        w[row, i] = 0.0
    for row in range(BASIC_ROWS, STORED_ROWS):
        w[row, i] = 0.0
    u0, u1, u2, u3 = uniform4(seed, _RESET_STREAM, _FIRST_DRAWS, episode)
    v0, v1, v2, _ = uniform4(seed, _RESET_STREAM, _SECOND_DRAWS, episode)
    w[ROW.context_at, i] = w[ROW.draws_from, i] + CONTEXT_WIDTH * math.floor(v2 * w[ROW.draws, i])
    take_context(w, i, constants)
    draws = (u1, u2, u3, v0, v1)
    for k in range(SINES):
        angle = 2.0 * np.pi * draws[k] if w[ROW.hand.random_phases, i] != 0.0 else w[ROW.hand.phase[k], i]
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
    if w[ROW.task.starts.moving, i] + w[ROW.task.starts.gripped, i] > 0.0:
        explore(w, i, seed, episode, constants)
    w[ROW.alive, i] = 1.0
    locate(w, i, constants)
    if plans(w, i):
        plan_hand(w, i, constants, config[CONFIG.substep] * config[CONFIG.substeps], config[CONFIG.substeps])
    if w[ROW.task.sensing.is_ideal, i] == 0.0:
        for _ in range(1 + MAX_DELAY):
            take_reading(w, i, seed, episode)


@device
def judge_step(w: Any, i: int, period: float, limit: float) -> None:
    """Count the step, and find the reward and whether the episode ends. A world that had ended stays so."""
    began = w[ROW.alive, i] != 0.0
    w[ROW.began, i] = w[ROW.alive, i]
    w[ROW.step, i] += 1.0
    at = situated(w, i)
    length = w[ROW.task.path.length, i]
    pace, ratio = w[ROW.task.pace, i], w[ROW.pace_ratio, i]
    ratio += w[ROW.task.pace_decay, i] * (w[ROW.travel, i] / (period * pace) - ratio)
    excused = (ratio < 1.0) & in_start_up(w[ROW.reached, i], length, pace, w[ROW.step, i] * period)
    w[ROW.pace_ratio, i] = 1.0 if excused else ratio
    at_end = reached_end(at.arc_length, length)
    success = at_end & (abs(at.normal_error) <= w[ROW.task.arrival, i])
    error_max, truncation_error = w[ROW.task.error_max, i], w[ROW.task.truncation_error, i]
    left_workspace = strayed(at.arc_length, at.normal_error, error_max) & (error_max < truncation_error)
    q = load(w, ROW.motion, i)
    lost = singular(q, w[ROW.task.singularity_margin, i]) | too_fast(
        kinetic_energy(load(w, ROW.machine.arm, i), q), w[ROW.task.energy_max, i]
    )
    failure = (not success) & (at_end | left_workspace | lost)
    acceleration = tip_acceleration(w, i, period)
    outcome = Outcome(
        at=at,
        advance=w[ROW.advance, i],
        reached=w[ROW.reached, i],
        path_length=length,
        pace=pace,
        pace_ratio=w[ROW.pace_ratio, i],
        acceleration=math.sqrt(acceleration.x * acceleration.x + acceleration.y * acceleration.y),
        volts=load(w, ROW.command, i),
        last_volts=load(w, ROW.last_command, i),
        voltage_max=w[ROW.machine.voltage_max, i],
        energy=load(w, ROW.energy, i),
        failed=failure,
    )
    terms = reward_terms(load(w, ROW.task.weight, i), outcome, period)
    store(w, ROW.terms, i, terms)
    w[ROW.reward, i] = total(terms)
    terminated = success | failure
    astray = (not terminated) & strayed(at.arc_length, at.normal_error, truncation_error)
    truncated = astray | (w[ROW.step, i] >= limit)
    w[ROW.alive, i] = 1.0 if began & (not terminated) & (not truncated) else 0.0
    end = Flags(1.0 if terminated else 0.0, 1.0 if truncated else 0.0, 1.0 if success else 0.0)
    store(w, ROW.end, i, end)


@device
def has_begun(w: Any, i: int) -> bool:
    """Tell whether a world that ``judge_step`` has judged was alive before the step."""
    return w[ROW.began, i] != 0.0


@device
def conclude_step(
    w: Any, width: int, lanes: int, words: Any, first: int, config: Any, constants: Any, with_extras: bool
) -> None:
    """Find what a control step has led to: place, reward, end, the hand's next plan, observation.

    Parameters
    ----------
    w, width, lanes
        The first ``width`` columns are looked at; the first ``lanes`` of them are worlds.
    words, first
        Seed and episode count of all worlds (N, 2), and the number of the world in the first column.
    with_extras
        Whether there may be hands that plan or sensors that are not ideal.
    """
    period = config[CONFIG.substep] * config[CONFIG.substeps]
    for i in range(width):
        locate(w, i, constants)
    for i in range(width):
        judge_step(w, i, period, config[CONFIG.limit])
    if with_extras:
        for i in range(lanes):
            if plans(w, i):
                plan_hand(w, i, constants, period, config[CONFIG.substeps])
    for i in range(width):
        observe_world(w, i)
    if with_extras:
        for i in range(lanes):
            if w[ROW.task.sensing.is_ideal, i] == 0.0:
                take_reading(w, i, words[first + i, 0], words[first + i, 1])
                observe_reading(w, i, constants)
    scale_entries(w, 0, width, config)


@device
def next_episode(w: Any, i: int, world: int, a: Arrays, t: int) -> None:
    """Start the next episode of a world's seed, and write its first observation and telemetry."""
    a.words[world, 1] += _ONE
    start_episode(w, i, a.words[world, 0], a.words[world, 1], a.config, a.constants)
    see(w, i, a.config, a.constants)
    write_observation(w, i, a.obs, world, a.config, a.constants)
    if a.telemetry.shape[0] > 0:
        record_reset(w, i, a.telemetry, t, world, a.constants)


@device
def end_step(w: Any, i: int, world: int, a: Arrays, t: int, ended: int) -> None:
    """Write what a control step of one world returns, and begin its next episode as ``ended`` says.

    The world was judged and observed. Its rows of the arrays are written; with SAME_STEP the final observations and the
    second layer of the telemetry get the last ones of a world that has ended.
    """
    records = a.telemetry.shape[0] > 0
    period = a.config[CONFIG.substep] * a.config[CONFIG.substeps]
    begins = ended == NEXT_STEP
    if has_begun(w, i):
        write_observation(w, i, a.obs, world, a.config, a.constants)
        a.rewards[world] = w[ROW.reward, i]
        for flag in range(FLAGS):
            a.flags[flag, world] = w[ROW.end[flag], i] != 0.0
        if records:
            record_step(w, i, a.telemetry, t, world, period, a.constants)
        begins = w[ROW.alive, i] == 0.0 and ended == SAME_STEP
        if begins:
            write_observation(w, i, a.final_obs, world, a.config, a.constants)
            if records:
                record_step(w, i, a.telemetry, t + 1, world, period, a.constants)
    elif begins:
        a.rewards[world] = 0.0
        for flag in range(FLAGS):
            a.flags[flag, world] = False
    if begins:
        next_episode(w, i, world, a, t)
