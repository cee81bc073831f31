"""Follow a path while a hand pushes along it and disturbs across it (paper section IV-A)."""

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray

from pter_gym.compiled.compiler import device
from pter_gym.compiled.layout import Field, Layout
from pter_gym.errors import ParameterError
from pter_gym.hands import (
    NO_HAND,
    MultiSineHand,
    Operator,
    OperatorModel,
    RecordedForces,
    impedance_of,
    operator_model,
)
from pter_gym.params import PRESENT_CLUTCH, Arm, Machine, quantity, require, require_kind, require_number
from pter_gym.paths import Line, Path
from pter_gym.physics.arm import Linkage, Motion, sin_difference
from pter_gym.physics.clutch import PerClutch
from pter_gym.physics.model import MODEL_ROWS, Model, model_of, store_four

Sensors = Literal["encoders", "torque", "force"]

ERROR_SCALE = 0.25
SPEED_SCALE = 4.0
OMEGA_SCALE = 10.0
TORQUE_SCALE = 100.0
FORCE_SCALE = 200.0
CURVATURE_SCALE = 20.0
ERROR_UNIT = 0.01
ACCELERATION_UNIT = 10.0

ENTRIES = 24
"""Largest number of entries of an observation without those of the context."""

MAX_DELAY = 2
"""Largest delay of the sensors in control steps."""

SHARPEST = 0.9
"""Largest ratio of the workspace's half-width to a path's radius of curvature: further in, a foot is not unique."""

_PATH_SAMPLES = 257


@dataclass(frozen=True, kw_only=True)
class RewardWeights:
    """Weights of the reward terms, each a rate per second; the reward is never positive."""

    error: float = quantity("1/s", "chosen: per 10 mm of normal error", default=1.0)
    pace: float = quantity("1/s", "chosen: per commanded pace of speed error along the path", default=1.0)
    acceleration: float = quantity("1/s", "chosen: per 10 m/s² of tip acceleration", default=0.1)
    effort: float = quantity("1/s", "chosen: per mean squared voltage, relative to the largest", default=0.1)
    failure: float = quantity("1", "chosen: once, on leaving the workspace", default=100.0)

    def __post_init__(self) -> None:
        """Check that no weight is negative."""
        for name in ("error", "pace", "acceleration", "effort", "failure"):
            require_number(self, name, at_least=0.0)


@dataclass(frozen=True, kw_only=True)
class Sensing:
    """What stands between the machine and the observation; nothing by default.

    Noise is Gaussian, drawn at each control instant from the world's seed. All but the command is delayed.
    """

    angle_resolution: float = quantity("rad", "chosen: step of the joint encoders", default=0.0)
    velocity_noise: float = quantity("rad/s", "chosen: standard deviation", default=0.0)
    torque_noise: float = quantity("N·m", "chosen: standard deviation", default=0.0)
    force_noise: float = quantity("N", "chosen: standard deviation", default=0.0)
    delay: int = quantity("1", f"chosen: control steps from measurement to observation, at most {MAX_DELAY}", default=0)

    def __post_init__(self) -> None:
        """Check that nothing is negative and the delay a whole number of control steps."""
        require_number(self, "angle_resolution", at_least=0.0, at_most=0.1)
        for name in ("velocity_noise", "torque_noise", "force_noise"):
            require_number(self, name, at_least=0.0)
        require_number(self, "delay", at_least=0, at_most=MAX_DELAY)
        require(self.delay == int(self.delay), self, "delay", self.delay, "a whole number")


IDEAL_SENSING = Sensing()
"""Exact sensors without delay."""


