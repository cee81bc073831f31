# pyright: standard
"""How well ``pter identify --hand`` measures hands that were not used to make it.

    python benchmarks/measured_hands.py HANDS SECONDS [CONDITION …]

Each hand is drawn within the ranges of published arms, and moves the simulated arm in loops while
the clutches pulse. Prints a table: medians over hands of errors and half widths of stiffness,
damping and mass, how many of the intervals given hold the truth, how many numbers are called
identified, how many of these are off by more than 10 %, and how many hands have a warning. Takes
1.5 s of processor time for a hand and a minute.
"""

import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pter_gym import BASELINE, initial_state, simulate
from pter_gym.params import Hand, Machine
from pter_gym.tools.identification import Log
from pter_gym.tools.identification.hand import identify_hand
from pter_gym.tools.identification.pulses import pulses, tip_positions
from pter_gym.tools.identification.rehearsal import disturbances, loops

Array = NDArray[np.float64]

MIDDLE = np.array([0.720822, 2.170796])
"""Angles of the links about which hands move [rad]."""

SUBSTEP, PERIOD = 0.5e-3, 5e-3
"""Substep of the simulated arm, and time between rows of the log [s]."""


CHUNK = 0.05
"""Time for which a hand that reacts, gives way or changes stays as it is [s]."""


@dataclass(frozen=True)
class Condition:
    """A hand's behaviour and the sensors that record it."""

    tremor: float = 0.0  # N at 5 Hz
    bits: int = 14
    noise: float = 0.3  # N
    offset: float = 0.0  # N
    drift: float = 0.0  # N over the log
    force_delay: int = 0  # rows of 5 ms
    delay: int = 0  # of angles and forces together, rows
    handle: float = 0.0  # kg that the user forgot
    change: float = 0.0  # of the stiffness from the first to the last second, relative
    reaction: float = 0.0  # s, 0 for none: the hand then pushes against a pulse
    lead: float = np.inf  # m by which the intent runs ahead at most
    isotropic: bool = True


CONDITIONS = {
    "14 bits, 0.3 N": Condition(),
    "tremor of 6 N at 5.3 Hz": Condition(tremor=6.0),
    "10 bits": Condition(bits=10),
    "1 N of noise": Condition(noise=1.0),
    "forces 15 ms late": Condition(force_delay=3),
    "stiffness rises by 40 %": Condition(change=0.4),
    "direction": Condition(isotropic=False),
    "reacts after 0.15 s": Condition(reaction=0.15),
    "reacts after 0.1 s": Condition(reaction=0.1),
    "intent leads by ≤ 0.12 m": Condition(lead=0.12),
    "12 bits": Condition(bits=12),
    "all 15 ms late": Condition(delay=3),
    "forces 5 ms late": Condition(force_delay=1),
    "handle off by 5 %": Condition(handle=0.025),
    "sensor drifts by 5 N": Condition(drift=5.0),
    "sensor off by 5 N": Condition(offset=5.0),
    "0.1 N of noise": Condition(noise=0.1),
    "16 bits": Condition(bits=16),
}


def draw_hand(rng: np.random.Generator, *, isotropic: bool) -> Hand:
    """Return a hand within the ranges of published arms."""
    hand = Hand(
        mass=float(rng.uniform(0.6, 2.0)),
        damping=float(rng.uniform(6.0, 30.0)),
        stiffness=float(rng.uniform(120.0, 600.0)),
    )
    if isotropic:
        return hand
    size, turn = rng.uniform(0.2, 0.6), rng.uniform(0.0, 2.0 * np.pi)
    both = tuple((size * np.array([np.cos(turn), np.sin(turn)])).tolist())
    return replace(hand, stiffness_anisotropy=both, damping_anisotropy=both)


def matrix(value: float, anisotropy: Sequence[float]) -> Array:
    """Return a hand's damping or stiffness in all directions, (2, 2)."""
    e, f = anisotropy
    return value * np.array([[1.0 + e, f], [f, 1.0 - e]])


