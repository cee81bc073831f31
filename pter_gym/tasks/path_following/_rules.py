"""The rules of path following as pure functions: position on the path, reward, end of episodes.

The observation is in ``_observation``. The engine loads a world's numbers, calls these functions
and stores what they return; gradients and the browser's module use the same ones.
"""

import math
from dataclasses import Field, dataclass, fields
from typing import Annotated, Any, NamedTuple

import numpy as np

from pter_gym._compiled.compiler import inlined
from pter_gym._compiled.records import Entry
from pter_gym._physics.arm import (
    Motion,
    UnitVector,
    Vector,
    components,
    cos_difference,
    joint_torque,
    motion_at,
    sin_difference,
)
from pter_gym._physics.clutch import PerClutch
from pter_gym._physics.model import model_of
from pter_gym._physics.scalars import clamp
from pter_gym._physics.step import Energy
from pter_gym.hands import MultiSineHand
from pter_gym.params import BASELINE, Checked, parameter
from pter_gym.paths import Line
from pter_gym.paths._projection import Foot

# --- where am I ---


class PathVector(NamedTuple):
    """A vector by its components along and across the path."""

    along: Annotated[float, Entry("", "{} along the path")]
    across: Annotated[float, Entry("", "{} across the path, positive to its left")]


class Band(NamedTuple):
    """The band along the path within which the tip is free: a virtual fixture.

    Without width it is the path.
    """

    right: Annotated[float, Entry("m", "width of the free band to the right of the path")]
    left: Annotated[float, Entry("m", "width of the free band to the left of the path")]


NO_BAND = Band(0.0, 0.0)


class PathState(NamedTuple):
    """The tip relative to the path at a control instant [m, 1/m, m/s].

    ``offset`` is its distance from the path, ``normal_error`` that from the free band, both
    positive to the left.
    """

    arc_length: float
    offset: float
    normal_error: float
    heading: UnitVector
    curvature: float
    speed: PathVector


@inlined
def path_state(foot: Foot, v_x: float, v_y: float, free: Band) -> PathState:
    """Return the tip's state relative to its path, from its projection and velocity [m/s]."""
    speed = to_path(Vector(v_x, v_y), foot.heading)
    beyond = beyond_band(foot.normal_error, free)
    return PathState(
        foot.arc_length, foot.normal_error, beyond, foot.heading, foot.curvature, speed
    )


@inlined
def beyond_band(offset: float, free: Band) -> float:
    """Return how far the tip is beyond the free band [m], from its offset to the path's left."""
    return offset - clamp(offset, -free.right, free.left)


@inlined
def to_path(vector: Vector, heading: UnitVector) -> PathVector:
    """Return the components of a vector along and across a path with a heading."""
    along, across = components(vector, heading)
    return PathVector(along, across)


@inlined
def to_world(vector: PathVector, heading: UnitVector) -> Vector:
    """Return a vector given by its components along and across a path with a heading."""
    return Vector(
        vector.along * heading.cos - vector.across * heading.sin,
        vector.along * heading.sin + vector.across * heading.cos,
    )


# --- what is it worth ---

ERROR_WIDTH = 0.06
"""Distance from the path [m] at which tracking pays 1/e of what it pays on the path."""

PRECISION_WIDTH = 0.006
"""The same for precision: a few times the mean error of a ranked policy."""

PACE_WINDOW = 0.1
"""Time constant [s] of the mean of the pace that is judged: about the lag of the clutches."""

MAX_PACE_RATIO = 50.0
"""Ratio to the commanded pace beyond which a pace costs no more."""

PERFECT = 100.0
"""What the whole path at the commanded pace and without error pays."""

REST = 5.0
"""What rest costs over what twice the pace costs: an episode lasts two path times longer than a
rollout at the commanded pace, which costs ``PERFECT``, so a rollout that stops for good, however
late, has earned nothing."""

ACCELERATION_UNIT = 10.0


class Outcome(NamedTuple):
    """The outcome of a control step.

    Attributes
    ----------
    at
        Position of the tip relative to the path.
    advance
        Progress of the tip beyond the previous largest arc length [m].
    reached
        The largest arc length so far [m].
    path_length
        Length of the path [m].
    pace
        Commanded pace [m/s].
    pace_ratio
        Rate of change of the arc length over the commanded pace, averaged over about
        ``PACE_WINDOW``.
    acceleration
        Mean acceleration of the tip over the control step [m/s²].
    volts, last_volts, voltage_max
        Voltages of this control step and the previous one, and their limit [V].
    energy
        Work of the hand and the clutches in the control step [J].
    failed
        Whether the tip has left the workspace or missed the end of the path.
    """

    at: PathState
    advance: float
    reached: float
    path_length: float
    pace: float
    pace_ratio: float
    acceleration: float
    volts: PerClutch
    last_volts: PerClutch
    voltage_max: float
    energy: Energy
    failed: bool


