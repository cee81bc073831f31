"""Draws of stored and seeded test episodes, separate from those of training episodes."""

import math
from dataclasses import replace
from typing import Any

import numpy as np

from pter_gym.hands import SINES
from pter_gym.params import Machine
from pter_gym.scenarios._suite import Scenario
from pter_gym.scenarios.distributions import Pair
from pter_gym.tasks.path_following import PathFollowing

STREAM = 20261120
"""Where the seeds of stored test episodes begin."""

FRESH, FRESH_RESETS, FRESH_ORDER = 20261121, 20261122, 20261123
"""Where the seeds of a seed's test episodes begin, of their resets, and of their order."""


StratifiedPair = tuple[Machine, PathFollowing, str]
"""A machine, a task, and the stratum within which bootstrap intervals resample."""


def evaluation_draws(
    scenario: Scenario, fresh: tuple[int, str] | None = None
) -> list[StratifiedPair]:
    """Return test episodes of a scenario, always the same for the same seed.

    The phases of the hand's sines are drawn here, so the reset's seed only determines the sensor
    noise.

    Parameters
    ----------
    scenario
        The scenario.
    fresh
        Seed ≥ 0 of test episodes, and the name of their pace: as many in each stratum as stored
        ones. They differ from pace to pace, so a policy cannot use what it remembers from another
        pace. None draws the stored ones.
    """
    draws = scenario.draws.at_pace(scenario.draws.varied_task.template.pace)
    rng = np.random.default_rng(
        [STREAM, *_name(scenario)] if scenario.place is None else [STREAM, scenario.place]
    )
    pairs = [draws.draw(rng) for _ in range(scenario.episodes)]
    in_order = [_labelled(scenario, pair, rng) for pair in pairs]
    if fresh is None:
        return in_order
    free: dict[str, list[int]] = {}
    # in another order, so that a position does not reveal the stratum
    order = _fresh_rng(FRESH_ORDER, scenario, fresh).permutation(len(in_order))
    for place, k in reversed(list(enumerate(order))):
        free.setdefault(in_order[int(k)][2], []).append(place)
    rng = _fresh_rng(FRESH, scenario, fresh)
    episodes: dict[int, StratifiedPair] = {}
    while len(episodes) < len(in_order):
        episode = _labelled(scenario, draws.draw(rng), rng)
        if places := free.get(episode[2]):
            episodes[places.pop()] = episode
    return [episodes[place] for place in range(len(in_order))]


def fresh_reset_seeds(scenario: Scenario, fresh: tuple[int, str]) -> list[int]:
    """Return the seeds of the resets of test episodes, from their seed and their pace's name."""
    rng = _fresh_rng(FRESH_RESETS, scenario, fresh)
    return rng.integers(2**63, size=scenario.episodes).tolist()


def _labelled(scenario: Scenario, pair: Pair, rng: np.random.Generator) -> StratifiedPair:
    """Return a pair with known phases, and with its stratum."""
    machine, task = with_phases(pair, rng)
    return machine, task, type(getattr(task, scenario.stratum)).__name__


def with_phases(pair: Pair, rng: np.random.Generator) -> Pair:
    """Return a pair with the phases that its hand would draw on a reset."""
    machine, task = pair
    if task.hand.random_phases:
        phases = tuple(rng.uniform(0.0, 2.0 * math.pi, SINES).tolist())
        hand: Any = task.hand
        task = replace(task, hand=replace(hand, phases=phases, random_phases=False))
    return machine, task


def _fresh_rng(stream: int, scenario: Scenario, fresh: tuple[int, str]) -> np.random.Generator:
    seed, pace = fresh
    return np.random.default_rng([stream, seed, *f"{pace} ".encode(), *_name(scenario)])


def _name(scenario: Scenario) -> bytes:
    return f"{scenario.name}-v{scenario.version}".encode()
