"""The task as its user states it (path, hand, pace, workspace, …), checked against a machine."""

import math
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from types import MappingProxyType
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from pter_gym._internal.fields import Checked, parameter, require, require_number
from pter_gym._physics.arm import elbow_cosine
from pter_gym._physics.arrangement import Arrangement
from pter_gym._physics.model import Model, arrangement_of, max_damping, model_of
from pter_gym._physics.stability import (
    MAX_CONDITION,
    MAX_SUBSTEPS,
    condition,
    largest_energy,
    largest_force,
    largest_travel,
)
from pter_gym.errors import ParameterError, unknown_name
from pter_gym.hands import MultiSineHand, Operator
from pter_gym.hands._operators import NO_HAND
from pter_gym.params import BASELINE, SLOTS, Arm, Hand, Machine
from pter_gym.params._machine import ClutchTorques
from pter_gym.paths import Line, Path
from pter_gym.paths._arcs import Arcs, ArcSegment
from pter_gym.paths._reach import SINGULARITY_MARGIN, check_reach
from pter_gym.tasks.path_following._observation import BOUND, ERROR_SCALE, SPEED_SCALE
from pter_gym.tasks.path_following._pace import COMMANDED_PACE
from pter_gym.tasks.path_following._reward import RewardWeights

MAX_DELAY = 2
"""Largest delay of the sensors in control steps."""

MAX_CURVATURE_RATIO = 0.9
"""Largest half-width of a workspace over a path's radius, so that the nearest point is unique."""

MAX_HALF_WIDTH = BOUND * ERROR_SCALE
"""Largest half-width of a workspace [m]: what an observation can tell."""

MAX_START_SPEED_ALONG = 2.0
"""Largest speed along the path of an episode that begins moving, over the commanded pace."""

MAX_START_SPEED_ACROSS = 0.5
"""Largest speed across the path of such an episode, over the commanded pace."""

_SHARE: dict[str, Any] = {"at_least": 0.0, "at_most": 1.0}


@dataclass(frozen=True, kw_only=True)
class Sensing(Checked):
    """Sensor effects between the machine and the observation; none by default.

    Noise is Gaussian, drawn at each control instant from the world's seed. Everything except the
    command is delayed.
    """

    angle_resolution: float = parameter(
        "rad", "chosen: step of the joint encoders", at_least=0.0, at_most=0.1, default=0.0
    )
    velocity_noise: float = parameter(
        "rad/s", "chosen: standard deviation", at_least=0.0, default=0.0
    )
    encoder_velocity: bool = parameter(
        "1",
        "chosen: True for velocities that are differences of encoder readings over the control "
        "period",
        default=False,
        later=True,
    )
    torque_noise: float = parameter("N·m", "chosen: standard deviation", at_least=0.0, default=0.0)
    force_noise: float = parameter("N", "chosen: standard deviation", at_least=0.0, default=0.0)
    delay: int = parameter(
        "1",
        f"chosen: control steps from measurement to observation, at most {MAX_DELAY}",
        at_least=0,
        below=MAX_DELAY + 1,
        default=0,
    )


IDEAL_SENSING = Sensing()
"""Exact sensors without delay."""


@dataclass(frozen=True, kw_only=True)
class Starts(Checked):
    """How episodes begin; by default at rest at the start of the path, clutches released.

    Other starts are for training, to explore more states. A ``moving`` start puts the tip anywhere
    along the path, with a uniformly drawn offset, at up to twice the commanded pace; a ``gripped``
    start is at rest at the path's start. In both, the clutches have settled at random voltages, and
    each is released with a probability of one in five.
    """

    moving: float = parameter("1", "chosen: share of the episodes", **_SHARE, default=0.0)
    gripped: float = parameter("1", "chosen: share of the episodes", **_SHARE, default=0.0)
    offset: float = parameter(
        "m",
        "chosen: half-range of the distance from the path where an episode begins moving",
        at_least=0.0,
        at_most=MAX_HALF_WIDTH,
        default=0.05,
    )

    def __post_init__(self) -> None:
        """Check that the shares add up to at most 1."""
        super().__post_init__()
        require_number(self, "gripped", at_most=1.0 - self.moving)


