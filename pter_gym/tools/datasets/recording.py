"""Episodes of policies at several skill levels, in the registered environments.

They are recorded in many worlds at once, 8,700 to 13,800 control steps per second on one core,
where Minari's own ``DataCollector``, which wraps a single environment, records 450 to 1,150.
"""

from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from pter_gym._internal.checks import whole_number
from pter_gym._internal.reading import read_toml
from pter_gym.benchmark._load_policy import load_policy
from pter_gym.errors import unknown_name
from pter_gym.policies import TrainedPolicy, read_policy
from pter_gym.scenarios import find_scenario
from pter_gym.tasks.path_following import COLUMN

LEVELS = MappingProxyType(
    {
        "expert": "a trained policy of the package, without noise",
        "medium": "a policy that was trained for a part of the time, without noise",
        "replay": "the stages of a training from its start on, each with the noise with which it explored",
        "random": "actions drawn evenly from the action space",
    }
)
"""What acts in a data set, by level."""

EXPERTS = MappingProxyType({"standard": "ppo-standard"})
"""Experts by scenario, here one that sees one observation at a time and so can be cloned; elsewhere ``residual``."""

STAGES = Path(__file__).parent / "stages"
"""The training whose stages act: a policy for each, and ``stages.toml``, which describes them."""

WORLDS = 128
"""Worlds that are simulated at once."""

EPISODES_OF_A_SEED = 2**32
"""Episode k of seed K is that of a reset with the seed K times this, plus k; so all levels have the same episodes."""

REFERENCE_EPISODES = 100
"""Episodes whose mean return is a reference score."""


class RecordedEpisode(NamedTuple):
    """An episode of T control steps.

    ``seed`` is that of its reset. ``observations`` are float32 (T + 1, entries), ``actions``
    float32 (T, clutches) and normalised, ``rewards`` float64 (T,), ``terminations`` and
    ``truncations`` bool (T,). ``arrived`` says whether the tip reached the end of the path, and
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


class Actor(NamedTuple):
    """A trained policy with the noise of its exploration, or random actions without a policy.

    The noise of normalised actions is n = ρ·n' + σ·ε with the ``persistence`` ρ, the ``deviation``
    σ and a normal ε.
    """

    name: str
    policy: TrainedPolicy | None = None
    deviation: float = 0.0
    persistence: float = 0.0

    def bind(
        self, envs: Any, seed: int
    ) -> tuple[Callable[[Any], Any], Callable[[NDArray[np.bool_]], None]]:
        """Return functions that act, from observations to actions of all worlds, and that begin episodes in some."""
        if self.policy is None:
            envs.action_space.seed(seed)
            return lambda _: envs.action_space.sample(), lambda _: None
        acting, rng, noise = (
            load_policy(self.policy, envs),
            np.random.default_rng(seed),
            np.zeros(envs.action_space.shape),
        )

        def explore(obs: NDArray[np.float32]) -> NDArray[np.float32]:
            noise[:] = self.persistence * noise + self.deviation * rng.standard_normal(noise.shape)
            return np.clip(acting(obs) + noise, -1.0, 1.0).astype(np.float32)

        return explore if self.deviation else acting, acting.reset


def actors_of(scenario: str, level: str) -> list[Actor]:
    """Return the actors of a data set, each for the same share of its control steps.

    Raises
    ------
    ParameterError
        If there is no such level.
    """
    table = read_toml(STAGES / "stages.toml", "stages")
    stages = {each["name"]: read_policy(STAGES / each["name"]) for each in table["stages"]}
    if level == "random":
        return [Actor("random")]
    if level == "expert":
        name = EXPERTS.get(scenario, "residual")
        return [Actor(name, read_policy(name))]
    if level == "medium":
        name = table["medium"].get(scenario, table["medium"]["others"])
        return [Actor(name, stages[name])]
    if level == "replay":
        return [
            Actor(each["name"], stages[each["name"]], each["deviation"], table["persistence"])
            for each in table["stages"]
        ]
    raise unknown_name("level", level, LEVELS)


def environment_of(scenario: str, seed: int = 0) -> tuple[str, dict[str, Any]]:
    """Return the id of a data set's environment and its arguments."""
    return find_scenario(scenario).id, {"frame_skip": 1, "context_seed": seed}


