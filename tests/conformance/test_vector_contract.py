"""What Gymnasium asks of a vector environment beyond its values: memory, seeds, partial resets, masks."""

from collections.abc import Iterator
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

from pter_gym.envs._vector import PathFollowingVectorEnv
from pter_gym.hands import MultiSineHand
from pter_gym.paths import Line
from pter_gym.tasks.path_following import PathFollowing

NEXT_STEP, SAME_STEP, DISABLED = AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP, AutoresetMode.DISABLED
WORLDS, LIMIT, STEPS = 4, 25, 70
TASK = PathFollowing(
    path=Line(x=-0.1, y=0.54, length=0.2),
    start_offset=0.02,
    hand=MultiSineHand(push=50.0, amplitudes=(12.8,) * 5, random_phases=True),
)
"""A short path: some episodes end at its end and some at the limit, at different times."""

FIRST = np.arange(WORLDS) == 0
each_mode = pytest.mark.parametrize("mode", AutoresetMode, ids=lambda mode: mode.name)


def make(mode: AutoresetMode) -> Any:
    return PathFollowingVectorEnv(WORLDS, task=TASK, autoreset_mode=mode, max_episode_steps=LIMIT)


def actions(seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).uniform(0.0, 9.0, (STEPS, WORLDS, 4)).astype(np.float32)


def play(env: Any, rows: Any, seed: Any = 0) -> Iterator[tuple[Any, ...]]:
    """Yield what a seeded reset and steps return, with the resets that DISABLED needs."""
    yield env.reset(seed=seed)
    for row in rows:
        returned = env.step(row)
        yield returned
        ended = returned[2] | returned[3]
        if env.metadata["autoreset_mode"] == DISABLED and ended.any():
            yield env.reset(options={"reset_mask": ended})


def leaves(value: Any) -> Iterator[np.ndarray]:
    """Yield the arrays within what was returned."""
    if isinstance(value, (tuple, dict)) or getattr(value, "dtype", None) == np.dtype(object):
        for part in value.values() if isinstance(value, dict) else value:
            yield from leaves(part)
    elif isinstance(value, np.ndarray):
        yield value


def bits(value: Any) -> list[bytes]:
    return [leaf.tobytes() for leaf in leaves(value)]


def world(returned: tuple[Any, ...], number: int) -> list[Any]:
    """What one world returned, infos left out."""
    return [part[number].tobytes() for part in returned[:-1]]


@each_mode
def test_returns_share_no_memory_and_keep_their_values(mode: AutoresetMode) -> None:
    kept = [(returned, bits(returned)) for returned in play(make(mode), actions())]
    for (one, _), (two, _) in pairwise(kept):
        assert not any(np.shares_memory(a, b) for a in leaves(one) for b in leaves(two))
    assert all(bits(returned) == before for returned, before in kept)


@each_mode
def test_what_is_written_to_actions_and_returns_goes_nowhere(mode: AutoresetMode) -> None:
    def spoiled() -> Iterator[np.ndarray]:
        for row in actions():
            given = row.copy()
            yield given
            assert given.tobytes() == row.tobytes(), "step changed its actions"
            given[:] = 1.0

    clean = [bits(returned) for returned in play(make(mode), actions())]
    for returned, expected in zip(play(make(mode), spoiled()), clean, strict=True):
        assert bits(returned) == expected
        for leaf in leaves(returned[:2] if len(returned) == 2 else (returned[0], returned[1], returned[4])):
            leaf.fill(1)


@pytest.mark.parametrize("mode", [NEXT_STEP, SAME_STEP], ids=lambda mode: mode.name)
def test_a_world_depends_on_its_own_seed_and_actions_alone(mode: AutoresetMode) -> None:
    mixed = np.where(FIRST[:, None], actions(), actions(1))
    one, other = play(make(mode), actions(), [5, 6, 7, 8]), play(make(mode), mixed, [5, 90, 91, 92])
    assert [world(each, 0) for each in one] == [world(each, 0) for each in other]
    seeded, listed = play(make(mode), actions(), 5), play(make(mode), actions(), [5, 6, 7, 8])
    assert [bits(each) for each in seeded] == [bits(each) for each in listed]


def test_adjacent_seeds_share_no_stream() -> None:
    env = make(NEXT_STEP)
    starts = [env.reset(seed=0 if k == 0 else None)[0].copy() for k in range(12)]
    assert len({row.tobytes() for start in starts for row in start}) == 12 * WORLDS


@each_mode
def test_a_partial_reset_restarts_the_chosen_worlds_alone(mode: AutoresetMode) -> None:
    env, plain = make(mode), make(mode)
    rows = actions()[: LIMIT - 8]
    for each in (env, plain):
        each.reset(seed=0)
        shown = each.step(rows[0])[0]
    options = {"reset_mask": FIRST.copy()}
    obs, infos = env.reset(options=options)
    assert options.keys() == {"reset_mask"}
    assert (options["reset_mask"] == FIRST).all()
    np.testing.assert_array_equal(obs[1:], shown[1:])
    np.testing.assert_array_equal(infos["_telemetry"], FIRST)
    assert infos["telemetry"][0, 0] == 0.0
    for row in rows[1:]:
        one, two = env.step(row), plain.step(row)
        assert [world(one, k) for k in range(1, WORLDS)] == [world(two, k) for k in range(1, WORLDS)]
        if (one[2] | one[3] | two[2] | two[3]).any() and mode == DISABLED:
            break


def test_seeds_reach_the_chosen_worlds_alone() -> None:
    env, plain, fresh = (make(NEXT_STEP) for _ in range(3))
    start = fresh.reset(seed=[1000, 1, 2, 3])[0]
    for each in (env, plain):
        each.reset(seed=0)
    assert env.reset(seed=[1000, 1001, 1002, 1003], options={"reset_mask": FIRST})[0][0].tobytes() == start[0].tobytes()
    np.testing.assert_array_equal(env.reset()[0][1:], plain.reset()[0][1:])