@dataclass(frozen=True, kw_only=True)
class Failure(Checked):
    """How and when one clutch fails; policies are not told.

    From then on it gives a share of its torque, 0 if it is dead, or it holds a voltage whatever the
    command is, or both. Its torque changes with the lag of the clutch, and observations, telemetry
    and the reward's effort go on to show the command.
    """

    clutch: int = parameter("1", "number of the clutch, from 1", at_least=1, below=SLOTS + 1)
    torque: float = parameter(
        "1",
        "chosen: share of its torque that is left, viscous friction aside",
        **_SHARE,
        default=1.0,
    )
    volts: float | None = parameter(
        "V", "chosen: voltage that it holds; None where it follows the command", default=None
    )
    after: float = parameter(
        "s",
        "chosen: time of the episode after which it fails; 0 for from the start",
        at_least=0.0,
        default=0.0,
    )

    def __post_init__(self) -> None:
        """Check each field, and that something fails."""
        super().__post_init__()
        if self.volts is not None:
            require_number(self, "volts", at_least=0.0)
        fails = self.torque < 1.0 or self.volts is not None
        require(fails, self, "torque", "below 1 for a clutch that holds no voltage")


AT_REST = Starts()
"""All episodes begin at rest at the start of the path."""

STARTS = MappingProxyType({"rest": AT_REST, "path": Starts(moving=0.4, gripped=0.3)})
"""Starts by name: those of test episodes, and those to train with."""


def find_starts(starts: Starts | str) -> Starts:
    """Return starts by themselves or their name in ``STARTS``, or raise a ParameterError."""
    if isinstance(starts, str) and starts not in STARTS:
        raise unknown_name("starts", starts, STARTS)
    return STARTS[starts] if isinstance(starts, str) else starts


_NO_BAND = "chosen: 0 for a path to follow; more for a corridor or a wall beside it"


@dataclass(frozen=True, kw_only=True)
class PathFollowing(Checked):
    """The task: path, hand, commanded pace, workspace, start and reward.

    With ``free_left`` or ``free_right`` the path is a virtual fixture: the tip is free within these
    distances to its left and right, and errors count from there. Equal ones make a corridor. One of
    0 makes the path the edge of a wall.
    """

    path: Path = parameter("1", "see Line", default=Line())
    hand: Operator = parameter("1", "see MultiSineHand", default=MultiSineHand())
    pace: float = parameter(
        "m/s",
        "derived: the baseline's mean tip speed in Table I, 19.69 in/s",
        above=0.0,
        at_most=BOUND * SPEED_SCALE,
        default=COMMANDED_PACE,
    )
    control_period: float = parameter(
        "s", "chosen: 100 Hz control", above=0.0, at_most=1.0, default=0.01
    )
    error_max: float = parameter(
        "m",
        "chosen: the workspace ends this far from the path",
        above=0.0,
        at_most=MAX_HALF_WIDTH,
        default=0.25,
    )
    truncation_error: float = parameter(
        "m",
        "chosen: if not above error_max, an episode is truncated this far from the path; by default"
        " none is",
        above=0.0,
        at_most=2.0 * MAX_HALF_WIDTH,
        default=2.0 * MAX_HALF_WIDTH,
    )
    free_left: float = parameter(
        "m", _NO_BAND, at_least=0.0, at_most=MAX_HALF_WIDTH, default=0.0, later=True
    )
    free_right: float = parameter(
        "m", _NO_BAND, at_least=0.0, at_most=MAX_HALF_WIDTH, default=0.0, later=True
    )
    arrival: float = parameter(
        "m",
        "chosen: half of error_max's default; within this of the path its end is a success",
        above=0.0,
        default=0.125,
    )
    singularity_margin: float = parameter(
        "1",
        "chosen: smallest |sin(θA − θB)| of the workspace",
        above=0.0,
        below=1.0,
        default=SINGULARITY_MARGIN,
    )
    start_offset: float = parameter(
        "m",
        "chosen: half-range of the start's normal offset, drawn at reset",
        at_least=0.0,
        default=0.0,
    )
    friction_drift: float = parameter(
        "1/s",
        "chosen: relative change of all clutch torques in a second",
        at_least=-1.0,
        at_most=1.0,
        default=0.0,
    )
    failures: tuple[Failure, ...] = parameter(
        "1", "chosen: what fails, see Failure; by default nothing", default=(), later=True
    )
    sensing: Sensing = parameter("1", "see Sensing", default=IDEAL_SENSING)
    starts: Starts = parameter("1", "see Starts", default=AT_REST)
    reward: RewardWeights = parameter("1", "see RewardWeights", default=RewardWeights())

    def __post_init__(self) -> None:
        """Check each field, and that starts are within the workspace."""
        super().__post_init__()
        require_number(self, "start_offset", below=min(self.error_max, self.truncation_error))
        failures = cast("object", self.failures)
        each = cast("tuple[object, ...]", failures) if isinstance(failures, tuple) else (None,)
        require(
            all(isinstance(one, Failure) for one in each)
            and len({one.clutch for one in self.failures}) == len(each),
            self,
            "failures",
            "a tuple of Failures, each of another clutch",
        )


