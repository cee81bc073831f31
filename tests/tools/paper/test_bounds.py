"""Torque, lag and passivity changed one by one, and what the laws do with the clutches."""

from dataclasses import replace

import numpy as np
import pytest
from studies import bounds
from studies.bounds import CLUTCHES, SEARCHED, SEED, Actuators, adapted, drawn_task, try_out
from studies.clutch_use import clutch_use, episodes, stuck_clutches

from pter_gym._engine.batch import Batch
from pter_gym._physics.friction import ClutchMode
from pter_gym.benchmark._naming import find_policy
from pter_gym.benchmark.metrics import score_episodes
from pter_gym.benchmark.simulation import simulate, time_limit
from pter_gym.benchmark.statistics import bootstrap_interval
from pter_gym.benchmark.tuned import find_tuned
from pter_gym.controllers import Impedance, SingleDof
from pter_gym.errors import ParameterError
from pter_gym.params import BASELINE
from pter_gym.scenarios import PACES

DRAWS = 6
LAW = find_tuned("impedance-tuned", "standard").knots[2][1]


def test_the_true_clutches_are_the_benchmarks_machine():
    assert CLUTCHES.machine == BASELINE
    task = drawn_task("brisk")
    batch = Batch(BASELINE, task, DRAWS)
    seeds = range(SEED, SEED + DRAWS)
    policy = find_policy("impedance-tuned").bind(BASELINE, batch.layout)
    scores = score_episodes(simulate(batch, policy, seeds, time_limit(task)), [task] * DRAWS)
    found = try_out(LAW, CLUTCHES, "brisk", draws=DRAWS)
    assert found.path_error == bootstrap_interval(scores["path_error_m"])
    assert found.mean_pace_error == scores["mean_pace_error"].mean()
    assert found.pushing == 0.0


def test_draws_differ_by_their_seeds_alone():
    first, again, others = (try_out(LAW, CLUTCHES, "brisk", draws=DRAWS, seed=s).path_error for s in (1, 1, 50))
    assert first == again != others


def test_actuators_change_one_thing_each():
    clutch = BASELINE.clutch
    stronger = Actuators(torque=2.0).machine
    assert stronger.clutch.dynamic.torque(10.0) == 2.0 * clutch.dynamic.torque(10.0)
    assert stronger.clutch.breakaway.torque(24.0) == pytest.approx(2.0 * clutch.breakaway.torque(24.0))
    assert stronger.clutch.time_constant == clutch.time_constant
    quick = Actuators(time_constant=0.0).machine
    assert np.exp(-quick.substep / quick.clutch.time_constant) == 0.0
    assert replace(quick, clutch=replace(quick.clutch, time_constant=clutch.time_constant)) == BASELINE
    for field, value in (("torque", 0.0), ("time_constant", -0.1), ("pushes", 1)):
        with pytest.raises(ParameterError, match=field):
            Actuators(**{field: value})


def test_the_law_knows_the_torque_it_has():
    """So twice the torque needs a smaller voltage, and saturates less."""
    weak, strong = (try_out(LAW, Actuators(torque=x), "brisk", draws=DRAWS) for x in (0.5, 2.0))
    assert weak.saturated > 2.0 * strong.saturated


@pytest.mark.slow
def test_motors_push_and_need_a_law_that_may():
    found = try_out(LAW, Actuators(pushes=True), "brisk", draws=DRAWS)
    assert 0.0 < found.pushing <= 1.0
    assert found.path_error.value < try_out(LAW, CLUTCHES, "brisk", draws=DRAWS).path_error.value
    with pytest.raises(ParameterError, match="Impedance where actuators push"):
        try_out(SingleDof(), Actuators(pushes=True), "brisk", draws=DRAWS)


def test_shortfall_counts_what_the_leaderboard_asks():
    good = try_out(LAW, CLUTCHES, "brisk", draws=DRAWS)
    assert good.shortfall == 0.0
    assert replace(good, completed=0.5, mean_pace_error=0.25).shortfall == pytest.approx(0.49 + 0.10)


def test_adapted_gains_cost_no_more_on_their_draws_and_leave_the_rest(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(bounds, "POPULATION", 6)
    monkeypatch.setattr(bounds, "GENERATIONS", 4)
    law, actuators = replace(LAW, stiffness=0.25 * LAW.stiffness), Actuators(torque=0.5)
    found = adapted(law, actuators, "brisk", draws=DRAWS)
    before, after = (try_out(x, actuators, "brisk", draws=DRAWS, seed=SEED - DRAWS) for x in (law, found))
    assert found != law
    assert after.path_error.value + after.shortfall < before.path_error.value + before.shortfall
    same = {name: getattr(law, name) for name in SEARCHED[Impedance]}
    assert replace(found, **same) == law
    assert adapted(law, actuators, "brisk", draws=DRAWS) == found


def test_clutch_use_is_what_the_scores_say():
    """Means over all instants; of the scores, means over episodes weighted by their lengths."""
    rows = episodes("impedance", "brisk", draws=DRAWS)
    scores = score_episodes(rows, [drawn_task("brisk")] * DRAWS)
    use = clutch_use("impedance", "brisk", draws=DRAWS)
    weights = np.isfinite(rows[1:, :, 0]).sum(axis=0)
    assert use.any_saturated == pytest.approx(np.average(scores["saturated"], weights=weights))
    assert use.at_rest == pytest.approx(np.average(scores["stuck"], weights=weights))
    assert use.path_error.value == bootstrap_interval(scores["path_error_m"]).value
    assert use.stuck.sum() == pytest.approx(use.one_stuck + 4.0 * use.at_rest)
    assert use.saturated.max() <= use.any_saturated <= use.saturated.sum()


def test_stuck_clutches_by_mode():
    modes = np.array([ClutchMode.TWO_DOF, ClutchMode.STUCK_3, ClutchMode.ZERO_DOF, np.nan], np.float64)
    assert stuck_clutches(modes).tolist() == [[False] * 4, [False, False, True, False], [True] * 4, [False] * 4]


@pytest.mark.parametrize("pace", PACES)
def test_drawn_task_is_that_of_the_scenario(pace: str):
    assert drawn_task(pace).pace == PACES[pace]
    assert drawn_task(pace).hand.random_phases
