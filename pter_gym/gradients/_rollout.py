# pyright: standard
"""Rollouts at given voltages and forces, and their gradients, for NumPy."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pter_gym._physics.arm import Motion, tip_position, tip_velocity
from pter_gym._physics.open_loop import BODY_WIDTH, State, body_of, check_volts, finite_array
from pter_gym.errors import DivergenceError, ParameterError
from pter_gym.gradients._adjoint import FIRST, LAST, kernels
from pter_gym.gradients._machine import by_machine, divided
from pter_gym.params import Machine

Array = NDArray[np.float64]

STATE = {
    "theta": (0, 2),
    "omega": (2, 4),
    "torque_breakaway": (8, 12),
    "torque_dynamic": (12, 16),
    "lagged_volts": (16, 20),
}
"""Where the entries of a ``State`` are among those that a kernel keeps at a control instant."""

UNITS = slice(4, 8)
"""Where cosine and sine of link A, and of link B, are."""


@dataclass(frozen=True)
class Inputs:
    """Arguments of a rollout, checked, as the kernels take them: N control steps, S substeps."""

    machine: Machine
    body: Array
    volts: Array
    hand_force: Array
    hand_target: Array


@dataclass(frozen=True)
class Gradient:
    """Derivatives of a scalar with respect to a rollout's inputs, N control steps of S substeps.

    Attributes
    ----------
    volts
        With respect to the voltages of each control step [1/V], shape (N, 4).
    hand_force, hand_target
        With respect to the hand's force [1/N] and its spring's target [1/m] in each substep, shape
        (N, S, 2).
    state
        With respect to the initial state; a change of an angle also turns the link's unit vector.
    machine
        With respect to each parameter that the motion depends on, by its name, such as
        ``clutch.time_constant``.
    """

    volts: Array
    hand_force: Array
    hand_target: Array
    state: State
    machine: dict[str, float]


@dataclass(frozen=True)
class Rollout:
    """The state at N + 1 control instants, the first before the first control step.

    Attributes
    ----------
    theta, omega
        Absolute link angles [rad] and angular velocities [rad/s], shape (N + 1, 2).
    torque_breakaway, torque_dynamic
        Torque limits of the clutches [N·m], shape (N + 1, 4).
    lagged_volts
        Lagged clutch voltages [V], shape (N + 1, 4).
    tip_position, tip_velocity
        World frame, origin on the axis of the drive [m, m/s], shape (N + 1, 2).
    """

    theta: Array
    omega: Array
    torque_breakaway: Array
    torque_dynamic: Array
    lagged_volts: Array
    tip_position: Array
    tip_velocity: Array
    _states: Array
    _inputs: Inputs

    @property
    def final(self) -> State:
        """The state after the last control step, from which another rollout may begin."""
        return _state_of(self._states[-1])

    def gradient(self, **by: ArrayLike) -> Gradient:
        """Return the gradient of a scalar, from its derivatives by attributes of this rollout.

        Parameters
        ----------
        **by
            The derivatives with respect to ``theta``, ``omega``, ``tip_position`` and so on, each
            an array of that attribute's shape. Attributes that are left out have a derivative of
            zero.

        Raises
        ------
        ParameterError
            If there is no such attribute, a shape is wrong, or an array is not of finite numbers.
        """
        by_name = {name: self._derivative(name, values) for name, values in by.items()}
        by_states, by_lengths = self._by_states(by_name)
        result = gradient_of(self._inputs, self._states, by_states)
        for name, value in by_lengths.items():
            result.machine[name] += value
        return result

    def _derivative(self, name: str, values: ArrayLike) -> Array:
        names = (*STATE, "tip_position", "tip_velocity")
        if name not in names:
            raise ParameterError(
                f"derivatives must be with respect to one of {', '.join(names)}, got {name!r}"
            )
        array = finite_array(name, values)
        shape = getattr(self, name).shape
        if array.shape != shape:
            raise ParameterError(
                f"the derivative with respect to {name} must have the shape {shape}, "
                f"got {array.shape}"
            )
        return array

    def _by_states(self, by: dict[str, Array]) -> tuple[Array, dict[str, float]]:
        """Return derivatives by the states at control instants, and by lengths of links."""
        by_states = np.zeros_like(self._states)
        for name, (begin, end) in STATE.items():
            by_states[:, begin:end] += by.get(name, 0.0)
        position = by.get("tip_position", np.zeros_like(self.tip_position))
        velocity = by.get("tip_velocity", np.zeros_like(self.tip_position))
        lengths: dict[str, float] = {}
        for link, name in enumerate(("length_a", "length_b")):
            length, at = getattr(self._inputs.machine.arm, name), UNITS.start + 2 * link
            along, omega = self._states[:, at : at + 2], self.omega[:, link : link + 1]
            across = np.stack([-along[:, 1], along[:, 0]], axis=1)
            by_states[:, 2 + link] += length * np.sum(velocity * across, axis=1)
            by_states[:, at] += length * (position[:, 0] + omega[:, 0] * velocity[:, 1])
            by_states[:, at + 1] += length * (position[:, 1] - omega[:, 0] * velocity[:, 0])
            lengths[f"arm.{name}"] = float(np.sum(position * along + velocity * omega * across))
        return by_states, lengths


def rollout(
    machine: Machine | str | None,
    state: State,
    volts: ArrayLike,
    hand_force: ArrayLike,
    *,
    hand_target: ArrayLike | None = None,
    period: float = 0.01,
) -> Rollout:
    """Simulate one machine with given voltages and forces, and keep what its gradient needs.

    The motion is the same as in ``pter_gym.simulate``, in control steps of equal substeps as in an
    environment.

    Parameters
    ----------
    machine
        The machine or its name, None for the default PTER.
    state
        Where to start.
    volts
        Clutch voltages [V] of each control step, shape (N, 4), within [0, voltage_max].
    hand_force
        Force on the tip [N], world frame, shape (2,), (N, 2), or (N, S, 2) for each of a control
        step's S substeps.
    hand_target
        Tip position to which the hand's spring pulls [m], of a shape that ``hand_force`` may have;
        needed if it has a stiffness.
    period
        Length of a control step [s]; it has the fewest equal substeps that are no longer than
        ``machine.substep``.

    Raises
    ------
    ParameterError
        If a shape is wrong, an array is not of finite numbers, or a voltage is out of range.
    DivergenceError
        If the motion diverges: the substep is too long for so fast a motion.
    """
    return run(checked(machine, state, volts, hand_force, hand_target, period))


def checked(
    machine: Machine | str | None,
    state: State,
    volts: ArrayLike,
    hand_force: ArrayLike,
    hand_target: ArrayLike | None,
    period: float,
) -> Inputs:
    """Return what a rollout takes, or raise a ParameterError."""
    machine, substeps = divided(machine, period)
    if hand_target is None and machine.hand.stiffness > 0.0:
        raise ParameterError("hand_target is needed: the hand has a stiffness")
    commands = finite_array("volts", volts)
    if commands.ndim != 2 or commands.shape[1] != 4 or not len(commands):
        raise ParameterError(f"volts must have the shape (N, 4) with N ≥ 1, got {commands.shape}")
    check_volts(machine, commands)
    shape = len(commands), substeps, 2
    target = np.zeros(2) if hand_target is None else hand_target
    return Inputs(
        machine,
        body_of(machine, state),
        np.array(commands, order="C"),
        _in_substeps("hand_force", hand_force, shape),
        _in_substeps("hand_target", target, shape),
    )


@np.errstate(all="ignore")  # of kernels that are not compiled
def run(inputs: Inputs) -> Rollout:
    """Simulate checked inputs."""
    states = np.empty((len(inputs.volts) + 1, LAST - FIRST))
    forward, _ = kernels(has_paper_clutches=inputs.machine.has_paper_clutches)
    machine = inputs.machine
    forward(
        inputs.body, inputs.volts, inputs.hand_force, inputs.hand_target, machine.substep, states
    )
    diverged = ~np.isfinite(states).all(axis=1)
    if diverged.any():
        raise DivergenceError(
            f"the motion diverged in control step {int(diverged.argmax()) - 1}: "
            "make substeps shorter"
        )
    position, velocity = tip_motion(states, machine.arm, np)
    return Rollout(
        **{name: states[:, begin:end] for name, (begin, end) in STATE.items()},
        tip_position=position,
        tip_velocity=velocity,
        _states=states,
        _inputs=inputs,
    )


def tip_motion(states: Any, arm: Any, library: Any) -> tuple[Any, Any]:
    """Return position and velocity of the tip at the control instants, for NumPy or JAX."""
    q = Motion(*states.T[: len(Motion._fields)])
    return tuple(library.stack(of(arm, q), axis=-1) for of in (tip_position, tip_velocity))


@np.errstate(divide="ignore", invalid="ignore")  # in branches that are not taken
def gradient_of(inputs: Inputs, states: Array, by_states: Array) -> Gradient:
    """Return the gradient of a scalar, from its derivatives by the states at control instants."""
    volts, force, target = (
        np.empty_like(each) for each in (inputs.volts, inputs.hand_force, inputs.hand_target)
    )
    bar = np.empty((BODY_WIDTH, 1))
    arguments = (
        inputs.body,
        inputs.volts,
        inputs.hand_force,
        inputs.hand_target,
        inputs.machine.substep,
    )
    _, backward = kernels(has_paper_clutches=inputs.machine.has_paper_clutches)
    backward(*arguments, states, by_states, volts, force, target, bar)
    first = bar[FIRST:LAST, 0].copy()
    cos, sin = states[0, UNITS][::2], states[0, UNITS][1::2]
    first[0:2] += cos * first[UNITS][1::2] - sin * first[UNITS][::2]
    return Gradient(volts, force, target, _state_of(first), by_machine(inputs.machine, bar))


def _in_substeps(name: str, values: ArrayLike, shape: tuple[int, int, int]) -> Array:
    array, (steps, _, width) = finite_array(name, values), shape
    if array.shape not in ((width,), (steps, width), shape):
        raise ParameterError(
            f"{name} must have the shape ({width},), ({steps}, {width}) or {shape}, "
            f"got {array.shape}"
        )
    spread = array[:, None] if array.ndim == 2 else array
    return np.array(np.broadcast_to(spread, shape), order="C")


def _state_of(entries: Array) -> State:
    return State(**{name: entries[begin:end].copy() for name, (begin, end) in STATE.items()})