def substeps(task: PathFollowing, machine: Machine) -> int:
    """Return the number of substeps in a control period: the fewest not longer than the machine's.

    Raises
    ------
    ParameterError
        If there would be too many.
    """
    count = math.ceil(task.control_period / machine.substep * (1.0 - 1e-9))
    require(
        count <= MAX_SUBSTEPS,
        task,
        "control_period",
        f"at most {MAX_SUBSTEPS} times as long as the machine's substep, {machine.substep:g} s",
    )
    return count


def sensing_of(task: PathFollowing, machine: Machine) -> Sensing:
    """Return a task's sensors, with the delay of a machine that has one, in whole control steps.

    Raises
    ------
    ParameterError
        If the delay is longer than a task allows.
    """
    if machine.delay == 0.0:
        return task.sensing
    steps, longest = round(machine.delay / task.control_period), MAX_DELAY * task.control_period
    accepted = (
        f"at most {longest:g} s, {MAX_DELAY} control steps (a task with a longer control_period "
        "takes more)"
    )
    require(steps <= MAX_DELAY, machine, "delay", accepted)
    return replace(task.sensing, delay=steps)


@dataclass(frozen=True)
class HeldMachine:
    """A machine with a task's hand at its tip, and what the integrator can hold of it.

    Attributes
    ----------
    machine
        It, with substeps that fill a control period.
    period
        Control period [s].
    """

    machine: Machine
    period: float

    @cached_property
    def model(self) -> Model:
        """Its constants."""
        return model_of(self.machine)

    @cached_property
    def arrangement(self) -> Arrangement:
        """Its W."""
        return arrangement_of(self.machine)

    @cached_property
    def factors(self) -> ClutchTorques:
        """Its largest torques over those of the present clutches."""
        clutch, most = self.machine.clutch, self.machine.clutch.largest
        usual = BASELINE.clutch.torques(clutch.voltage_max)
        scale = math.fsum(self.machine.slot_scale) / len(self.machine.clutches)
        return ClutchTorques(
            scale * most.breakaway / usual.breakaway, scale * most.dynamic / usual.dynamic
        )

    @cached_property
    def condition(self) -> float:
        """A bound of the condition of its mass matrix."""
        return condition(self.model.arm, self.machine.substep)

    @cached_property
    def force(self) -> float:
        """The largest force of a hand [N]."""
        return largest_force(self.model.arm, self.machine.substep, self.period)

    @cached_property
    def travel(self) -> float:
        """How far the tip may move in a control step [m]."""
        return largest_travel(self.model.arm, self.machine.substep, self.period)


