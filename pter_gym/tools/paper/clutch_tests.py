"""Open-loop tests of clutches: the paper's Figures 3, 4, 5 and 9, step response, held loads."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pter_gym._physics import arm, friction
from pter_gym._physics.model import model_of
from pter_gym._physics.open_loop import Trajectory, initial_state, simulate
from pter_gym.params import Machine
from pter_gym.tools.paper.parameters import BREAKAWAY_SMALL_VOLTAGE

__all__ = [
    "Holding",
    "MaterialCurves",
    "Reversal",
    "SingleDofTest",
    "StepResponse",
    "holding",
    "reversals",
    "single_dof",
    "step_response",
    "torque_curves",
]

Array = NDArray[np.float64]

W: Array = np.array(friction.COUPLING)
"""Slip velocities of the four clutches from the links' angular velocities, shape (4, 2)."""

POSE = (0.5, 2.0)
"""Angles of the links [rad]: tip in front of the drive, elbow near a right angle."""

RESOLUTION = 1e-3
"""Longest substep of the tests [s]: they record a torque once per substep."""


def resolved(machine: Machine, longest: float = RESOLUTION) -> Machine:
    """Return a machine whose substep is at most a given length [s]."""
    return replace(machine, substep=min(machine.substep, longest))


def tip(machine: Machine, theta: ArrayLike) -> Array:
    """Return the tip position [m], (2, …), at angles [rad], (…, 2)."""
    return np.array(arm.tip_position(model_of(machine).arm, arm.motion_of(theta)))


def tip_force(machine: Machine, theta: ArrayLike, joint_torque: ArrayLike) -> Array:
    """Return the tip force [N], (2,), that loads the links with torques [N·m] at angles [rad]."""
    at = model_of(machine).arm, arm.motion_of(theta)
    columns = [arm.joint_torque(*at, 1.0, 0.0), arm.joint_torque(*at, 0.0, 1.0)]
    return np.linalg.solve(np.transpose(columns), np.asarray(joint_torque, float))


def holding_torque(machine: Machine, volts: float | None = None) -> float:
    """Return a clutch's largest torque [N·m], stuck or not, by default at the top voltage [V]."""
    return max(machine.clutch.largest if volts is None else machine.clutch.torques(volts))


# --- Figs. 3 and 4: single degree of freedom ---

LOCKED_WITH = {1: 2, 2: 1, 3: 4, 4: 3}
"""Clutch that is locked while another one is tested; clutch 2 for clutch 1 is the paper's."""

RAMP_TIME = 0.5
"""When a ramp reaches the torque at which a clutch gives way [s]."""

MAX_TURN, MAX_DURATION = 0.6, 2.0
"""A test ends at this turn of a link [rad], and at this time at the latest [s]."""

LINE_TURNS = np.linspace(-0.4, 0.74, 181)
"""Turns of the driven link at which the single-DOF line is returned [rad]; the elbow stays bent."""


@dataclass(frozen=True)
class SingleDofTest:
    """One clutch under a ramped torque while another one is locked.

    Attributes
    ----------
    clutch, locked
        Numbers of the clutch under test and of the locked one, 1 to 4.
    volts
        Constant voltages of the clutches [V], shape (4,).
    share
        Torque that the clutch under test carries per unit of the ramp while nothing moves.
    input_torque, trajectory
        Ramp in the middle of each substep [N·m], shape (T,), and T substeps.
    line
        Points of the single-DOF line that the tip can move on [m], shape (K, 2).
    deviation
        Distance of the tip from its position allowed by the line [m], shape (T,).
    """

    clutch: int
    locked: int
    volts: Array
    share: float
    input_torque: Array
    trajectory: Trajectory
    line: Array
    deviation: Array

    @property
    def torque(self) -> Array:
        """Magnitude of the torque of the clutch under test [N·m], shape (T,)."""
        return np.abs(self.trajectory.torque[:, self.clutch - 1])

    @property
    def locked_torque(self) -> Array:
        """Torque of the locked clutch [N·m], shape (T,)."""
        return self.trajectory.torque[:, self.locked - 1]

    @property
    def breakaway(self) -> int:
        """Index of the first substep with motion."""
        return int(np.flatnonzero(self.trajectory.omega.any(axis=1))[0])


