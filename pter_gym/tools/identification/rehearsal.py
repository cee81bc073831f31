# pyright: standard
"""A simulated person who moves a machine while its clutches pulse: what a log will tell."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pter_gym._physics.open_loop import initial_state, simulate
from pter_gym.hands import NORMAL
from pter_gym.params import Hand, Machine
from pter_gym.tools.identification.hand import FINE, identify_hand
from pter_gym.tools.identification.log import Log
from pter_gym.tools.identification.pulses import pulses, tip_positions

Array = NDArray[np.float64]

INTERVAL, SUBSTEPS = 5e-3, 10
"""Time between rows [s], and substeps between them."""

SECONDS = 120.0
"""Duration of a rehearsal [s]."""

REACH, LOOPS = 0.08, (0.17, 0.5)
"""Amplitude of each of the three sines that make the person's loops [m]; their frequencies [Hz]."""

DISTURBANCES = {0.5: 2.1, 1.0: 2.1, 2.0: 1.4, 4.0: 0.7, 8.0: 0.7}
"""Frequencies [Hz] and amplitudes [N] of the person's own forces, as ``HumanArm`` has them across a
path, here in x and y."""

ENCODER, NOISE = 2.0 * np.pi / 2**14, 0.3
"""Step of the encoders [rad], noise of the force sensor [N]."""


def loops(times: Array, rng: np.random.Generator) -> Array:
    """Return where a person wants to be [m], from the middle: irregular loops of 2 to 6 s."""
    target = np.zeros((len(times), 2))
    for _ in range(3):
        turns = 2.0 * np.pi * (rng.uniform(*LOOPS, 2) * times[:, None] + rng.random(2))
        target += REACH * np.sin(turns)
    return target * np.minimum(times, 1.0)[:, None]


def disturbances(times: Array, rng: np.random.Generator) -> Array:
    """Return a person's own forces [N], (T, 2)."""
    force = np.zeros((len(times), 2))
    for frequency, size in DISTURBANCES.items():
        force += size * np.sin(2.0 * np.pi * (frequency * times[:, None] + rng.random(2)))
    return force


def rehearse(
    machine: Machine, hand: Hand, middle: Array, force: float, seconds: float, seed: int
) -> Log:
    """Return the log of a simulated isotropic hand under pulses of up to a force [N]."""
    rng = np.random.default_rng(seed)
    volts = pulses(machine, middle, seconds, INTERVAL, force, seed)
    held = replace(machine, hand=hand, substep=INTERVAL / SUBSTEPS)
    times: Array = held.substep * np.arange(len(volts) * SUBSTEPS, dtype=np.float64)
    target = tip_positions(machine, np.asarray(middle)[None]) + loops(times, rng)
    own = disturbances(times, rng)
    run = simulate(
        held,
        initial_state(held, middle),
        np.repeat(volts, SUBSTEPS, axis=0),
        own,
        hand_target=target,
    )
    acceleration = np.gradient(run.tip_velocity, held.substep, axis=0)
    total = own + hand.stiffness * (target - run.tip_position)
    total -= hand.damping * run.tip_velocity + hand.mass * acceleration
    rows = slice(None, None, SUBSTEPS)
    return Log(
        interval=INTERVAL,
        volts=volts,
        theta=ENCODER * np.round(run.theta[rows] / ENCODER),
        force=total[rows] + NOISE * rng.standard_normal((len(volts), 2)),
    )


def minutes_needed(
    machine: Machine, middle: Array, force: float, reaction: float, hand: Hand = NORMAL
) -> dict[str, float]:
    """Return the minutes of pulses after which numbers of a hand count as identified.

    Errors fall with the square root of the duration.
    """
    found = identify_hand(
        rehearse(machine, hand, middle, force, SECONDS, 0), machine, hand, reaction=reaction
    )
    return {
        name: SECONDS / 60.0 * (half / getattr(hand, name) / FINE) ** 2
        for name, (_, half) in found.estimates.items()
    }