def held_machine(task: PathFollowing, machine: Machine) -> HeldMachine:
    """Return the machine with the task's hand at the tip.

    Raises
    ------
    ParameterError
        If both the machine and the task have a hand, the explicit spring of the hand is too stiff
        for the machine, or there would be too many substeps.
    """
    impedance, period = task.hand.impedance, task.control_period
    if impedance != NO_HAND:
        accepted = "none, since the task's hand brings its own"
        require(machine.hand == NO_HAND, machine, "hand", accepted)
    return _held(machine, impedance, period / substeps(task, machine), period)


@lru_cache(maxsize=256)
def _held(machine: Machine, impedance: Hand, substep: float, period: float) -> HeldMachine:
    changed = {"hand": impedance} if impedance != NO_HAND else {}
    changed |= {"substep": substep} if substep != machine.substep else {}
    return HeldMachine(replace(machine, **changed) if changed else machine, period)


def check_machine(task: PathFollowing, machine: Machine, room: float = 1.0) -> None:
    """Check that a machine can do the task, whose path keeps ``room`` times its margin.

    Raises
    ------
    ParameterError
        If a point of the path or a start off it lies outside the arm's reach or too close to a
        singular pose, the path bends so much that its centre of curvature is within the workspace,
        a control period has too many substeps, a clutch that fails isn't there or holds more than
        the largest voltage, a sine is too fast for the substep, the machine's hand has a spring,
        which would need an intent, its delay is too long, or the arm may become too fast for the
        integrator (``pter_gym._physics.stability``).
    """
    sensing_of(task, machine)
    _check_failures(task, machine)
    substep = held_machine(task, machine).machine.substep
    require(
        max(task.hand.frequencies, default=0.0) * substep <= 0.1,
        task,
        "hand.frequencies",
        f"≤ {0.1 / substep:g} Hz, a tenth of the substep's rate",
    )
    require(machine.hand.stiffness == 0.0, machine, "hand.stiffness", "0: this hand has no intent")
    check_motion(task, machine)
    arm = machine.arm
    widest = task.error_max + max(task.free_left, task.free_right)
    margin = room * task.singularity_margin
    accepted = f"< {1.0 / room:g}, so that drawn paths keep {room:g} times as much"
    require(margin < 1.0, task, "singularity_margin", accepted)
    _check_path(task.path, widest, margin, arm.length_a, arm.length_b)
    if task.start_offset != 0.0:
        _check_start(task, arm, margin)


def _check_failures(task: PathFollowing, machine: Machine) -> None:
    count, most = len(machine.clutches), machine.clutch.voltage_max
    for failure in task.failures:
        require(
            failure.clutch <= count, failure, "clutch", f"one of the machine's {count} clutches"
        )
        if failure.volts is not None:
            require_number(failure, "volts", at_most=most)


def check_motion(task: PathFollowing, machine: Machine) -> None:
    """Check that the integrator can handle the motion that the hand and the start cause.

    Raises
    ------
    ParameterError
        If it cannot, or if ``held_machine`` raises one.
    """
    held = held_machine(task, machine)
    require(
        held.condition <= MAX_CONDITION,
        machine,
        "arm",
        "so far from singular that the mass matrix with the hand's mass and damping has a "
        f"condition of at most {MAX_CONDITION:g}, not {held.condition:.3g}",
    )
    force, most = strongest(task, machine), held.force
    require(
        force <= most,
        task,
        "hand",
        f"at most {most:.4g} N strong on this arm, not {force:.4g} N, for which the integrator "
        "could lose the motion within a control step; a shorter substep or control_period allows "
        "more",
    )
    if task.starts.moving > 0.0:
        arm, h, period = held.model.arm, held.machine.substep, task.control_period
        fastest = (
            task.pace
            * math.hypot(MAX_START_SPEED_ALONG, MAX_START_SPEED_ACROSS)
            / task.singularity_margin
        )
        omega_a, omega_b = fastest / arm.length_a, fastest / arm.length_b
        energy = (
            0.5 * (arm.m11 * omega_a**2 + arm.m22 * omega_b**2)
            + abs(arm.coupling) * omega_a * omega_b
        )
        require(
            energy
            <= largest_energy(arm, h, period, _force_within(task.starts.offset, task, machine)),
            task,
            "starts",
            "at rest, or moving with a smaller pace or a larger singularity_margin: the integrator "
            "could lose the motion; a shorter substep or control_period allows more",
        )


