"""Build machines and tasks of every kind, and simulate those that are accepted, at the limits of what is.

    python -m tests.campaigns.fuzz --combinations 1e6 --steps 1e9 --processes 2 --write

The first part changes fields of usual machines and tasks, whatever they are, to near numbers, numbers of another size,
and what is no number at all: the constructors accept them or raise a ParameterError, and say nothing else. The second
part draws parameters that are as extreme as they may be: forces and speeds up to the limits of
``pter_gym._physics.limits``, near-singular arms, long substeps and control periods. Worlds of them run with voltages of
several kinds. Every number that comes out has to be finite, the energy of each control step to balance, and unit
vectors to have unit length. A batch in which something is wrong is named at once; one that takes longer than
``PATIENCE`` ends the campaign with its stack.
"""

import faulthandler
import math
import multiprocessing
import sys
import time
import warnings
from collections import Counter
from collections.abc import Callable, Iterable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import cache, partial
from typing import Any, NamedTuple

import numpy as np
import tyro

from pter_gym._engine.batch import Batch, Returns
from pter_gym._engine.world import FLAG, ROW, SAME_STEP
from pter_gym._physics.limits import largest_energy, largest_force
from pter_gym._physics.model import model_of
from pter_gym.errors import ParameterError
from pter_gym.hands import HumanArm, MultiSineHand, Operator, RecordedForces
from pter_gym.params import BASELINE, DELRIN_THEORETICAL, Arm, Clutch, Hand, Machine, TorqueCurve
from pter_gym.scenarios import find_scenario
from pter_gym.tasks.path_following import COLUMN, STARTS, PathFollowing, Sensing, Starts, check_machine
from pter_gym.tasks.path_following._context import context_of
from pter_gym.tasks.path_following._specification import held_machine, strongest

from .reports import put, table

PATIENCE = 300.0
ENERGY_LIMIT = 1e-9
UNIT_LIMIT = 1e-12
KINDS = 48
COPIES = 16
ROUNDS = 12
ROUND = 64

ODD: tuple[Any, ...] = (
    *(0.0, -0.0, -1.0, 5e-324, 1e-300, 1e-12, 1e-9, 1e9, 1e12, 1e150, 1.7e308, -1e308, math.nan, math.inf, -math.inf),
    *(0, 1, 10**400, True, None, "1", b"1", 1j, (), (1.0,), [1.0], {}, np.float64(0.5), np.float32(2.0), np.int64(3)),
    *(np.nan, np.ones(2), object, ParameterError),
)
"""What a person or a program may give in place of a number."""

MACHINES = (
    BASELINE,
    replace(DELRIN_THEORETICAL, hand=Hand(mass=1.5, damping=10.0)),
    replace(BASELINE, clutch=replace(BASELINE.clutch, lag="voltage"), clutch_scale=(0.5, 1.5, 1.0, 0.8)),
)
"""Usual machines, whose fields are changed."""

NOISE = Sensing(angle_resolution=1e-3, velocity_noise=0.02, torque_noise=0.1, force_noise=0.5, delay=2)
FORCES = RecordedForces(times=(0.0, 0.013, 0.3), along=(40.0, 60.0, 80.0), across=(0.0, 9.0, -9.0))
REACH = BASELINE.arm.length_a + BASELINE.arm.length_b


@cache
def usual_tasks() -> list[PathFollowing]:
    """Return tasks with every kind of path, hand, sensors and starts."""
    drawn = [
        pair[1] for name in ("everything", "tremor") for pair in find_scenario(name).randomisation(contexts=64).pairs()
    ]
    return [*drawn, PathFollowing(hand=FORCES, starts=STARTS["path"]), PathFollowing(sensing=NOISE, start_offset=0.01)]


