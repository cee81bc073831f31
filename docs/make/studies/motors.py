"""What if the actuators could push? Four motors in the clutches' places, with the clutches' torques and lag.

A slipping clutch's torque opposes its slip; a motor's has the sign of its command. A command is a voltage with a sign:
the torque tends to the clutches' dynamic torque at that voltage, with that sign, behind the clutches' lag. Motors have
no friction, so nothing ever sticks. All else is the environment's own: arm, hand, draws, observation, telemetry.
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
from pter_gym.compiled.records import load, read, store
from pter_gym.controllers import Impedance, PaceSchedule, Policy, bind
from pter_gym.controllers.gains import NOMINAL, read_gains, table_voltage
from pter_gym.controllers.laws import allocate_in, pace_integral, physical, see_tip, wanted_force
from pter_gym.engine.batch import Batch
from pter_gym.engine.episode import conclude_step
from pter_gym.engine.hand import hand_force
from pter_gym.engine.recording import record_step
from pter_gym.engine.sensing import write_observation
from pter_gym.engine.step import add_energy, push_tip, take_command
from pter_gym.engine.world import CONFIG, CONSTANT_ROWS, ROW, ROWS, STORED_ROWS
from pter_gym.errors import ParameterError
from pter_gym.hands import NO_HAND, MultiSineHand
from pter_gym.hands.model import renew_sines
from pter_gym.params import Machine, require, require_kind
from pter_gym.physics.arm import Linkage, Load, Motion, Vector, advance_position, joint_torque
from pter_gym.physics.clutch import Curve, PerClutch, curve_torque, relax
from pter_gym.physics.friction import resolve, torques_on_links
from pter_gym.physics.step import Energy, energy_terms, free_motion
from pter_gym.tasks.path_following import IDEAL_SENSING, PathFollowing
from pter_gym.tasks.path_following.observation import SEEN
from pter_gym.tasks.path_following.situation import to_world

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
    pace = physical(obs, scales, SEEN.pace)
    nominal = read(gains, NOMINAL, 0)
    g = read_gains(gains, pace)
    tip = see_tip(obs, scales, nominal)
    limit = nominal.torque_limit
    force_x, force_y = wanted_force(g, tip, pace, pace_integral(g, tip, pace, memory))
    want_a, want_b = joint_torque(tip.arm, tip.q, force_x, force_y)
    wanted = allocate_in(
        g, tip, want_a, want_b, PerClutch(-limit, -limit, -limit, -limit), PerClutch(limit, limit, limit, limit)
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
def motor_substep(q: Motion, torque: PerClutch, arm: Linkage, force: Vector, h: float) -> tuple[Motion, Energy]:
    """Advance the arm by h [s] under motor torques [N·m] and a force at the tip [N].

    In the energy terms [J], ``dissipated`` is what the motors take; it is negative where they push.
    """
    on_a, on_b = torques_on_links(torque)
    nothing = PerClutch(0.0, 0.0, 0.0, 0.0)
    impact = free_motion(q, arm, Load(force.x, force.y, on_a, on_b, 0.0, 0.0), h)
    omega_a, omega_b = resolve(impact.m11, impact.m12, impact.m22, impact.p_a, impact.p_b, nothing)
    after = advance_position(q, omega_a, omega_b, h)
    hand_a, hand_b = joint_torque(arm, q, force.x, force.y)
    terms = energy_terms(q, after, arm, impact, nothing, h)
    return after, Energy(
        h * (omega_a * hand_a + omega_b * hand_b),
        -h * (omega_a * on_a + omega_b * on_b),
        terms.numerical_loss,
        terms.residual,
    )


@device
def move(w: Any, i: int, target: PerClutch, h: float) -> None:
    """Advance world i by a substep; its lagged torques are where a clutch has its dynamic ones."""
    torque = relax(load(w, ROW.torques.dynamic, i), target, w[ROW.machine.torque_decay, i])
    store(w, ROW.torques.dynamic, i, torque)
    force = to_world(hand_force(w, i), load(w, ROW.foot.heading, i))
    push_tip(w, i)
    after, energy = motor_substep(load(w, ROW.motion, i), torque, load(w, ROW.machine.arm, i), force, h)
    store(w, ROW.motion, i, after)
    add_energy(w, i, energy)


def _build_step(digest: str) -> Any:
    def step(w: Any, words: Any, volts: Any, obs: Any, telemetry: Any, config: Any, constants: Any) -> None:
        _ = digest
        h = config[CONFIG.substep]
        count = int(config[CONFIG.substeps])
        for i in range(obs.shape[0]):
            if w[ROW.alive, i] == 0.0:
                continue
            signs = PerClutch(volts[i, 0], volts[i, 1], volts[i, 2], volts[i, 3])
            take_command(w, i, PerClutch(abs(signs.x1), abs(signs.x2), abs(signs.x3), abs(signs.x4)))
            machine = load(w, ROW.machine, i)
            target = motor_torques(machine.dynamic, machine.scale, load(w, ROW.command, i), signs)
            for _k in range(count):
                move(w, i, target, h)
            store(w, ROW.torque, i, load(w, ROW.torques.dynamic, i))
            store(w, ROW.sines, i, renew_sines(load(w, ROW.sines, i)))
            conclude_step(w, i, words[i, 0], words[i, 1], config, constants)
            write_observation(w, i, obs, i, config, constants)
            record_step(w, i, telemetry, 0, i, h * count, constants)

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

    It is that of ``pter_gym.benchmark.simulation.simulate`` except for this: torques and powers have any sign, voltages
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
    acting.reset()
    arrays = batch.device_arrays()
    w = _columns(arrays["worlds"], arrays["constants"], batch.num_worlds)
    kernel, telemetry = _step_kernel(), [first]
    while len(telemetry) <= max_steps and w[ROW.alive].any():
        rows = np.full((1, *first.shape), np.nan)
        volts = np.asarray(acting.act(obs), np.float64)
        kernel(w, arrays["words"], volts, obs, rows, arrays["config"], arrays["constants"])
        telemetry.append(rows[0])
    return np.stack(telemetry)


def _columns(worlds: Array, constants: Array, count: int) -> Array:
    """Return the rows of ``count`` worlds and of their constants, one column each, from blocks of them."""
    w = np.zeros((ROWS, count))
    stored = worlds.shape[1]
    w[:stored] = worlds.transpose(1, 0, 2).reshape(stored, -1)[:, :count]
    places = w[ROW.context_at].astype(np.intp) + np.arange(CONSTANT_ROWS)[:, None]
    w[STORED_ROWS : STORED_ROWS + CONSTANT_ROWS] = constants[places]
    return w


def _check(machine: Machine, task: PathFollowing) -> None:
    """Raise a ParameterError unless motors can replace the clutches of a machine in a task."""
    require(machine.clutch.lag == "normal_force", machine.clutch, "lag", machine.clutch.lag, "normal_force")
    require(machine.hand == NO_HAND, machine, "hand", machine.hand, "a force alone")
    require_kind(task, "hand", MultiSineHand)
    require(task.friction_drift == 0.0, task, "friction_drift", task.friction_drift, "0")
    require(task.sensing == IDEAL_SENSING, task, "sensing", task.sensing, "ideal")
