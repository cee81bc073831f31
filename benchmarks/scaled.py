"""Search gains and powers of `single-dof-scaled` on lines and bends of drawn devices, with CMA-ES.

    python benchmarks/scaled.py [--minutes MINUTES] [--file FILE]

Minimises the geometric mean, over 40 devices, `standard` and `paths` and three paces, of what
``pter tune`` minimises, at most 1 m; prints it every five generations, and that of the mean of the
candidates on 60 other devices, which FILE then holds. The worlds of all devices step together.
docs/development/any-device.md has the result.
"""

import math
import re
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from cmaes import CMA
from numpy.typing import NDArray

from pter_agents.draws import DEVICES
from pter_gym.benchmark import Assessment, Episodes, training_episodes
from pter_gym.benchmark.episodes import EPISODE_FIELDS
from pter_gym.benchmark.measures import Travel
from pter_gym.benchmark.rollout import NUMBERS, RANKED, SKIP, bind_to, sensors_of
from pter_gym.controllers import Powers, Scaled
from pter_gym.controllers._scaled import Ratios
from pter_gym.errors import ParameterError
from pter_gym.policies.tuned import SCALED_TABLE, find_scaled
from pter_gym.scenarios import PACES

SCENARIOS = ("standard", "paths")
SEARCHED, OTHERS = (2**32 + 1, 40, 4), (2**33 + 1, 60, 6)
"""Seed, devices, and episodes of each at each scenario and pace."""

POPULATION, GENERATIONS, ROWS = 16, 5, 50
POWER, GAIN = 0.12, 0.15
"""Standard deviations at the beginning, of an exponent and of a gain's logarithm."""

SHIPPED = find_scaled()
GAINS = tuple(each.gain for each in SHIPPED.powers)
Numbers = NDArray[np.float64]


def numbers_of(law: Scaled) -> Numbers:
    """Return the exponents of a law, and zeros for the logarithms of its gains' factors."""
    powers = [getattr(each, ratio) for each in law.powers for ratio in Ratios._fields]
    return np.array([*powers, *[0.0] * (len(law.schedule.knots) * len(GAINS))])


def law_of(numbers: Numbers) -> Scaled:
    """Return the law with these exponents, and the shipped gains times these factors."""
    powers, factors = np.split(numbers, [len(GAINS) * len(Ratios._fields)])
    exponents = powers.round(3).reshape(len(GAINS), -1).tolist()
    found = (
        Powers(gain=gain, **dict(zip(Ratios._fields, row, strict=True)))
        for gain, row in zip(GAINS, exponents, strict=True)
    )
    scaled = np.exp(factors).reshape(-1, len(GAINS))
    knots = tuple(
        (pace, replace(law, **{gain: short(getattr(law, gain) * by) for gain, by in each}))
        for (pace, law), each in (
            (knot, zip(GAINS, row, strict=True))
            for knot, row in zip(SHIPPED.schedule.knots, scaled, strict=True)
        )
    )
    return Scaled(schedule=replace(SHIPPED.schedule, knots=knots), powers=tuple(found))


def short(value: float) -> float:
    return float(f"{value:.4g}")


def drawn(seed: int, devices: int, count: int) -> list[list[list[Episodes]]]:
    """Return episodes by pace, device and scenario; paths out of a device's reach are left out."""
    rng = np.random.default_rng(seed)
    machines = [DEVICES.draw(rng) for _ in range(devices)]
    found: list[list[list[Episodes]]] = []
    for pace in PACES:
        found.append([])
        for machine in machines:
            parts: list[Episodes] = []
            for scenario in SCENARIOS:
                try:
                    parts.append(training_episodes(scenario, pace, count, seed, machine))
                except ParameterError:  # out of reach
                    continue
            if parts:
                found[-1].append(parts)
    return found


def joined(parts: Sequence[Episodes]) -> Episodes:
    """Return episodes one after the other."""
    entries: Any = {
        name: tuple(item for part in parts for item in getattr(part, name))
        for name in EPISODE_FIELDS
    }
    return Episodes("", **entries)