class Numbers:
    """Random numbers for parameters: mostly near usual ones, some of another size, some odd."""

    def __init__(self, rng: np.random.Generator, odd: float) -> None:
        self.rng, self.odd = rng, odd

    def chance(self, share: float) -> bool:
        return bool(self.rng.random() < share)

    def of(self, options: Any) -> Any:
        return options[int(self.rng.integers(len(options)))]

    def varied(self, value: Any) -> Any:
        """Return a value of parameters, with other ones in all that it is made of."""
        if isinstance(value, str):
            return self.of((value, "pressure")) if self.chance(self.odd) else value
        if self.chance(self.odd):
            return self.of(ODD)
        if is_dataclass(value):
            changed = [item.name for item in fields(value) if item.init and self.chance(0.4)]
            return replace(value, **{name: self.varied(getattr(value, name)) for name in changed})  # type: ignore[type-var]
        match value:
            case tuple():
                wrong = value[:1] if self.chance(self.odd) else ()
                return tuple(self.varied(each) for each in (*value, *wrong))
            case bool():
                return self.chance(0.5)
            case int():
                return self.of((0, 1, 2))
            case float():
                spread = 0.0 if self.chance(0.97) else float(self.rng.normal(0.0, 8.0))
                size = math.exp(self.rng.uniform(-0.7, 0.7) + spread)
                return size * value if value else self.of((0.0, 0.02, -0.02, 0.5)) * size
        return value


def scaled(value: Any, times: float, *units: str) -> Any:
    """Return parameters with all numbers of some units so many times as large."""
    if isinstance(value, tuple):
        return tuple(scaled(each, times) for each in value)
    if isinstance(value, float):
        return times * value
    of_unit = [item.name for item in fields(value) if item.metadata.get("unit") in units]
    inner = [item.name for item in fields(value) if is_dataclass(getattr(value, item.name))]
    changed = {name: scaled(getattr(value, name), times, *units) for name in (*of_unit, *inner)}
    return replace(value, **changed)


class Built(NamedTuple):
    """What the constructors said: how often they accepted, and the refusals by the field that they name."""

    accepted: int
    refused: Counter[str]


def build(combinations: int, seed: int = 0) -> Built:
    """Build combinations of machine and task. What is raised but a ParameterError, a warning too, gets out."""
    rng, accepted, refused = np.random.default_rng([seed, 1]), 0, Counter[str]()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for _ in range(combinations):
            n = Numbers(rng, odd=float(rng.choice((0.0, 0.003, 0.03, 0.3))))
            try:
                machine, task = n.varied(n.of(MACHINES)), n.varied(n.of(usual_tasks()))
                if isinstance(machine, Machine) and isinstance(task, PathFollowing):
                    check_machine(task, machine)
                accepted += 1
            except ParameterError as error:
                refused[str(error).split(" must ")[0]] += 1
    return Built(accepted, refused)


# --- as extreme as is accepted ---


@dataclass(frozen=True)
class Shared:
    """What the worlds of a batch share."""

    substep: float
    substeps: int
    voltage_max: float


