"""How well the force region predicts the errors of which-clutches.md, in a minute.

    python docs/make/force_region.py

The arrangements, their rows of W and their errors are those of the page's table. For each, two
measures are averaged over poses on the paths where the errors were measured: `along`, the steering
force to the weaker side while the tip moves along the path, and `worst`, the same in the worst
direction of motion. Both were chosen before a correlation was computed. Forces count in whole
newtons, so what is below half a newton is a tie at 0.
"""

import re
from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from markup import DOCS, code, number, table
from numpy.typing import NDArray
from scipy.stats import spearmanr

from pter_gym.benchmark.episodes import find_episodes
from pter_gym.haptics import force_extremes, force_range, link_angles
from pter_gym.params import BASELINE, Connection, Machine
from pter_gym.paths import Path

Array = NDArray[np.float64]

PAGE = DOCS / "which-clutches.md"
COLUMNS = ("`standard`: best law", "`standard`: policy", "`paths`: best law", "`paths`: policy")
MEASURES = ("along", "worst")
POSES = {"standard": 100, "paths": 20}
"""Equally spaced poses on each path of a scenario; twice as many change no correlation."""

SPEED = 0.25


class PageRow(NamedTuple):
    """An arrangement of the page: name, machine, errors [mm] in the order of ``COLUMNS``."""

    name: str
    machine: Machine
    errors: tuple[float, ...]


def rows() -> Iterator[PageRow]:
    """Yield the arrangements of the page's table."""
    for line in PAGE.read_text("utf-8").splitlines():
        if row := re.match(r"\| `([\w-]+)` \| (\([^|]*\)) \|(.*)", line):
            pairs = re.findall(r"\((\S+), (\S+)\)", row[2].replace("−", "-"))
            clutches = tuple(
                Connection(str(k), (float(a), float(b))) for k, (a, b) in enumerate(pairs)
            )
            errors = tuple(
                float(re.match(r"[\d.]+", cell.strip())[0])
                for cell in row[3].split("|")[: len(COLUMNS)]
            )
            yield PageRow(row[1], replace(BASELINE, clutches=clutches), errors)


def paths_of(scenario: str) -> list[Path]:
    """Return the different paths of a scenario's stored episodes."""
    return list(dict.fromkeys(task.path for task in find_episodes(scenario, "medium").tasks))


def measured(machine: Machine, paths: list[Path], poses: int) -> tuple[float, ...]:
    """Return the values of ``MEASURES`` [N], means over equally spaced poses on each path."""
    values = []
    for path in paths:
        x, y, heading, _ = path.arcs.at((np.arange(poses) + 0.5) / poses * path.length)
        theta = link_angles(machine.arm, np.stack([x, y], axis=-1))
        ahead = SPEED * np.stack([np.cos(heading), np.sin(heading)], axis=-1)
        worst = force_extremes(machine, theta, speed=SPEED).least_steering
        values.append((force_range(machine, theta, ahead).steering.mean(), worst.mean()))
    return tuple(abs(np.round(np.mean(values, axis=0))).tolist())


def correlations(rows: list[PageRow], forces: dict[str, Array]) -> Iterator[list[str]]:
    """Yield for each column of errors Spearman's correlation with each measure, and its p-value."""
    for name, errors in zip(COLUMNS, zip(*(row.errors for row in rows), strict=True), strict=True):
        tests = [spearmanr(values, errors) for values in forces[name.split("`")[1]].T]
        yield [
            name,
            *(f"{test.statistic:.2f} (p = {test.pvalue:.3f})".replace("-", "−") for test in tests),
        ]


def main() -> None:
    """Print each arrangement's measures and their rank correlations with the page's errors."""
    arrangements = list(rows())
    forces: dict[str, Array] = {}
    for scenario, poses in POSES.items():
        paths = paths_of(scenario)
        forces[scenario] = np.array([measured(row.machine, paths, poses) for row in arrangements])
    header = [
        "Arrangement",
        *(f"`{scenario}`: {measure}" for scenario in forces for measure in MEASURES),
    ]
    lines = zip(arrangements, np.hstack([*forces.values()]), strict=True)
    print(table(header, ([code(row.name), *map(number, values)] for row, values in lines)))
    print(table(["Errors", *MEASURES], correlations(arrangements, forces)))


if __name__ == "__main__":
    main()
