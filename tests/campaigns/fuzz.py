"""Build machines and tasks of every kind, and simulate those that are accepted, at the limits of what is.

    python tests/campaigns/fuzz.py --combinations 1e6 --steps 1e9
    python tests/campaigns/fuzz.py --combinations 1e6 --steps 1e9 --processes 2 --write

The first part gives the constructors usual numbers, extreme ones, and what is no number at all: they accept it or raise
a ParameterError, and say nothing else. The second part draws parameters that are as extreme as they may be: forces and
speeds up to the limits of ``pter_gym.physics.limits``, near-singular arms, long substeps and control periods. Worlds of
them run with voltages of several kinds. Every number that comes out has to be finite, and the energy of each control
step to balance. A batch in which something is wrong is named at once; one that takes longer than ``PATIENCE`` ends the
campaign with its stack. ``--write`` puts the figures into docs/robustness.md.
"""

import argparse
import faulthandler
import math
import multiprocessing
import sys
import time
import warnings
from collections import Counter
from collections.abc import Callable, Iterable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field, fields, replace
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from pter_gym.engine.batch import Batch, Returns
from pter_gym.engine.world import FLAG, SAME_STEP
from pter_gym.errors import ParameterError
from pter_gym.hands import HumanArm, MultiSineHand, Operator, RecordedForces, TremorArm
from pter_gym.params import BASELINE, Arm, Clutch, Hand, Machine, TorqueCurve
from pter_gym.paths import Arc, Circle, Line, Polyline, Sine, Spline
from pter_gym.paths import Path as Curve
from pter_gym.physics.limits import largest_energy, largest_force
from pter_gym.physics.model import model_of
from pter_gym.tasks.path_following import (
    COLUMN,
    PathFollowing,
    RewardWeights,
    Sensing,
    Starts,
    check_machine,
)
from pter_gym.tasks.path_following.specification import held_machine, strongest

ROOT = Path(__file__).parents[2]
PATIENCE = 300.0
ENERGY_LIMIT = 1e-9
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

Draw = Callable[[], Any]


class Numbers:
    """Random numbers for parameters: mostly usual ones, some of another size, some odd."""

    def __init__(self, rng: np.random.Generator, odd: float) -> None:
        self.rng, self.odd = rng, odd

    def chance(self, share: float) -> bool:
        return bool(self.rng.random() < share)

    def of(self, options: Any) -> Any:
        return options[int(self.rng.integers(len(options)))]

    def near(self, low: float, high: float) -> Any:
        """Return a number between two positive ones, of another size, or something odd."""
        if self.chance(self.odd):
            return self.of(ODD)
        spread = 0.0 if self.chance(0.93) else float(self.rng.normal(0.0, 8.0))
        return float(math.exp(self.rng.uniform(math.log(low), math.log(high)) + spread))

    def even(self, low: float, high: float) -> Any:
        """Return a number from a range, or something odd."""
        return self.of(ODD) if self.chance(self.odd) else float(self.rng.uniform(low, high))

    def several(self, count: int, draw: Draw) -> Any:
        """Return a tuple, of the wrong length or type at times."""
        if self.chance(self.odd):
            return self.of(ODD)
        wrong = int(self.chance(self.odd))
        return tuple(draw() for _ in range(count + wrong))


# --- anything at all ---


def any_machine(n: Numbers) -> Machine:
    """A machine of any numbers, or a ParameterError."""
    inertia = partial(n.near, 0.05, 5.0)
    arm = Arm(
        length_a=n.near(0.1, 1.0),
        length_b=n.near(0.1, 1.0),
        inertia_a=inertia(),
        inertia_b=inertia(),
        coupling=n.even(-0.1, 0.1),
    )
    curves = [
        TorqueCurve(slope=n.near(0.1, 5.0), knee=n.even(0.0, 24.0), curvature=n.even(-0.05, 2.0)) for _ in range(2)
    ]
    clutch = Clutch(
        breakaway=curves[0],
        dynamic=curves[1],
        time_constant=n.near(1e-3, 1.0),
        voltage_max=n.near(5.0, 50.0),
        lag=n.of(("normal_force", "voltage", "pressure")) if n.chance(n.odd) else n.of(("normal_force", "voltage")),
    )
    hand = Hand() if n.chance(0.5) else Hand(mass=n.near(0.1, 5.0), damping=n.near(0.1, 50.0), stiffness=0.0)
    return Machine(
        arm=n.of(ODD) if n.chance(0.1 * n.odd) else arm,
        clutch=clutch,
        hand=hand,
        clutch_scale=n.several(4, partial(n.near, 0.3, 3.0)),
        slip_threshold=n.near(1e-4, 1e-1),
        substep=n.of((1e-3, 1e-3, 1e-3, 2e-3, 5e-4, 1e-2, 1e-4)) if n.chance(0.8) else n.near(1e-5, 1e-2),
    )


