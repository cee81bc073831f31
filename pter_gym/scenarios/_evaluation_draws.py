"""The draws of stored and fresh evaluation episodes, separate from all training draws."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from pter_gym.hands import SINES, HumanArm, MultiSineHand
from pter_gym.params import Machine
from pter_gym.scenarios._suite import Scenario
from pter_gym.scenarios.randomisation import Randomisation
from pter_gym.tasks.path_following import PathFollowing

STREAM = 20261120
"""Where the seeds of all stored evaluation episodes begin."""

FRESH, FRESH_RESETS, FRESH_ORDER = 20261121, 20261122, 20261123
"""Where the seeds of all fresh evaluation episodes begin, of the seeds of their resets, and of their order."""


class EvaluationDraw(NamedTuple):
    """A machine, a task, and the stratum within which bootstrap intervals resample."""

    machine: Machine
    task: PathFollowing
    stratum: str


def evaluation_draws(scenario: Scenario, fresh: tuple[int, str] | None = None) -> list[EvaluationDraw]:
    """Return evaluation episodes of a scenario, always the same for the same seed.

    The phases of the hand's sines are drawn here, so the reset's seed only determines the sensor noise.

    Parameters
    ----------
    scenario
        The scenario.
    fresh
        Seed ≥ 0 of fresh episodes, and the name of their pace: as many in each stratum as stored ones. They differ from
        pace to pace, so a policy cannot use what it remembers from another pace. None draws the stored ones.
    """
    rng = np.random.default_rng(_seed(scenario))
    draws = Randomisation(machine=scenario.machine, task=scenario.task, own=scenario.own)
    pairs = [draws.draw(rng) for _ in range(scenario.episodes)]
    stored = [_labelled(scenario, machine, _with_phases(task, rng)) for machine, task in pairs]
    if fresh is None:
        return stored
    return _fresh(scenario, draws, fresh_strata(scenario, [draw.stratum for draw in stored], fresh), fresh)


def fresh_strata(scenario: Scenario, stored: Sequence[str], fresh: tuple[int, str]) -> tuple[str, ...]:
    """Return the strata of fresh episodes: the stored ones shuffled, so that position does not reveal them."""
    rng = np.random.default_rng(_fresh_seed(FRESH_ORDER, scenario, fresh))
    return tuple(stored[int(k)] for k in rng.permutation(len(stored)))


def fresh_reset_seeds(scenario: Scenario, fresh: tuple[int, str]) -> list[int]:
    """Return the seeds of the resets of fresh episodes, from their seed and the name of their pace."""
    rng = np.random.default_rng(_fresh_seed(FRESH_RESETS, scenario, fresh))
    return rng.integers(2**63, size=scenario.episodes).tolist()


def _fresh(
    scenario: Scenario, draws: Randomisation, strata: Sequence[str], fresh: tuple[int, str]
) -> list[EvaluationDraw]:
    """Return new draws with these strata in this order; draws for a full stratum are dropped."""
    free: dict[str, list[int]] = {}
    for place, stratum in reversed(list(enumerate(strata))):
        free.setdefault(stratum, []).append(place)
    rng = np.random.default_rng(_fresh_seed(FRESH, scenario, fresh))
    found: dict[int, EvaluationDraw] = {}
    while len(found) < len(strata):
        machine, task = draws.draw(rng)
        draw = _labelled(scenario, machine, _with_phases(task, rng))
        if places := free.get(draw.stratum):
            found[places.pop()] = draw
    return [found[place] for place in range(len(strata))]


def _labelled(scenario: Scenario, machine: Machine, task: PathFollowing) -> EvaluationDraw:
    return EvaluationDraw(machine, task, type(getattr(task, scenario.stratum)).__name__)


def _seed(scenario: Scenario) -> list[int]:
    """Return the seed of a scenario's stored episodes: from its name, or from its ``place``."""
    return [STREAM, *_name(scenario)] if scenario.place is None else [STREAM, scenario.place]


def _fresh_seed(stream: int, scenario: Scenario, fresh: tuple[int, str]) -> list[int]:
    seed, pace = fresh
    return [stream, seed, *f"{pace} ".encode(), *_name(scenario)]


def _name(scenario: Scenario) -> bytes:
    return f"{scenario.name}-v{scenario.version}".encode()


def _with_phases(task: PathFollowing, rng: np.random.Generator) -> PathFollowing:
    """Return the task with the phases that its hand would draw on a reset."""
    if not isinstance(task.hand, (MultiSineHand, HumanArm)) or not task.hand.random_phases:
        return task
    phases = tuple(rng.uniform(0.0, 2.0 * math.pi, SINES).tolist())
    return replace(task, hand=replace(task.hand, phases=phases, random_phases=False))
