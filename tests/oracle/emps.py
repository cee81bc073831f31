"""Records of a machine: EMPS, a prismatic axis with dry friction that a motor drives by a screw.

``emps.npz`` holds both records of Janot, Gautier and Brunot, "Data Set and Reference Models of
EMPS" (Workshop on Nonlinear System Identification Benchmarks, Eindhoven, 2019), as distributed at
github.com/wmkouw/NSI-EMPS (MIT licence): 24,841 rows at 1 kHz, rounded to 0.1 µm and 1 mV and
stored as differences. In the second, 5 V are added to the motor's command for half of each second.
"""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np

from pter_gym._physics.open_loop import initial_state, simulate
from pter_gym.params import BASELINE, Machine
from pter_gym.tools.identification import Log

MASS, VISCOUS, DRY, OFFSET = 95.1089, 203.5034, 20.3935, -3.1648
"""Published: M [kg], Fv [N·s/m], Fc [N], and a constant force against the motor's [N]."""

FORCE_PER_VOLT = 35.150652
"""Of the motor [N/V]."""

POSITION_GAIN, VELOCITY_GAIN = 160.18, 243.45
"""Of the recorded controller [1/s, V·s/m]."""

INTERVAL = 1e-3
LENGTH = 0.1
"""Of link A [m]: the axis moves its tip, on an arc of this radius."""

LINK_B = 0.5 * np.pi + 1.35
"""Angle of link B, which rests [rad]: the force points along it, so it feels no torque."""

RECORDS = ("plain", "pulses")


@cache
def record(name: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Position [m], the motor's command [V] and the position's reference [m], shape (rows,)."""
    with np.load(Path(__file__).with_name("emps.npz")) as stored:
        position, volts, reference = (
            stored[key].astype(np.float64)
            for key in (f"{name}_position", f"{name}_volts", "reference")
        )
    twice = [1e-7 * np.cumsum(np.cumsum(each)) for each in (position, reference)]
    return twice[0], 1e-3 * np.cumsum(volts), twice[1]


def pulses(name: str) -> np.ndarray:
    """What a record adds to the motor's command [V], shape (rows,)."""
    k = np.arange(len(record(name)[0])) - 344
    return 5.0 * ((name == "pulses") & (k >= 0) & (k // 500 % 2 == 0))


def log_of(name: str, bits: int | None = None) -> Log:
    """A record as the log of a two-axis arm, by an encoder of so many bits a turn."""
    position, volts, _ = record(name)
    theta = np.column_stack([position / LENGTH, np.full(len(position), LINK_B)])
    if bits is not None:
        step = 2.0 * np.pi / 2**bits
        theta = step * np.round(theta / step)
    along_b = FORCE_PER_VOLT * volts / np.sin(LINK_B - position / LENGTH)
    force = np.outer(along_b, [np.cos(LINK_B), np.sin(LINK_B)])
    return Log(
        interval=INTERVAL, volts=np.zeros((len(volts), 4)), theta=theta, force=force, name="EMPS"
    )


def start() -> Machine:
    """A machine of which the lengths are known."""
    return replace(BASELINE, arm=replace(BASELINE.arm, length_a=LENGTH))


def published(dry: float = DRY) -> Machine:
    """The axis as link A."""
    arm = replace(
        start().arm,
        inertia_a=MASS * LENGTH**2,
        coupling=0.0,
        viscous_a=VISCOUS * LENGTH**2,
        dry_a=dry * LENGTH,
    )
    return replace(BASELINE, arm=arm, substep=0.5e-3)


def follow(machine: Machine, name: str, offset: float = OFFSET) -> tuple[np.ndarray, np.ndarray]:
    """Position [m] and command [V] of the recorded controller on a simulated axis."""
    position, _, reference = record(name)
    step = position[1] - position[0]  # a record begins in motion
    state = initial_state(machine, (position[0] / LENGTH, LINK_B), (step / INTERVAL / LENGTH, 0.0))
    added, before = pulses(name), position[0] - step
    found, volts = np.empty_like(position), np.empty_like(position)
    for k in range(len(position)):
        found[k] = state.theta[0] * LENGTH
        wanted = POSITION_GAIN * (reference[k] - found[k]) - (found[k] - before) / INTERVAL
        volts[k], before = VELOCITY_GAIN * wanted + added[k], found[k]
        torque = (LENGTH * (FORCE_PER_VOLT * volts[k] - offset), 0.0)
        off, none = (0.0,) * 4, (0.0, 0.0)
        state = simulate(machine, state, off, none, torque, duration=INTERVAL).final
    return found, volts