def any_path(n: Numbers, reach: float = 1.0) -> Curve:
    """A path of any numbers within a reach."""
    at = {"x": n.even(-0.5 * reach, 0.5 * reach), "y": n.even(0.2 * reach, 0.9 * reach)}
    size = partial(n.near, 0.05 * reach, 0.6 * reach)
    point = partial(n.several, 2, partial(n.even, -0.8 * reach, 0.8 * reach))
    kinds: tuple[Callable[[], Curve], ...] = (
        lambda: Line(**at, direction=n.even(-4.0, 4.0), length=size()),
        lambda: Arc(**at, direction=n.even(-4.0, 4.0), radius=size(), angle=n.even(-6.0, 6.0)),
        lambda: Circle(
            center_x=at["x"],
            center_y=at["y"],
            radius=n.near(0.05 * reach, 0.3 * reach),
            start=n.even(-4.0, 4.0),
            clockwise=n.of(ODD) if n.chance(n.odd) else n.chance(0.5),
        ),
        lambda: Sine(
            **at,
            direction=n.even(-1.0, 1.0),
            extent=size(),
            amplitude=n.even(-0.1 * reach, 0.1 * reach),
            periods=n.near(0.2, 4.0),
        ),
        lambda: Spline(points=n.several(3, point)),
        lambda: Polyline(points=n.several(3, point), radius=size()),
    )
    return kinds[int(n.rng.choice(6, p=(0.4, 0.2, 0.1, 0.16, 0.07, 0.07)))]()


def any_hand(n: Numbers) -> Operator:
    """A hand of any numbers."""
    sines = {
        "amplitudes": n.several(5, partial(n.even, -20.0, 20.0)),
        "frequencies": n.several(5, partial(n.near, 0.1, 20.0)),
        "phases": n.several(5, partial(n.even, -10.0, 10.0)),
        "random_phases": n.of(ODD) if n.chance(n.odd) else n.chance(0.5),
    }
    kind = n.rng.random()
    if kind < 0.6:
        return MultiSineHand(push=n.even(-100.0, 200.0), **sines)
    if kind < 0.8:
        held = Hand(mass=n.near(0.1, 5.0), damping=n.near(0.1, 50.0), stiffness=n.near(10.0, 1000.0))
        meant = {"impedance": held, "eagerness": n.near(0.5, 3.0), "rise": n.near(0.05, 2.0), "lead": n.near(0.01, 0.5)}
        if kind < 0.7:
            return HumanArm(**meant, **sines)
        return TremorArm(
            **meant,
            **sines,
            frequency=n.near(0.5, 20.0),
            acceleration=n.near(0.1, 50.0),
            direction=n.even(-4.0, 4.0),
            phase=n.even(-10.0, 10.0),
            swell=n.even(0.0, 1.0),
            swell_frequency=n.near(0.01, 0.5),
            swell_phase=n.even(-10.0, 10.0),
            lasts=n.near(0.1, 5.0),
        )
    count = int(n.rng.integers(1, 6))
    times = (0.0, *np.cumsum(n.rng.uniform(1e-3, 0.5, count)).tolist())
    forces = partial(n.several, count + 1, partial(n.even, -100.0, 100.0))
    return RecordedForces(times=n.of(ODD) if n.chance(n.odd) else times, along=forces(), across=forces())


