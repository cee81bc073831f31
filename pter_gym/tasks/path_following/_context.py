"""The context of a world: the constants of machine, hand and task for the kernels, and those that are observable."""

import math
from typing import Annotated, Any, NamedTuple

from pter_gym._compiled.records import Entry, layout_of, rows, width
from pter_gym._physics.arrangement import Arrangement
from pter_gym._physics.limits import largest_energy
from pter_gym._physics.model import Model, arrangement_of, model_of
from pter_gym.hands import HandModel
from pter_gym.params import PRESENT_CLUTCH, Machine
from pter_gym.tasks.path_following._observation import FORCE_SCALE
from pter_gym.tasks.path_following._reward import PACE_WINDOW, Terms
from pter_gym.tasks.path_following._specification import IDEAL_SENSING, PathFollowing, held_machine, strongest


class PathModel(NamedTuple):
    """Start and number of a path's arcs in the constants, and its length."""

    first: Annotated[float, Entry("1", "where the path's arcs begin in the constants")]
    arcs: Annotated[float, Entry("1", "number of the path's arcs")]
    length: Annotated[float, Entry("m", "length of the path")]


class SensingModel(NamedTuple):
    """Effects between the machine and the observation."""

    angle_resolution: Annotated[float, Entry("rad", "step of the joint encoders")]
    velocity_noise: Annotated[float, Entry("rad/s", "standard deviation of the angular velocities' noise")]
    torque_noise: Annotated[float, Entry("N·m", "standard deviation of the torques' noise")]
    force_noise: Annotated[float, Entry("N", "standard deviation of the force's noise")]
    delay: Annotated[float, Entry("1", "control steps from measurement to observation")]
    is_ideal: Annotated[float, Entry("1", "1 if sensors are exact and without delay")]


class StartModel(NamedTuple):
    """How episodes begin."""

    moving: Annotated[float, Entry("1", "share of the episodes that begin anywhere along the path, moving")]
    gripped: Annotated[float, Entry("1", "share of the episodes that begin at rest with settled clutches")]
    offset: Annotated[float, Entry("m", "half-range of the distance from the path of those that begin moving")]


class TaskModel(NamedTuple):
    """Constants of one task."""

    path: Annotated[PathModel, Entry()]
    pace: Annotated[float, Entry("m/s", "commanded mean speed along the path")]
    pace_decay: Annotated[float, Entry("1", "part of a new speed in the mean that the reward judges")]
    error_max: Annotated[float, Entry("m", "the workspace ends this far from the path")]
    truncation_error: Annotated[float, Entry("m", "an episode is truncated this far from the path")]
    arrival: Annotated[float, Entry("m", "how near to the path its end counts as reached")]
    singularity_margin: Annotated[float, Entry("1", "smallest |sin(θA − θB)| of the workspace")]
    energy_max: Annotated[float, Entry("J", "an episode ends as a failure above this kinetic energy")]
    start_offset: Annotated[float, Entry("m", "half-range of the start's normal offset")]
    starts: StartModel
    friction_drift: Annotated[float, Entry("1/s", "relative change of all clutch torques in a second")]
    weight: Annotated[Terms, Entry("", "weight")]
    sensing: SensingModel


class Told(NamedTuple):
    """Values of machine and task in the telemetry, and on request in the observation."""

    time_constant: Annotated[float, Entry("s", "time constant of the clutches", 0.1)]
    breakaway_factor: Annotated[float, Entry("1", "largest breakaway torque over that of the present clutches")]
    dynamic_factor: Annotated[float, Entry("1", "largest dynamic torque over that of the present clutches")]
    friction_drift: Annotated[float, Entry("1/s", "relative change of the clutch torques in a second", 0.01)]
    hand_mass: Annotated[float, Entry("kg", "mass that the hand adds at the tip")]
    hand_damping: Annotated[float, Entry("N·s/m", "damping that the hand adds at the tip", 20.0)]
    hand_stiffness: Annotated[float, Entry("N/m", "stiffness of the hand towards its intent", 300.0)]
    hand_push: Annotated[float, Entry("N", "constant force of the hand along the path", FORCE_SCALE)]


class Context(NamedTuple):
    """Everything that is constant during an episode."""

    machine: Model
    hand: HandModel
    task: TaskModel
    told: Told
    arrangement: Arrangement


CONTEXT = rows(Context)
"""Places of a context's numbers in the constants, from its beginning on."""

CONTEXT_WIDTH = width(Context)
"""Numbers of a context."""

TOLD = layout_of(Told)
"""Layout of what is told of a context."""


def context_of(task: PathFollowing, machine: Machine, arcs: tuple[int, int], recording: tuple[int, int]) -> Context:
    """Return the context of a task on a machine.

    Parameters
    ----------
    task, machine
        A pair that passes ``check_machine``.
    arcs, recording
        Start and number of the path's arcs and of the hand's recorded instants in the array of constants.
    """
    held = held_machine(task, machine)
    hand = task.hand.model(task.pace, held.substep, recording)
    model = model_of(held)
    fastest = largest_energy(model.arm, held.substep, task.control_period, strongest(task, machine))
    return Context(
        machine=model,
        hand=hand,
        task=task_model(task, arcs, fastest),
        told=told_of(task, machine, hand.push),
        arrangement=arrangement_of(held),
    )


def task_model(task: PathFollowing, arcs: tuple[int, int], energy_max: float) -> TaskModel:
    """Return the constants of a task: its fields and values derived from them.

    Parameters
    ----------
    task, arcs
        As in ``context_of``.
    energy_max
        Kinetic energy that the arm may have [J].
    """
    weights: Any = vars(task.reward)
    made: dict[str, Any] = {
        "path": PathModel(*arcs, task.path.length),
        "pace_decay": -math.expm1(-task.control_period / PACE_WINDOW),
        "energy_max": energy_max,
        "starts": StartModel(**vars(task.starts)),
        "weight": Terms(**weights),
        "sensing": SensingModel(**vars(task.sensing), is_ideal=float(task.sensing == IDEAL_SENSING)),
    }
    return TaskModel(**{name: made[name] if name in made else getattr(task, name) for name in TaskModel._fields})


def told_of(task: PathFollowing, machine: Machine, push: float) -> Told:
    """Return the observable values of a task on a machine whose hand pushes with a force [N]."""
    clutch, hand = machine.clutch, held_machine(task, machine).hand
    top = clutch.voltage_max
    scale = math.fsum(machine.slot_scale) / len(machine.clutches)
    return Told(
        time_constant=clutch.time_constant,
        breakaway_factor=scale * clutch.breakaway.torque(top) / PRESENT_CLUTCH.breakaway.torque(top),
        dynamic_factor=scale * clutch.dynamic.torque(top) / PRESENT_CLUTCH.dynamic.torque(top),
        friction_drift=task.friction_drift,
        hand_mass=hand.mass,
        hand_damping=hand.damping,
        hand_stiffness=hand.stiffness,
        hand_push=push,
    )