def extreme_machine(n: Numbers, shared: Shared) -> Machine:
    """A machine that may be tiny, huge, near singular or all but frictionless."""
    size = float(10.0 ** n.rng.uniform(-3.0, 3.0)) if n.chance(0.5) else 1.0
    inertia_a, inertia_b = size * 10.0 ** n.rng.uniform(-2.0, 1.0, 2)
    share = (
        float(n.rng.uniform(-1.0, 1.0))
        if n.chance(0.6)
        else float(n.of((-1.0, 1.0))) * (1.0 - 10.0 ** n.rng.uniform(-5.0, -1.0))
    )
    lengths = 10.0 ** n.rng.uniform(-2.0, 1.0) * n.rng.uniform(0.4, 1.6, 2)
    arm = Arm(
        length_a=float(lengths[0]),
        length_b=float(lengths[1]),
        inertia_a=float(inertia_a),
        inertia_b=float(inertia_b),
        coupling=float(share * math.sqrt(inertia_a * inertia_b)),
    )
    slope = float(size * 10.0 ** n.rng.uniform(-6.0, 6.0)) if n.chance(0.3) else float(size * n.rng.uniform(0.1, 5.0))
    knee = float(n.rng.uniform(0.0, 1.2 * shared.voltage_max))
    bend = float(n.rng.uniform(-0.45, 2.0)) * slope / shared.voltage_max
    dynamic = TorqueCurve(slope=slope, knee=knee, curvature=bend)
    clutch = Clutch(
        breakaway=dynamic.scaled(float(n.rng.uniform(0.3, 3.0))),
        dynamic=dynamic,
        time_constant=float(10.0 ** n.rng.uniform(-9.0, 3.0)),
        voltage_max=shared.voltage_max,
        lag="voltage" if n.chance(0.3) else "normal_force",
    )
    hand = Hand(
        mass=0.0 if n.chance(0.5) else float(size * 10.0 ** n.rng.uniform(-3.0, 2.0)),
        damping=0.0 if n.chance(0.5) else float(size * 10.0 ** n.rng.uniform(-3.0, 6.0)),
    )
    return Machine(
        arm=arm,
        clutch=clutch,
        hand=hand,
        clutch_scale=tuple((10.0 ** n.rng.uniform(-1.0, 1.0, 4)).tolist()),
        slip_threshold=float(10.0 ** n.rng.uniform(-9.0, 3.0)),
        substep=shared.substep,
    )


def extreme_task(n: Numbers, machine: Machine, shared: Shared) -> PathFollowing:
    """A task on a machine, with a hand as strong as it may be or a part of that, and starts as fast."""
    usual = scaled(n.of(usual_tasks()), (machine.arm.length_a + machine.arm.length_b) / REACH, "m")
    slowed = replace(usual, hand=slow(usual.hand, shared.substep), starts=Starts())
    wide = n.varied(replace(slowed, control_period=shared.substep * shared.substeps))
    wide = replace(wide, control_period=shared.substep * shared.substeps)
    held = held_machine(wide, machine)
    arm, h, period = model_of(held).arm, held.substep, wide.control_period
    limit, present = largest_force(arm, h, period), strongest(wide, machine)
    share = float(n.of((1.0 - 1e-9, 1.0 - 1e-9, 0.5, 0.1, 0.01)))
    task = replace(wide, hand=stronger(wide.hand, share * limit / present if present > 0.0 else 1.0))
    if n.chance(0.5):
        least = min(machine.arm.length_a, machine.arm.length_b)
        rate = math.sqrt(
            largest_energy(arm, h, period, strongest(task, machine)) / (arm.m11 + arm.m22 + abs(arm.coupling))
        )
        pace = rate * least * task.singularity_margin
        task = replace(task, pace=min(task.pace, pace), starts=Starts(moving=0.7, gripped=0.2, offset=0.01))
    return task


def slow(hand: Operator, substep: float) -> Operator:
    """The hand with sines that the substep can follow."""
    if isinstance(hand, MultiSineHand | HumanArm):
        return replace(hand, frequencies=tuple(min(each, 0.1 / substep) for each in hand.frequencies))
    return hand


def stronger(hand: Operator, times: float) -> Operator:
    """The hand with all its forces so many times as large; an arm, whose impedance pushes, becomes no stronger."""
    return hand if isinstance(hand, HumanArm) and times >= 1.0 else scaled(hand, times, "N", "m/s²")


def extreme_pairs(rng: np.random.Generator) -> tuple[list[tuple[Machine, PathFollowing]], int]:
    """Pairs that one batch can hold, and how many draws were refused on the way."""
    n, pairs, refused = Numbers(rng, odd=0.0), list[tuple[Machine, PathFollowing]](), 0
    shared = Shared(
        substep=float(n.of((1e-2, 5e-3, 1e-3, 1e-3, 1e-3, 1e-4, 1e-6))),
        substeps=int(n.rng.choice((1, 2, 5, 10, 50, 100), p=(0.15, 0.2, 0.25, 0.3, 0.07, 0.03))),
        voltage_max=float(n.of((24.0, 24.0, 1.0, 1e3, 1e-6, 1e6))),
    )
    while len(pairs) < KINDS:
        try:
            machine = extreme_machine(n, shared)
            task = extreme_task(n, machine, shared)
            check_machine(task, machine)
            pairs.append((machine, task))
        except ParameterError:
            refused += 1
    return pairs, refused


