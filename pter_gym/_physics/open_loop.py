"""Open-loop trajectories: the physics without the environment."""

from dataclasses import dataclass, field
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pter_gym._compiled.compiler import compile_kernel, compiled, inlined, outlined
from pter_gym._compiled.records import Records, load, rows, store, width, write
from pter_gym._physics.arm import (
    Load,
    PerLink,
    Vector,
    kinetic_energy,
    motion_of,
    tip_position,
    tip_velocity,
)
from pter_gym._physics.clutch import PerClutch, Torques, faded, heated, product, sought
from pter_gym._physics.friction import mode_of, slip_velocities, without_dry
from pter_gym._physics.model import arrangement_of, model_of
from pter_gym._physics.step import (
    Body,
    Energy,
    arrangement_from,
    control_step_on,
    kick_torques,
    paper_clutches,
)
from pter_gym.errors import DivergenceError, ParameterError
from pter_gym.params import Machine, find_machine

Array = NDArray[np.float64]


class Row(NamedTuple):
    """One substep of a trajectory."""

    theta: PerLink
    omega: PerLink
    tip_position: Vector
    tip_velocity: Vector
    torque: PerClutch
    slip_velocity: PerClutch
    torque_breakaway: PerClutch
    torque_dynamic: PerClutch
    mode: float
    kinetic_energy: float
    energy: Energy


BODY = rows(Body)
BODY_WIDTH = width(Body)
COLUMN = rows(Row)


@dataclass(frozen=True)
class State:
    """Physical state of one machine.

    Attributes
    ----------
    theta, omega
        Absolute link angles [rad] and angular velocities [rad/s], shape (2,).
    torque_breakaway, torque_dynamic
        Present torque limits of the four clutches [N·m], shape (4,).
    lagged_volts
        Clutch voltages behind lag and hysteresis [V], shape (4,); they differ from the command only
        with ``lag="voltage"`` or ``hysteresis``.
    heat
        Heat of the clutches [J], shape (4,); it changes only with a ``fade``.
    """

    theta: Array
    omega: Array
    torque_breakaway: Array
    torque_dynamic: Array
    lagged_volts: Array
    heat: Array = field(default_factory=lambda: np.zeros(4))


@dataclass(frozen=True)
class Trajectory:
    """Time-major record of a simulation; row k holds values at the end of substep k.

    Attributes
    ----------
    time
        End of each substep [s], shape (T,).
    theta, omega
        Absolute link angles [rad] and angular velocities [rad/s], shape (T, 2).
    tip_position, tip_velocity
        World frame, origin on the axis of the drive [m, m/s], shape (T, 2).
    mode
        ClutchMode after the substep, int8, shape (T,).
    torque
        Torque that each clutch generated on the arm during the substep [N·m], shape (T, 4). It
        opposes the slip.
    slip_velocity, power
        Slip velocity of each clutch [rad/s] and ``torque·slip_velocity`` ≤ 0 [W], shape (T, 4).
    torque_breakaway, torque_dynamic
        Torque limits behind the lag [N·m], shape (T, 4).
    kinetic_energy
        ½·θ̇ᵀMθ̇ [J], shape (T,).
    hand_work, dissipated, numerical_loss, residual
        Energy terms of each substep [J], shape (T,): the kinetic energy changes by
        ``hand_work − dissipated − numerical_loss + residual``.
    initial, final
        State before the first and after the last substep.
    """

    time: Array
    theta: Array
    omega: Array
    tip_position: Array
    tip_velocity: Array
    mode: NDArray[np.int8]
    torque: Array
    slip_velocity: Array
    power: Array
    torque_breakaway: Array
    torque_dynamic: Array
    kinetic_energy: Array
    hand_work: Array
    dissipated: Array
    numerical_loss: Array
    residual: Array
    initial: State
    final: State


