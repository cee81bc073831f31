"""Rides of many worlds at given voltages, in the environment's own batch, with exact gradients by the voltages.

A ride is a kernel call of the engine, with a law that reads its voltages from a table. Its gradient is that of
`pter_gym.gradients`, to which `Rides` gives each world's machine and hand as the ride found them. Two things that a
rollout of a lone machine does not know are added: clutches whose friction drifts, and a push along a curved path, which
turns with the tip's place. An intent that waits for the tip is taken as it was, without a derivative.
"""

from collections.abc import Sequence
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pter_gym._compiled.compiler import compile_kernel, device
from pter_gym._engine.batch import Batch
from pter_gym._physics.arm import UnitVector
from pter_gym._physics.clutch import PerClutch
from pter_gym._physics.open_loop import BODY, BODY_WIDTH, body_of, initial_state
from pter_gym.benchmark.simulation import time_limit
from pter_gym.gradients import _adjoint as adjoint
from pter_gym.hands._model import PerSine, Sines, advance_sines, intent_speed, renew_sines, sum_of_sines, unit_vector
from pter_gym.params import Machine
from pter_gym.tasks.path_following import COLUMN, PathFollowing
from pter_gym.tasks.path_following._situation import PathVector, to_world
from pter_gym.tasks.path_following._specification import held_machine, substeps

Array = NDArray[np.float64]

DRIFT, TURN_X, TURN_Y, ACROSS_X, ACROSS_Y = range(2, 7)
"""Columns behind a force: the clutches' drift, how the heading turns with the tip, and the force's derivative by it."""

COS_A = int(BODY.motion.cos_a) - adjoint.FIRST


@device
def replay(obs: Any, scales: Any, gains: Any, memory: Any) -> PerClutch:  # noqa: ARG001
    """Return the voltages that a world's memory holds behind the number of its next control step."""
    at = 1 + 4 * int(memory[0])
    memory[0] += 1.0
    return PerClutch(memory[at], memory[at + 1], memory[at + 2], memory[at + 3])


@device
def drifted_forward(body: Any, h: float, force: Any, target: Any, tape: Any) -> None:
    """Move a body through a control step at the drift that comes with the forces."""
    body[BODY.drift, 0] = force[0, DRIFT]
    adjoint.forward_step(body, h, force, target, tape)


@device
def turned_backward(
    body: Any, bar: Any, h: float, force: Any, target: Any, tape: Any, by_force: Any, by_target: Any
) -> None:
    """Pull adjoints back through a control step, and through the heading of its forces to where the tip was."""
    adjoint.backward_step(body, bar, h, force, target, tape, by_force, by_target)
    by_heading = 0.0
    for k in range(len(force)):
        by_heading += by_force[k, 0] * force[k, ACROSS_X] + by_force[k, 1] * force[k, ACROSS_Y]
    by_x, by_y = by_heading * force[0, TURN_X], by_heading * force[0, TURN_Y]
    length_a, length_b = body[BODY.machine.arm.length_a, 0], body[BODY.machine.arm.length_b, 0]
    bar[BODY.motion.cos_a, 0] += length_a * by_x
    bar[BODY.motion.sin_a, 0] += length_a * by_y
    bar[BODY.motion.cos_b, 0] += length_b * by_x
    bar[BODY.motion.sin_b, 0] += length_b * by_y


@cache
def kernels() -> tuple[Any, Any]:
    """Return ``forward`` and ``backward`` of whole rides."""
    return (
        compile_kernel(adjoint._build_forward, forward_step=drifted_forward),
        compile_kernel(adjoint._build_backward, forward_step=drifted_forward, backward_step=turned_backward),
    )


class Ridden(NamedTuple):
    """Telemetry of N rides at given voltages, (T + 1, N, columns), NaN after their ends; see ``Rides.ride``."""

    telemetry: Array
    volts: Array