@dataclass(frozen=True, kw_only=True)
class PathFollowing:
    """The task: path, hand, commanded pace, workspace, start and reward."""

    path: Path = quantity("1", "see Line", default=Line())
    hand: Operator = quantity("1", "see MultiSineHand", default=MultiSineHand())
    pace: float = quantity("m/s", "derived: the baseline's mean tip speed in Table I, 19.69 in/s", default=0.5)
    control_period: float = quantity("s", "chosen: 100 Hz control", default=0.01)
    error_max: float = quantity("m", "chosen: the workspace ends this far from the path", default=0.25)
    singularity_margin: float = quantity("1", "chosen: smallest |sin(θA − θB)| of the workspace", default=0.2)
    start_offset: float = quantity("m", "chosen: half-range of the start's normal offset, drawn at reset", default=0.0)
    friction_drift: float = quantity("1/s", "chosen: relative change of all clutch torques in a second", default=0.0)
    sensing: Sensing = quantity("1", "see Sensing", default=IDEAL_SENSING)
    reward: RewardWeights = quantity("1", "see RewardWeights", default=RewardWeights())

    def __post_init__(self) -> None:
        """Check each number by itself; ``check_machine`` checks the task against a machine."""
        require_kind(self, "path", Path)
        require_kind(self, "hand", *get_args(Operator))
        require_kind(self, "reward", RewardWeights)
        require_kind(self, "sensing", Sensing)
        require_number(self, "pace", above=0.0, at_most=SPEED_SCALE)
        require_number(self, "control_period", above=0.0, at_most=1.0)
        require_number(self, "error_max", above=0.0, at_most=ERROR_SCALE)
        require_number(self, "singularity_margin", above=0.0, below=1.0)
        require_number(self, "start_offset", at_least=0.0, below=self.error_max)
        require_number(self, "friction_drift", at_least=-1.0, at_most=1.0)


def substeps(task: PathFollowing, machine: Machine) -> int:
    """Return the number of substeps in a control period.

    Raises
    ------
    ParameterError
        If the substep does not divide the control period.
    """
    ratio = task.control_period / machine.substep
    count = round(ratio)
    require(
        count >= 1 and abs(ratio - count) < 1e-9 * ratio,
        task,
        "control_period",
        task.control_period,
        f"a whole multiple of the machine's substep {machine.substep:g} s",
    )
    return count


def held_machine(task: PathFollowing, machine: Machine) -> Machine:
    """Return the machine with what the task's hand adds to it at the tip.

    Raises
    ------
    ParameterError
        If both the machine and the task bring a hand, or the explicit spring of the hand is too stiff for the machine.
    """
    impedance = impedance_of(task.hand)
    if impedance == NO_HAND:
        return machine
    require(machine.hand == NO_HAND, machine, "hand", machine.hand, "none, since the task's hand brings its own")
    return replace(machine, hand=impedance)


def check_machine(task: PathFollowing, machine: Machine) -> None:
    """Check that a machine can do the task.

    Raises
    ------
    ParameterError
        If a point of the path or a start off it lies outside the arm's reach or too near to a singular pose, the path
        bends so much that its centre of curvature is within the workspace, the substep does not divide the control
        period, a sine is too fast for the substep, or the machine's hand has a spring, which would need an intent.
    """
    substeps(task, machine)
    if not isinstance(task.hand, RecordedForces):
        require(
            max(task.hand.frequencies) * machine.substep <= 0.1,
            task,
            "hand.frequencies",
            task.hand.frequencies,
            f"≤ {0.1 / machine.substep:g} Hz, a tenth of the substep's rate",
        )
    require(
        machine.hand.stiffness == 0.0, machine, "hand.stiffness", machine.hand.stiffness, "0: this hand has no intent"
    )
    held_machine(task, machine)
    arm = machine.arm
    _check_path(task.path, task.error_max, task.singularity_margin, arm.length_a, arm.length_b)
    _check_start(task, arm)


@lru_cache(maxsize=4096)
def _check_path(path: Path, error_max: float, margin: float, length_a: float, length_b: float) -> None:
    bend = path.max_curvature
    if bend * error_max > SHARPEST:
        raise ParameterError(
            f"PathFollowing.error_max must be ≤ {SHARPEST / bend:.4g} m, {SHARPEST:g} of the smallest radius of "
            f"{type(path).__name__}, got {error_max!r}"
        )
    points = path.sampled(_PATH_SAMPLES)
    outside = sin_elbow(length_a, length_b, points) <= margin
    if outside.any():
        x, y = points[outside.argmax()]
        raise ParameterError(
            f"PathFollowing.path must be within reach with |sin(θA − θB)| > {margin:g}, but ({x:.4g}, {y:.4g}) m "
            f"is not: {path!r:.400}"
        )


