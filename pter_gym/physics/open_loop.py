"""Open-loop trajectories, for people who want the physics without the environment."""

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pter_gym.compiled.compiler import compile_kernel
from pter_gym.errors import DivergenceError, ParameterError
from pter_gym.params import Machine
from pter_gym.physics.arm import Load, kinetic_energy, tip_position, tip_velocity
from pter_gym.physics.clutch import PerClutch, relax, relax_torques, scaled, steady_torques
from pter_gym.physics.friction import generated_torques, mode_of, slip_velocities
from pter_gym.physics.model import (
    BREAKAWAY,
    DYNAMIC,
    LAGGED_VOLTS,
    SCALE,
    SLIP_THRESHOLD,
    STATE_ROWS,
    TORQUE_DECAY,
    VOLTAGE_DECAY,
    breakaway_curve,
    dynamic_curve,
    linkage,
    load_four,
    load_motion,
    load_torques,
    model_of,
    store_four,
    store_motion,
    store_torques,
)
from pter_gym.physics.step import clutch_load, substep

Array = NDArray[np.float64]

_COLUMNS = (
    ("theta", 2),
    ("omega", 2),
    ("tip_position", 2),
    ("tip_velocity", 2),
    ("torque", 4),
    ("slip_velocity", 4),
    ("torque_breakaway", 4),
    ("torque_dynamic", 4),
    ("mode", 1),
    ("kinetic_energy", 1),
    ("hand_work", 1),
    ("dissipated", 1),
    ("numerical_loss", 1),
    ("residual", 1),
)
_WIDTH = sum(width for _, width in _COLUMNS)


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
        Voltages behind the lag [V], shape (4,); they differ from the command with ``lag="voltage"`` only.
    """

    theta: Array
    omega: Array
    torque_breakaway: Array
    torque_dynamic: Array
    lagged_volts: Array


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
        Torque that each clutch generated on the arm during the substep [N·m], shape (T, 4). It opposes the slip.
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
    machine: Machine,
    theta: ArrayLike,
    omega: ArrayLike = (0.0, 0.0),
    volts: ArrayLike = (0.0, 0.0, 0.0, 0.0),
) -> State:
    """Return a state whose clutches have settled at constant voltages.

    Parameters
    ----------
    theta, omega
        Absolute link angles [rad] and angular velocities [rad/s], shape (2,).
    volts
        Voltages [V] at which the clutches have settled, shape (4,), within [0, voltage_max].

    Raises
    ------
    ParameterError
        If a shape is wrong, a number is not finite, or a voltage is out of range.
    """
    settled = _volts(machine, volts, 1)[0]
    clutch = machine.clutch
    scale = np.array(machine.clutch_scale)
    return State(
        theta=_vector("theta", theta, 2),
        omega=_vector("omega", omega, 2),
        torque_breakaway=scale * [clutch.breakaway.torque(float(v)) for v in settled],
        torque_dynamic=scale * [clutch.dynamic.torque(float(v)) for v in settled],
        lagged_volts=settled,
    )


def simulate(
    machine: Machine,
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
        The machine; its ``substep`` is the time step.
    state
        Where to start: from ``initial_state`` or the ``final`` of an earlier trajectory.
    volts
        Clutch voltages [V], shape (4,) or (T, 4), within [0, voltage_max].
    hand_force
        Force on the tip [N], world frame, shape (2,) or (T, 2).
    joint_torque
        Torques on links A and B [N·m], shape (2,) or (T, 2).
    hand_target
        Tip position to which the hand's spring pulls [m], shape (2,) or (T, 2); needed if it has a stiffness.
    duration
        Length of the simulation [s]; needed if no input has a time axis.

    Returns
    -------
    Trajectory
        T rows.

    Raises
    ------
    ParameterError
        If shapes disagree, a number is not finite, a voltage is out of range, or an argument is missing.
    DivergenceError
        If the motion diverges: the substep is too long for so fast a motion.
    """
    if hand_target is None and machine.hand.stiffness > 0.0:
        raise ParameterError("hand_target is needed: the hand has a stiffness")
    target = (0.0, 0.0) if hand_target is None else hand_target
    steps = _steps(machine, duration, volts, hand_force, joint_torque, target)
    packed = _pack(state)
    record = np.empty((steps, _WIDTH))
    _kernel()(
        np.array([model_of(machine)]).T.copy(),
        packed,
        _volts(machine, volts, steps),
        _rows("hand_force", hand_force, steps, 2),
        _rows("joint_torque", joint_torque, steps, 2),
        _rows("hand_target", target, steps, 2),
        machine.substep,
        record,
    )
    diverged = ~np.isfinite(record).all(axis=1)
    if diverged.any():
        raise DivergenceError(f"the motion diverged in substep {int(diverged.argmax())}: make machine.substep smaller")
    return _trajectory(record, machine.substep, state, _unpack(packed))