def single_dof(machine: Machine) -> tuple[SingleDofTest, ...]:
    """Ramp up a torque against each clutch while another one leaves one degree of freedom.

    The voltages have settled beforehand; that on the clutch under test has the breakaway torque of
    the paper. The ramp acts on link A, or on link B where link A is locked.
    """
    return tuple(_single_dof_test(resolved(machine), *each) for each in LOCKED_WITH.items())


def _single_dof_test(machine: Machine, clutch: int, locked: int) -> SingleDofTest:
    link, volts = int(locked == 1), np.zeros(4)
    volts[clutch - 1] = machine.clutch.breakaway.voltage(BREAKAWAY_SMALL_VOLTAGE)
    volts[locked - 1] = machine.clutch.voltage_max
    direction: Array = np.eye(2)[link]
    share = abs(float(np.linalg.solve(W[[clutch - 1, locked - 1]].T, direction)[0]))
    time = machine.substep * (np.arange(float(round(MAX_DURATION / machine.substep))) + 0.5)
    ramp = BREAKAWAY_SMALL_VOLTAGE / share / RAMP_TIME * time
    torque = np.outer(ramp, direction)
    start = initial_state(machine, POSE, volts=volts)
    turned = np.abs(simulate(machine, start, volts, (0.0, 0.0), torque).theta - POSE)
    end = int(np.searchsorted(turned.max(axis=1), MAX_TURN))
    run = simulate(machine, start, volts, (0.0, 0.0), torque[:end])
    line, allowed = (
        _line(machine, locked, turns) for turns in (LINE_TURNS, run.theta[:, link] - POSE[link])
    )
    deviation = np.linalg.norm(run.tip_position - allowed, axis=1)
    return SingleDofTest(clutch, locked, volts, share, ramp[:end], run, line, deviation)


def _line(machine: Machine, locked: int, turns: Array) -> Array:
    """Return tip positions [m], (K, 2), with a clutch locked and a link turned by angles [rad]."""
    return tip(machine, POSE + np.outer(turns, friction.LINES[locked - 1])).T


# --- the step response ---

STEP_VOLTS, STEP_LEAD = 4.0, 0.02
"""Voltage after the step [V], low, so the arm stays slow; time before the step [s]."""


@dataclass(frozen=True)
class StepResponse:
    """Generated torque of each clutch after a step of its voltage to ``STEP_VOLTS``, one test each.

    Attributes
    ----------
    time_constant, final
        Time constant of the clutches [s], and the torque to which they settle [N·m].
    time
        Time from the step to the middle of each substep, where torques act [s], shape (T,).
    torque, first_order
        Magnitude of the torques, shape (4, T), and the first-order response, shape (T,) [N·m].
    """

    time_constant: float
    final: float
    time: Array
    torque: Array
    first_order: Array


def step_response(machine: Machine) -> StepResponse:
    """Step each clutch's voltage while a constant tip force keeps it slipping."""
    machine = resolved(machine)
    tau, final = machine.clutch.time_constant, machine.clutch.dynamic.torque(STEP_VOLTS)
    lead = round(STEP_LEAD / machine.substep)
    steps = lead + round(3.0 * tau / machine.substep)
    torque = np.zeros((4, steps))
    for x in range(4):
        volts = np.zeros((steps, 4))
        volts[lead:, x] = STEP_VOLTS
        force = tip_force(machine, POSE, 1.2 * final * W[x])
        run = simulate(machine, initial_state(machine, POSE), volts, force)
        torque[x] = np.abs(run.torque[:, x])
    time = machine.substep * (np.arange(float(steps)) + 0.5 - lead)
    return StepResponse(tau, final, time, torque, -final * np.expm1(-np.maximum(time, 0.0) / tau))


