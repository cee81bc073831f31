"""Episodes of a policy as the registered environment gives them, many worlds at once."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from pter_gym.datasets.levels import Act, actors_of
from pter_gym.envs.vector import PathFollowingVectorEnv
from pter_gym.errors import ParameterError
from pter_gym.internal.checks import whole_number
from pter_gym.scenarios import find_scenario
from pter_gym.tasks.path_following import COLUMN

WORLDS = 128
"""Worlds that are simulated at once."""

MOST_SEED = 2**31 - 1

EPISODES_OF_A_SEED = 2**32
"""Episode k of seed K is that of a reset with the seed K times this, plus k; so all levels have the same episodes."""


@dataclass(frozen=True)
class Episode:
    """An episode of T control steps.

    Attributes
    ----------
    seed
        Of its reset.
    observations
        float32 (T + 1, entries), each entry relative to its scale.
    actions
        float32 (T, 4), normalised.
    rewards
        float64 (T,).
    terminations, truncations
        bool (T,).
    arrived
        Whether the end of the path was reached.
    distance
        Mean distance of the tip from the path [m].
    """

    seed: int
    observations: NDArray[np.float32]
    actions: NDArray[np.float32]
    rewards: NDArray[np.float64]
    terminations: NDArray[np.bool_]
    truncations: NDArray[np.bool_]
    arrived: bool
    distance: float

    def __len__(self) -> int:
        """Return the number of control steps."""
        return len(self.rewards)


def environment_of(scenario: str, seed: int = 0) -> tuple[str, dict[str, Any]]:
    """Return the id of a data set's environment and its arguments."""
    return find_scenario(scenario).id, {"action_unit": "normalised", "context_seed": seed}


def record_episodes(
    scenario: str, level: str, steps: int, *, seed: int = 0, on_steps: Callable[[int], object] = lambda _: None
) -> list[Episode]:
    """Return whole episodes on training draws, at least so many control steps together.

    Parameters
    ----------
    scenario, level
        Names, of ``SCENARIOS`` and ``LEVELS``.
    steps
        Control steps, at least 1. Each of those who act has an even share, and ends its last episode.
    seed
        Of draws, resets and noise, from 0 to 2³¹ − 1.
    on_steps
        Called with the control steps of episodes that have ended.

    Raises
    ------
    ParameterError
        If a name is unknown, or a number is out of range.
    """
    steps = whole_number("steps", steps)
    seed = whole_number("seed", seed, at_least=0)
    if seed > MOST_SEED:
        raise ParameterError(f"seed must be a whole number from 0 to {MOST_SEED}, got {seed}")
    name, arguments = environment_of(scenario, seed)
    actors = actors_of(scenario, level)
    found: list[Episode] = []
    envs: Any = gymnasium.make_vec(name, num_envs=WORLDS, autoreset_mode=AutoresetMode.DISABLED, **arguments)
    try:
        for place, actor in enumerate(actors):
            act = actor.bind(envs, seed * len(actors) + place)
            share = steps * (place + 1) // len(actors) - steps * place // len(actors)
            first = seed * EPISODES_OF_A_SEED + len(found)
            for episode in _until(_episodes(envs, act, first), share):
                found.append(episode)
                on_steps(len(episode))
    finally:
        envs.close()
    return found


def _until(episodes: Iterator[Episode], steps: int) -> Iterator[Episode]:
    """Give episodes until they have so many control steps together."""
    while steps > 0:
        episode = next(episodes)
        steps -= len(episode)
        yield episode


def _episodes(envs: PathFollowingVectorEnv, act: Act, first: int) -> Iterator[Episode]:
    """Give the episodes of the seeds from the first on, in their order, without an end."""
    worlds = _Worlds(envs, first)
    ended: dict[int, Episode] = {}
    while True:
        for episode in worlds.step(act):
            ended[episode.seed] = episode
        while first in ended:
            yield ended.pop(first)
            first += 1


class _Worlds:
    """Worlds that begin the episode of the next seed as soon as one has ended, and what has happened in each so far."""

    def __init__(self, envs: PathFollowingVectorEnv, first: int) -> None:
        self._envs = envs
        count = envs.num_envs
        most: int = envs.spec.max_episode_steps  # type: ignore[union-attr, assignment]
        self._rows = np.arange(count)
        self._seeds = [first + k for k in range(count)]
        self._next = first + count
        self._lengths = np.zeros(count, np.intp)
        self._obs: NDArray[np.float32] = envs.reset(seed=self._seeds)[0]
        self._observations = np.empty((count, most + 1, self._obs.shape[1]), np.float32)
        self._actions = np.empty((count, most, 4), np.float32)
        self._rewards = np.empty((count, most))
        self._distances = np.empty((count, most))

    def step(self, act: Act) -> list[Episode]:
        """Go on by one control step, and return the episodes that have ended with it."""
        at = self._rows, self._lengths
        self._observations[at] = self._obs
        self._actions[at] = actions = act(self._obs)
        self._obs, rewards, terminated, truncated, infos = self._envs.step(actions)
        self._rewards[at] = rewards
        self._distances[at] = np.abs(infos["telemetry"][:, COLUMN.normal_error])
        self._lengths += 1
        self._observations[self._rows, self._lengths] = self._obs
        over = terminated | truncated
        found = [
            self._episode(world, bool(terminated[world]), bool(truncated[world]), bool(infos["is_success"][world]))
            for world in np.flatnonzero(over).tolist()
        ]
        if found:
            self._begin(over)
        return found

    def _episode(self, world: int, terminated: bool, truncated: bool, arrived: bool) -> Episode:
        """Return the episode of a world, which has ended."""
        steps = int(self._lengths[world])
        ends = np.zeros((2, steps), np.bool_)
        ends[:, -1] = terminated, truncated
        return Episode(
            self._seeds[world],
            self._observations[world, : steps + 1].copy(),
            self._actions[world, :steps].copy(),
            self._rewards[world, :steps].copy(),
            ends[0],
            ends[1],
            arrived,
            float(self._distances[world, :steps].mean()),
        )

    def _begin(self, over: NDArray[np.bool_]) -> None:
        """Begin the next episodes in some worlds."""
        for world in np.flatnonzero(over).tolist():
            self._seeds[world] = self._next
            self._next += 1
        seeds = [seed if begins else None for seed, begins in zip(self._seeds, over, strict=True)]
        self._lengths[over] = 0
        self._obs = self._envs.reset(seed=seeds, options={"reset_mask": over})[0]