def _build(digest: str) -> Any:
    def kernel(
        p: Any, s: Any, volts: Any, hand_force: Any, joint_torque: Any, hand_target: Any, h: float, record: Any
    ) -> None:
        _ = digest
        arm = linkage(p, 0, 0)
        for k in range(record.shape[0]):
            command = PerClutch(volts[k, 0], volts[k, 1], volts[k, 2], volts[k, 3])
            lagged = relax(load_four(s, LAGGED_VOLTS, 0), command, p[VOLTAGE_DECAY, 0])
            steady = steady_torques(breakaway_curve(p, 0, 0), dynamic_curve(p, 0, 0), lagged)
            target = scaled(steady, load_four(p, SCALE, 0), 1.0)
            torques = relax_torques(load_torques(s, BREAKAWAY, 0), target, p[TORQUE_DECAY, 0])
            load = Load(
                hand_force[k, 0],
                hand_force[k, 1],
                joint_torque[k, 0],
                joint_torque[k, 1],
                hand_target[k, 0],
                hand_target[k, 1],
            )
            q, impact, limit, energy = substep(load_motion(s, 0), torques, arm, load, p[SLIP_THRESHOLD, 0], h)
            store_motion(s, 0, q)
            store_torques(s, BREAKAWAY, 0, torques)
            store_four(s, LAGGED_VOLTS, 0, lagged)
            load_a, load_b = clutch_load(impact, q.omega_a, q.omega_b, h)
            generated = generated_torques(q.omega_a, q.omega_b, load_a, load_b, limit)
            slip = slip_velocities(q.omega_a, q.omega_b)
            x, y = tip_position(arm, q)
            v_x, v_y = tip_velocity(arm, q)
            row = (
                q.theta_a,
                q.theta_b,
                q.omega_a,
                q.omega_b,
                x,
                y,
                v_x,
                v_y,
                generated.x1,
                generated.x2,
                generated.x3,
                generated.x4,
                slip.x1,
                slip.x2,
                slip.x3,
                slip.x4,
            )
            for column in range(16):
                record[k, column] = row[column]
            for clutch in range(4):
                record[k, 16 + clutch] = s[BREAKAWAY + clutch, 0]
                record[k, 20 + clutch] = s[DYNAMIC + clutch, 0]
            record[k, 24] = mode_of(q.omega_a, q.omega_b)
            record[k, 25] = kinetic_energy(arm, q)
            record[k, 26] = energy.hand_work
            record[k, 27] = energy.dissipated
            record[k, 28] = energy.numerical_loss
            record[k, 29] = energy.residual

    return kernel


@cache
def _kernel() -> Any:
    return compile_kernel(_build)


def _trajectory(record: Array, h: float, initial: State, final: State) -> Trajectory:
    columns: dict[str, Any] = {}
    first = 0
    for name, width in _COLUMNS:
        values = record[:, first : first + width]
        columns[name] = values[:, 0] if width == 1 else values
        first += width
    columns["mode"] = columns["mode"].astype(np.int8)
    return Trajectory(
        time=h * np.arange(1.0, len(record) + 1.0),
        power=columns["torque"] * columns["slip_velocity"],
        initial=initial,
        final=final,
        **columns,
    )


def _pack(state: State) -> Array:
    theta = _vector("state.theta", state.theta, 2)
    omega = _vector("state.omega", state.omega, 2)
    packed = np.empty((STATE_ROWS, 1))
    packed[0:2, 0] = theta
    packed[2:4, 0] = omega
    packed[4:8, 0] = np.cos(theta[0]), np.sin(theta[0]), np.cos(theta[1]), np.sin(theta[1])
    packed[BREAKAWAY:DYNAMIC, 0] = _vector("state.torque_breakaway", state.torque_breakaway, 4)
    packed[DYNAMIC:LAGGED_VOLTS, 0] = _vector("state.torque_dynamic", state.torque_dynamic, 4)
    packed[LAGGED_VOLTS:, 0] = _vector("state.lagged_volts", state.lagged_volts, 4)
    if min(packed[BREAKAWAY:, 0]) < 0.0:
        raise ParameterError("state: torques and lagged voltages must be ≥ 0")
    return packed


def _unpack(packed: Array) -> State:
    return State(
        theta=packed[0:2, 0].copy(),
        omega=packed[2:4, 0].copy(),
        torque_breakaway=packed[BREAKAWAY:DYNAMIC, 0].copy(),
        torque_dynamic=packed[DYNAMIC:LAGGED_VOLTS, 0].copy(),
        lagged_volts=packed[LAGGED_VOLTS:, 0].copy(),
    )


def _numbers(name: str, values: ArrayLike) -> Array:
    try:
        array = np.asarray(values, np.float64)
    except (TypeError, ValueError):
        raise ParameterError(f"{name} must be an array of finite numbers, got {values!r}") from None
    if not np.isfinite(array).all():
        raise ParameterError(f"{name} must hold finite numbers only")
    return array


def _vector(name: str, values: ArrayLike, width: int) -> Array:
    array = _numbers(name, values)
    if array.shape != (width,):
        raise ParameterError(f"{name} must have the shape ({width},), got {array.shape}")
    return array.copy()


def _rows(name: str, values: ArrayLike, steps: int, width: int) -> Array:
    array = _numbers(name, values)
    if array.shape not in ((width,), (steps, width)):
        raise ParameterError(f"{name} must have the shape ({width},) or ({steps}, {width}), got {array.shape}")
    # a copy, since a read-only view is another type for the compiler, which would compile the kernel anew
    return np.array(np.broadcast_to(array, (steps, width)), order="C")


def _volts(machine: Machine, volts: ArrayLike, steps: int) -> Array:
    rows = _rows("volts", volts, steps, 4)
    top = machine.clutch.voltage_max
    if rows.size and not (rows.min() >= 0.0 and rows.max() <= top):
        raise ParameterError(f"volts must lie within [0, {top:g}] V")
    return rows


def _steps(machine: Machine, duration: float | None, *inputs: ArrayLike) -> int:
    shapes = [np.shape(values) for values in inputs]
    lengths = {shape[0] for shape in shapes if len(shape) == 2}
    if duration is not None:
        if not 0.0 < duration < float("inf"):
            raise ParameterError(f"duration must be a finite number > 0 s, got {duration!r}")
        lengths.add(round(duration / machine.substep))
    if len(lengths) != 1:
        found = ", ".join(map(str, sorted(lengths))) or "none"
        raise ParameterError(f"inputs and duration must agree on one number of substeps, found {found}")
    return lengths.pop()
