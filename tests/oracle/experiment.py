"""The experiment that makes a machine's parameters visible, and what it would record on a simulated
machine.

A person moves the handle about the middle of the workspace all the time, and pulls harder where it
resists. Meanwhile the clutches are switched on and off, one at a time, at voltage after voltage. So
each clutch slips at each voltage, breaks away, and is switched while it slips; without clutches the
motion shows the inertias.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pter_gym._internal.fields import require_number
from pter_gym._physics.arm import motion_of, tip_position, tip_velocity
from pter_gym._physics.model import model_of
from pter_gym._physics.open_loop import initial_state, simulate
from pter_gym.errors import ParameterError
from pter_gym.params import SLOTS, Hand, Machine
from pter_gym.tools.identification import Log

Array = NDArray[np.float64]

TRUE_SUBSTEP = 0.25e-3
"""Substep of the simulated machine [s], finer than the model's."""

ITERATIONS = 4
"""Simulations until small torques that depend on angles agree with these."""

MIDDLE = (0.5 * math.pi - 0.85, 0.5 * math.pi + 0.6)
"""Angles of the links in the middle of the motion [rad]."""


@dataclass(frozen=True, kw_only=True)
class Experiment:
    """What is applied and recorded.

    Attributes
    ----------
    levels
        Voltages of the steps [V]: in random order, with the first one again.
    on, off
        How long a clutch is on, and then off [s].
    free
        Motion without clutches before the steps [s].
    interval
        Time between two rows of the log [s].
    stiffness, damping
        Of the person's hand towards the point where it wants to be [N/m, N·s/m].
    amplitude
        How far that point moves from the middle in x and y [m].
    frequencies
        Of that motion in x and y [Hz].
    """

    levels: tuple[float, ...] = (12.0, 3.0, 20.0, 6.0, 22.0, 9.0, 18.0, 15.0, 12.0)
    on: float = 1.1
    off: float = 0.3
    free: float = 5.0
    interval: float = 2e-3
    stiffness: float = 800.0
    damping: float = 30.0
    amplitude: float = 0.12
    frequencies: tuple[float, float] = (0.83, 1.27)

    def __post_init__(self) -> None:
        """Check the times."""
        for name in ("on", "off", "free", "interval"):
            require_number(self, name, above=0.0)

    def duration(self, clutches: int) -> float:
        """Return the length of the log [s] of a machine with so many clutches."""
        return self.free + clutches * len(self.levels) * (self.on + self.off)

    def voltages(self, times: Array, clutches: int) -> Array:
        """Return voltages [V] at times [s], shape (T, 4): the clutches in turn, level by level."""
        place = np.floor((times - self.free) / (self.on + self.off)).astype(int)
        within = (times - self.free) - place * (self.on + self.off)
        applied = np.zeros((len(times), SLOTS))
        on = (place >= 0) & (place < clutches * len(self.levels)) & (within < self.on)
        applied[on, place[on] % clutches] = np.array(self.levels)[place[on] // clutches]
        return applied


@dataclass(frozen=True, kw_only=True)
class Recorder:
    """The sensors that write the log.

    Attributes
    ----------
    angle_resolution
        Step of the encoders [rad].
    angle_noise, force_noise
        Standard deviations [rad, N].
    delay
        Time from a recorded voltage to the motion that it makes [s], 0 to 0.1.
    """

    angle_resolution: float = 2.0 * math.pi / 16384
    angle_noise: float = 0.0
    force_noise: float = 0.3
    delay: float = 0.0

    def __post_init__(self) -> None:
        """Check the ranges."""
        for name in ("angle_resolution", "angle_noise", "force_noise"):
            require_number(self, name, at_least=0.0)
        require_number(self, "delay", at_least=0.0, at_most=0.1)


EXPERIMENT = Experiment()
RECORDER = Recorder()


def record_log(
    machine: Machine,
    experiment: Experiment = EXPERIMENT,
    recorder: Recorder = RECORDER,
    seed: int = 0,
    torque: Callable[[Array], Array] | None = None,
) -> Log:
    """Return the log that the experiment would give on a simulated machine.

    Parameters
    ----------
    machine
        The machine; its hand and substep are not used.
    experiment, recorder
        What is done and how it is recorded.
    seed
        Of the noise and of the phases of the hand's motion, at least 0.
    torque
        Torques on the links [N·m] by their angles [rad], both of shape (rows, 2); None for none.
    """
    rng = np.random.default_rng([seed, 0x4964])
    ratio = round(experiment.interval / TRUE_SUBSTEP)
    if abs(ratio * TRUE_SUBSTEP - experiment.interval) > 1e-9:
        raise ParameterError(f"Experiment.interval must be a multiple of {TRUE_SUBSTEP:g} s")
    rows = round(experiment.duration(len(machine.clutches)) / experiment.interval)
    halves: Array = 0.5 * TRUE_SUBSTEP * np.arange(2 * rows * ratio, dtype=np.float64)
    middles = experiment.interval * (np.arange(rows, dtype=np.float64) + 0.5)
    applied = experiment.voltages(middles, len(machine.clutches)).clip(
        max=machine.clutch.voltage_max
    )
    # in the middle of substeps, so that no rounding decides which row a voltage is of
    row_of = np.floor((halves[1::2] - recorder.delay) / experiment.interval).astype(int)
    middle = tip_position(model_of(machine).arm, motion_of(MIDDLE))
    target = middle + _hand_path(experiment, halves, rng)
    theta, force = _motion(machine, experiment, applied[row_of.clip(0)], target, torque)
    theta = theta[::ratio] + recorder.angle_noise * rng.standard_normal((rows, 2))
    if recorder.angle_resolution > 0.0:
        theta = recorder.angle_resolution * np.round(theta / recorder.angle_resolution)
    force = force[::ratio] + recorder.force_noise * rng.standard_normal((rows, 2))
    return Log(
        interval=experiment.interval, volts=applied, theta=theta, force=force, name="simulated"
    )


def _motion(
    machine: Machine,
    experiment: Experiment,
    volts: Array,
    target: Array,
    torque: Callable[[Array], Array] | None,
) -> tuple[Array, Array]:
    """Return angles [rad] and forces [N] at the beginning of each substep, both of shape (T, 2).

    The hand's target has a row for the beginning of each substep and one for its middle, where the
    force acts.
    """
    held = replace(
        machine,
        hand=Hand(damping=experiment.damping, stiffness=experiment.stiffness),
        substep=TRUE_SUBSTEP,
    )
    state = initial_state(held, MIDDLE)
    run = simulate(held, state, volts, (0.0, 0.0), hand_target=target[1::2])
    for _ in range(ITERATIONS if torque else 0):
        of_angles = torque(run.theta)
        run = simulate(held, state, volts, (0.0, 0.0), of_angles, hand_target=target[1::2])
    theta = np.concatenate([[state.theta], run.theta[:-1]])
    omega = np.concatenate([[state.omega], run.omega[:-1]])
    arm, q = model_of(machine).arm, motion_of(theta, omega)
    tip, velocity = (np.stack(of(arm, q), axis=-1) for of in (tip_position, tip_velocity))
    return theta, experiment.stiffness * (target[::2] - tip) - experiment.damping * velocity


def _hand_path(experiment: Experiment, times: Array, rng: np.random.Generator) -> Array:
    """The hand's target, relative to the centre [m], shape (T, 2)."""
    phases = rng.uniform(0.0, 2.0 * math.pi, 2)
    swing = np.sin(times[:, None] * (2.0 * math.pi * np.array(experiment.frequencies)) + phases)
    return experiment.amplitude * swing * np.minimum(times, 1.0)[:, None]