def record(
    hand: Hand,
    condition: Condition,
    rng: np.random.Generator,
    seconds: float,
    machine: Machine = BASELINE,
    force: float = 30.0,
) -> Log:
    """Return the log of a hand that moves the arm while clutches pulse."""
    machine = replace(machine, hand=hand, substep=SUBSTEP)
    per_row = round(PERIOD / SUBSTEP)
    rows = round(seconds / PERIOD)
    times: Array = SUBSTEP * np.arange(rows * per_row, dtype=np.float64)
    volts = pulses(machine, MIDDLE, seconds, PERIOD, force, int(rng.integers(1 << 30)))
    held = np.repeat(volts, per_row, axis=0)
    target = tip_positions(machine, MIDDLE[None]) + loops(times, rng)
    own = disturbances(times, rng) + condition.tremor * np.sin(
        2.0 * np.pi * (5.3 * times[:, None] + rng.random(2))
    )
    stiffness = matrix(hand.stiffness, hand.stiffness_anisotropy)
    damping = matrix(hand.damping, hand.damping_anisotropy)
    _, v, theta, passive = simulated(machine, held, own, target, condition, stiffness, times)
    a = np.gradient(v, SUBSTEP, axis=0)
    total = passive + own - v @ damping - (hand.mass + condition.handle) * a
    pick = slice(0, None, per_row)
    total, theta = total[pick], theta[pick]
    total = np.roll(total, condition.force_delay + condition.delay, axis=0)
    theta = np.roll(theta, condition.delay, axis=0)
    total = total + condition.noise * rng.standard_normal(total.shape) + condition.offset
    total += condition.drift * np.linspace(0.0, 1.0, rows)[:, None]
    step = 2.0 * np.pi / 2**condition.bits
    first = 20  # rows that rolled round
    return Log(
        interval=PERIOD,
        volts=volts[first:],
        theta=(step * np.round(theta / step))[first:],
        force=total[first:],
    )


def simulated(
    machine: Machine,
    volts: Array,
    own: Array,
    target: Array,
    condition: Condition,
    stiffness: Array,
    times: Array,
) -> tuple[Array, Array, Array, Array]:
    """Return positions, velocities, angles at substeps, and the force of the spring, (T, 2)."""
    state = initial_state(machine, MIDDLE)
    reacts = condition.reaction > 0.0 or np.isfinite(condition.lead)
    chunk = round(CHUNK / SUBSTEP) if reacts or condition.change else len(times)
    parts, springs, shift = [], [], np.zeros(2)
    late = round(condition.reaction / CHUNK)
    for begin in range(0, len(times), chunk):
        rows = slice(begin, begin + chunk)
        to, grown = target[rows] + shift, 1.0
        if condition.change:
            grown = 1.0 + condition.change * (times[begin] / times[-1] - 0.5)
        changed = replace(
            machine, hand=replace(machine.hand, stiffness=machine.hand.stiffness * grown)
        )
        if parts and np.isfinite(condition.lead):
            ahead = to - parts[-1][0][-1]
            far = np.maximum(np.linalg.norm(ahead, axis=1, keepdims=True) / condition.lead, 1.0)
            to = parts[-1][0][-1] + ahead / far
        if condition.reaction and len(parts) > late:
            behind = target[begin - late * chunk] - parts[-late][0][-1]
            shift = 0.5 * behind
            to = target[rows] + shift
        run = simulate(changed, state, volts[rows], own[rows], hand_target=to)
        state = run.final
        parts.append((run.tip_position, run.tip_velocity, run.theta))
        springs.append((to - run.tip_position) @ (grown * stiffness))
    x, v, theta = (np.concatenate([part[k] for part in parts]) for k in range(3))
    return x, v, theta, np.concatenate(springs)


def main(hands: int, seconds: float, names: Sequence[str]) -> None:
    """Print a row of a Markdown table for each condition."""
    print("| Condition | Error of K, B, M [%] | Half of the interval [%] | ", end="")
    print("Truth inside | Identified | of these off by > 10 % | Hands warned of |")
    print("|---|---|---|---|---|---|---|")
    for name in names or CONDITIONS:
        condition = CONDITIONS[name]
        errors, halves = np.zeros((2, hands, 3))
        given, identified = np.zeros((2, hands, 3), bool)
        warned = 0
        for seed in range(hands):
            rng = np.random.default_rng([seed, [*CONDITIONS].index(name)])
            hand = draw_hand(rng, isotropic=condition.isotropic)
            found = identify_hand(record(hand, condition, rng, seconds), BASELINE)
            warned += bool(found.warnings)
            for k, each in enumerate(found.findings[:3]):
                true = getattr(hand, each.quantity.name)
                value, half = found.estimates[each.quantity.name]
                errors[seed, k], halves[seed, k] = value / true - 1.0, half / true
                given[seed, k] = each.status != "kept"
                identified[seed, k] = each.status == "identified"
        sizes = np.abs(errors)
        print(
            f"| {name} | {row(np.median(sizes, 0))} | {row(np.median(halves, 0))} | "
            f"{(given & (sizes <= halves)).sum()} of {given.sum()} | {identified.sum()} | "
            f"{(identified & (sizes > 0.1)).sum()} | {warned} of {hands} |",
            flush=True,
        )


def row(shares: Array) -> str:
    """Return shares as percentages."""
    return ", ".join(f"{100.0 * each:.0f}" for each in shares)


if __name__ == "__main__":
    main(int(sys.argv[1]), float(sys.argv[2]), sys.argv[3:])
