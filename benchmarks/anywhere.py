"""Trained policies against the best tuned law, on the scenarios and where no scenario goes.

    python benchmarks/anywhere.py [--policies NAME …] [--episodes N]

A policy is a shipped one (by default `residual`) or a file of `pter export`. Fresh draws of six
scenarios, and sixteen sets of draws of other machines, hands and paths, 100 episodes at each pace.
The law is the best of all tuned laws with all gains of the package, at each pace of each set by
itself. Prints a row for each set: path errors [mm], those of the median policy over the law's, the
same of the means of the worst twentieths, and the share of episodes that it completes. Takes about
six minutes of processor time, and one for each policy.
"""

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import tyro

from pter_gym.benchmark import Episodes, evaluate, find_policy
from pter_gym.benchmark.boards import worst_twentieth
from pter_gym.hands import HumanArm
from pter_gym.params import BASELINE, Hand, Machine
from pter_gym.paths import Arc, Line, Polyline, Spline
from pter_gym.policies.tuned import read_gains, tuned_names
from pter_gym.scenarios import PACES, find_scenario
from pter_gym.scenarios.distributions import Draws, OneOf, Uniform, Vary
from pter_gym.scenarios.variations import CURVED, EQ5, STANDARD

SCENARIOS = ("standard", "paths", "hands", "materials", "everything", "tremor")

SEED, FIRST_RESET = 20_261_128, 2**51


def line(direction: float, x: tuple[float, float], y: tuple[float, float], longest: float) -> Any:
    """Return lines that begin in a box and head within 0.2 rad of a direction."""
    about = Uniform(direction - 0.2, direction + 0.2)
    length = Uniform(0.5 * longest, longest)
    return Vary(Line(), x=Uniform(*x), y=Uniform(*y), direction=about, length=length)


def spiral() -> Spline:
    """Return a spiral of one and a half turns towards its centre."""
    angles = [0.25 * math.pi * k for k in range(13)]
    radii = [0.24 - 0.01 * k for k in range(13)]
    pairs = zip(angles, radii, strict=True)
    return Spline(points=tuple((r * math.cos(a), 0.6 + r * math.sin(a)) for a, r in pairs))


def sets() -> dict[str, Draws]:
    """Return the sets of draws by name."""
    clutch, arm = BASELINE.clutch, BASELINE.arm
    square = tuple(
        (0.2 * x, 0.58 + 0.2 * y) for x, y in ((0, -1), (1, -1), (1, 1), (-1, 1), (-1, -1))
    )

    def on(machine: Machine) -> Draws:
        return Draws(machine=machine, task=Vary(STANDARD))

    def along(path: Any, error_max: float = CURVED.error_max) -> Draws:
        return Draws(task=Vary(replace(CURVED, error_max=error_max), path=path))

    def pushed(hand: Any) -> Draws:
        return Draws(task=Vary(STANDARD, hand=hand))

    def human(impedance: Any) -> Any:
        return Vary(
            HumanArm(impedance=impedance, random_phases=True),
            eagerness=Uniform(1.3, 1.7),
            rise=Uniform(0.2, 0.5),
            amplitudes=(Uniform(1.0, 5.0),) * 5,
        )

    return {
        "lines from right to left": along(line(math.pi, (0.45, 0.65), (0.55, 0.8), 1.0)),
        "lines towards the base": along(line(-0.5 * math.pi, (-0.25, 0.25), (0.75, 0.85), 0.4)),
        "lines away from the base": along(line(0.5 * math.pi, (-0.25, 0.25), (0.38, 0.45), 0.4)),
        "arcs of 0.1 m": along(
            Vary(
                Arc(radius=0.1),
                x=Uniform(-0.25, 0.05),
                y=Uniform(0.5, 0.65),
                direction=Uniform(-math.pi, math.pi),
                angle=OneOf((Uniform(-4.0, -2.0), Uniform(2.0, 4.0))),
            ),
            0.08,
        ),
        "spiral": along(spiral(), 0.08),
        "an S from right to left": along(
            Spline(points=((0.5, 0.6), (0.2, 0.75), (0.0, 0.6), (-0.2, 0.45), (-0.5, 0.6)))
        ),
        "rounded square": along(Polyline(points=(*square, (0.0, 0.38)), radius=0.1), 0.08),
        "torques × 0.6": on(replace(BASELINE, clutch_scale=(0.6,) * 4)),
        "breakaway × 1.3": on(
            replace(BASELINE, clutch=replace(clutch, breakaway=clutch.breakaway.scaled(1.3)))
        ),
        "time constant × 2": on(replace(BASELINE, clutch=replace(clutch, time_constant=0.21))),
        "time constant × 3": on(replace(BASELINE, clutch=replace(clutch, time_constant=0.315))),
        "delay of 20 ms": on(replace(BASELINE, delay=0.02)),
        "inertia × 1.6": on(
            replace(
                BASELINE,
                arm=replace(arm, inertia_a=1.6 * arm.inertia_a, inertia_b=1.6 * arm.inertia_b),
            )
        ),
        "push × 1.6": pushed(replace(EQ5, push=1.6 * EQ5.push)),
        "stiff arms": pushed(human(Hand(mass=2.5, damping=40.0, stiffness=900.0))),
        "soft arms": pushed(human(Hand(mass=0.5, damping=4.0, stiffness=80.0))),
    }


def laws() -> Iterator[Any]:
    """Yield each tuned law with each gains."""
    for scenario, table in read_gains().items():
        for name in tuned_names({scenario: table}):
            yield find_policy(name, scenario=scenario)


def errors(policy: Any, episodes: Episodes) -> tuple[float, float, float]:
    """Return the mean path error and that of the worst twentieth [mm], and the share completed."""
    scores = evaluate(policy, episodes)
    error = 1e3 * scores["path_error_m"]
    return float(error.mean()), worst_twentieth(error), float(scores["completed"].mean())


def main(policies: tuple[str, ...] = ("residual",), episodes: int = 100) -> None:
    """Print a row for each set of draws."""
    drawn = {name: find_scenario(name).draws for name in SCENARIOS} | sets()
    for name, draws in drawn.items():
        rows: list[list[tuple[float, float, float]]] = []
        for pace in PACES:
            machines, tasks = zip(*draws.pairs(episodes, SEED, pace), strict=True)
            resets = tuple(range(FIRST_RESET, FIRST_RESET + episodes))
            some = Episodes(name, machines, tasks, resets, ("",) * episodes)
            best = min(errors(law, some) for law in laws())
            rows.append([best, *(errors(find_policy(policy), some) for policy in policies)])
        columns = [
            " / ".join(f"{error:.1f}" for error, _, _ in each) for each in zip(*rows, strict=True)
        ]
        middle = [sorted(row[1:])[len(policies) // 2] for row in rows]
        for which in (0, 1):
            ratios = (own[which] / row[0][which] for own, row in zip(middle, rows, strict=True))
            columns.append(" / ".join(f"{ratio:.2f}" for ratio in ratios))
        columns.append(" / ".join(f"{100 * done:.0f}" for _, _, done in middle))
        print(f"| {' | '.join([name, *columns])} |", flush=True)


if __name__ == "__main__":
    tyro.cli(main)