# --- Fig. 5: torque over voltage ---

MEASURED_FROM = 4.0
"""Lowest voltage of the paper's tests [V] (section IV-B.1)."""


@dataclass(frozen=True)
class MaterialCurves:
    """Torques of clutch 1 with a material [N·m] over its voltage [V], arrays (K,).

    ``breakaway`` and ``dynamic`` are the curves. ``bench_breakaway`` and ``bench_dynamic`` are from
    a bench test: the largest torque before the slip and the mean torque during it, NaN where there
    was no test.
    """

    volts: Array
    breakaway: Array
    dynamic: Array
    bench_breakaway: Array
    bench_dynamic: Array


def torque_curves(machines: Mapping[str, Machine]) -> dict[str, MaterialCurves]:
    """Return torque curves of clutch 1 and six bench tests of it, by the machine's name.

    In a bench test, as in the paper's, the voltage is constant and a slowly rising torque acts on
    link A until the clutch slips, and a little longer. Link B is locked.
    """
    return {name: _torque_curves(machine) for name, machine in machines.items()}


def _torque_curves(machine: Machine) -> MaterialCurves:
    clutch, top = machine.clutch, machine.clutch.voltage_max
    volts, bench = np.linspace(0.0, top, 241), np.full((2, 241), np.nan)
    for k in np.searchsorted(volts, np.linspace(min(MEASURED_FROM, top), top, 6)):
        bench[:, k] = _bench_test(machine, float(volts[k]))
    curves = (
        np.array([curve.torque(float(v)) for v in volts])
        for curve in (clutch.breakaway, clutch.dynamic)
    )
    return MaterialCurves(volts, *curves, *bench)


def _bench_test(machine: Machine, volts: float) -> tuple[float, float]:
    """Return breakaway and dynamic torque of clutch 1 [N·m], tested at a constant voltage [V]."""
    machine = resolved(machine)
    applied = (volts, machine.clutch.voltage_max, 0.0, 0.0)
    rate = holding_torque(machine, volts) * machine.substep / RAMP_TIME
    ramp = rate * (np.arange(round(1.1 * RAMP_TIME / machine.substep)) + 0.5)
    start = initial_state(machine, POSE, volts=applied)
    run = simulate(machine, start, applied, (0.0, 0.0), np.outer(ramp, [1.0, 0.0]))
    generated = np.abs(run.torque[:, 0])
    first = int(np.flatnonzero(run.slip_velocity[:, 0])[0])
    slip = np.abs(run.slip_velocity[first:-1, 0])
    slipping = slip >= 2.0 * machine.slip_threshold  # not at the edge of the band, where it creeps
    return float(generated[: first + 1].max()), float(generated[first + 1 :][slipping].mean())


# --- Fig. 9: reversal ---

REVERSAL_SPEED = -1.2
"""Angular velocity of link A at the start [rad/s]."""

FORCE_TIME = 0.05
"""When the force steps up [s]."""

FORCE_MARGIN = 1.05
"""Torque of the tip force about clutch 1, relative to its largest holding torque among the
machines.

The less it exceeds it, the longer the slip stays in the stick band, where the clutch exerts its
breakaway torque. """

FINE = 1e-4
"""Longest substep [s]: about a third of the shortest time in the stick band."""


@dataclass(frozen=True)
class Reversal:
    """One machine's slip-stick-slip transition.

    Attributes
    ----------
    volts, force
        Voltage of clutch 1 [V], the others are released; force at the tip after its step [N].
    trajectory, index
        The test, and its last substep before the slip of clutch 1 changes its sign.
    dynamic
        Dynamic torque of clutch 1 [N·m].
    jump
        Largest magnitude of its torque within 50 ms of zero slip, relative to the dynamic torque,
        minus 1.
    """

    volts: float
    force: float
    trajectory: Trajectory
    index: int
    dynamic: float
    jump: float

    @property
    def torque(self) -> Array:
        """Generated torque of clutch 1 [N·m], shape (T,)."""
        return self.trajectory.torque[:, 0]


