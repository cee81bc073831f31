"""Episodes of a policy as in the registered environment, in many worlds at once."""

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from pter_gym._internal.checks import whole_number
from pter_gym.errors import ParameterError
from pter_gym.scenarios import find_scenario
from pter_gym.tasks.path_following import COLUMN
from pter_gym.tools.datasets.levels import Act, actors_of

WORLDS = 128
"""Worlds that are simulated at once."""

MAX_SEED = 2**31 - 1

EPISODES_OF_A_SEED = 2**32
"""Episode k of seed K is that of a reset with the seed K times this, plus k; so all levels have the same episodes."""


class Episode(NamedTuple):
    """An episode of T control steps: the seed of its reset, and what the environment took and gave, as bits.

    ``observations`` are float32 (T + 1, entries), ``actions`` float32 (T, 4) and normalised, ``rewards`` float64 (T,),
    ``terminations`` and ``truncations`` bool (T,). ``arrived`` says whether the tip reached the end of the path, and
    ``distance`` is its mean distance from the path [m].
    """

    seed: int
    observations: NDArray[np.float32]
    actions: NDArray[np.float32]
    rewards: NDArray[np.float64]
    terminations: NDArray[np.bool_]
    truncations: NDArray[np.bool_]
    arrived: bool
    distance: float


def environment_of(scenario: str, seed: int = 0) -> tuple[str, dict[str, Any]]:
    """Return the id of a data set's environment and its arguments."""
    return find_scenario(scenario).id, {"frame_skip": 1, "context_seed": seed}


def record_episodes(
    scenario: str, level: str, steps: int, *, seed: int = 0, on_steps: Callable[[int], object] = lambda _: None
) -> list[Episode]:
    """Return complete episodes on training draws, with at least ``steps`` control steps in total.

    Parameters
    ----------
    scenario, level
        Names, of ``SCENARIOS`` and ``LEVELS``.
    steps
        Control steps, at least 1. Each actor of the level has an even share, and completes its last episode.
    seed
        Seed of draws, resets and noise, from 0 to 2³¹ − 1.
    on_steps
        Called with the number of control steps of each completed episode.

    Raises
    ------
    ParameterError
        If a name is unknown, or a number is out of range.
    """
    steps = whole_number("steps", steps)
    seed = whole_number("seed", seed, at_least=0)
    if seed > MAX_SEED:
        raise ParameterError(f"seed must be a whole number from 0 to {MAX_SEED}, got {seed}")
    name, arguments = environment_of(scenario, seed)
    actors = actors_of(scenario, level)
    found: list[Episode] = []
    envs: Any = gymnasium.make_vec(name, num_envs=WORLDS, autoreset_mode=AutoresetMode.DISABLED, **arguments)
    try:
        for place, actor in enumerate(actors):
            episodes = _episodes(
                envs, actor.bind(envs, seed * len(actors) + place), seed * EPISODES_OF_A_SEED + len(found)
            )
            share = steps * (place + 1) // len(actors) - steps * place // len(actors)
            while share > 0:
                episode = next(episodes)
                found.append(episode)
                share -= len(episode.rewards)
                on_steps(len(episode.rewards))
    finally:
        envs.close()
    return found


def _episodes(envs: Any, act: Act, first: int) -> Iterator[Episode]:
    """Yield the episodes of consecutive seeds, in order and without end.

    A world begins the next seed's episode as soon as its own has ended.
    """
    seeds: list[int] = list(range(first, first + envs.num_envs))
    rows: list[list[Any]] = [[] for _ in seeds]
    ended: dict[int, Episode] = {}
    obs = envs.reset(seed=seeds)[0]
    while True:
        actions = act(obs)
        after, *results, infos = envs.step(actions)
        errors = np.abs(infos["telemetry"][:, COLUMN.normal_error])
        for row, *step in zip(rows, obs, actions, *results, errors, strict=True):
            row.append(step)
        obs, over = after, results[1] | results[2]
        if not over.any():
            continue
        for world in np.flatnonzero(over).tolist():
            seen, *columns, distances = (np.array(column) for column in zip(*rows[world], strict=True))
            seen = np.concatenate([seen, after[world : world + 1]])
            arrived, distance = bool(infos["is_success"][world]), float(distances.mean())
            ended[seeds[world]] = Episode(seeds[world], seen, *columns, arrived=arrived, distance=distance)
            seeds[world], rows[world] = max(seeds) + 1, []
        begun = [seed if new else None for seed, new in zip(seeds, over.tolist(), strict=True)]
        obs = envs.reset(seed=begun, options={"reset_mask": over})[0]
        while first in ended:
            yield ended.pop(first)
            first += 1