@lru_cache(maxsize=4096)
def strongest(task: PathFollowing, machine: Machine) -> float:
    """Return a bound of the mean force of a task's hand on the tip in a control step [N]."""
    path_width = min(task.error_max, task.truncation_error) + max(task.free_left, task.free_right)
    reach = machine.arm.length_a + machine.arm.length_b
    return _force_within(min(2.0 * reach, task.path.length + path_width), task, machine)


def _force_within(length: float, task: PathFollowing, machine: Machine) -> float:
    """Return that bound with the tip within a length [m] of the hand's target at first."""
    held = held_machine(task, machine)
    hand = task.hand.model(task.pace, held.machine.substep, (0, 0))
    samples = task.hand.sampled(task.control_period)
    largest_sample = np.abs(samples).max(axis=0) if len(samples) else (0.0, 0.0)
    stretch = length + hand.intent_lead + 0.5 * held.travel
    impedance = task.hand.impedance
    stiffness = impedance.stiffness * (1.0 + math.hypot(*impedance.stiffness_anisotropy))
    pull = stiffness * stretch + max_damping(impedance) * hand.intent_speed
    return pull + math.hypot(
        abs(hand.push) + largest_sample[0], math.fsum(map(abs, hand.amplitude)) + largest_sample[1]
    )


def largest_error_max(path: Path) -> float:
    """Return the largest half-width of a workspace about a path [m]."""
    return min(MAX_HALF_WIDTH, (1.0 - 1e-9) * MAX_CURVATURE_RATIO / max(path.max_curvature, 1e-3))


@lru_cache(maxsize=4096)
def _check_path(
    path: Path, error_max: float, margin: float, length_a: float, length_b: float
) -> None:
    bend = path.max_curvature
    if bend * error_max > MAX_CURVATURE_RATIO:
        raise ParameterError(
            "PathFollowing.error_max, with a free band, must be ≤ "
            f"{MAX_CURVATURE_RATIO / bend:.4g} m, {MAX_CURVATURE_RATIO:g} of the smallest radius "
            f"of {type(path).__name__}, got {error_max!r}"
        )
    check_reach(path.arcs.extremes, length_a, length_b, margin)


def _check_start(task: PathFollowing, arm: Arm, margin: float) -> None:
    (x, y), heading, offset = task.path.point(0.0), task.path.heading(0.0), task.start_offset
    cos, sin = math.cos(heading), math.sin(heading)
    starts = Arcs(
        np.array(
            [ArcSegment(x + offset * sin, y - offset * cos, -sin, cos, 0.0, 0.0, 2.0 * offset)]
        )
    )
    elbows = sin_elbow(arm.length_a, arm.length_b, starts.extremes)
    require(
        float(elbows.min()) > margin,
        task,
        "start_offset",
        f"so small that all starts are within reach with |sin(θA − θB)| > {margin:g}",
    )


def sin_elbow(length_a: float, length_b: float, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return |sin(θA − θB)| with the tip at points (K, 2) [m], or −1 out of reach; (K,)."""
    tip: Any = points.T
    cos = elbow_cosine(length_a, length_b, *tip)
    return np.where(np.abs(cos) <= 1.0, np.sqrt(np.maximum(1.0 - cos * cos, 0.0)), -1.0)
