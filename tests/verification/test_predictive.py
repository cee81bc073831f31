"""The predictive controller: it beats what guides it, knows the future, and leaves the world alone while it plans."""

import numpy as np
import pytest

from pter_gym.benchmark.metrics import score
from pter_gym.benchmark.simulation import simulate
from pter_gym.controllers import Free, SingleDof
from pter_gym.envs.batch import Batch
from pter_gym.errors import ParameterError
from pter_gym.params import BASELINE
from pter_gym.predictive import Planner, Predictive, run_predictive
from pter_gym.scenarios import find_scenario
from pter_gym.tasks.path_following import T_ARC_LENGTH, T_TIME, T_VOLTS

GUIDE = SingleDof(damping_tangential=250.0, pace_fraction=0.75, approach=20.0, strength=150.0, slow=0.5, feedback=2.0)
FEW = Predictive(samples=64)


@pytest.mark.slow
def test_it_beats_its_guide_and_keeps_the_pace() -> None:
    for machine, task in find_scenario("standard").randomisation("brisk", contexts=2, seed=5).pairs():
        telemetry = run_predictive(FEW, machine, task, 3, GUIDE, 600)
        found = score(telemetry, task)
        batch = Batch(machine, task, 1)
        guided = simulate(batch, GUIDE.bind(BASELINE, batch.layout), [3], 600)[:, 0]
        expected = score(guided[np.isfinite(guided[:, T_TIME])], task)
        assert found.completed
        assert found.path_error_m < 0.9 * expected.path_error_m
        assert max(found.mean_pace_error, found.segment_pace_error) < 0.15
        np.testing.assert_array_equal(run_predictive(FEW, machine, task, 3, GUIDE, 20), telemetry[:21])


@pytest.mark.slow
def test_the_best_plan_costs_no_more_than_the_guides_and_comes_true() -> None:
    ((machine, task),) = find_scenario("standard").randomisation("brisk", contexts=1, seed=6).pairs()
    world = Batch(machine, task, 1)
    obs, row = world.reset([1])
    planner = Planner(FEW, machine, task, GUIDE)
    before = world.get_state()
    begin = float(row[0, T_ARC_LENGTH])
    first = planner.decide(world, obs, begin)
    after = world.get_state()
    assert all(before[name].tobytes() == after[name].tobytes() for name in before)
    guided = Planner(FEW, machine, task, GUIDE).guided(before, obs)
    plans = np.stack([planner.latest, guided])
    costs = planner.costs(before, obs, np.repeat(plans, FEW.samples // 2, axis=0), begin)
    assert costs[0] <= costs[-1]
    assert costs[0] == costs[FEW.samples // 2 - 1]
    np.testing.assert_array_equal(first, planner.latest[0])
    rows = planner.foresee(before, obs, np.repeat(plans, FEW.samples // 2, axis=0))
    for step in range(FEW.horizon):
        place = step / FEW.knot_steps
        volts = [np.interp(place, np.arange(FEW.knots), planner.latest[:, clutch]) for clutch in range(4)]
        real = world.step(np.array(volts)[None]).telemetry[0, 0]
        np.testing.assert_allclose(rows[step, 0], real, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(real[T_VOLTS : T_VOLTS + 4], volts, rtol=1e-6)


@pytest.mark.parametrize(
    ("field", "keywords"),
    [
        ("samples", {"samples": 1}),
        ("samples", {"samples": 64.5}),
        ("horizon", {"horizon": 12}),
        ("knot_steps", {"knot_steps": 0}),
        ("rounds", {"rounds": 0}),
        ("spread", {"spread": 0.0}),
        ("pace_weight", {"pace_weight": -1.0}),
        ("seed", {"seed": -1}),
    ],
)
def test_bad_settings_are_named(field: str, keywords: dict[str, float]) -> None:
    with pytest.raises(ParameterError, match=rf"Predictive\.{field} must be"):
        Predictive(**keywords)  # type: ignore[arg-type]


def test_any_controller_may_guide() -> None:
    ((machine, task),) = find_scenario("standard").randomisation("brisk", contexts=1, seed=6).pairs()
    assert len(run_predictive(Predictive(samples=8, rounds=1), machine, task, 0, Free(), 3)) == 4