def reversals(machines: Mapping[str, Machine]) -> dict[str, Reversal]:
    """Let a step force reverse link A, which slips in clutch 1 at a constant voltage.

    The arm moves at the start; the force, along link B, opposes that motion and is large enough to
    reverse it. The voltage is the one with the breakaway torque of Fig. 4 on the first machine.
    """
    first = next(iter(machines.values()))
    volts = first.clutch.breakaway.voltage(BREAKAWAY_SMALL_VOLTAGE)
    largest = max(holding_torque(machine, volts) for machine in machines.values())
    force = tip_force(first, POSE, (FORCE_MARGIN * largest, 0.0))
    return {name: _reversal(machine, volts, force) for name, machine in machines.items()}


def _reversal(machine: Machine, volts: float, force: Array) -> Reversal:
    machine, applied = resolved(machine, FINE), (volts, 0.0, 0.0, 0.0)
    forces = np.zeros((round(0.25 / machine.substep), 2))
    forces[round(FORCE_TIME / machine.substep) :] = force
    start = initial_state(machine, POSE, (REVERSAL_SPEED, 0.0), applied)
    run = simulate(machine, start, applied, forces)
    moving = np.flatnonzero(run.slip_velocity[:, 0])  # zeros have no sign
    index = int(moving[np.flatnonzero(np.diff(np.sign(run.slip_velocity[moving, 0])))[0]])
    dynamic = machine.clutch.dynamic.torque(volts)
    near = np.abs(run.time - run.time[index]) <= 0.05
    jump = float(np.abs(run.torque[near, 0]).max() / dynamic - 1.0)
    return Reversal(volts, float(np.hypot(*force)), run, index, dynamic, jump)


# --- loads that four engaged clutches hold together (section III-A) ---


@dataclass(frozen=True)
class Holding:
    """Static loads on four engaged clutches, raised until the arm moves; arrays (K,).

    ``limit`` is the largest joint torque in that direction [N·m] that some set of clutch torques
    balances, ``moved_at`` the one at which the arm moved. ``weakest_slips`` says whether the clutch
    with the lowest breakaway torque slipped.
    """

    limit: Array
    moved_at: Array
    weakest_slips: NDArray[np.bool_]


def holding(machine: Machine) -> Holding:
    """Load the arm, at random voltages, poses and directions, until it moves, 200 times."""
    random = np.random.default_rng(0)
    return Holding(*map(np.array, zip(*(_load(machine, random) for _ in range(200)), strict=True)))


def largest_load(capacity: Array, direction: Array) -> float:
    """Return the largest joint torque [N·m] along a unit vector (2,) that clutches balance.

    It is where the set ``{Wᵀτ: |τ_x| ≤ capacity_x}`` ends; ``capacity`` holds each clutch's largest
    torque [N·m], shape (4,).
    """
    normals = W @ np.array([[0.0, 1.0], [-1.0, 0.0]])
    return float(np.min((np.abs(W @ normals.T).T @ capacity) / np.abs(normals @ direction)))


def _load(machine: Machine, random: np.random.Generator) -> tuple[float, float, bool]:
    volts = random.uniform(0.1, 1.0, 4) * machine.clutch.voltage_max
    state = initial_state(machine, random.uniform(0.0, 2.0 * np.pi, 2), volts=volts)
    angle = random.uniform(0.0, 2.0 * np.pi)
    direction = np.array([np.cos(angle), np.sin(angle)])
    limit = largest_load(np.maximum(state.torque_breakaway, state.torque_dynamic), direction)
    ramp = limit * np.linspace(0.98, 1.02, 81)
    run = simulate(machine, state, volts, (0.0, 0.0), np.outer(ramp, direction))
    first = int(np.flatnonzero(run.omega.any(axis=1))[0])
    weakest = int(np.argmin(state.torque_breakaway))
    return limit, float(ramp[first]), bool(run.slip_velocity[first, weakest] != 0.0)
