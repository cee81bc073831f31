"""When an episode ends, and why."""

from typing import NamedTuple

from pter_gym._compiled.compiler import inlined
from pter_gym._physics.arm import Motion, sin_difference
from pter_gym.tasks.path_following._model import TaskModel
from pter_gym.tasks.path_following._position import PathState


@inlined
def reached_end(arc_length: float, path_length: float) -> bool:
    """Return whether the tip has reached the end of the path."""
    return arc_length >= path_length


@inlined
def strayed(arc_length: float, normal_error: float, furthest: float) -> bool:
    """Return whether the tip is over ``furthest`` [m] from the path or behind its start."""
    return (abs(normal_error) > furthest) | (arc_length < -furthest)


@inlined
def singular(q: Motion, margin: float) -> bool:
    """Return whether |sin(θA − θB)| is below the margin or NaN."""
    return not abs(sin_difference(q)) >= margin


@inlined
def too_fast(kinetic_energy: float, energy_max: float) -> bool:
    """Return whether the arm has more kinetic energy [J] than the integrator can hold, or NaN."""
    return not kinetic_energy <= energy_max


class Ending(NamedTuple):
    """Why an episode may be over. If the tip has arrived, nothing else counts."""

    arrived: bool
    missed: bool
    strayed: bool
    singular: bool
    too_fast: bool


@inlined
def ending(at: PathState, q: Motion, kinetic_energy: float, task: TaskModel) -> Ending:
    """Return what terminates an episode, from path state, arm and kinetic energy [J]."""
    at_end = reached_end(at.arc_length, task.path.length)
    arrived = at_end & (abs(at.normal_error) <= task.arrival)
    return Ending(
        arrived=arrived,
        missed=at_end & (not arrived),
        strayed=strayed(at.arc_length, at.normal_error, task.error_max)
        & (task.error_max < task.truncation_error),
        singular=singular(q, task.singularity_margin),
        too_fast=too_fast(kinetic_energy, task.energy_max),
    )


@inlined
def has_failed(end: Ending) -> bool:
    """Return whether an episode has been terminated without success."""
    return (not end.arrived) & (end.missed | end.strayed | end.singular | end.too_fast)


@inlined
def is_astray(at: PathState, terminated: bool, task: TaskModel) -> bool:
    """Return whether an episode is truncated for its distance from the path."""
    return (not terminated) & strayed(at.arc_length, at.normal_error, task.truncation_error)
