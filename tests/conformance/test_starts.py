"""How episodes begin: at rest in evaluation, anywhere in training where the user asks for it."""

from dataclasses import replace
from typing import Any

import gymnasium
import numpy as np
import pytest

from pter_gym._engine.batch import Batch
from pter_gym._engine.world import ROW
from pter_gym.benchmark.episodes import load_episodes, scenarios
from pter_gym.envs.scenario import TRUNCATION_ERROR, training_draws
from pter_gym.errors import ParameterError, ResetNeededError
from pter_gym.hands import HumanArm
from pter_gym.params import BASELINE
from pter_gym.paths import Line
from pter_gym.scenarios import SCENARIOS
from pter_gym.tasks.path_following import (
    AT_REST,
    COLUMN,
    STARTS,
    PathFollowing,
    RewardWeights,
    Starts,
    observation_layout,
)

MOVING, GRIPPED = Starts(moving=1.0), Starts(gripped=1.0)
COUNT = 512
PROGRESS = observation_layout(BASELINE, "torque").names.index("progress")


def first_rows(scenario: str, starts: Starts, seed: int = 0) -> tuple[np.ndarray, list[PathFollowing]]:
    """Return the telemetry of resets, and the tasks that were begun."""
    pairs = SCENARIOS[scenario].randomisation(contexts=64, starts=starts).pairs()
    machines, tasks = map(list, zip(*pairs, strict=True))
    batch = Batch(machines, tasks, COUNT, draws=True)
    rows = batch.reset(range(seed, seed + COUNT))[1]
    return rows, [tasks[k] for k in rows[:, COLUMN.context].astype(int)]


@pytest.mark.parametrize("scenario", SCENARIOS)
def test_moving_starts_are_all_along_the_path_and_within_the_workspace(scenario: str) -> None:
    rows, tasks = first_rows(scenario, MOVING)
    share = rows[:, COLUMN.arc_length] / [task.path.length for task in tasks]
    assert share.min() < 0.02
    assert 0.9 < share.max() < 0.93
    np.testing.assert_allclose(rows[:, COLUMN.reached], rows[:, COLUMN.arc_length], rtol=1e-12, atol=1e-12)
    errors = np.abs(rows[:, COLUMN.normal_error])
    assert (errors <= MOVING.offset + 1e-12).all()
    assert errors.max() > 0.9 * MOVING.offset
    speed = np.hypot(*rows[:, [*COLUMN.tip_velocity]].T) / [task.pace for task in tasks]
    assert speed.max() < 2.07, "twice the pace along the path and half of it across"
    assert 0.9 < speed.mean() < 1.2
    assert np.isfinite(rows).all()


def test_gripped_starts_are_at_rest_with_settled_clutches() -> None:
    rows, _ = first_rows("standard", GRIPPED)
    at_rest, _ = first_rows("standard", AT_REST)
    np.testing.assert_array_equal(rows[:, [*COLUMN.tip]], at_rest[:, [*COLUMN.tip]])
    assert not rows[:, [*COLUMN.tip_velocity]].any()
    volts = rows[:, [*COLUMN.volts]]
    released = (volts == 0.0).mean()
    assert abs(released - 0.2) < 4.0 * np.sqrt(0.2 * 0.8 / volts.size)
    engaged = volts[volts > 0.0]
    assert abs(engaged.mean() - 12.0) < 4.0 * 24.0 / np.sqrt(12.0 * engaged.size)
    assert not at_rest[:, [*COLUMN.volts]].any()


def test_settled_clutches_hold_what_they_would_after_a_long_time() -> None:
    task = PathFollowing(starts=GRIPPED)
    batch = Batch(BASELINE, task, 16)
    volts = batch.reset(range(16))[1][:, [*COLUMN.volts]]
    assert volts.any(axis=1).all()
    gripped = batch.truth()
    still = Batch(replace(BASELINE, clutch=replace(BASELINE.clutch, time_constant=1e-6)), PathFollowing(), 16)
    still.reset(range(16))
    still.step(volts)
    first, last = ROW.torques.breakaway.x1, ROW.torques.dynamic.x4 + 1
    np.testing.assert_allclose(gripped[:, first:last], still.truth()[:, first:last], rtol=1e-12)


def test_a_moving_start_is_within_a_narrow_workspace_with_the_intent_at_the_tip() -> None:
    path = Line(x=-0.1, y=0.5, direction=0.0, length=0.2)
    task = PathFollowing(path=path, hand=HumanArm(), error_max=0.03, starts=MOVING)
    batch = Batch(BASELINE, task, 16)
    row = batch.reset(range(16))[1]
    assert 0.0 < np.abs(row[:, COLUMN.normal_error]).max() <= 0.03 < MOVING.offset
    ahead = batch.truth()[:, ROW.intent] - row[:, COLUMN.arc_length]
    assert (ahead >= -1e-12).all()
    assert (ahead <= task.pace * task.control_period).all()
    assert row[:, COLUMN.arc_length].max() > 0.1


def test_shares_are_kept_and_each_seed_begins_the_same_way() -> None:
    starts = STARTS["path"]
    rows, _ = first_rows("standard", starts)
    again, _ = first_rows("standard", starts)
    np.testing.assert_array_equal(rows, again)
    moving = (rows[:, COLUMN.arc_length] > 0.0).mean()
    gripped = ((rows[:, COLUMN.arc_length] <= 1e-9) & rows[:, [*COLUMN.volts]].any(axis=1)).mean()
    for found, share in ((moving, starts.moving), (gripped, starts.gripped)):
        assert abs(found - share) < 4.0 * np.sqrt(share * (1.0 - share) / COUNT)


