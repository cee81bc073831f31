"""One runner for policies of all kinds: laws in the kernel, planners, networks and plain callables."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from pter_gym.benchmark import PACES, find_policy, run_standard_test
from pter_gym.benchmark.naming import find_controller
from pter_gym.benchmark.simulation import record_episode, run, simulate, time_limit
from pter_gym.controllers import CONTROLLERS, BoundPolicy, Free, Impedance, PaceSchedule, bind
from pter_gym.controllers.predictive import Honest, Privileged, Settings
from pter_gym.engine.batch import Batch
from pter_gym.errors import ParameterError
from pter_gym.params import BASELINE
from pter_gym.scenarios import find_scenario
from pter_gym.tasks.path_following import PathFollowing

SETTINGS = Settings(samples=8, rounds=2, elite=2, horizon=10)
SEEDS = [3, 4, 5]


def drawn(scenario: str, pace: str) -> tuple[Sequence[Any], Sequence[Any]]:
    machines, tasks = zip(*find_scenario(scenario).randomisation(pace, contexts=3, seed=8).pairs(), strict=True)
    return machines, tasks


@pytest.mark.parametrize("name", ["impedance", "torque-feedback"])
@pytest.mark.parametrize("pace", PACES)
def test_at_a_knot_that_holds_a_schedule_is_its_controller(name: str, pace: str) -> None:
    machines, tasks = drawn("standard", pace)
    schedule = find_policy(name)
    assert isinstance(schedule, PaceSchedule)
    batch = Batch(machines, tasks)
    each = (schedule, schedule.at(PACES[pace]))
    one, other = (simulate(batch, policy, SEEDS, 400) for policy in each)
    assert one.tobytes() == other.tobytes()


def test_a_schedule_is_between_its_knots() -> None:
    schedule = find_policy("impedance")
    assert isinstance(schedule, PaceSchedule)
    slow, medium = (schedule.at(PACES[pace]).damping_tangential for pace in ("slow", "medium"))
    batch = Batch(BASELINE, PathFollowing(pace=0.185), 1)
    half = Impedance(damping_tangential=0.5 * (slow + medium))
    one, other = (simulate(batch, policy, [1], 50) for policy in (schedule, half))
    np.testing.assert_allclose(one, other, rtol=1e-3, atol=1e-3)


@pytest.mark.parametrize("hold", [-0.1, 1.0, 0.5])
def test_knots_that_run_into_each_other_are_refused(hold: float) -> None:
    with pytest.raises(ParameterError, match=r"PaceSchedule\.hold must be"):
        PaceSchedule(((0.1, Impedance()), (0.2, Impedance())), hold=hold)


@pytest.mark.parametrize("kind", [Privileged, Honest])
def test_planners_of_one_batch_do_what_each_does_alone(kind: type[Privileged | Honest]) -> None:
    machines, tasks = drawn("everything", "brisk")
    policy = kind(Free(), SETTINGS)
    batch = Batch(machines, tasks, sensors="force")
    limits = [6, 8, 7]
    together = run(batch, bind(policy, BASELINE, batch.layout), SEEDS, limits)
    assert together.steps == 8
    assert together.decision_ms > 0.0
    for world, (machine, task, seed, limit) in enumerate(zip(machines, tasks, SEEDS, limits, strict=True)):
        alone = record_episode(policy, machine, task, seed, limit)
        np.testing.assert_array_equal(together.telemetry[: limit + 1, world], alone.telemetry)


def test_planners_say_what_they_need() -> None:
    policy = Honest(Free(), SETTINGS)
    task = PathFollowing()
    with pytest.raises(ParameterError, match='sensors="force"'):
        bind(policy, BASELINE, Batch(BASELINE, task, 1).layout)
    batch = Batch(BASELINE, task, 2, sensors="force")
    bound = bind(policy, BASELINE, batch.layout)
    obs, _ = batch.reset([0, 1])
    with pytest.raises(ParameterError, match="batch must be given to reset_in"):
        bound.act(obs)


def test_a_planner_does_the_standard_test_too() -> None:
    result = run_standard_test({"honest": Honest(Free(), SETTINGS)}, time_constants=(0.1,))
    assert len(result.runs["honest"][0].telemetry) > 10


class Counting:
    """Releases all clutches, and counts its episodes and decisions."""

    def __init__(self) -> None:
        self.resets = self.decisions = 0

    def reset(self) -> None:
        self.resets += 1

    def __call__(self, obs: NDArray[np.float32]) -> NDArray[np.float64]:
        self.decisions += 1
        return np.zeros((len(obs), 4))


def test_a_plain_callable_is_told_of_new_episodes_and_moves_as_the_same_law_in_the_kernel() -> None:
    batch = Batch(BASELINE, PathFollowing(), 3)
    mine = Counting()
    plain = bind(mine, BASELINE, batch.layout)
    rows = simulate(batch, plain, SEEDS, 15)
    assert (mine.resets, mine.decisions) == (1, 15)
    assert not plain.compiled
    assert plain.fingerprint is None
    np.testing.assert_array_equal(rows, simulate(batch, bind(Free(), BASELINE, batch.layout), SEEDS, 15))


def test_the_door_takes_what_is_bound_and_refuses_what_cannot_act() -> None:
    layout = Batch(BASELINE, PathFollowing(), 1).layout
    bound = bind(Free(), BASELINE, layout)
    assert bind(bound, BASELINE, layout) is bound
    with pytest.raises(ParameterError, match="policy must have a method bind or be callable, got 'impedance'"):
        bind("impedance", BASELINE, layout)  # type: ignore[arg-type]


@pytest.mark.parametrize("name", CONTROLLERS)
def test_built_in_laws_run_compiled_and_can_be_told(name: str) -> None:
    layout = Batch(BASELINE, PathFollowing(), 1).layout
    first, second = (bind(find_controller(name), BASELINE, layout) for _ in range(2))
    assert isinstance(first, BoundPolicy)
    assert first.compiled
    assert first.fingerprint == second.fingerprint


def test_a_run_stops_when_all_have_ended_or_reached_their_limit() -> None:
    machines, tasks = drawn("standard", "brisk")
    batch = Batch(machines, tasks)
    limits = [time_limit(task) for task in tasks]
    by_steps = run(batch, bind(Counting(), BASELINE, batch.layout), SEEDS, limits)
    assert by_steps.ended.all()
    assert by_steps.steps < max(limits)
    strided = run(batch, bind(Free(), BASELINE, batch.layout), SEEDS, limits, columns=[0, 1], stride=16)
    assert strided.ended.all()
    assert strided.telemetry.shape == (strided.steps + 1, 3, 2)
    assert strided.steps % 16 == 0
    np.testing.assert_array_equal(strided.telemetry[: by_steps.steps + 1], by_steps.telemetry[..., :2])