def _check_start(task: PathFollowing, arm: Arm) -> None:
    (x, y), heading = task.path.point(0.0), task.path.heading(0.0)
    ends = [
        (x - offset * math.sin(heading), y + offset * math.cos(heading))
        for offset in (-task.start_offset, task.start_offset)
    ]
    elbows = sin_elbow(arm.length_a, arm.length_b, np.array(ends))
    require(
        float(elbows.min()) > task.singularity_margin,
        task,
        "start_offset",
        task.start_offset,
        f"so small that all starts are within reach with |sin(θA − θB)| > {task.singularity_margin:g}",
    )


def sin_elbow(length_a: float, length_b: float, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return |sin(θA − θB)| with the tip at points (K, 2) [m], or −1 where the arm cannot reach; shape (K,)."""
    cos = ((points**2).sum(axis=1) - length_a**2 - length_b**2) / (2.0 * length_a * length_b)
    return np.where(np.abs(cos) <= 1.0, np.sqrt(np.maximum(1.0 - cos * cos, 0.0)), -1.0)


CONTEXT = Layout(
    (
        Field("time_constant", "s", "of the clutches", 0.5),
        Field("breakaway_factor", "1", "largest breakaway torque over that of the present clutches", 2.0),
        Field("dynamic_factor", "1", "largest dynamic torque over that of the present clutches", 2.0),
        Field("friction_drift", "1/s", "relative change of the clutch torques in a second", 0.5),
        Field("hand_mass", "kg", "of the hand at the tip", 5.0),
        Field("hand_damping", "N·s/m", "of the hand at the tip", 100.0),
        Field("hand_stiffness", "N/m", "of the hand towards its intent", 1000.0),
        Field("hand_push", "N", "constant force along the path", FORCE_SCALE),
    )
)
"""What the telemetry tells of machine and task, and the observation if it is asked to."""


class TaskModel(NamedTuple):
    """Constants of one world's task as the kernels see them."""

    path_first: float
    path_count: float
    path_length: float
    pace: float
    error_max: float
    singularity_margin: float
    start_offset: float
    friction_drift: float
    weight_error: float
    weight_pace: float
    weight_acceleration: float
    weight_effort: float
    weight_failure: float
    angle_resolution: float
    velocity_noise: float
    torque_noise: float
    force_noise: float
    delay: float
    senses_ideally: float


_FIELDS = (*Model._fields, *OperatorModel._fields, *TaskModel._fields)

PARAM_ROWS = len(_FIELDS)
"""Numbers of a context that the kernels work with: those of Model, OperatorModel and TaskModel in turn."""

OPERATOR = MODEL_ROWS
"""First row of the hand's constants."""

PATH_FIRST = _FIELDS.index("path_first")
PATH_COUNT = _FIELDS.index("path_count")
PATH_LENGTH = _FIELDS.index("path_length")
PACE = _FIELDS.index("pace")
ERROR_MAX = _FIELDS.index("error_max")
SINGULARITY_MARGIN = _FIELDS.index("singularity_margin")
START_OFFSET = _FIELDS.index("start_offset")
FRICTION_DRIFT = _FIELDS.index("friction_drift")
WEIGHT_ERROR = _FIELDS.index("weight_error")
WEIGHT_PACE = _FIELDS.index("weight_pace")
WEIGHT_ACCELERATION = _FIELDS.index("weight_acceleration")
WEIGHT_EFFORT = _FIELDS.index("weight_effort")
WEIGHT_FAILURE = _FIELDS.index("weight_failure")
ANGLE_RESOLUTION = _FIELDS.index("angle_resolution")
VELOCITY_NOISE = _FIELDS.index("velocity_noise")
TORQUE_NOISE = _FIELDS.index("torque_noise")
FORCE_NOISE = _FIELDS.index("force_noise")
DELAY = _FIELDS.index("delay")
SENSES_IDEALLY = _FIELDS.index("senses_ideally")
PUSH = _FIELDS.index("push")
RANDOM_PHASES = _FIELDS.index("random_phases")
INTENT_SPEED = _FIELDS.index("intent_speed")
INTENT_RISE = _FIELDS.index("intent_rise")
INTENT_LEAD = _FIELDS.index("intent_lead")
RECORD_FIRST = _FIELDS.index("record_first")
RECORD_COUNT = _FIELDS.index("record_count")
AMPLITUDE = _FIELDS.index("amplitude_0")
PHASE = _FIELDS.index("phase_0")
TURN = _FIELDS.index("turn_0_cos")


def context_rows(
    task: PathFollowing, machine: Machine, arcs: tuple[int, int], recording: tuple[int, int]
) -> tuple[float, ...]:
    """Return the constants of a task on a machine for the kernels, and what an observation may tell of them.

    Parameters
    ----------
    task, machine
        What fits together by ``check_machine``.
    arcs, recording
        Where the arcs of the path and the hand's recording begin in the array of constants, and how many there are.
    """
    weights, sensing = task.reward, task.sensing
    model = TaskModel(
        *arcs,
        task.path.length,
        task.pace,
        task.error_max,
        task.singularity_margin,
        task.start_offset,
        task.friction_drift,
        weights.error,
        weights.pace,
        weights.acceleration,
        weights.effort,
        weights.failure,
        sensing.angle_resolution,
        sensing.velocity_noise,
        sensing.torque_noise,
        sensing.force_noise,
        sensing.delay,
        float(sensing == IDEAL_SENSING),
    )
    return (
        *model_of(held_machine(task, machine)),
        *operator_model(task.hand, task.pace, machine.substep, recording),
        *model,
        *context_values(task, machine),
    )


def context_values(task: PathFollowing, machine: Machine) -> tuple[float, ...]:
    """Return the entries of ``CONTEXT`` in their units."""
    clutch, hand = machine.clutch, held_machine(task, machine).hand
    top = clutch.voltage_max
    scale = math.fsum(machine.clutch_scale) / len(machine.clutch_scale)
    return (
        clutch.time_constant,
        scale * clutch.breakaway.torque(top) / PRESENT_CLUTCH.breakaway.torque(top),
        scale * clutch.dynamic.torque(top) / PRESENT_CLUTCH.dynamic.torque(top),
        task.friction_drift,
        hand.mass,
        hand.damping,
        hand.stiffness,
        task.hand.push if isinstance(task.hand, MultiSineHand) else 0.0,
    )


CONTEXT_ROWS = PARAM_ROWS + len(CONTEXT)
"""Numbers of a context in the array of constants: those that kernels work with, then the entries of ``CONTEXT``."""


def observation_layout(machine: Machine, sensors: Sensors, observe_context: bool = False) -> Layout:
    """Return the layout of the observation; each entry is stored relative to its scale and limited to [−1, 1].

    With ``observe_context`` it ends with the entries of ``CONTEXT``.

    Raises
    ------
    ParameterError
        If there are no such sensors.
    """
    if sensors not in get_args(Sensors):
        raise ParameterError(f"sensors must be one of {', '.join(get_args(Sensors))}, got {sensors!r}")
    clutches = range(1, 5)
    volts = machine.clutch.voltage_max
    layout = [
        Field("cos_a", "1", "cosine of link A's angle"),
        Field("sin_a", "1", "sine of link A's angle"),
        Field("cos_b", "1", "cosine of link B's angle"),
        Field("sin_b", "1", "sine of link B's angle"),
        Field("omega_a", "rad/s", "angular velocity of link A", OMEGA_SCALE),
        Field("omega_b", "rad/s", "angular velocity of link B", OMEGA_SCALE),
        Field("normal_error", "m", "distance from the path, positive to its left", ERROR_SCALE),
        Field("progress", "1", "projection of the tip on the path, over its length"),
        Field("heading_cos", "1", "cosine of the path's heading there"),
        Field("heading_sin", "1", "sine of the path's heading there"),
        Field("curvature", "1/m", "curvature of the path there, positive to the left", CURVATURE_SCALE),
        Field("speed_along", "m/s", "tip velocity along the path", SPEED_SCALE),
        Field("speed_across", "m/s", "tip velocity across the path, positive to its left", SPEED_SCALE),
        Field("pace", "m/s", "commanded mean speed along the path", SPEED_SCALE),
        *(Field(f"volts_{x}", "V", f"last voltage of clutch {x}", volts) for x in clutches),
    ]
    if sensors != "encoders":
        layout += [Field(f"torque_{x}", "N·m", f"generated torque of clutch {x}", TORQUE_SCALE) for x in clutches]
    if sensors == "force":
        layout += [
            Field("force_along", "N", "hand's force along the path", FORCE_SCALE),
            Field("force_across", "N", "hand's force across the path, positive to its left", FORCE_SCALE),
        ]
    return Layout((*layout, *(CONTEXT.fields if observe_context else ())))


_CLUTCHES = range(1, 5)

TELEMETRY = Layout(
    (
        Field("time", "s", "since the start of the episode"),
        Field("theta_a", "rad", "angle of link A"),
        Field("theta_b", "rad", "angle of link B"),
        Field("tip_x", "m", "tip position"),
        Field("tip_y", "m", "tip position"),
        Field("tip_velocity_x", "m/s", "tip velocity"),
        Field("tip_velocity_y", "m/s", "tip velocity"),
        Field("acceleration_x", "m/s²", "tip acceleration, mean over the control period"),
        Field("acceleration_y", "m/s²", "tip acceleration, mean over the control period"),
        Field("arc_length", "m", "projection of the tip on the path"),
        Field("reached", "m", "largest arc length so far"),
        Field("normal_error", "m", "distance from the path, positive to its left"),
        Field("force_x", "N", "hand's force in the last substep"),
        Field("force_y", "N", "hand's force in the last substep"),
        Field("mode", "1", "ClutchMode after the last substep"),
        *(Field(f"volts_{x}", "V", f"voltage of clutch {x}") for x in _CLUTCHES),
        *(Field(f"torque_{x}", "N·m", f"generated torque of clutch {x}, last substep") for x in _CLUTCHES),
        *(Field(f"power_{x}", "W", f"power of clutch {x} on the arm, last substep") for x in _CLUTCHES),
        Field("kinetic_energy", "J", "of the arm, with the hand's mass"),
        Field("hand_work", "J", "work of the hand in this control period"),
        Field("dissipated", "J", "energy taken by the clutches in this control period"),
        Field("numerical_loss", "J", "the integrator's loss in this control period"),
        Field("residual", "J", "the integrator's gain from the turning mass matrix in this control period"),
        Field("reward_error", "1", "reward term"),
        Field("reward_pace", "1", "reward term"),
        Field("reward_acceleration", "1", "reward term"),
        Field("reward_effort", "1", "reward term"),
        Field("reward_failure", "1", "reward term"),
        Field("reward", "1", "sum of the reward terms"),
        Field("is_success", "1", "1 once the end of the path is reached"),
        Field("context", "1", "number of the drawn machine and task, 0 where none is drawn"),
        Field("terminated", "1", "1 at the end of the path and on leaving the workspace"),
        *(replace(field, scale=1.0) for field in CONTEXT.fields),
    )
)
"""Layout of the telemetry row that each control step writes; all entries in their units."""

T_TIME = TELEMETRY.index("time")
T_THETA = TELEMETRY.index("theta_a")
T_TIP = TELEMETRY.index("tip_x")
T_VELOCITY = TELEMETRY.index("tip_velocity_x")
T_ACCELERATION = TELEMETRY.index("acceleration_x")
T_ARC_LENGTH = TELEMETRY.index("arc_length")
T_REACHED = TELEMETRY.index("reached")
T_ERROR = TELEMETRY.index("normal_error")
T_FORCE = TELEMETRY.index("force_x")
T_MODE = TELEMETRY.index("mode")
T_VOLTS = TELEMETRY.index("volts_1")
T_TORQUE = TELEMETRY.index("torque_1")
T_POWER = TELEMETRY.index("power_1")
T_KINETIC = TELEMETRY.index("kinetic_energy")
T_ENERGY = TELEMETRY.index("hand_work")
T_REWARD = TELEMETRY.index("reward_error")
T_SUCCESS = TELEMETRY.index("is_success")
T_CONTEXT = TELEMETRY.index("context")
T_TERMINATED = TELEMETRY.index("terminated")
T_TOLD = TELEMETRY.index(CONTEXT.names[0])
TOLD = len(CONTEXT)


class Situation(NamedTuple):
    """Where a world is with respect to its path at a control instant [m, 1/m, m/s]."""

    arc_length: float
    normal_error: float
    heading_cos: float
    heading_sin: float
    curvature: float
    speed_along: float
    speed_across: float


@device
def situation(
    arc_length: float,
    normal_error: float,
    heading_cos: float,
    heading_sin: float,
    curvature: float,
    v_x: float,
    v_y: float,
) -> Situation:
    """Return where a world is from the projection of its tip and the tip's velocity [m/s]."""
    return Situation(
        arc_length,
        normal_error,
        heading_cos,
        heading_sin,
        curvature,
        v_x * heading_cos + v_y * heading_sin,
        v_y * heading_cos - v_x * heading_sin,
    )


@device
def observe(
    s: Any,
    row: int,
    i: int,
    q: Motion,
    at: Situation,
    path_length: float,
    pace: float,
    volts: PerClutch,
    torques: PerClutch,
    force_along: float,
    force_across: float,
) -> None:
    """Write all entries that ``observation_layout`` may hold, in its order and in their units, from ``row`` on."""
    s[row, i] = q.cos_a
    s[row + 1, i] = q.sin_a
    s[row + 2, i] = q.cos_b
    s[row + 3, i] = q.sin_b
    s[row + 4, i] = q.omega_a
    s[row + 5, i] = q.omega_b
    s[row + 6, i] = at.normal_error
    s[row + 7, i] = at.arc_length / path_length
    s[row + 8, i] = at.heading_cos
    s[row + 9, i] = at.heading_sin
    s[row + 10, i] = at.curvature
    s[row + 11, i] = at.speed_along
    s[row + 12, i] = at.speed_across
    s[row + 13, i] = pace
    store_four(s, row + 14, i, volts)
    store_four(s, row + 18, i, torques)
    s[row + 22, i] = force_along
    s[row + 23, i] = force_across


@device
def reached_end(arc_length: float, path_length: float) -> bool:
    """Tell whether the tip has reached the end of the path."""
    return arc_length >= path_length


@device
def left_workspace(
    arc_length: float, normal_error: float, q: Motion, error_max: float, singularity_margin: float
) -> bool:
    """Tell whether the tip is too far from the path, has backed off its start, or the pose is near a singular one."""
    far = (abs(normal_error) > error_max) | (arc_length < -error_max)
    return far | (abs(sin_difference(q)) < singularity_margin)


@device
def reward_terms(
    p: Any,
    row: int,
    i: int,
    at: Situation,
    acceleration: float,
    volts: PerClutch,
    voltage_max: float,
    period: float,
) -> tuple[float, float, float, float]:
    """Return the running reward terms of a control step: error, pace, acceleration, effort. None is positive.

    The parameters of world i begin at ``row``.
    """
    mean_square = 0.25 * (volts.x1 * volts.x1 + volts.x2 * volts.x2 + volts.x3 * volts.x3 + volts.x4 * volts.x4)
    return (
        -period * p[row + WEIGHT_ERROR, i] * abs(at.normal_error) / ERROR_UNIT,
        -period * p[row + WEIGHT_PACE, i] * abs(at.speed_along - p[row + PACE, i]) / p[row + PACE, i],
        -period * p[row + WEIGHT_ACCELERATION, i] * acceleration / ACCELERATION_UNIT,
        -period * p[row + WEIGHT_EFFORT, i] * mean_square / (voltage_max * voltage_max),
    )


@device
def motion_at(arm: Linkage, x: float, y: float) -> Motion:
    """Return the arm at rest with the tip at (x, y) [m]; θB leads θA."""
    cos = (x * x + y * y - arm.length_a * arm.length_a - arm.length_b * arm.length_b) / (
        2.0 * arm.length_a * arm.length_b
    )
    sin = math.sqrt(1.0 - cos * cos)
    re = arm.length_a + arm.length_b * cos
    im = arm.length_b * sin
    square = x * x + y * y
    cos_a = (x * re + y * im) / square
    sin_a = (y * re - x * im) / square
    cos_b = cos_a * cos - sin_a * sin
    sin_b = sin_a * cos + cos_a * sin
    return Motion(math.atan2(sin_a, cos_a), math.atan2(sin_b, cos_b), 0.0, 0.0, cos_a, sin_a, cos_b, sin_b)
