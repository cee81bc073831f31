"""Make the stored evaluation episodes in pter_gym/episodes again.

They change every published score: raise the versions of the scenarios.

Each is a draw from its scenario with a generator of its own, apart from all training draws, and with the phases of the
hand's sines drawn here, so that nothing about an episode is left to a random stream but the noise of its sensors.
"""

import math
from dataclasses import replace

import numpy as np
import tyro

from pter_gym.benchmark.episodes import store_episodes
from pter_gym.hands import SINES, HumanArm, MultiSineHand
from pter_gym.scenarios import SCENARIOS
from pter_gym.scenarios.randomisation import Randomisation
from pter_gym.tasks.path_following import PathFollowing

COUNTS = {"standard": 200, "paths": 300, "hands": 300, "materials": 300, "everything": 1000}


def with_phases(task: PathFollowing, rng: np.random.Generator) -> PathFollowing:
    """The task with the phases that its hand would draw at a reset."""
    if not isinstance(task.hand, (MultiSineHand, HumanArm)) or not task.hand.random_phases:
        return task
    phases = tuple(rng.uniform(0.0, 2.0 * math.pi, SINES).tolist())
    return replace(task, hand=replace(task.hand, phases=phases, random_phases=False))


def stratum(task: PathFollowing, scenario: str) -> str:
    """The kind of episode within which intervals draw again."""
    part = task.hand if scenario == "hands" else task.path
    return type(part).__name__


def store(name: str, count: int, number: int) -> None:
    """Draw the episodes of a scenario, and store them."""
    rng = np.random.default_rng([20261120, number])
    scenario = SCENARIOS[name]
    draws = Randomisation(machine=scenario.machine, task=scenario.task)
    pairs = [draws.draw(rng) for _ in range(count)]
    machines = [machine for machine, _ in pairs]
    tasks = [with_phases(task, rng) for _, task in pairs]
    strata = [stratum(task, name) for task in tasks]
    path = store_episodes(name, machines, tasks, list(range(count)), strata, version=scenario.version)
    print(path.name, path.stat().st_size, {kind: strata.count(kind) for kind in sorted(set(strata))})


def main() -> None:
    """Make the stored evaluation episodes again; they change every published score."""
    for number, (name, count) in enumerate(COUNTS.items()):
        store(name, count, number)


if __name__ == "__main__":
    tyro.cli(main)