def any_task(n: Numbers, substep: float, reach: float) -> PathFollowing:
    """A task of any numbers, for a machine's substep and reach."""
    sensing = Sensing(
        angle_resolution=n.even(0.0, 0.01),
        velocity_noise=n.near(1e-3, 1.0),
        torque_noise=n.near(1e-2, 5.0),
        force_noise=n.near(1e-2, 5.0),
        delay=n.of((0, 1, 2, 3, 1.0, 0.5)) if n.chance(n.odd) else n.of((0, 1, 2)),
    )
    moving = n.even(0.0, 1.0)
    starts = Starts(
        moving=moving,
        gripped=n.even(0.0, 1.0 - moving if isinstance(moving, float) and 0.0 <= moving < 1.0 else 0.0),
        offset=n.even(0.0, 0.1),
    )
    weights = {name: n.near(1e-2, 1e3) for name in ("tracking", "pace", "effort", "failure") if n.chance(0.5)}
    most = n.of((1, 2, 5, 10, 10, 10, 20))
    return PathFollowing(
        path=any_path(n, reach),
        hand=any_hand(n),
        pace=n.near(0.05, 4.0),
        control_period=most * substep if n.chance(0.9) else n.near(1e-3, 1.0),
        error_max=n.near(0.01, 0.25),
        truncation_error=n.near(0.01, 0.5),
        arrival=n.near(0.01, 0.2),
        singularity_margin=n.near(0.01, 0.3),
        start_offset=0.0 if n.chance(0.6) else n.even(0.0, 0.05),
        friction_drift=n.even(-1.0, 1.0),
        sensing=sensing if n.chance(0.3) else Sensing(),
        starts=starts if n.chance(0.3) else Starts(),
        reward=RewardWeights(**weights),
    )


@dataclass
class Built:
    """What the constructors said: how often they accepted, and the refusals by the field that they name."""

    combinations: int = 0
    accepted: int = 0
    refused: Counter[str] = field(default_factory=Counter[str])
    seconds: float = 0.0


def build(combinations: int, seed: int = 0) -> Built:
    """Build combinations of machine and task. What is raised but a ParameterError, a warning too, gets out."""
    rng, found, begin = np.random.default_rng([seed, 1]), Built(), time.process_time()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for _ in range(combinations):
            n = Numbers(rng, odd=float(rng.choice((0.0, 0.003, 0.03, 0.3))))
            try:
                machine = any_machine(n)
                task = any_task(n, machine.substep, machine.arm.length_a + machine.arm.length_b)
                check_machine(task, machine)
                found.accepted += 1
            except ParameterError as error:
                found.refused[str(error).split(" must ")[0]] += 1
            found.combinations += 1
    found.seconds = time.process_time() - begin
    return found


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
    reach = machine.arm.length_a + machine.arm.length_b
    wide = replace(any_task(n, shared.substep, reach), control_period=shared.substep * shared.substeps)
    wide = replace(wide, hand=slow(wide.hand, shared.substep), starts=Starts())
    arm, h, period = model_of(held_machine(wide, machine)).arm, machine.substep, wide.control_period
    limit, present = largest_force(arm, h, period), strongest(wide, machine)
    share = float(n.of((1.0 - 1e-9, 1.0 - 1e-9, 0.5, 0.1, 0.01)))
    task = replace(wide, hand=stronger(wide.hand, share * limit / present if present > 0.0 else 1.0))
    if n.chance(0.5):
        least = min(machine.arm.length_a, machine.arm.length_b)
        rate = math.sqrt(largest_energy(arm, h, period) / (arm.m11 + arm.m22 + abs(arm.coupling)))
        pace = rate * least * task.singularity_margin
        task = replace(task, pace=min(task.pace, pace), starts=Starts(moving=0.7, gripped=0.2, offset=0.01))
    return task


def slow(hand: Operator, substep: float) -> Operator:
    """The hand with sines that the substep can follow."""
    if isinstance(hand, MultiSineHand | HumanArm):
        return replace(hand, frequencies=tuple(min(each, 0.1 / substep) for each in hand.frequencies))
    return hand