def voltages(rng: np.random.Generator, worlds: int) -> np.ndarray:
    """Actions from 0 to 1 for a round (ROUND, worlds, 4): held, alternating, random, released or full."""
    drawn = rng.random((ROUND, worlds, 4))
    kind = rng.integers(5, size=worlds)
    drawn[:, kind == 0] = drawn[:1, kind == 0]
    drawn[:, kind == 1] = np.round(drawn[:, kind == 1])
    drawn[:, kind == 3] = 0.0
    drawn[:, kind == 4] *= rng.random((ROUND, int((kind == 4).sum()), 4)) < 0.3
    return drawn


@dataclass
class Ran:
    """What worlds did: their steps and episodes, how many ended as too fast, what went wrong."""

    steps: int = 0
    kinds: int = 0
    refused: int = 0
    episodes: int = 0
    too_fast: int = 0
    not_finite: int = 0
    energy_error: float = 0.0
    unit_error: float = 0.0
    slowest: float = 0.0
    seconds: float = 0.0
    worst: str = ""


def run(steps: int, seed: int = 0, each: Callable[..., Iterable[Ran]] = map) -> Ran:
    """Simulate worlds of extreme parameters for so many world-steps; ``each`` is ``map``, or that of a pool."""
    batches = math.ceil(steps / (KINDS * COPIES * ROUNDS * ROUND))
    total = Ran()
    for found in each(partial(ran_batch, seed), range(batches)):
        if found.worst:
            print(found.worst, flush=True)
        total = merged(total, found)
    return total


def ran_batch(seed: int, number: int) -> Ran:
    """Simulate some worlds of each of some extreme pairs for a few rounds, and return what they did."""
    compile_kernels()
    found, begin, where = Ran(), time.process_time(), f"batch {number} of seed {seed}"
    rng = np.random.default_rng([seed, 2, number])
    pairs, found.refused = extreme_pairs(rng)
    found.kinds = len(pairs)
    faulthandler.dump_traceback_later(PATIENCE, exit=True)
    start = time.perf_counter()
    machines, tasks = map(list, zip(*(COPIES * pairs), strict=True))
    batch = Batch(machines, tasks, sensors="force", observe_context=True, max_steps=int(rng.integers(20, 2000)))
    most = np.array([context_of(task, machine, (0, 0), (0, 0)).task.energy_max for machine, task in pairs])
    worlds = len(machines)
    obs, telemetry = batch.reset(rng.integers(2**63, size=worlds).tolist())
    energy = telemetry[:, COLUMN.kinetic_energy]
    look(found, where, obs, telemetry)
    for _ in range(ROUNDS):
        for action in batch.action_high * voltages(rng, worlds):
            returns = batch.step(action, SAME_STEP)
            energy = look_at_step(found, where, returns, energy, np.tile(most, COPIES))
            found.steps += worlds
    state = batch.get_state()["worlds"]
    look(found, where, state)
    lanes = state.transpose(0, 2, 1).reshape(-1, state.shape[1])[:worlds]
    for row in (ROW.motion.cos_a, ROW.motion.cos_b, *(sine.cos for sine in ROW.sines)):
        found.unit_error = max(found.unit_error, float(np.abs(np.hypot(lanes[:, row], lanes[:, row + 1]) - 1.0).max()))
    faulthandler.cancel_dump_traceback_later()
    found.slowest, found.seconds = time.perf_counter() - start, time.process_time() - begin
    return found


