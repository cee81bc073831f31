"""Rides of the environment at given voltages with feedback, and their exact linearisation.

The environment's own batch moves the worlds. `Rides.linearise` differentiates each control step by the adjoint of
`pter_gym.gradients`, from the state in which the environment began it, so it also finds whether both arrive at the same
state. Two things that a rollout of a lone machine does not know are added: clutches whose friction drifts, and a push
along a curved path, which turns with the tip's place. An intent that waits for the tip is taken as it was.
"""

from collections.abc import Sequence
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pter_gym._compiled.compiler import compile_kernel, device
from pter_gym._compiled.records import store, width
from pter_gym._engine.batch import Batch
from pter_gym._engine.world import SKIP
from pter_gym._physics.arm import UnitVector
from pter_gym._physics.clutch import PerClutch, Torques
from pter_gym._physics.model import model_of
from pter_gym._physics.open_loop import BODY, BODY_WIDTH, body_of, initial_state, scratch
from pter_gym.gradients._adjoint import FIRST, LAST, backward_step, forward_step
from pter_gym.hands._model import intent_speed
from pter_gym.params import Machine
from pter_gym.tasks.path_following import COLUMN, PathFollowing
from pter_gym.tasks.path_following._rules import PathVector, to_world
from pter_gym.tasks.path_following._specification import held_machine, substeps

Array = NDArray[np.float64]

STATE = 12
"""Entries of a state: two angles, two angular velocities, and the breakaway and dynamic torques of four clutches."""

TAPE = LAST - FIRST + width(Torques) + 1
"""Entries of what ``forward_step`` keeps."""

DRIFT, TURN_X, TURN_Y, ACROSS_X, ACROSS_Y = range(2, 7)
"""Columns behind a force: the clutches' drift, how the heading turns with the tip, and the force's derivative by it."""


@device
def put_state(body: Any, state: Any) -> None:
    """Put a body into a state (STATE,)."""
    for k in range(2):
        body[BODY.motion.theta_a + k, 0] = state[k]
        body[BODY.motion.omega_a + k, 0] = state[2 + k]
        body[BODY.motion.cos_a + 2 * k, 0] = np.cos(state[k])
        body[BODY.motion.sin_a + 2 * k, 0] = np.sin(state[k])
    for k in range(8):
        body[BODY.torques.breakaway.x1 + k, 0] = state[4 + k]


@device
def seed(body: Any, bar: Any, entry: int) -> None:
    """Make the adjoint that of one of the angles and angular velocities."""
    bar[:] = 0.0
    if entry < 2:
        bar[BODY.motion.cos_a + 2 * entry, 0] = -body[BODY.motion.sin_a + 2 * entry, 0]
        bar[BODY.motion.sin_a + 2 * entry, 0] = body[BODY.motion.cos_a + 2 * entry, 0]
    else:
        bar[BODY.motion.omega_a + entry - 2, 0] = 1.0


@device
def put_adjoint(body: Any, bar: Any, by: Any) -> None:
    """Write the adjoints of a state and of voltages, (STATE + 4,)."""
    for k in range(2):
        at = BODY.motion.cos_a + 2 * k
        by[k] = body[at, 0] * bar[at + 1, 0] - body[at + 1, 0] * bar[at, 0]
        by[2 + k] = bar[BODY.motion.omega_a + k, 0]
    for k in range(8):
        by[4 + k] = bar[BODY.torques.breakaway.x1 + k, 0]
    for k in range(4):
        by[STATE + k] = bar[BODY.command.x1 + k, 0]


