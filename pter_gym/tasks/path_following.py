"""Follow a path while a hand pushes along it and disturbs across it (paper section IV-A)."""

import math
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple, get_args

from pter_gym._jit import device
from pter_gym.errors import ParameterError
from pter_gym.layout import Field, Layout
from pter_gym.operators import MultiSineHand
from pter_gym.params import Machine, quantity, require, require_number
from pter_gym.paths import Line, LineModel, line_model, project
from pter_gym.physics.arm import Linkage, Motion, sin_difference, tip_position, tip_velocity
from pter_gym.physics.clutch import PerClutch
from pter_gym.physics.model import MODEL_ROWS, store_four

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
"""Largest number of entries of an observation."""

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
class PathFollowing:
    """The task: path, hand, commanded pace, workspace, start and reward."""

    path: Line = quantity("1", "see Line", default=Line())
    hand: MultiSineHand = quantity("1", "see MultiSineHand", default=MultiSineHand())
    pace: float = quantity("m/s", "derived: the baseline's mean tip speed in Table I, 19.69 in/s", default=0.5)
    control_period: float = quantity("s", "chosen: 100 Hz control", default=0.01)
    error_max: float = quantity("m", "chosen: the workspace ends this far from the path", default=0.25)
    singularity_margin: float = quantity("1", "chosen: smallest |sin(θA − θB)| of the workspace", default=0.2)
    start_offset: float = quantity("m", "chosen: half-range of the start's normal offset, drawn at reset", default=0.0)
    reward: RewardWeights = quantity("1", "see RewardWeights", default=RewardWeights())

    def __post_init__(self) -> None:
        """Check each number by itself; ``check_machine`` checks the task against a machine."""
        for name, kind in (("path", Line), ("hand", MultiSineHand), ("reward", RewardWeights)):
            require(isinstance(getattr(self, name), kind), self, name, getattr(self, name), f"of type {kind.__name__}")
        require_number(self, "pace", above=0.0, at_most=SPEED_SCALE)
        require_number(self, "control_period", above=0.0, at_most=1.0)
        require_number(self, "error_max", above=0.0, at_most=ERROR_SCALE)
        require_number(self, "singularity_margin", above=0.0, below=1.0)
        require_number(self, "start_offset", at_least=0.0, below=self.error_max)


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


def check_machine(task: PathFollowing, machine: Machine) -> None:
    """Check that a machine can do the task.

    Raises
    ------
    ParameterError
        If a point of the path lies outside the arm's reach or too near to a singular pose, the substep does not divide
        the control period, a sine is too fast for the substep, or the machine's hand has a spring, which would need a
        target.
    """
    substeps(task, machine)
    fastest = max(task.hand.frequencies)
    require(
        fastest * machine.substep <= 0.1,
        task,
        "hand.frequencies",
        task.hand.frequencies,
        f"≤ {0.1 / machine.substep:g} Hz, a tenth of the substep's rate",
    )
    require(
        machine.hand.stiffness == 0.0, machine, "hand.stiffness", machine.hand.stiffness, "0: this hand has no intent"
    )
    path = task.path
    for k in range(_PATH_SAMPLES):
        x, y = path.point(path.length * k / (_PATH_SAMPLES - 1))
        require(
            sin_elbow(machine.arm.length_a, machine.arm.length_b, x, y) > task.singularity_margin,
            task,
            "path",
            path,
            f"within reach with |sin(θA − θB)| > {task.singularity_margin:g}, but ({x:.4g}, {y:.4g}) m is not",
        )


def sin_elbow(length_a: float, length_b: float, x: float, y: float) -> float:
    """Return |sin(θA − θB)| with the tip at (x, y) [m], or −1 where the arm cannot reach."""
    cos = (x * x + y * y - length_a**2 - length_b**2) / (2.0 * length_a * length_b)
    return math.sqrt(1.0 - cos * cos) if abs(cos) <= 1.0 else -1.0


class TaskModel(NamedTuple):
    """Constants of one world's task as the kernels see them: rows of the parameter array after those of Model."""

    start_x: float
    start_y: float
    heading_cos: float
    heading_sin: float
    path_length: float
    pace: float
    error_max: float
    singularity_margin: float
    start_offset: float
    weight_error: float
    weight_pace: float
    weight_acceleration: float
    weight_effort: float
    weight_failure: float
    push: float
    random_phases: float
    amplitude_0: float
    amplitude_1: float
    amplitude_2: float
    amplitude_3: float
    amplitude_4: float
    phase_0: float
    phase_1: float
    phase_2: float
    phase_3: float
    phase_4: float
    turn_0_cos: float
    turn_0_sin: float
    turn_1_cos: float
    turn_1_sin: float
    turn_2_cos: float
    turn_2_sin: float
    turn_3_cos: float
    turn_3_sin: float
    turn_4_cos: float
    turn_4_sin: float