def merged(one: Ran, two: Ran) -> Ran:
    """Return what the worlds of both did."""
    sums = {item.name: getattr(one, item.name) + getattr(two, item.name) for item in fields(Ran)}
    largest = {name: max(getattr(one, name), getattr(two, name)) for name in ("energy_error", "unit_error", "slowest")}
    return Ran(**{**sums, **largest, "worst": one.worst or two.worst})


@cache
def compile_kernels() -> None:
    """Compile what is to run, which takes longer than ``PATIENCE`` on a busy machine."""
    batch = Batch(BASELINE, PathFollowing())
    batch.reset([0])
    batch.step(np.zeros((1, 4)))


def look(found: Ran, where: str, *arrays: np.ndarray) -> None:
    """Count numbers that are not finite."""
    wrong = sum(int((~np.isfinite(array)).sum()) for array in arrays)
    if wrong:
        found.not_finite += wrong
        found.worst = found.worst or where


def look_at_step(found: Ran, where: str, returns: Returns, before: np.ndarray, most: np.ndarray) -> np.ndarray:
    """Look at what a step returned; return the kinetic energies with which the next one begins."""
    ended = returns.flags[FLAG.terminated] | returns.flags[FLAG.truncated]
    now = returns.telemetry[0]
    last = np.where(ended[:, None], returns.telemetry[1], now)
    look(found, where, returns.obs, returns.final_obs[ended], returns.rewards, last, now)
    work, dissipated, lost, residual = last[:, [*COLUMN.energy]].T
    after = last[:, COLUMN.kinetic_energy]
    terms = np.abs([after, before, work, dissipated, lost, residual]).max(axis=0)
    error = np.abs(after - before - (work - dissipated - lost + residual)) / np.maximum(terms, 1e-300)
    worst = float(error.max(initial=0.0))
    if worst > max(found.energy_error, ENERGY_LIMIT):
        found.worst = f"{where}, world {int(error.argmax())}"
    found.energy_error = max(found.energy_error, worst)
    found.episodes += int(ended.sum())
    found.too_fast += int((after > most).sum())
    return now[:, COLUMN.kinetic_energy]


def main(combinations: float = 1e6, steps: float = 1e9, seed: int = 0, processes: int = 1, write: bool = False) -> int:
    """Run both parts, print or write the figures, and return 1 if something was found.

    Args:
        combinations: Of constructors.
        steps: Of all worlds together.
        seed: Of all draws.
        processes: How many work at once.
        write: Put the figures into docs/robustness.md.
    """
    with ProcessPoolExecutor(processes, multiprocessing.get_context("spawn")) as pool:
        building = pool.submit(build, int(combinations), seed)
        ran = run(int(steps), seed, pool.map)
        built = building.result()
    rows = [
        ["Combinations of constructors", f"{built.accepted + built.refused.total():,}"],
        ["accepted, refused with a ParameterError", f"{built.accepted:,}, {built.refused.total():,}"],
        ["World-steps", f"{ran.steps:,} in {ran.episodes:,} episodes"],
        ["extreme machines with tasks: accepted, refused", f"{ran.kinds:,}, {ran.refused:,}"],
        ["episodes that ended as too fast", f"{ran.too_fast:,}"],
        ["Numbers not finite", f"{ran.not_finite:,}"],
        ["Energy balance, largest error", f"{ran.energy_error:.2g} of the largest term"],
        ["Unit vectors, largest error", f"{ran.unit_error:.2g}"],
        ["Longest batch", f"{ran.slowest:.1f} s"],
        ["Processor time of the worlds", f"{ran.seconds:,.0f} s"],
    ]
    put("fuzz", table(["What", "Found"], rows), write=write)
    return int(ran.not_finite > 0 or ran.energy_error > ENERGY_LIMIT or ran.unit_error > UNIT_LIMIT)


if __name__ == "__main__":
    sys.exit(tyro.cli(main))