@device
def turn(body: Any, bar: Any, force: Any, by_force: Any) -> None:
    """Pull the adjoint of a control step's forces back through their heading to where the tip was."""
    by_heading = 0.0
    for k in range(len(force)):
        by_heading += by_force[k, 0] * force[k, ACROSS_X] + by_force[k, 1] * force[k, ACROSS_Y]
    by_x, by_y = by_heading * force[0, TURN_X], by_heading * force[0, TURN_Y]
    length_a, length_b = body[BODY.machine.arm.length_a, 0], body[BODY.machine.arm.length_b, 0]
    bar[BODY.motion.cos_a, 0] += length_a * by_x
    bar[BODY.motion.sin_a, 0] += length_a * by_y
    bar[BODY.motion.cos_b, 0] += length_b * by_x
    bar[BODY.motion.sin_b, 0] += length_b * by_y


def _build_derivatives(digest: str) -> Any:
    def derivatives(given: Any, states: Any, volts: Any, force: Any, target: Any, h: float, by: Any, ends: Any) -> None:
        """Fill the derivatives of each control step's last angles and velocities, and these."""
        _ = digest
        body, end = scratch(given), scratch(given)
        tape = np.empty((force.shape[1] + 1, 2, TAPE))
        bar = np.empty((BODY_WIDTH, 1))
        by_force, by_target = np.empty((force.shape[1], 2)), np.empty((force.shape[1], 2))
        for n in range(volts.shape[0]):
            put_state(body, states[n])
            store(body, BODY.command, 0, PerClutch(volts[n, 0], volts[n, 1], volts[n, 2], volts[n, 3]))
            body[BODY.drift, 0] = force[n, 0, DRIFT]
            forward_step(body, h, force[n], target[n], tape)
            end[:] = body
            for k in range(4):
                ends[n, k] = end[BODY.motion.theta_a + k, 0]
                seed(end, bar, k)
                backward_step(body, bar, h, force[n], target[n], tape, by_force, by_target)
                turn(body, bar, force[n], by_force)
                put_adjoint(body, bar, by[n, k])

    return derivatives


@cache
def derivatives_kernel() -> Any:
    return compile_kernel(_build_derivatives)


class Ridden(NamedTuple):
    """Rides of W worlds, C at a time, or of some of these: arrays of T control steps, NaN after the end.

    Attributes
    ----------
    volts
        What was applied, (T, …, 4); after the end the last voltages.
    states
        At the control instants, (T + 1, …, STATE).
    time, arc_length, normal_error, success
        Of the telemetry, (T + 1, …).
    """

    volts: Array
    states: Array
    time: Array
    arc_length: Array
    normal_error: Array
    success: Array


class Linear(NamedTuple):
    """How W rides depend on states and voltages: x⁺ = A·x + B·u, and arc length and normal error by C·x.

    ``apart`` is the largest difference between angles and angular velocities at the end of a control step, in the
    environment and in the rollout that is differentiated.
    """

    a: Array
    b: Array
    c: Array
    apart: float