def record_episodes(
    scenario: str,
    level: str,
    steps: int,
    *,
    seed: int = 0,
    on_steps: Callable[[int], object] = lambda _: None,
) -> list[RecordedEpisode]:
    """Return complete episodes on training draws, with at least ``steps`` control steps in total.

    Parameters
    ----------
    scenario, level
        Names, of ``SCENARIOS`` and ``LEVELS``.
    steps
        Control steps, at least 1. Each actor of the level has an even share, and completes its last
        episode.
    seed
        Seed of draws, resets and noise, at least 0 and below 2³².
    on_steps
        Called with the number of control steps of each completed episode.

    Raises
    ------
    ParameterError
        If a name is unknown, or a number is out of range.
    """
    steps, seed = whole_number("steps", steps), whole_number("seed", seed, at_least=0)
    actors = actors_of(scenario, level)
    found: list[RecordedEpisode] = []
    for place, actor in enumerate(actors):
        episodes = _episodes(scenario, actor, seed, len(found), seed * len(actors) + place)
        share = steps * (place + 1) // len(actors) - steps * place // len(actors)
        while share > 0:
            found.append(next(episodes))
            share -= len(found[-1].rewards)
            on_steps(len(found[-1].rewards))
    return found


def _episodes(
    scenario: str, actor: Actor, seed: int, first: int, noise_seed: int
) -> Iterator[RecordedEpisode]:
    """Yield the episodes of a seed in their order from the first on, without end.

    A world begins the next episode as soon as its own has ended.
    """
    name, arguments = environment_of(scenario, seed)
    envs: Any = gymnasium.make_vec(name, WORLDS, autoreset_mode=AutoresetMode.DISABLED, **arguments)
    act, begin = actor.bind(envs, noise_seed)
    following = seed * EPISODES_OF_A_SEED + first
    seeds: list[int] = list(range(following, following + WORLDS))
    rows: list[list[Any]] = [[] for _ in seeds]
    ended: dict[int, RecordedEpisode] = {}
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
            seen, *columns, distances = (
                np.array(column) for column in zip(*rows[world], strict=True)
            )
            seen = np.concatenate([seen, after[world : world + 1]])
            arrived, distance = bool(infos["is_success"][world]), float(distances.mean())
            ended[seeds[world]] = RecordedEpisode(
                seeds[world], seen, *columns, arrived=arrived, distance=distance
            )
            seeds[world], rows[world] = max(seeds) + 1, []
        begun = [
            new if is_over else None for new, is_over in zip(seeds, over.tolist(), strict=True)
        ]
        obs = envs.reset(seed=begun, options={"reset_mask": over})[0]
        begin(over)
        while following in ended:
            yield ended.pop(following)
            following += 1


@cache
def reference_score(scenario: str, level: str, seed: int = 0) -> float:
    """Return the mean return of the first actor of a level in ``REFERENCE_EPISODES``, which begin at rest."""
    name, arguments = environment_of(scenario, seed)
    envs: Any = gymnasium.make_vec(name, REFERENCE_EPISODES, **arguments, starts="rest")
    act, _ = actors_of(scenario, level)[0].bind(envs, seed)
    obs, _ = envs.reset(seed=seed)
    total, is_first = 0.0, np.ones(REFERENCE_EPISODES, np.bool_)
    while is_first.any():
        obs, rewards, terminated, truncated, _ = envs.step(act(obs))
        total += float(rewards[is_first].sum())
        is_first &= ~(terminated | truncated)
    return total / REFERENCE_EPISODES
