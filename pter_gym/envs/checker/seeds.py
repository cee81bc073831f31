"""Checks of seeds: each world has its own, and nothing else decides its episodes."""

from contextlib import closing
from typing import Any

from gymnasium.vector.utils import iterate

from pter_gym.envs.checker.bits import bits_of
from pter_gym.envs.checker.playing import (
    Check,
    Missing,
    Subject,
    batched,
    error_of,
    lives_of,
    merged,
    require,
    reset,
)

STREAM_EPISODES = 12
"""Episodes whose starts are compared between adjacent seeds."""

STREAM_OVERLAP = 8
"""Starts in a row that two seeds must have in common to be taken for one stream."""


def need_seed_lists(subject: Subject) -> None:
    """Raise Missing if ``reset`` refuses a seed for each world."""
    with closing(subject.build()) as env:
        error = error_of(lambda: reset(env, subject.seeds()))
    if error is not None:
        raise Missing(f"reset refuses a list of seeds ({type(error).__name__})")


def _seeds_list(subject: Subject) -> str:
    need_seed_lists(subject)
    actions = subject.actions()
    one, two = (lives_of(subject.build, actions, seed) for seed in (subject.seed, subject.seeds()))
    require(one == two, "seed=s is not seed=[s, s + 1, …]")
    return "seed=s is seed=[s, s + 1, …]"


def _seeds_order(subject: Subject) -> str:
    need_seed_lists(subject)
    actions, seeds = subject.actions(), subject.seeds()
    turned: list[Any] = []
    with closing(subject.build()) as env:
        for action in actions:
            rows = list(iterate(env.action_space, action))
            turned.append(batched(env, [*rows[1:], rows[0]]))
    one = lives_of(subject.build, actions, seeds)
    two = lives_of(subject.build, turned, [*seeds[1:], seeds[0]])
    require([*one[1:], one[0]] == two, "the same seeds and actions in another order give other episodes")
    return "the order of the worlds does not matter"


def _seeds_company(subject: Subject) -> str:
    need_seed_lists(subject)
    actions, seeds = subject.actions(), subject.seeds()
    with closing(subject.build()) as env:
        pairs = zip(actions, reversed(actions), strict=True)
        mixed = [merged(env, subject.first_alone(), one, other) for one, other in pairs]
    one = lives_of(subject.build, actions, seeds)
    two = lives_of(subject.build, mixed, [seeds[0], *(seed + 1000 for seed in seeds[1:])])
    require(one[0] == two[0], "world 0 lives other episodes when the others have other seeds and actions")
    return "a world's episodes depend on its own seed and actions alone"


def _seeds_streams(subject: Subject) -> str:
    with closing(subject.build()) as env:
        resets = [reset(env, subject.seed if k == 0 else None).rows() for k in range(STREAM_EPISODES)]
    starts = [[bits_of(rows[world]) for rows in resets] for world in range(subject.worlds)]
    if len({start for life in starts for start in life}) == 1:
        raise Missing("all episodes start alike: let make draw their starts")
    for world, life in enumerate(starts):
        for other in range(world):
            require(not _overlap(life, starts[other]), f"the seeds of worlds {other} and {world} share a stream")
    return f"{subject.worlds} adjacent seeds have {subject.worlds} streams"


def _overlap(one: list[Any], two: list[Any]) -> bool:
    """Tell whether one list runs along the other, some episodes ahead or behind."""
    lags = range(len(one) - STREAM_OVERLAP + 1)
    return any(one[lag:] == two[: len(two) - lag] or two[lag:] == one[: len(one) - lag] for lag in lags)


SEEDS: tuple[Check, ...] = (_seeds_list, _seeds_order, _seeds_company, _seeds_streams)