class Rides:
    """Worlds that ride the same episodes again and again, each in so many copies.

    Parameters
    ----------
    machines, tasks, seeds
        Of W episodes.
    copies
        C.
    """

    def __init__(
        self, machines: Sequence[Machine], tasks: Sequence[PathFollowing], seeds: Sequence[int], copies: int
    ) -> None:
        self._shape = copies, len(tasks)
        self._batch = Batch([*machines] * copies, [*tasks] * copies)
        self._tasks, self._seeds = tasks, [*seeds] * copies
        self._held = [held_machine(task, machine) for task, machine in zip(tasks, machines, strict=True)]
        self._period, self._substeps = tasks[0].control_period, substeps(tasks[0], machines[0])
        self._hands = [task.hand.model(task.pace, self._held[0].substep, (0, 0)) for task in tasks]
        self._models = [model_of(machine) for machine in self._held]
        self._lengths = np.array([[machine.arm.length_a, machine.arm.length_b] for machine in self._held])
        self._kept = np.array([model.torque_decay for model in self._models])[:, None] ** (2 * self._substeps)
        self._scale = np.array([tuple(model.scale) for model in self._models])
        self._rate = np.array([task.friction_drift for task in tasks])
        curves = [[tuple(model.breakaway), tuple(model.dynamic)] for model in self._models]
        self._curves = np.moveaxis(np.array(curves), 0, -1)[..., None]

    def follow(self, volts: Array, states: Array | None = None, gains: Array | None = None) -> Ridden:
        """Ride at voltages (T, C, W, 4), plus gains (T, W, 4, STATE) times how far states are from given ones."""
        steps, worlds = len(volts), self._shape
        row: Any = self._batch.reset(self._seeds)[1]
        found = Ridden(
            np.zeros((steps, *worlds, 4)),
            np.full((steps + 1, *worlds, STATE), np.nan),
            *(np.full((steps + 1, *worlds), np.nan) for _ in range(4)),
        )
        torques, alive = np.zeros((*worlds, 8)), np.ones(worlds, np.bool_)
        for n in range(steps + 1):
            row = row.reshape(*worlds, -1)
            found.states[n] = np.concatenate([self._motion(row), torques], axis=-1)
            for name in ("time", "arc_length", "normal_error"):
                getattr(found, name)[n] = row[..., getattr(COLUMN, name)]
            found.success[n] = row[..., COLUMN.is_success]
            alive &= row[..., COLUMN.terminated] == 0.0
            if n == steps or not alive.any():
                found.volts[n:] = found.volts[n - 1]
                break
            asked = volts[n]
            if states is not None and gains is not None:
                asked = asked + np.einsum("wij,cwj->cwi", gains[n], np.nan_to_num(found.states[n] - states[n]))
            given = asked.clip(0.0, self._batch.action_high).astype(np.float32).astype(np.float64)
            found.volts[n] = np.where(alive[..., None], given, found.volts[n - 1])
            row = self._batch.step(found.volts[n].reshape(-1, 4), SKIP).telemetry[0]
            steady, _ = self._steady(found.volts[n], n)
            torques = self._kept * torques + (1.0 - self._kept) * steady
        return found

    def _motion(self, row: Any) -> Array:
        """Return angles and angular velocities, (C, W, 4)."""
        theta, velocity = row[..., [*COLUMN.theta]], row[..., [*COLUMN.tip_velocity]]
        columns = self._lengths[..., None] * np.stack([-np.sin(theta), np.cos(theta)], axis=-1)
        (a_x, a_y), (b_x, b_y) = np.moveaxis(columns, (-2, -1), (0, 1))
        omega_a = b_y * velocity[..., 0] - b_x * velocity[..., 1]
        omega_b = a_x * velocity[..., 1] - a_y * velocity[..., 0]
        omega = np.stack([omega_a, omega_b], axis=-1) / (a_x * b_y - a_y * b_x)[..., None]
        return np.concatenate([theta, omega], axis=-1)

    def _drift(self, step: Any) -> Array:
        """Return what friction's drift has made of the torques by a control step, (…, W)."""
        return (1.0 + self._rate * self._period * np.asarray(step, np.float64)[..., None]).clip(0.1, 10.0)

    def _steady(self, volts: Array, step: Any) -> tuple[Array, Array]:
        """Return the torques to which clutches tend (…, W, 8), and their derivatives by the voltages."""
        scale = self._scale * self._drift(step)[..., None]
        values: list[Array] = []
        slopes: list[Array] = []
        for slope, knee, curvature in self._curves:
            beyond = np.maximum(volts - knee, 0.0)
            values.append(scale * (slope * volts + curvature * beyond**2))
            slopes.append(scale * (slope + 2.0 * curvature * beyond))
        return np.concatenate(values, axis=-1), np.concatenate(slopes, axis=-1)

    def linearise(self, ridden: Ridden) -> Linear:
        """Return how rides of the W worlds depend on their states and voltages."""
        steps, worlds = ridden.volts.shape[:2]
        a, b = np.zeros((steps, worlds, STATE, STATE)), np.zeros((steps, worlds, STATE, 4))
        c, apart = np.zeros((steps + 1, worlds, 2, STATE)), 0.0
        _, slopes = self._steady(ridden.volts, np.arange(steps))
        a[:] = np.eye(STATE)
        a[..., 4:, 4:] *= self._kept[:, None]
        for k in range(8):
            b[..., 4 + k, k % 4] = (1.0 - self._kept[:, 0]) * slopes[..., k]
        for world, task in enumerate(self._tasks):
            count = int(np.isfinite(ridden.time[:, world]).sum())
            s, error = ridden.arc_length[:count, world], ridden.normal_error[:count, world]
            states = ridden.states[:count, world].copy()
            _, _, heading, curvature = task.path.arcs.at(s)
            left = np.stack([-np.sin(heading), np.cos(heading)], axis=1)
            along = np.stack([left[:, 1], -left[:, 0]], axis=1)
            ahead = along / (1.0 - curvature * error)[:, None]
            force, target = self._loads(world, s, along, curvature[:, None] * ahead)
            machine, by, ends = self._held[world], np.empty((count - 1, 4, STATE + 4)), np.empty((count - 1, 4))
            body = body_of(machine, initial_state(machine, states[0, :2]))
            given = states, np.ascontiguousarray(ridden.volts[: count - 1, world]), force, target, machine.substep
            derivatives_kernel()(body, *given, by, ends)
            apart = max(apart, float(np.abs(ends - states[1:, :4]).max()))
            a[: count - 1, world, :4], b[: count - 1, world, :4] = by[..., :STATE], by[..., STATE:]
            columns = self._lengths[world, :, None] * np.stack([-np.sin(states[:, :2]), np.cos(states[:, :2])], axis=-1)
            for output, direction in enumerate((ahead, left)):
                c[:count, world, output, :2] = np.einsum("nkx,nx->nk", columns, direction)
        return Linear(a, b, c, apart)

    def _loads(self, world: int, s: Array, along: Any, turn: Array) -> tuple[Array, Array]:
        """Return force with the columns behind it, and the spring's target, in each substep of a ride."""
        task, hand, steps = self._tasks[world], self._hands[world], len(s) - 1
        middle = (np.arange(self._substeps) + 0.5) / self._substeps
        recorded: Any = np.zeros((steps, self._substeps, 2))
        if len(table := task.hand.sampled(self._period)):
            ends = table[np.minimum(np.arange(steps + 1), len(table) - 1)]
            recorded = ends[:-1, None] + middle[:, None] * np.diff(ends, axis=0)[:, None]
        turns = self._period * (np.arange(steps)[:, None, None] + middle[:, None]) * np.array(task.hand.frequencies)
        across: Any = np.sin(2.0 * np.pi * turns + hand.phase) @ hand.amplitude + recorded[..., 1]
        heading = UnitVector(along[:-1, :1], along[:-1, 1:])
        pushed = np.stack(to_world(PathVector(hand.push + recorded[..., 0], across), heading), axis=-1)
        force, target = np.zeros((steps, self._substeps, 7)), np.zeros((steps, self._substeps, 2))
        force[..., :2] = pushed
        force[..., DRIFT] = self._drift(np.arange(steps))[:, world, None]
        force[..., TURN_X : TURN_Y + 1] = turn[:-1, None]
        force[..., ACROSS_X], force[..., ACROSS_Y] = -pushed[..., 1], pushed[..., 0]
        if hand.intent_speed > 0.0:
            places = np.stack(task.path.arcs.at(self._intents(world, s))[:2], axis=1)
            change = np.diff(places, axis=0)[:, None]
            target[:] = places[:-1, None] + middle[:, None] * change
            force[..., :2] += self._held[world].hand.damping * change / self._period
        return force, target

    def _intents(self, world: int, s: Array) -> Array:
        """Return the arc length of the intended point at the control instants."""
        hand, found = self._hands[world], [0.0]
        for step, reached in enumerate(s[:-1].tolist()):
            speed = intent_speed(self._period * (step + 0.5), hand.intent_rise, hand.intent_speed)
            found.append(max(found[-1], min(found[-1] + self._period * speed, reached + hand.intent_lead)))
        return np.array(found)
