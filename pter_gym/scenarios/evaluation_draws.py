"""The draws of which stored evaluation episodes are made, apart from all training draws."""

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from pter_gym.hands import SINES, HumanArm, MultiSineHand
from pter_gym.params import Machine
from pter_gym.scenarios.randomisation import Randomisation
from pter_gym.scenarios.suite import Scenario
from pter_gym.tasks.path_following import PathFollowing

STREAM = 20261120
"""Where the seeds of all evaluation episodes begin."""


class EvaluationDraw(NamedTuple):
    """A machine, a task, and the kind of episode within which intervals draw again."""

    machine: Machine
    task: PathFollowing
    stratum: str


def evaluation_draws(scenario: Scenario) -> list[EvaluationDraw]:
    """Return the evaluation episodes of a scenario, always the same.

    The phases of the hand's sines are drawn here, so nothing about an episode is left to a random stream but the
    noise of its sensors.
    """
    rng = np.random.default_rng(_seed(scenario))
    draws = Randomisation(machine=scenario.machine, task=scenario.task)
    pairs = [draws.draw(rng) for _ in range(scenario.episodes)]
    found = [(machine, _with_phases(task, rng)) for machine, task in pairs]
    return [EvaluationDraw(machine, task, type(getattr(task, scenario.stratum)).__name__) for machine, task in found]


def _seed(scenario: Scenario) -> list[int]:
    """Return the seed of a scenario's evaluation episodes: from its name, or from its place in an old list."""
    if scenario.place is not None:
        return [STREAM, scenario.place]
    return [STREAM, *f"{scenario.name}-v{scenario.version}".encode()]


def _with_phases(task: PathFollowing, rng: np.random.Generator) -> PathFollowing:
    """Return the task with the phases that its hand would draw at a reset."""
    if not isinstance(task.hand, (MultiSineHand, HumanArm)) or not task.hand.random_phases:
        return task
    phases = tuple(rng.uniform(0.0, 2.0 * math.pi, SINES).tolist())
    return replace(task, hand=replace(task.hand, phases=phases, random_phases=False))