def stronger(hand: Operator, times: float) -> Operator:
    """The hand with all its forces so many times as large."""

    def all_of(values: tuple[float, ...]) -> tuple[float, ...]:
        return tuple(times * value for value in values)

    if isinstance(hand, MultiSineHand):
        return replace(hand, push=times * hand.push, amplitudes=all_of(hand.amplitudes))
    if isinstance(hand, RecordedForces):
        return replace(hand, along=all_of(hand.along), across=all_of(hand.across))
    assert isinstance(hand, HumanArm)
    if times >= 1.0:
        return hand
    weaker = replace(hand, amplitudes=all_of(hand.amplitudes))
    return replace(weaker, acceleration=times * weaker.acceleration) if isinstance(weaker, TremorArm) else weaker


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
    batches: int = 0
    kinds: int = 0
    refused: int = 0
    episodes: int = 0
    too_fast: int = 0
    not_finite: int = 0
    energy_error: float = 0.0
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
    """Return what the worlds of a batch did."""
    compile_kernels()
    found, begin = Ran(batches=1), time.process_time()
    rng = np.random.default_rng([seed, 2, number])
    pairs, found.refused = extreme_pairs(rng)
    found.kinds = len(pairs)
    faulthandler.dump_traceback_later(PATIENCE, exit=True)
    start = time.perf_counter()
    run_batch(found, pairs, rng, f"batch {number} of seed {seed}")
    found.slowest = time.perf_counter() - start
    faulthandler.cancel_dump_traceback_later()
    found.seconds = time.process_time() - begin
    return found


def merged(one: Ran, two: Ran) -> Ran:
    """Return what the worlds of both did."""
    sums = {item.name: getattr(one, item.name) + getattr(two, item.name) for item in fields(Ran)}
    largest = {name: max(getattr(one, name), getattr(two, name)) for name in ("energy_error", "slowest")}
    return Ran(**{**sums, **largest, "worst": one.worst or two.worst})


@cache
def compile_kernels() -> None:
    """Compile what is to run, which takes longer than ``PATIENCE`` on a busy machine."""
    batch = Batch(BASELINE, PathFollowing())
    batch.reset([0])
    batch.step(np.zeros((1, 4)))


def run_batch(found: Ran, pairs: list[tuple[Machine, PathFollowing]], rng: np.random.Generator, where: str) -> None:
    """Simulate some worlds of each pair for a few rounds."""
    machines, tasks = map(list, zip(*(COPIES * pairs), strict=True))
    batch = Batch(machines, tasks, sensors="force", observe_context=True, max_steps=int(rng.integers(20, 2000)))
    most = np.array([largest_energy(model_of(held_machine(t, m)).arm, m.substep, t.control_period) for m, t in pairs])
    worlds = len(machines)
    obs, telemetry = batch.reset(rng.integers(2**63, size=worlds).tolist())
    energy = telemetry[:, COLUMN.kinetic_energy]
    look(found, where, obs, telemetry)
    for _ in range(ROUNDS):
        for action in batch.action_high * voltages(rng, worlds):
            returns = batch.step(action, SAME_STEP)
            energy = look_at_step(found, where, returns, energy, np.tile(most, COPIES))
            found.steps += worlds
    look(found, where, batch.get_state()["worlds"])


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


def figures(built: Built, ran: Ran) -> list[list[str]]:
    """The rows of the table."""
    return [
        ["Combinations of constructors", f"{built.combinations:,}"],
        ["accepted, refused with a ParameterError", f"{built.accepted:,}, {sum(built.refused.values()):,}"],
        ["World-steps", f"{ran.steps:,} in {ran.episodes:,} episodes"],
        ["extreme machines with tasks: accepted, refused", f"{ran.kinds:,}, {ran.refused:,}"],
        ["episodes that ended as too fast", f"{ran.too_fast:,}"],
        ["Numbers not finite", f"{ran.not_finite:,}"],
        ["Energy balance, largest error", f"{ran.energy_error:.2g} of the largest term"],
        ["Longest batch", f"{ran.slowest:.1f} s"],
        ["Processor time", f"{built.seconds + ran.seconds:,.0f} s"],
    ]


def main() -> int:
    """Read the arguments and run; 1 if something was found."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--combinations", type=float, default=1e6, help="of constructors")
    parser.add_argument("--steps", type=float, default=1e9, help="of all worlds together")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--write", action="store_true", help="put the figures into docs/robustness.md")
    arguments = parser.parse_args()
    with ProcessPoolExecutor(arguments.processes, multiprocessing.get_context("spawn")) as pool:
        building = pool.submit(build, int(arguments.combinations), arguments.seed)
        ran = run(int(arguments.steps), arguments.seed, pool.map)
        built = building.result()
    sys.path.append(str(ROOT / "docs" / "make"))
    from pages import put_block, table

    put_block(
        ROOT / "docs" / "robustness.md", "fuzz", table(["What", "Found"], figures(built, ran)), write=arguments.write
    )
    return int(ran.not_finite > 0 or ran.energy_error > ENERGY_LIMIT)


if __name__ == "__main__":
    sys.exit(main())