@inlined
def mean_square(volts: PerClutch) -> float:
    """Return the mean squared voltage [V²]."""
    return 0.25 * (
        volts.x1 * volts.x1 + volts.x2 * volts.x2 + volts.x3 * volts.x3 + volts.x4 * volts.x4
    )


@inlined
def pace_share(ratio: float) -> float:
    """Return the share of the pay that a pace earns, from its ratio to the commanded one."""
    slower = ratio if ratio > 0.0 else 0.0
    square = ratio * ratio
    return slower * square if ratio < 1.0 else 1.0 / (square * square)


@inlined
def paid(weight: float, outcome: Outcome, width: float) -> float:
    """Return the pay for new arc length, which is 1/e at a distance ``width`` from the path [m]."""
    near = math.exp(-abs(outcome.at.normal_error) / width)
    return weight * outcome.advance / outcome.path_length * pace_share(outcome.pace_ratio) * near


@inlined
def pace_cost(ratio: float) -> float:
    """Return the cost of a pace over the commanded one: |ratio − 1|, times ``REST`` below 1."""
    slower = ratio if ratio > 0.0 else 0.0
    faster = ratio if ratio < MAX_PACE_RATIO else MAX_PACE_RATIO
    return REST * (1.0 - slower) if ratio < 1.0 else faster - 1.0


@dataclass(frozen=True, kw_only=True)
class RewardWeights(Checked):
    """Weights of the reward terms of ``reward_terms``, each ≥ 0.

    A stored task that lacks one has its default.
    """

    tracking: float = parameter(
        "1",
        "chosen: for the whole path at the commanded pace without error",
        at_least=0.0,
        default=PERFECT,
    )
    precision: float = parameter(
        "1",
        "chosen: for the whole path at the commanded pace without error; next to nothing 30 mm "
        "beside it",
        at_least=0.0,
        default=0.0,
    )
    pace: float = parameter(
        "1",
        f"chosen: at twice the commanded pace, in one path time; {REST:g} times as much at rest",
        at_least=0.0,
        default=0.1 * PERFECT,
    )
    acceleration: float = parameter(
        "1/s",
        f"chosen: per {ACCELERATION_UNIT:g} m/s² of tip acceleration",
        at_least=0.0,
        default=0.0,
    )
    effort: float = parameter(
        "1/s",
        "chosen: per mean of the squared voltages, relative to the largest",
        at_least=0.0,
        default=10.0,
    )
    failure: float = parameter(
        "1",
        "chosen: on leaving the workspace or missing the end of the path, times the part that was "
        "reached",
        at_least=0.0,
        default=PERFECT,
    )


def weighted(weight: Field[Any]) -> Any:
    """Return the type of a term: a number with its weight's unit and meaning."""
    told = weight.metadata
    return Annotated[
        float, Entry(told["unit"], "{}: " + told["provenance"].removeprefix("chosen: "))
    ]


_TERMS = [(item.name, weighted(item)) for item in fields(RewardWeights)]
Terms = NamedTuple("Terms", _TERMS)
"""One number for each term of the reward."""


@inlined
def reward_terms(weight: Any, outcome: Outcome, period: float) -> Any:
    """Return the weighted ``Terms`` of a control step of ``period`` [s]."""
    return Terms(
        tracking=paid(weight.tracking, outcome, ERROR_WIDTH),
        precision=paid(weight.precision, outcome, PRECISION_WIDTH),
        pace=-weight.pace
        * pace_cost(outcome.pace_ratio)
        * outcome.pace
        * period
        / outcome.path_length,
        acceleration=-period * weight.acceleration * outcome.acceleration / ACCELERATION_UNIT,
        effort=-period
        * weight.effort
        * mean_square(outcome.volts)
        / (outcome.voltage_max * outcome.voltage_max),
        failure=-weight.failure * outcome.reached / outcome.path_length if outcome.failed else 0.0,
    )


@inlined
def total(terms: Any) -> float:
    """Return the sum of the terms."""
    found = terms[0]
    for k in range(1, len(terms)):
        found += terms[k]
    return found


# --- the numbers of a task ---


class PathModel(NamedTuple):
    """Start and number of a path's arcs in the constants, and its length."""

    first: Annotated[float, Entry("1", "where the path's arcs begin in the constants")]
    arcs: Annotated[float, Entry("1", "number of the path's arcs")]
    length: Annotated[float, Entry("m", "length of the path")]