def initial_state(
    machine: Machine | str | None,
    theta: ArrayLike,
    omega: ArrayLike = (0.0, 0.0),
    volts: ArrayLike = (0.0, 0.0, 0.0, 0.0),
) -> State:
    """Return a state whose clutches have settled at constant voltages.

    Parameters
    ----------
    machine
        The machine or its name; None for the default PTER.
    theta, omega
        Absolute link angles [rad] and angular velocities [rad/s], shape (2,).
    volts
        Voltages [V] to which they rose, shape (4,), within [0, voltage_max].

    Raises
    ------
    ParameterError
        If there is no such machine, a shape is wrong, a number is not finite, or a voltage is out
        of range.
    """
    machine = find_machine(machine)
    settled = _volts(machine, volts, 1)[0]
    lagged = [sought(0.0, v, machine.clutch.hysteresis) for v in settled.tolist()]
    breakaway, dynamic = np.transpose([machine.clutch.torques(v) for v in lagged])
    scale = np.array(machine.slot_scale)
    return State(
        theta=_vector("theta", theta, 2),
        omega=_vector("omega", omega, 2),
        torque_breakaway=scale * breakaway,
        torque_dynamic=scale * dynamic,
        lagged_volts=np.array(lagged),
    )


def simulate(
    machine: Machine | str | None,
    state: State,
    volts: ArrayLike,
    hand_force: ArrayLike,
    joint_torque: ArrayLike = (0.0, 0.0),
    *,
    hand_target: ArrayLike | None = None,
    duration: float | None = None,
) -> Trajectory:
    """Simulate one machine in open loop, one row of each input per substep.

    Parameters
    ----------
    machine
        The machine or its name, None for the default PTER; its ``substep`` is the time step.
    state
        Where to start: from ``initial_state`` or the ``final`` of an earlier trajectory.
    volts
        Clutch voltages [V], shape (4,) or (T, 4), within [0, voltage_max].
    hand_force
        Force on the tip [N], world frame, shape (2,) or (T, 2).
    joint_torque
        Torques on links A and B [N·m], shape (2,) or (T, 2).
    hand_target
        Tip position to which the hand's spring pulls [m], shape (2,) or (T, 2); needed if it has a
        stiffness.
    duration
        Length of the simulation [s]; needed if no input has a time axis.

    Returns
    -------
    Trajectory
        T rows.

    Raises
    ------
    ParameterError
        If shapes disagree, a number is not finite, a voltage is out of range, or an argument is
        missing.
    DivergenceError
        If the motion diverges: the substep is too long for so fast a motion.
    """
    machine = find_machine(machine)
    if hand_target is None and machine.hand.stiffness > 0.0:
        raise ParameterError("hand_target is needed: the hand has a stiffness")
    target = (0.0, 0.0) if hand_target is None else hand_target
    steps = _steps(machine, duration, volts, hand_force, joint_torque, target)
    body = body_of(machine, state)
    record = np.empty((steps, width(Row)))
    with np.errstate(all="ignore"):  # where it is not compiled
        _kernel(paper_clutches=machine.has_paper_clutches)(
            body,
            _volts(machine, volts, steps),
            _rows("hand_force", hand_force, steps, 2),
            _rows("joint_torque", joint_torque, steps, 2),
            _rows("hand_target", target, steps, 2),
            machine.substep,
            record,
        )
    _check_finite(record)
    return _trajectory(record, machine.substep, state, _state_of(body))


def body_of(machine: Machine, state: State) -> Array:
    """Return a machine in a state as ``advance`` takes it, a column (entries, 1).

    Raises
    ------
    ParameterError
        If a number of the state is not finite, or a torque or voltage is negative.
    """
    body: Any = np.zeros((BODY_WIDTH, 1))
    store(body, BODY.machine, 0, model_of(machine))
    store(body, BODY.arrangement, 0, arrangement_of(machine))
    theta, omega = _vector("state.theta", state.theta, 2), _vector("state.omega", state.omega, 2)
    store(body, BODY.motion, 0, motion_of(theta, omega))
    names = ("torque_breakaway", "torque_dynamic", "lagged_volts", "heat")
    entries = {
        name: PerClutch(*_vector(f"state.{name}", getattr(state, name), 4)) for name in names
    }
    for name, values in entries.items():
        if min(values) < 0.0:
            raise ParameterError(f"state.{name} must be ≥ 0, got {min(values):g}")
    breakaway, dynamic, lagged, heat = entries.values()
    store(body, BODY.torques, 0, Torques(breakaway, dynamic))
    store(body, BODY.lagged_volts, 0, lagged)
    store(body, BODY.heat, 0, heat)
    store(body, BODY.strength, 0, faded(heat, machine.clutch.fade, 1.0))
    return body