class Rides:
    """N worlds that ride the same episodes again and again.

    Parameters
    ----------
    machines, tasks, seeds
        Of the episodes.
    """

    def __init__(self, machines: Sequence[Machine], tasks: Sequence[PathFollowing], seeds: Sequence[int]) -> None:
        self.batch = Batch(machines, tasks)
        self.tasks, self.seeds = tasks, seeds
        self.held = [held_machine(task, machine) for task, machine in zip(tasks, machines, strict=True)]
        self.steps = max(map(time_limit, tasks))
        self.period, self.substep = tasks[0].control_period, self.held[0].substep
        self.substeps = substeps(tasks[0], machines[0])
        self._hands = [task.hand.model(task.pace, self.substep, (0, 0)) for task in tasks]
        self._sines = self._sum_of_sines()
        self._recorded = self._recordings()

    def _sum_of_sines(self) -> Array:
        """Return the disturbance in the middle of each substep [N], (T, S, N), as the engine advances it."""

        def per_sine(values: Any) -> Any:
            return np.moveaxis(np.array([tuple(each) for each in values]), 0, -1)

        hands = self._hands
        amplitude = PerSine(*per_sine([hand.amplitude for hand in hands]))
        turn = Sines(*(UnitVector(*each) for each in per_sine([hand.half_turn for hand in hands])))
        starts = per_sine([[unit_vector(angle) for angle in hand.phase] for hand in hands])
        sines = Sines(*(UnitVector(*each) for each in starts))
        found = np.empty((self.steps, self.substeps, len(hands)))
        for step in range(self.steps):
            for k in range(self.substeps):
                sines = advance_sines(sines, turn)
                found[step, k] = sum_of_sines(amplitude, sines)
                sines = advance_sines(sines, turn)
            sines = renew_sines(sines)
        return found

    def _recordings(self) -> Array:
        """Return the recorded forces along and across in the middle of each substep [N], (2, T, S, N)."""
        found = np.zeros((2, self.steps, self.substeps, len(self.tasks)))
        part = ((np.arange(self.substeps) + 0.5) / self.substeps)[:, None]
        for world, task in enumerate(self.tasks):
            if len(table := task.hand.sampled(self.period)):
                ends = table[np.minimum(np.arange(self.steps + 1), len(table) - 1)]
                found[..., world] = np.moveaxis(ends[:-1, None] + part * np.diff(ends, axis=0)[:, None], -1, 0)
        return found

    def ride(self, volts: Array) -> Ridden:
        """Ride at voltages (T, N, 4), which are rounded as the environment rounds actions."""
        steps, worlds, _ = volts.shape
        volts = volts.astype(np.float32).astype(np.float64)
        obs, first = self.batch.reset(self.seeds)
        memory = np.zeros((worlds, 1 + 4 * steps))
        memory[:, 1:] = volts.swapaxes(0, 1).reshape(worlds, -1)
        _, rows = self.batch.rollout(obs, replay, np.empty(0), steps, memory)
        return Ridden(np.concatenate([first[None], rows]), volts)

    def gradient(self, ridden: Ridden, by_arc: Array, by_error: Array) -> tuple[Array, Array]:
        """Return derivatives by the voltages (T, N, 4), from those by arc length and normal error (T + 1, N).

        Also return how far the tip of each gradient's own rollout was from that of the environment, (N,) [m].
        """
        found = np.zeros_like(ridden.volts)
        apart = np.zeros(len(self.tasks))
        for world, task in enumerate(self.tasks):
            rows = ridden.telemetry[:, world]
            rows = rows[: int(np.isfinite(rows[:, COLUMN.time]).sum())]
            steps = len(rows) - 1
            s, error = rows[:, COLUMN.arc_length], rows[:, COLUMN.normal_error]
            _, _, heading, curvature = task.path.arcs.at(s)
            along = np.stack([np.cos(heading), np.sin(heading)], axis=1)
            left = np.stack([-along[:, 1], along[:, 0]], axis=1)
            turn = (1.0 / (1.0 - curvature * error))[:, None] * along
            force, target = self._loads(world, s, along, curvature[:, None] * turn)
            arm = self.held[world].arm
            at = rows[:, [*COLUMN.tip]]
            by_tip = turn * by_arc[: steps + 1, world, None] + left * by_error[: steps + 1, world, None]
            by_states = np.zeros((steps + 1, adjoint.LAST - adjoint.FIRST))
            by_states[:, COS_A : COS_A + 4] = np.concatenate([arm.length_a * by_tip, arm.length_b * by_tip], axis=1)
            body = body_of(self.held[world], initial_state(self.held[world], rows[0, [*COLUMN.theta]]))
            states = np.empty_like(by_states)
            volts = np.ascontiguousarray(ridden.volts[:steps, world])
            forward, backward = kernels()
            forward(body, volts, force, target, self.substep, states)
            units = states[:, COS_A : COS_A + 4]
            apart[world] = np.abs(arm.length_a * units[:, :2] + arm.length_b * units[:, 2:] - at).max()
            by_volts, bar = np.empty_like(volts), np.empty((BODY_WIDTH, 1))
            backward(
                *(body, volts, force, target, self.substep, states, by_states),
                *(by_volts, np.empty_like(target), np.empty_like(target), bar),
            )
            found[:steps, world] = by_volts
        return found, apart

    def _loads(self, world: int, s: Array, along: Array, turn: Array) -> tuple[Array, Array]:
        """Return force with the columns behind it, and the spring's target, in each substep of a ride."""
        task, hand, steps = self.tasks[world], self._hands[world], len(s) - 1
        heading = UnitVector(along[:-1, :1], along[:-1, 1:])
        recorded = self._recorded[:, :steps, :, world]
        parts = PathVector(hand.push + recorded[0], self._sines[:steps, :, world] + recorded[1])
        pushed = np.stack(to_world(parts, heading), axis=-1)
        force = np.zeros((steps, self.substeps, 7))
        force[..., :2] = pushed
        drift = 1.0 + task.friction_drift * self.period * np.arange(steps)
        force[..., DRIFT] = drift.clip(0.1, 10.0)[:, None]
        force[..., TURN_X : TURN_Y + 1] = turn[:-1, None]
        force[..., ACROSS_X], force[..., ACROSS_Y] = -pushed[..., 1], pushed[..., 0]
        target = np.zeros((steps, self.substeps, 2))
        if hand.intent_speed > 0.0:
            x, y, _, _ = task.path.arcs.at(self._intents(world, s))
            places = np.stack([x, y], axis=1)
            velocity = (np.diff(places, axis=0) / self.period)[:, None]
            target[:] = places[:-1, None] + ((np.arange(self.substeps) + 0.5) * self.substep)[:, None] * velocity
            force[..., :2] += self.held[world].hand.damping * velocity
        return force, target

    def _intents(self, world: int, s: Array) -> Array:
        """Return the arc length of the intended point at the control instants, (T + 1,)."""
        hand, at = self._hands[world], 0.0
        found = [at]
        for step, reached in enumerate(s[:-1].tolist()):
            speed = intent_speed(self.period * (step + 0.5), hand.intent_rise, hand.intent_speed)
            at = max(at, min(at + self.period * speed, reached + hand.intent_lead))
            found.append(at)
        return np.array(found)
