# pyright: standard
"""Which clutch pulses to give while a hand moves the arm, so that the log tells mass, damper and spring."""

from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from pter_gym.params import Machine

Array = NDArray[np.float64]

SHORTEST, LONGEST = 0.1, 0.3
"""Duration of a pulse, or of a pause between two [s]."""

LEAST = 0.4
"""Smallest force of a pulse over the largest."""


def pulses(
    machine: Machine, middle: Array, seconds: float, period: float, force: float, seed: int
) -> Array:
    rng = np.random.default_rng(seed)
    count = len(machine.clutches)
    levers = np.linalg.norm(tip_forces(machine, np.asarray(middle)[None])[0], axis=1)
    rows = round(seconds / period)
    volts, at, before = np.zeros((rows, 4)), 0, ()
    while at < rows:
        lasts = round(rng.uniform(SHORTEST, LONGEST) / period)
        sets = [(), *((k,) for k in range(count)), *combinations(range(count), 2)]
        on = sets[int(rng.choice([k for k, each in enumerate(sets) if each != before]))]
        for k in on:
            torque = rng.uniform(LEAST, 1.0) * force / levers[k] / len(on)
            volts[at : at + lasts, k] = machine.clutch.dynamic.voltage(torque / machine.slot_scale[k])
        at, before = at + lasts, on
    return volts


def tip_forces(machine: Machine, theta: Array) -> Array:
    """Return the forces on the tip [N] of 1 N·m in each clutch, (N, 4, 2), at angles (N, 2) [rad]."""
    arm, rows = machine.arm, np.array(machine.slot_rows)
    lengths = np.array([arm.length_a, arm.length_b])
    sine, cosine = lengths * np.sin(theta), lengths * np.cos(theta)
    size = -sine[:, 0] * cosine[:, 1] + sine[:, 1] * cosine[:, 0]  # det of J = [-sine; cosine]
    inverse = np.stack(
        [np.stack([cosine[:, 1], sine[:, 1]], 1), np.stack([-cosine[:, 0], -sine[:, 0]], 1)], 1
    ) / size[:, None, None]
    return np.einsum("xi,nij->nxj", rows, inverse)