def test_no_evaluation_episode_explores() -> None:
    for scenario in scenarios():
        assert {task.starts for task in load_episodes(scenario, "slow").tasks} == {AT_REST}


@pytest.mark.parametrize(
    ("keywords", "told"),
    {
        "starts": ({"starts": "anywhere"}, "starts must be among"),
        "pace": ({"pace": "fast"}, "pace must be among"),
        "error_max": ({"error_max": -1.0}, r"error_max must be .* > 0"),
        "reward": ({"reward": 3}, "reward must be of type RewardWeights"),
        "context_seed": ({"context_seed": -1}, "^context_seed must be a whole number ≥ 0"),
        "truncation_error": ({"truncation_error": 0.0}, r"truncation_error must be .* > 0"),
        "task": ({"task": PathFollowing()}, r"^task must not be given: PTER/Standard-v0 draws its own"),
        "randomisation": ({"randomisation": 1}, "^randomisation must not be given"),
    }.values(),
)
@pytest.mark.parametrize("make", [gymnasium.make, gymnasium.make_vec])
def test_a_wrong_argument_is_named_as_the_user_wrote_it(make: Any, keywords: dict[str, Any], told: str) -> None:
    with pytest.raises(ParameterError, match=told):
        make("PTER/Standard-v0", **keywords)


def test_a_task_that_is_no_task_is_named() -> None:
    for make in (gymnasium.make, gymnasium.make_vec):
        with pytest.raises(ParameterError, match=r"^task must be a PathFollowing.*got 'circle'"):
            make("PTER/PathFollowing-v0", task="circle")


@pytest.mark.parametrize("scenario", scenarios())
def test_training_is_truncated_near_the_path_and_no_evaluation_is(scenario: str) -> None:
    evaluated = load_episodes(scenario, "slow").tasks
    assert all(task.truncation_error > task.error_max for task in evaluated)
    for _, task in training_draws(scenario, contexts=4).pairs():
        assert task.error_max in {each.error_max for each in evaluated}
        assert task.truncation_error == TRUNCATION_ERROR <= task.error_max


NEAR = PathFollowing(truncation_error=0.1)
"""A task whose disturbance takes a free arm away from the path."""


def test_an_episode_that_strays_is_truncated_and_is_no_failure() -> None:
    free = np.zeros(4)
    for reward in (RewardWeights(), RewardWeights(failure=0.0)):
        near: Any = gymnasium.make("PTER/PathFollowing-v0", task=replace(NEAR, reward=reward)).unwrapped
        wide: Any = gymnasium.make("PTER/PathFollowing-v0", task=PathFollowing(reward=reward)).unwrapped
        near.reset(seed=0), wide.reset(seed=0)
        truncated = terminated = False
        while not (truncated or terminated):
            observation, pay, terminated, truncated, info = near.step(free)
            same, as_much, ends, _, told = wide.step(free)
            assert (observation == same).all()
            assert pay == as_much
            assert abs(told["telemetry"][COLUMN.normal_error]) <= 0.1 or truncated
        assert (terminated, truncated, ends, info["is_success"]) == (False, True, False, False)
        with pytest.raises(ResetNeededError):
            near.step(free)


@pytest.mark.parametrize(("error_max", "terminated"), [(0.099, True), (0.1, False), (0.101, False)])
def test_what_is_nearer_ends_an_episode_and_truncation_if_they_are_equal(error_max: float, terminated: bool) -> None:
    env: Any = gymnasium.make("PTER/PathFollowing-v0", task=replace(NEAR, error_max=error_max)).unwrapped
    env.reset(seed=0)
    ends = (False, False)
    while not any(ends):
        _, _, *ends, _ = env.step(np.zeros(4))
    assert tuple(ends) == (terminated, not terminated)


@pytest.mark.parametrize("scenario", SCENARIOS)
def test_a_training_episode_that_strays_is_never_terminated_on_the_way(scenario: str) -> None:
    worlds: Any = gymnasium.make_vec(SCENARIOS[scenario].id, 64, starts="rest")
    worlds.reset(seed=0)
    truncations = 0
    for _ in range(200):
        observations, _, terminated, truncated, infos = worlds.step(np.zeros((64, 4)))
        strayed = np.abs(infos["telemetry"][:, COLUMN.normal_error]) > TRUNCATION_ERROR
        assert not (terminated & strayed & (observations[:, PROGRESS] < 0.5)).any()
        truncations += (truncated & strayed).sum()
    assert truncations > (0 if scenario == "tremor" else 64), (
        "where every hand is an arm, it holds the tip near the path"
    )


def test_a_scenario_takes_what_its_episodes_share_and_nothing_that_it_draws() -> None:
    env: Any = gymnasium.make("PTER/Standard-v0", error_max=0.08, starts=MOVING, pace="slow").unwrapped
    env.reset(seed=0)
    assert (env.task.error_max, env.task.starts, env.task.pace) == (0.08, MOVING, 0.12)
    with pytest.raises(ParameterError, match="path must be one of what all episodes of paths share"):
        SCENARIOS["paths"].randomisation(path=None)