def _row(name: str) -> int:
    return MODEL_ROWS + TaskModel._fields.index(name)


PARAM_ROWS = MODEL_ROWS + len(TaskModel._fields)
PACE = _row("pace")
ERROR_MAX = _row("error_max")
SINGULARITY_MARGIN = _row("singularity_margin")
START_OFFSET = _row("start_offset")
WEIGHT_ERROR = _row("weight_error")
WEIGHT_PACE = _row("weight_pace")
WEIGHT_ACCELERATION = _row("weight_acceleration")
WEIGHT_EFFORT = _row("weight_effort")
WEIGHT_FAILURE = _row("weight_failure")
PUSH = _row("push")
RANDOM_PHASES = _row("random_phases")
AMPLITUDE = _row("amplitude_0")
PHASE = _row("phase_0")
TURN = _row("turn_0_cos")


def task_model(task: PathFollowing, machine: Machine) -> TaskModel:
    """Return the constants of a task on a machine for the kernels."""
    weights = task.reward
    angles = [2.0 * math.pi * f * machine.substep for f in task.hand.frequencies]
    turns = [part for angle in angles for part in (math.cos(angle), math.sin(angle))]
    return TaskModel(
        *line_model(task.path),
        task.pace,
        task.error_max,
        task.singularity_margin,
        task.start_offset,
        weights.error,
        weights.pace,
        weights.acceleration,
        weights.effort,
        weights.failure,
        task.hand.push,
        float(task.hand.random_phases),
        *task.hand.amplitudes,
        *task.hand.phases,
        *turns,
    )


@device
def line_of(p: Any, row: int, i: int) -> LineModel:
    """Read the path of world i; its parameters begin at ``row``."""
    return LineModel(
        p[row + MODEL_ROWS, i],
        p[row + MODEL_ROWS + 1, i],
        p[row + MODEL_ROWS + 2, i],
        p[row + MODEL_ROWS + 3, i],
        p[row + MODEL_ROWS + 4, i],
    )


def observation_layout(machine: Machine, sensors: Sensors) -> Layout:
    """Return the layout of the observation; each entry is stored relative to its scale and limited to [−1, 1].

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
    return Layout(tuple(layout))


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
        Field("terminated", "1", "1 at the end of the path and on leaving the workspace"),
    )
)
"""Layout of the telemetry row that each control step writes; all entries in their units."""

T_TIME = TELEMETRY.index("time")
T_THETA = TELEMETRY.index("theta_a")
T_TIP = TELEMETRY.index("tip_x")
T_VELOCITY = TELEMETRY.index("tip_velocity_x")
T_ACCELERATION = TELEMETRY.index("acceleration_x")
T_ARC_LENGTH = TELEMETRY.index("arc_length")
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
T_TERMINATED = TELEMETRY.index("terminated")


class Situation(NamedTuple):
    """Where a world is with respect to its path at a control instant [m, m/s]."""

    arc_length: float
    normal_error: float
    speed_along: float
    speed_across: float


@device
def situation(line: LineModel, arm: Linkage, q: Motion) -> Situation:
    """Return where a world is with respect to its path."""
    x, y = tip_position(arm, q)
    v_x, v_y = tip_velocity(arm, q)
    arc_length, normal_error = project(line, x, y)
    return Situation(
        arc_length,
        normal_error,
        v_x * line.heading_cos + v_y * line.heading_sin,
        v_y * line.heading_cos - v_x * line.heading_sin,
    )


@device
def observe(
    s: Any,
    row: int,
    i: int,
    q: Motion,
    at: Situation,
    line: LineModel,
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
    s[row + 7, i] = at.arc_length / line.path_length
    s[row + 8, i] = line.heading_cos
    s[row + 9, i] = line.heading_sin
    s[row + 10, i] = 0.0
    s[row + 11, i] = at.speed_along
    s[row + 12, i] = at.speed_across
    s[row + 13, i] = pace
    store_four(s, row + 14, i, volts)
    store_four(s, row + 18, i, torques)
    s[row + 22, i] = force_along
    s[row + 23, i] = force_across


@device
def reached_end(line: LineModel, at: Situation) -> bool:
    """Tell whether the tip has reached the end of the path."""
    return at.arc_length >= line.path_length


@device
def left_workspace(at: Situation, q: Motion, error_max: float, singularity_margin: float) -> bool:
    """Tell whether the tip is too far from the path, has backed off its start, or the pose is near a singular one."""
    far = (abs(at.normal_error) > error_max) | (at.arc_length < -error_max)
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
def start_motion(arm: Linkage, line: LineModel, offset: float) -> Motion:
    """Return the arm at rest with the tip at the start of the path, off it by a normal offset [m]; θB leads θA."""
    x = line.start_x - offset * line.heading_sin
    y = line.start_y + offset * line.heading_cos
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