@compiled
def scratch(body: NDArray[np.float64]) -> Any:
    """Return a copy of a ``body_of`` with a constant shape, so its entries stay in registers."""
    copy = np.empty((BODY_WIDTH, 1))
    for row in range(BODY_WIDTH):  # an array's assignment compiles for seconds
        copy[row, 0] = body[row, 0]
    return copy


@inlined
def _load_on(body: Records, i: int) -> Load:
    return load(body, BODY.load, i)


def _functions(arrangement_at: Any) -> tuple[Any, Any]:
    """Return ``advance`` and ``row_of``; see ``substep_on`` for ``arrangement_at``."""
    control_step = control_step_on(BODY, _load_on, arrangement_at)

    @inlined
    def advance(body: Records, command: PerClutch, on: Load, h: float) -> None:
        """Advance a ``body_of`` by a substep of h [s] at a command [V] under a load."""
        store(body, BODY.command, 0, command)
        store(body, BODY.load, 0, on)
        # the sum with −0 keeps the sign of a zero
        store(body, BODY.energy, 0, Energy(-0.0, -0.0, -0.0, -0.0))
        control_step(body, 1, h, 1, True, False)
        if body[BODY.machine.fade, 0] > 0.0:
            heat_clutches(body, h)

    @outlined
    def heat_clutches(body: Records, h: float) -> None:
        """Add what a substep has dissipated to the clutches' heat, and fade their torques."""
        q, impact, capacity = (
            load(body, BODY.motion, 0),
            load(body, BODY.impact, 0),
            load(body, BODY.capacity, 0),
        )
        arm, arrangement = load(body, BODY.machine.arm, 0), arrangement_at(body, 0)
        exerted = kick_torques(
            impact, q.omega_a, q.omega_b, capacity, body[BODY.span, 0], arrangement
        )
        torque = without_dry(exerted, arm.dry_a, arm.dry_b, arrangement)
        power = product(torque, slip_velocities(q.omega_a, q.omega_b, arrangement))
        heat = heated(load(body, BODY.heat, 0), power, h, body[BODY.machine.cooling, 0])
        store(body, BODY.heat, 0, heat)
        store(body, BODY.strength, 0, faded(heat, body[BODY.machine.fade, 0], 1.0))

    @inlined
    def row_of(body: Records) -> Row:
        """Return what to record of a machine after a substep."""
        arm = load(body, BODY.machine.arm, 0)
        q = load(body, BODY.motion, 0)
        torques = load(body, BODY.torques, 0)
        impact, capacity = load(body, BODY.impact, 0), load(body, BODY.capacity, 0)
        arrangement = arrangement_at(body, 0)
        torque = kick_torques(
            impact, q.omega_a, q.omega_b, capacity, body[BODY.span, 0], arrangement
        )
        x, y = tip_position(arm, q)
        v_x, v_y = tip_velocity(arm, q)
        return Row(
            theta=PerLink(q.theta_a, q.theta_b),
            omega=PerLink(q.omega_a, q.omega_b),
            tip_position=Vector(x, y),
            tip_velocity=Vector(v_x, v_y),
            torque=without_dry(torque, arm.dry_a, arm.dry_b, arrangement),
            slip_velocity=slip_velocities(q.omega_a, q.omega_b, arrangement),
            torque_breakaway=torques.breakaway,
            torque_dynamic=torques.dynamic,
            mode=mode_of(q.omega_a, q.omega_b, arrangement),
            kinetic_energy=kinetic_energy(arm, q),
            energy=load(body, BODY.energy, 0),
        )

    return advance, row_of


(advance, row_of), (advance_declared, row_of_declared) = (
    _functions(paper_clutches),
    _functions(arrangement_from(BODY)),
)


def _build(digest: str) -> Any:
    def kernel(
        start: NDArray[np.float64],
        volts: Records,
        hand_force: Records,
        joint_torque: Records,
        hand_target: Records,
        h: float,
        record: NDArray[np.float64],
    ) -> None:
        _ = digest
        body = scratch(start)
        for k in range(record.shape[0]):
            on = Load(
                hand_force[k, 0],
                hand_force[k, 1],
                joint_torque[k, 0],
                joint_torque[k, 1],
                hand_target[k, 0],
                hand_target[k, 1],
            )
            advance(body, PerClutch(volts[k, 0], volts[k, 1], volts[k, 2], volts[k, 3]), on, h)
            write(record[k], COLUMN, row_of(body))
        for row in range(BODY_WIDTH):
            start[row, 0] = body[row, 0]

    return kernel


