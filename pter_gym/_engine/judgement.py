"""How a control step is judged: place on the path, reward, and end of the episode."""

import math

from pter_gym._compiled.compiler import inlined
from pter_gym._compiled.records import Records, load, store
from pter_gym._engine.world import ROW, Flags
from pter_gym._physics.arm import Vector, kinetic_energy, tip_position, tip_velocity
from pter_gym.paths._projection import project
from pter_gym.tasks.path_following._ending import ending, has_failed, is_astray
from pter_gym.tasks.path_following._pace import recent_pace
from pter_gym.tasks.path_following._position import PathState, path_state
from pter_gym.tasks.path_following._reward import Outcome, reward_terms, total


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