class SensingModel(NamedTuple):
    """Effects between the machine and the observation."""

    angle_resolution: Annotated[float, Entry("rad", "step of the joint encoders")]
    velocity_noise: Annotated[
        float, Entry("rad/s", "standard deviation of the angular velocities' noise")
    ]
    torque_noise: Annotated[float, Entry("N·m", "standard deviation of the torques' noise")]
    force_noise: Annotated[float, Entry("N", "standard deviation of the force's noise")]
    encoder_velocity: Annotated[
        float, Entry("1", "1 if velocities are differences of encoder readings")
    ]
    delay: Annotated[float, Entry("1", "control steps from measurement to observation")]
    is_ideal: Annotated[float, Entry("1", "1 if sensors are exact and without delay")]


class StartModel(NamedTuple):
    """How episodes begin."""

    moving: Annotated[
        float, Entry("1", "share of the episodes that begin anywhere along the path, moving")
    ]
    gripped: Annotated[
        float, Entry("1", "share of the episodes that begin at rest with settled clutches")
    ]
    offset: Annotated[
        float, Entry("m", "half-range of the distance from the path of those that begin moving")
    ]


class TaskModel(NamedTuple):
    """Constants of one task."""

    path: Annotated[PathModel, Entry()]
    free: Band
    pace: Annotated[float, Entry("m/s", "commanded mean speed along the path")]
    pace_decay: Annotated[
        float, Entry("1", "part of a new speed in the mean that the reward judges")
    ]
    error_max: Annotated[float, Entry("m", "the workspace ends this far from the path")]
    truncation_error: Annotated[float, Entry("m", "an episode is truncated this far from the path")]
    arrival: Annotated[float, Entry("m", "how near to the path its end counts as reached")]
    singularity_margin: Annotated[float, Entry("1", "smallest |sin(θA − θB)| of the workspace")]
    energy_max: Annotated[
        float, Entry("J", "an episode ends as a failure above this kinetic energy")
    ]
    start_offset: Annotated[float, Entry("m", "half-range of the start's normal offset")]
    starts: StartModel
    friction_drift: Annotated[
        float, Entry("1/s", "relative change of all clutch torques in a second")
    ]
    weight: Annotated[Terms, Entry("", "weight")]
    sensing: SensingModel


# --- how fast am I: the pace that is judged ---

COMMANDED_PACE = 0.5
"""The paper's pace [m/s]: the baseline's mean tip speed in Table I, 19.69 in/s."""

TIME_CONSTANTS = 2.0
"""After this many time constants a clutch has 86 % of a torque that is requested at the start."""

START = 0.01
"""Part of the path that the allowance covers; time lost later counts."""


def start_up_allowance() -> float:
    """Return the allowance of the paper's machine with the paper's hand on the paper's line [s].

    It is two time constants of the clutches, plus the time lost while the push accelerates the arm
    from rest to the paper's pace v: with an effective mass m of the tip along the line and a push F
    this takes m·v/F, and half of it is lost compared with a start at that pace.
    """
    path = Line()
    arm = model_of(BASELINE).arm
    (x, y), heading = path.point(0.0), path.heading(0.0)
    at = motion_at(arm, x, y)
    torque = np.array(joint_torque(arm, at, math.cos(heading), math.sin(heading)))
    coupling = arm.coupling * cos_difference(at)
    mass = 1.0 / float(torque @ np.linalg.solve([[arm.m11, coupling], [coupling, arm.m22]], torque))
    lost = 0.5 * mass * COMMANDED_PACE / MultiSineHand().push
    return TIME_CONSTANTS * BASELINE.clutch.time_constant + lost


ALLOWANCE = start_up_allowance()
"""The extra time for the start-up [s], about 0.22 s: the same for all policies and scenarios."""


@inlined
def in_start_up(reached: float, length: float, pace: float, time: float) -> bool:
    """Return whether a delay is within the allowance, from the progress [m] and the time [s]."""
    return (reached <= START * length) & (time <= ALLOWANCE + START * length / pace)


@inlined
def recent_pace(
    ratio: float, travel: float, reached: float, time: float, period: float, task: TaskModel
) -> float:
    """Return the recent mean of the pace over the commanded one, after a control step.

    Parameters
    ----------
    ratio
        The mean before the step.
    travel, reached
        Change of the arc length in the step, and its largest value so far [m].
    time, period
        Time since the start of the episode, and length of the step [s].
    task
        The task. During start-up a slow pace counts as the commanded one.
    """
    ratio += task.pace_decay * (travel / (period * task.pace) - ratio)
    excused = (ratio < 1.0) & in_start_up(reached, task.path.length, task.pace, time)
    return 1.0 if excused else ratio


# --- is it over ---


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
