"""The context of a world: constants of machine, hand and task, and what is observable of them."""

import math
from functools import lru_cache
from typing import Annotated, Any, NamedTuple

from pter_gym._compiled.records import Entry, layout_of, rows, width
from pter_gym._physics.arrangement import Arrangement
from pter_gym._physics.clutch import PerClutch
from pter_gym._physics.model import Model
from pter_gym._physics.stability import largest_energy
from pter_gym.hands import HandModel
from pter_gym.params import SLOTS, Machine
from pter_gym.tasks.path_following._model import (
    FailureModel,
    PathModel,
    SensingModel,
    StartModel,
    TaskModel,
)
from pter_gym.tasks.path_following._observation import FORCE_SCALE
from pter_gym.tasks.path_following._position import FreeBand
from pter_gym.tasks.path_following._reward import PACE_WINDOW, Terms
from pter_gym.tasks.path_following._specification import (
    IDEAL_SENSING,
    Failure,
    PathFollowing,
    Sensing,
    held_machine,
    sensing_of,
    strongest,
)


class ObservedContext(NamedTuple):
    """Values of machine and task in the telemetry, and on request in the observation."""

    time_constant: Annotated[float, Entry("s", "time constant of the clutches", 0.1)]
    breakaway_factor: Annotated[
        float, Entry("1", "largest breakaway torque over that of the present clutches")
    ]
    dynamic_factor: Annotated[
        float, Entry("1", "largest dynamic torque over that of the present clutches")
    ]
    friction_drift: Annotated[
        float, Entry("1/s", "relative change of the clutch torques in a second", 0.01)
    ]
    hand_mass: Annotated[float, Entry("kg", "mass that the hand adds at the tip")]
    hand_damping: Annotated[float, Entry("N·s/m", "damping that the hand adds at the tip", 20.0)]
    hand_stiffness: Annotated[
        float, Entry("N/m", "stiffness of the hand towards its intent", 300.0)
    ]
    hand_push: Annotated[
        float, Entry("N", "constant force of the hand along the path", FORCE_SCALE)
    ]


class Context(NamedTuple):
    """Everything that is constant during an episode."""

    machine: Model
    hand: HandModel
    task: TaskModel
    told: ObservedContext
    arrangement: Arrangement


CONTEXT = rows(Context)
"""Places of a context's numbers in the constants, from its beginning on."""

CONTEXT_WIDTH = width(Context)
"""Numbers of a context."""

OBSERVED_CONTEXT = layout_of(ObservedContext)
"""Layout of what is told of a context."""


def context_of(
    task: PathFollowing, machine: Machine, arcs: tuple[int, int], recording: tuple[int, int]
) -> Context:
    """Return the context of a task on a machine.

    Parameters
    ----------
    task, machine
        A pair that passes ``check_machine``.
    arcs, recording
        Start and number of the path's arcs and of the hand's recorded instants in the array of
        constants.
    """
    held = held_machine(task, machine)
    model, in_hand, substep = held.model, held.machine.hand, held.machine.substep
    hand = task.hand.model(task.pace, substep, recording)
    fastest = largest_energy(model.arm, substep, task.control_period, strongest(task, machine))
    breakaway, dynamic = held.factors
    return Context(
        machine=model,
        hand=hand,
        task=task_model(task, sensing_of(task, machine), arcs, fastest),
        told=ObservedContext(
            time_constant=machine.clutch.time_constant,
            breakaway_factor=breakaway,
            dynamic_factor=dynamic,
            friction_drift=task.friction_drift,
            hand_mass=in_hand.mass,
            hand_damping=in_hand.damping,
            hand_stiffness=in_hand.stiffness,
            hand_push=hand.push,
        ),
        arrangement=held.arrangement,
    )


def task_model(
    task: PathFollowing, sensing: Sensing, arcs: tuple[int, int], energy_max: float
) -> TaskModel:
    """Return the constants of a task: its fields and values derived from them.

    Parameters
    ----------
    task, arcs
        As in ``context_of``.
    sensing
        Its sensors on a machine.
    energy_max
        Kinetic energy that the arm may have [J].
    """
    numbers: dict[str, Any] = {
        "path": PathModel(*arcs, task.path.length),
        "free": FreeBand(right=task.free_right, left=task.free_left),
        "pace_decay": -math.expm1(-task.control_period / PACE_WINDOW),
        "energy_max": energy_max,
        "starts": StartModel(**vars(task.starts)),
        "failures": failure_model(task.failures, task.control_period),
        "weight": Terms(**vars(task.reward)),
        "sensing": SensingModel(**vars(sensing), is_ideal=float(sensing == IDEAL_SENSING)),
    }
    return TaskModel(
        **{
            name: numbers[name] if name in numbers else getattr(task, name)
            for name in TaskModel._fields
        }
    )


@lru_cache(1024)
def failure_model(failures: tuple[Failure, ...], period: float) -> FailureModel:
    """Return what becomes of each clutch; the moments are in whole control steps."""
    found = {failure.clutch: failure for failure in failures}
    each = [found.get(clutch) for clutch in range(1, 1 + SLOTS)]
    return FailureModel(
        torque=PerClutch(*(1.0 if one is None else one.torque for one in each)),
        volts=PerClutch(*(-1.0 if one is None or one.volts is None else one.volts for one in each)),
        after=PerClutch(*(0.0 if one is None else steps_until(one.after, period) for one in each)),
    )


def steps_until(time: float, period: float) -> float:
    """Return the control steps that begin before a time [s]."""
    return float(math.ceil(time / period * (1.0 - 1e-9)))