@cache
def _kernel(*, paper_clutches: bool) -> Any:
    declared = {} if paper_clutches else {"advance": advance_declared, "row_of": row_of_declared}
    return compile_kernel(_build, **declared)


def _check_finite(record: Array) -> None:
    diverged = ~np.isfinite(record).all(axis=1)
    if diverged.any():
        raise DivergenceError(
            f"the motion diverged in substep {int(diverged.argmax())}: make machine.substep smaller"
        )


def _trajectory(record: Array, h: float, initial: State, final: State) -> Trajectory:
    columns: dict[str, Any] = {
        name: record[:, at if isinstance(at, int) else [*at]]
        for name, at in COLUMN._asdict().items()
    }
    energies = dict(zip(Energy._fields, columns.pop("energy").T, strict=True))
    columns["mode"] = columns["mode"].astype(np.int8)
    return Trajectory(
        time=h * np.arange(1.0, len(record) + 1.0),
        power=columns["torque"] * columns["slip_velocity"],
        initial=initial,
        final=final,
        **columns,
        **energies,
    )


def _state_of(body: Array) -> State:
    motion = load(body, BODY.motion, 0)
    torques = load(body, BODY.torques, 0)
    return State(
        theta=np.array([motion.theta_a, motion.theta_b]),
        omega=np.array([motion.omega_a, motion.omega_b]),
        torque_breakaway=np.array(torques.breakaway),
        torque_dynamic=np.array(torques.dynamic),
        lagged_volts=np.array(load(body, BODY.lagged_volts, 0)),
        heat=np.array(load(body, BODY.heat, 0)),
    )


def finite_array(name: str, values: ArrayLike) -> Array:
    """Return an array of finite numbers, or raise a ParameterError."""
    try:
        array = np.asarray(values, np.float64)
    except (TypeError, ValueError):
        raise ParameterError(
            f"{name} must be an array of finite numbers, got {values!r:.200}"
        ) from None
    if not np.isfinite(array).all():
        raise ParameterError(f"{name} must hold finite numbers only")
    return array


def _vector(name: str, values: ArrayLike, width: int) -> Array:
    array = finite_array(name, values)
    if array.shape != (width,):
        raise ParameterError(f"{name} must have the shape ({width},), got {array.shape}")
    return array.copy()


def _rows(name: str, values: ArrayLike, steps: int, width: int) -> Array:
    array = finite_array(name, values)
    if array.shape not in ((width,), (steps, width)):
        raise ParameterError(
            f"{name} must have the shape ({width},) or ({steps}, {width}), got {array.shape}"
        )
    # a copy: a read-only view is another type, for which the kernel would be compiled again
    return np.array(np.broadcast_to(array, (steps, width)), order="C")


def _volts(machine: Machine, volts: ArrayLike, steps: int) -> Array:
    rows = _rows("volts", volts, steps, 4)
    check_volts(machine, rows)
    return rows


def check_volts(machine: Machine, volts: Array) -> None:
    """Raise a ParameterError unless voltages lie within a machine's range."""
    top = machine.clutch.voltage_max
    if volts.size and not (volts.min() >= 0.0 and volts.max() <= top):
        raise ParameterError(f"volts must lie within [0, {top:g}] V")


def _steps(machine: Machine, duration: float | None, *inputs: ArrayLike) -> int:
    shapes = [np.shape(values) for values in inputs]
    lengths = {shape[0] for shape in shapes if len(shape) == 2}
    if duration is not None:
        if not 0.0 < duration < float("inf"):
            raise ParameterError(f"duration must be a finite number > 0 s, got {duration!r}")
        lengths.add(round(duration / machine.substep))
    if len(lengths) != 1:
        lengths_text = ", ".join(map(str, sorted(lengths))) or "none"
        raise ParameterError(
            f"inputs and duration must agree on one number of substeps, found {lengths_text}"
        )
    return lengths.pop()
