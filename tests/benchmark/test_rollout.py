"""One loop and one evaluator for policies of all kinds."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pter_gym._engine.batch import Batch
from pter_gym._physics.clutch import PerClutch
from pter_gym.benchmark import Assessment, Episodes, evaluate, find_policy, training_episodes
from pter_gym.benchmark.episodes import EPISODE_FIELDS
from pter_gym.benchmark.following import follow
from pter_gym.benchmark.rollout import record_episodes
from pter_gym.controllers import (
    Free,
    Impedance,
    Locked,
    PaceSchedule,
    Policy,
    Random,
    bind,
    compiled,
)
from pter_gym.errors import ActionError, LawIndexError, ParameterError
from pter_gym.params import BASELINE
from pter_gym.scenarios import PACES, find_scenario
from pter_gym.tasks.path_following import COLUMN, PathFollowing, observation_layout
from rollouts import simulate

SEEDS = [3, 4, 5]


def drawn(scenario: str, pace: str) -> tuple[Sequence[Any], Sequence[Any]]:
    machines, tasks = zip(*find_scenario(scenario).draws.pairs(3, 8, pace), strict=True)
    return machines, tasks


def test_a_schedule_is_its_controller_at_a_knot_that_holds_and_between_its_knots() -> None:
    found: Any = find_policy("impedance")
    for pace, speed in PACES.items():
        batch = Batch(*drawn("standard", pace))
        one, other = (simulate(batch, policy, SEEDS, 400) for policy in (found, found.at(speed)))
        assert one.tobytes() == other.tobytes()
    slow, medium = (found.at(PACES[pace]).damping_tangential for pace in ("slow", "medium"))
    half = Impedance(damping_tangential=0.5 * (slow + medium))
    batch = Batch(BASELINE, PathFollowing(pace=0.185), 1)
    np.testing.assert_allclose(
        *(simulate(batch, law, [1], 50) for law in (found, half)), rtol=1e-3, atol=1e-3
    )
    with pytest.raises(ParameterError, match="hold"):
        PaceSchedule(((0.1, Impedance()), (0.2, Impedance())), hold=0.5)


def episodes(scenario: str, pace: str, count: int = 3) -> Episodes:
    return training_episodes(scenario, pace, count, seed=8)


def released(observations: Any) -> Any:
    """Release all clutches."""
    return np.zeros((len(observations), 4))


def test_a_function_moves_as_the_compiled_law() -> None:
    drawn = episodes("standard", "brisk")
    plain, law = (record_episodes(policy, drawn).telemetry for policy in (released, Free()))
    np.testing.assert_array_equal(plain, law)


def test_a_rollout_stops_when_all_have_ended_or_reached_their_own_limits() -> None:
    drawn = episodes("standard", "brisk")
    telemetry = record_episodes(Locked(), drawn).telemetry
    lasted = np.isfinite(telemetry[..., COLUMN.time]).sum(axis=0) - 1
    np.testing.assert_array_equal(lasted, drawn.time_limits)
    assert len(telemetry) == max(drawn.time_limits) + 1
    short = replace(drawn, time_limits=(5, 7, 6))
    recorded = record_episodes(Locked(), short)
    assert recorded.telemetry.shape[:2] == (8, 3)
    np.testing.assert_array_equal(np.isfinite(recorded.telemetry[..., 0]).sum(axis=0), [6, 8, 7])
    np.testing.assert_array_equal((recorded.obs != 0.0).any(axis=-1).sum(axis=0), [6, 8, 7])


def test_nothing_is_scored_beyond_an_episodes_own_limit() -> None:
    """An episode has the scores that it has alone, whatever the limits of those beside it."""
    long, short = episodes("everything", "slow", 2), episodes("everything", "brisk", 6)
    assert max(long.time_limits) > max(short.time_limits)
    both = replace(
        short, **{name: getattr(short, name) + getattr(long, name) for name in EPISODE_FIELDS}
    )
    for ranking in (False, True):
        alone = evaluate(Locked(), short, ranking=ranking)
        beside = evaluate(Locked(), both, ranking=ranking)
        for name, values in alone.items():
            np.testing.assert_array_equal(beside[name][: len(short)], values)
    assert np.all(alone["mean_pace_error"] >= 1.0)


def test_validation_keeps_each_episodes_own_limit() -> None:
    """With the longest limit of the batch, torque feedback arrives in more brisk episodes."""
    drawn = training_episodes("everything", "brisk", 64, seed=0)
    assert len(set(drawn.time_limits)) > 1
    law = find_policy("torque-feedback", "everything")
    own = evaluate(law, drawn, ranking=True)["completed"].mean()
    longest = replace(drawn, time_limits=(max(drawn.time_limits),) * len(drawn))
    assert own < evaluate(law, longest, ranking=True)["completed"].mean()


def test_scores_that_decide_ranks_are_the_same_on_their_own() -> None:
    drawn = episodes("everything", "brisk", 12)
    every, ranking = (evaluate(Impedance(), drawn, ranking=only) for only in (False, True))
    assert set(ranking) == set(Assessment._fields)
    for name, values in ranking.items():
        np.testing.assert_array_equal(values, every[name])


@pytest.mark.parametrize("name", ["residual", "single-dof-tuned", "random"])
def test_scores_depend_on_neither_threads_nor_chunks(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    policy: Any = find_policy(name)
    if name == "residual":
        policy = replace(policy, interface=replace(policy.interface, frame_skip=2))
    drawn = episodes("standard", "brisk", 10)
    monkeypatch.setattr("pter_gym.benchmark.episodes.CHUNK", 3)
    alone, together = (evaluate(policy, drawn, threads, ranking=True) for threads in (1, 2))
    monkeypatch.undo()
    whole = evaluate(policy, replace(drawn), ranking=True)
    np.testing.assert_array_equal(together["path_error_m"], alone["path_error_m"])
    # numpy adds up a single column in another order
    np.testing.assert_allclose(whole["path_error_m"], alone["path_error_m"], rtol=1e-14)


@pytest.mark.parametrize("name", ["residual", "single-dof-tuned"])
def test_a_law_in_the_worlds_that_still_run_has_the_bits_of_one_in_all(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn = episodes("everything", "brisk", 40)
    policy = find_policy(name, "everything")
    widths: list[int] = []

    def noting(law: Any, batch: Batch, *arguments: Any) -> Any:
        widths.append(batch.num_worlds)
        return follow(law, batch, *arguments)

    monkeypatch.setattr("pter_gym.benchmark.rollout.follow", noting)
    part = record_episodes(policy, drawn)
    assert min(widths) <= 5 < max(widths) == 40
    monkeypatch.setattr("pter_gym.benchmark.rollout.FULL", 0.0)
    whole = record_episodes(policy, drawn)
    assert [each.tobytes() for each in part] == [each.tobytes() for each in whole]


@pytest.mark.parametrize(
    ("name", "machine"),
    [
        ("residual", None),
        ("ppo-standard", None),
        ("random", "two-brakes"),
        ("single-dof-scaled", "brakes-and-coupling"),
    ],
)
def test_a_law_that_acts_in_one_call_has_the_bits_of_one_asked_at_each_step(
    name: str, machine: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    policy: Any = find_policy(name)
    if name == "residual":  # holds its voltages also where worlds are left out
        policy = replace(policy, interface=replace(policy.interface, frame_skip=3))
    drawn = training_episodes("everything", "brisk", 20, 8, machine)
    together = record_episodes(policy, drawn, sensors="force")
    monkeypatch.setattr("pter_gym.benchmark.rollout.COMPILES", False)
    asked = record_episodes(policy, drawn, sensors="force")
    assert [each.tobytes() for each in together] == [each.tobytes() for each in asked]


@compiled
def beyond_arrays(obs: Any, scales: Any, gains: Any, memory: Any) -> PerClutch:
    return PerClutch(0.0, 0.0, 0.0, gains[int(scales.shape[0])])


@compiled
def not_finite(obs: Any, scales: Any, gains: Any, memory: Any) -> PerClutch:
    return PerClutch(0.0, 0.0, 0.0, math.nan)


@pytest.mark.parametrize(
    ("law", "error", "message"),
    [
        (beyond_arrays, LawIndexError, "law beyond_arrays: index is out of bounds"),
        (not_finite, ActionError, "action of world 0 must be finite"),
    ],
)
def test_what_is_wrong_in_a_law_is_told(law: Any, error: type[Exception], message: str) -> None:
    layout = observation_layout(BASELINE, "torque")
    policy = Policy.from_law(law, [1.0], BASELINE, layout)
    with pytest.raises(error, match=message):
        evaluate(policy, episodes("standard", "brisk", 3))


def test_random_voltages_differ_in_all_episodes_and_repeat() -> None:
    drawn = episodes("standard", "brisk", 66)

    def first_volts(policy: Any) -> Any:
        short = replace(drawn, time_limits=(3,) * 66)
        return record_episodes(policy, short).telemetry[1, :, [*COLUMN.volts]].T

    volts = first_volts(Random(seed=1))
    assert len({row.tobytes() for row in volts}) == 66
    np.testing.assert_array_equal(volts, first_volts(Random(seed=1)))
    assert not np.isin(volts, first_volts(Random(seed=2))).any()
    acting = bind(Random(), BASELINE, observation_layout(BASELINE, "torque"))
    obs, memory = np.zeros((1, 24), np.float32), acting.start(1)
    assert acting.act(obs, memory).tolist() != acting.act(obs, memory).tolist()


def test_a_policy_with_a_memory_has_it_from_whoever_loops() -> None:
    def count(observations: Any, memory: Any) -> Any:
        memory += 1.0
        return np.repeat(memory, 4, axis=1)

    layout = observation_layout(BASELINE, "torque")
    policy = Policy.from_function(count, layout, start=lambda worlds: np.zeros((worlds, 1)))
    drawn = replace(episodes("standard", "brisk"), time_limits=(4, 4, 4))
    for _ in range(2):
        volts = record_episodes(policy, drawn).telemetry[1:, :, COLUMN.volts.x1]
        np.testing.assert_array_equal(volts, [[1.0] * 3, [2.0] * 3, [3.0] * 3, [4.0] * 3])


def test_a_function_with_a_state_of_its_own_is_refused() -> None:
    class Counting:
        def reset(self) -> None: ...

        def __call__(self, observations: Any) -> Any: ...

    with pytest.raises(ParameterError, match="must not keep a memory"):
        record_episodes(Counting(), episodes("standard", "brisk"))
