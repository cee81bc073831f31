"""What if the actuators could push? Four motors in the clutches' places, with the clutches' torques and lag.

A slipping clutch's torque opposes its slip; a motor's has the sign of its command. A command is a voltage with a sign:
the torque tends to the clutches' dynamic torque at that voltage, with that sign, behind the clutches' lag. Motors have
no friction, so that nothing ever sticks. All else is the environment's own: arm, hand, draws, observation, telemetry.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pter_gym.benchmark.simulation import AnyPolicy
from pter_gym.compiled.compiler import compile_kernel, device
from pter_gym.compiled.layout import Layout
from pter_gym.controllers import Impedance, PaceSchedule, Policy, bind
from pter_gym.controllers.allocation import allocate
from pter_gym.controllers.gains import LENGTH_A, LENGTH_B, TORQUE_LIMIT, read_gains, table_voltage
from pter_gym.controllers.laws import PACE, pace_integral, see_tip, wanted_force
from pter_gym.engine.batch import Batch
from pter_gym.engine.world import (
    ALIVE,
    COMMAND,
    CONTEXT_AT,
    HEADING,
    LIMIT,
    PARAM,
    SCRATCH_ROWS,
    SINE,
    SUBSTEP,
    SUBSTEPS,
    TORQUE,
    hand_force,
    judge_step,
    locate,
    observe_world,
    push_tip,
    record_step,
    take_command,
    write_observation,
)
from pter_gym.errors import ParameterError
from pter_gym.hands import NO_HAND, MultiSineHand, renew_sines
from pter_gym.params import Machine, require, require_kind
from pter_gym.physics.arm import Linkage, Load, Motion, advance_position, joint_torque
from pter_gym.physics.clutch import Curve, PerClutch, curve_torque, relax
from pter_gym.physics.friction import resolve
from pter_gym.physics.model import (
    DYNAMIC,
    SCALE,
    TORQUE_DECAY,
    dynamic_curve,
    linkage,
    load_four,
    load_motion,
    store_four,
    store_motion,
)
from pter_gym.physics.step import Energy, energy_terms, free_motion
from pter_gym.tasks.path_following import COLUMN, IDEAL_SENSING, PARAM_ROWS, PathFollowing

Array = NDArray[np.float64]


@device
def signed(magnitude: float, direction: float) -> float:
    """Return a magnitude with the sign of a number."""
    return magnitude if direction >= 0.0 else -magnitude


@device
def push_freely(obs: Any, scales: Any, gains: Any, memory: Any) -> PerClutch:
    """Return the signed voltages [V] of the impedance law without the passive constraint.

    The wanted tip force is that of ``pter_gym.controllers.laws.guide``; the allocation may choose any sign of torque.
    """
    pace = obs[PACE] * scales[PACE]
    g = read_gains(gains, pace)
    tip = see_tip(obs, scales, gains)
    length_a = gains[LENGTH_A]
    length_b = gains[LENGTH_B]
    limit = gains[TORQUE_LIMIT]
    force_x, force_y = wanted_force(g, tip, pace, pace_integral(obs, g, tip, pace, memory))
    tip_space = g.tip_space >= 0.5
    wanted = allocate(
        length_a * (tip.cos_a * force_y - tip.sin_a * force_x),
        length_b * (tip.cos_b * force_y - tip.sin_b * force_x),
        PerClutch(-limit, -limit, -limit, -limit),
        PerClutch(limit, limit, limit, limit),
        length_a * length_a if tip_space else 1.0,
        length_a * length_b * (tip.cos_a * tip.cos_b + tip.sin_a * tip.sin_b) if tip_space else 0.0,
        length_b * length_b if tip_space else 1.0,
    )
    return PerClutch(
        signed(table_voltage(gains, abs(wanted.x1)), wanted.x1),
        signed(table_voltage(gains, abs(wanted.x2)), wanted.x2),
        signed(table_voltage(gains, abs(wanted.x3)), wanted.x3),
        signed(table_voltage(gains, abs(wanted.x4)), wanted.x4),
    )


@device
def motor_torques(curve: Curve, scale: PerClutch, volts: PerClutch, signs: PerClutch) -> PerClutch:
    """Return the torques [N·m] that motors settle to at voltages [V], with the signs of other numbers."""
    return PerClutch(
        signed(scale.x1 * curve_torque(curve, volts.x1), signs.x1),
        signed(scale.x2 * curve_torque(curve, volts.x2), signs.x2),
        signed(scale.x3 * curve_torque(curve, volts.x3), signs.x3),
        signed(scale.x4 * curve_torque(curve, volts.x4), signs.x4),
    )


@device
def motor_substep(
    q: Motion, torque: PerClutch, arm: Linkage, force_x: float, force_y: float, h: float
) -> tuple[Motion, Energy]:
    """Advance the arm by h [s] under motor torques [N·m] and a force at the tip [N].

    In the energy terms [J], ``dissipated`` is what the motors take; it is negative where they push.
    """
    on_a = torque.x1 + torque.x3 + torque.x4
    on_b = torque.x2 - torque.x3 + torque.x4
    nothing = PerClutch(0.0, 0.0, 0.0, 0.0)
    impact = free_motion(q, arm, Load(force_x, force_y, on_a, on_b, 0.0, 0.0), h)
    omega_a, omega_b = resolve(impact.m11, impact.m12, impact.m22, impact.p_a, impact.p_b, nothing)
    after = advance_position(q, omega_a, omega_b, h)
    hand_a, hand_b = joint_torque(arm, q, force_x, force_y)
    terms = energy_terms(q, after, arm, impact, nothing, h)
    return after, Energy(
        h * (omega_a * hand_a + omega_b * hand_b),
        -h * (omega_a * on_a + omega_b * on_b),
        terms.numerical_loss,
        terms.residual,
    )


@device
def move(w: Any, i: int, target: PerClutch, h: float) -> Energy:
    """Advance world i by a substep; its lagged torques stand where a clutch has its dynamic ones."""
    torque = relax(load_four(w, DYNAMIC, i), target, w[PARAM + TORQUE_DECAY, i])
    store_four(w, DYNAMIC, i, torque)
    along, across = hand_force(w, i)
    push_tip(w, i)
    cos = w[HEADING, i]
    sin = w[HEADING + 1, i]
    after, energy = motor_substep(
        load_motion(w, i), torque, linkage(w, PARAM, i), along * cos - across * sin, along * sin + across * cos, h
    )
    store_motion(w, i, after)
    return energy


def _build_step(digest: str) -> Any:
    def step(w: Any, volts: Any, obs: Any, telemetry: Any, config: Any, constants: Any) -> None:
        _ = digest
        h = config[SUBSTEP]
        count = int(config[SUBSTEPS])
        for i in range(obs.shape[0]):
            if w[ALIVE, i] == 0.0:
                continue
            signs = PerClutch(volts[i, 0], volts[i, 1], volts[i, 2], volts[i, 3])
            take_command(w, i, PerClutch(abs(signs.x1), abs(signs.x2), abs(signs.x3), abs(signs.x4)))
            target = motor_torques(
                dynamic_curve(w, PARAM, i), load_four(w, PARAM + SCALE, i), load_four(w, COMMAND, i), signs
            )
            hand = taken = loss = residual = 0.0
            for _k in range(count):
                energy = move(w, i, target, h)
                hand += energy.hand_work
                taken += energy.dissipated
                loss += energy.numerical_loss
                residual += energy.residual
            store_four(w, TORQUE, i, load_four(w, DYNAMIC, i))
            renew_sines(w, SINE, i)
            locate(w, i, constants)
            judge_step(w, i, h * count, config[LIMIT])
            observe_world(w, i, config)
            write_observation(w, i, obs, i, config, constants)
            record_step(w, i, telemetry, 0, i, h * count, constants)
            telemetry[0, i, COLUMN.energy.hand_work] = hand
            telemetry[0, i, COLUMN.energy.hand_work + 1] = taken
            telemetry[0, i, COLUMN.energy.hand_work + 2] = loss
            telemetry[0, i, COLUMN.energy.hand_work + 3] = residual

    return step


@cache
def _step_kernel() -> Any:
    return compile_kernel(_build_step)


def on_motors(controller: Impedance | PaceSchedule, machine: Machine, layout: Layout) -> Policy:
    """Return the impedance law for ``simulate_motors``: the gains of a controller, and no passive constraint.

    Raises
    ------
    ParameterError
        If it is another law, or has a torque loop, whose voltages know no sign.
    """
    kinds = {type(each) for _, each in controller.knots} if isinstance(controller, PaceSchedule) else {type(controller)}
    if kinds != {Impedance}:
        raise ParameterError("controller must be Impedance, without a torque loop, or a schedule of such")
    return replace(controller.bind(machine, layout), law=push_freely)


def simulate_motors(batch: Batch, policy: AnyPolicy, seeds: Sequence[int], max_steps: int) -> Array:
    """Return the telemetry of new episodes on motors, (steps + 1, N, len(TELEMETRY)), NaN after the end of an episode.

    It is that of ``pter_gym.benchmark.simulation.simulate`` but for this: torques and powers have any sign, voltages
    are magnitudes, and ``dissipated`` is what the motors take, negative where they push.

    Parameters
    ----------
    batch
        N worlds whose hands are forces alone, with ideal sensors, clutches that lag in the normal force, and no drift.
    policy
        Returns signed voltages, float32 (N, entries) to (N, 4); from ``on_motors``, or any other.
    seeds
        Of the resets, N of them.
    max_steps
        Control steps after which an episode is truncated.

    Raises
    ------
    ParameterError
        If a machine or a task has more to it.
    """
    for machine, task in batch.pairs:
        _check(machine, task)
    obs, first = batch.reset(seeds)
    acting = bind(policy, batch.machine, batch.layout)
    acting.reset(batch)
    arrays = batch.device_arrays()
    w = _columns(arrays["worlds"], arrays["constants"], batch.num_worlds)
    kernel, telemetry = _step_kernel(), [first]
    while len(telemetry) <= max_steps and w[ALIVE].any():
        rows = np.full((1, *first.shape), np.nan)
        volts = np.asarray(acting.act(obs), np.float64)
        kernel(w, volts, obs, rows, arrays["config"], arrays["constants"])
        telemetry.append(rows[0])
    return np.stack(telemetry)


def _columns(worlds: Array, constants: Array, count: int) -> Array:
    """Return the rows of ``count`` worlds and of their constants, one column each, from blocks of them."""
    w = np.zeros((SCRATCH_ROWS, count))
    stored = worlds.shape[1]
    w[:stored] = worlds.transpose(1, 0, 2).reshape(stored, -1)[:, :count]
    w[PARAM : PARAM + PARAM_ROWS] = constants[w[CONTEXT_AT].astype(np.intp) + np.arange(PARAM_ROWS)[:, None]]
    return w


def _check(machine: Machine, task: PathFollowing) -> None:
    """Raise a ParameterError unless motors can stand in for the clutches of a machine in a task."""
    require(machine.clutch.lag == "normal_force", machine.clutch, "lag", machine.clutch.lag, "normal_force")
    require(machine.hand == NO_HAND, machine, "hand", machine.hand, "a force alone")
    require_kind(task, "hand", MultiSineHand)
    require(task.friction_drift == 0.0, task, "friction_drift", task.friction_drift, "0")
    require(task.sensing == IDEAL_SENSING, task, "sensing", task.sensing, "ideal")