def travel_of(law: Scaled, devices: Sequence[Sequence[Episodes]]) -> Travel:
    """Return how the law, bound to each device, gets on in the episodes of all."""
    together = joined([part for parts in devices for part in parts])
    ends = np.cumsum([sum(map(len, parts)) for parts in devices]).tolist()
    places = [
        slice(end - sum(map(len, parts)), end) for end, parts in zip(ends, devices, strict=True)
    ]
    acting = [bind_to(law, parts[0]) for parts in devices]
    memories = [
        each.start(place.stop - place.start, [seed % NUMBERS for seed in together.seeds[place]])
        for each, place in zip(acting, places, strict=True)
    ]
    limits, steps, entries = np.array(together.time_limits), 0, len(acting[0].layout)
    running, volts = limits > 0, np.zeros((len(together), 4))
    travel, rows = Travel(together.tasks), list[Numbers]()
    with together.worlds(sensors_of(law)) as batch:
        obs, telemetry = batch.reset(together.seeds)
        travel.add(telemetry[None])
        while running.any():
            for each, memory, place in zip(acting, memories, places, strict=True):
                seen = np.ascontiguousarray(obs[place, :entries])
                volts[place] = each.act(seen, memory) if running[place].any() else 0.0
            obs, _, _, (terminated, truncated, _), (telemetry,) = batch.step(volts, SKIP)
            steps += 1
            telemetry[steps > limits], obs[steps > limits] = np.nan, 0.0
            rows.append(telemetry.copy())
            running &= ~(terminated | truncated) & (steps < limits)
            if len(rows) == ROWS or not running.any():
                travel.add(np.stack(rows))
                rows.clear()
    return travel


def value(law: Scaled, episodes: Sequence[Sequence[Sequence[Episodes]]]) -> float:
    """Return the geometric mean over devices, scenarios and paces [mm]."""
    logarithms: list[float] = []
    for devices in episodes:
        travel = travel_of(law, devices)
        scores = [RANKED[name](travel) for name in Assessment._fields]
        begin = 0
        for part in (part for parts in devices for part in parts):
            means = (float(each[begin : begin + len(part)].mean()) for each in scores)
            logarithms.append(math.log(min(Assessment(*means).value, 1.0)))
            begin += len(part)
    return 1e3 * math.exp(float(np.mean(logarithms)))


def written(law: Scaled) -> str:
    """Return the shipped file with another law's numbers."""
    rows = iter(law.schedule.knots)
    powers = {each.gain: each for each in law.powers}
    lines: list[str] = []
    gain = ""
    for line in SCALED_TABLE.read_text().splitlines():
        name, _, told = line.partition(" = ")
        numbers: dict[str, float] = {}
        if line.startswith("    ["):
            gains = next(rows)[1]
            numbers = {each: getattr(gains, each) for each in GAINS}
        elif name == "gain":
            gain = told.strip('"')
        elif name in Ratios._fields:
            numbers = {name: getattr(powers[gain], name)}
        lines.append(with_numbers(line, numbers))
    return "\n".join([*lines, ""])


def with_numbers(line: str, numbers: Mapping[str, float]) -> str:
    for name, number in numbers.items():
        line = re.sub(rf"\b{name} = [-\d.e]+", f"{name} = {number}", line)
    return line


def main(minutes: float = 20.0, file: str = "scaled.toml") -> None:
    """Search, and write the law in the middle of the last generation."""
    episodes, others = drawn(*SEARCHED), drawn(*OTHERS)
    start = numbers_of(SHIPPED)
    powers = len(GAINS) * len(Ratios._fields)
    spread = np.where(np.arange(len(start)) < powers, POWER, GAIN)
    print(f"shipped: {value(SHIPPED, episodes):.2f} mm, others {value(SHIPPED, others):.2f}")
    search = CMA(mean=np.zeros(len(start)), sigma=1.0, seed=1, population_size=POPULATION)
    end, generation = time.monotonic() + 60.0 * minutes, 0
    while time.monotonic() < end:
        points = [search.ask() for _ in range(POPULATION)]
        laws = [law_of(start + spread * point) for point in points]
        values = [math.log(value(law, episodes)) for law in laws]
        search.tell(list(zip(points, values, strict=True)))
        generation += 1
        if generation % GENERATIONS == 0:
            middle = law_of(start + spread * search.mean)
            mean = math.exp(float(np.mean(values)))
            print(f"{generation}: {mean:.2f} mm, others {value(middle, others):.2f}", flush=True)
            Path(file).write_text(written(middle))


if __name__ == "__main__":
    tyro.cli(main)
