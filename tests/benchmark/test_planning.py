"""Policies that plan, in the benchmark: marked, resumed, and a privileged one without a rank."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pter_gym._compiled.layout import Layout
from pter_gym.benchmark import PerSeed, find_policy, leaderboards, run_scenario
from pter_gym.benchmark import _evaluation as evaluation
from pter_gym.benchmark._naming import GUIDE_TABLE
from pter_gym.benchmark.leaderboard import table
from pter_gym.benchmark.tuned import find_tuned
from pter_gym.controllers import BoundPolicy, Free
from pter_gym.controllers._base import Plans
from pter_gym.controllers._predictive import Honest, Privileged, Settings
from pter_gym.controllers._predictive.policies import PlanningPolicy
from pter_gym.errors import ParameterError
from pter_gym.params import BASELINE, Machine

SETTINGS = Settings(samples=8, rounds=1, elite=1, horizon=10)
POLICIES = {"bound": Privileged(Free(), SETTINGS), "honest": Honest(Free(), SETTINGS), "free": Free()}


def test_planners_are_marked_not_repeated_and_the_privileged_one_has_no_rank(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    runs = run_scenario("standard", POLICIES, ["brisk"], episodes=1, results=tmp_path)
    bound, honest, free = runs
    assert free.planning is None
    for run, privileged in ((bound, True), (honest, False)):
        assert run.planning is not None
        assert (run.planning.privileged, run.planning.horizon_s, run.planning.rollouts) == (privileged, 0.1, 8)
        assert run.planning.decision_ms > 0.0
    monkeypatch.setattr(evaluation, "evaluate", lambda *_: pytest.fail("it was run again"))
    again = run_scenario("standard", POLICIES, ["brisk"], episodes=1, results=tmp_path)
    assert [run.planning for run in again] == [run.planning for run in runs]
    for one, two in zip(again, runs, strict=True):
        np.testing.assert_array_equal(one.scores["path_error_m"], two.scores["path_error_m"])
    (board,) = leaderboards(runs)
    standings = [each for name in POLICIES for each in board.standings if each.policy == name]
    assert standings[0].rank is None
    assert str(standings[0].reason).startswith("privileged")
    assert "privileged" not in str(standings[1].reason)
    assert [each.label for each in standings] == ["bound (privileged)", "honest", "free"]
    stored = [each.as_json() for each in standings]
    assert [each["privileged"] for each in stored] == [True, False, False]
    assert (stored[0]["planning"]["rollouts"], stored[2]["planning"]) == (8, None)
    assert "honest: 8 plans of 0.1 s, " in str(table(board).caption)


def test_they_are_found_by_name() -> None:
    bound, honest = find_policy("predictive"), find_policy("predictive-honest", seed=4, scenario="everything")
    assert isinstance(bound, Privileged)
    assert isinstance(honest, Honest)
    assert (bound.settings.seed, honest.settings.seed) == (0, 4)
    assert bound.guide == find_tuned("single-dof-tuned", "standard", path=GUIDE_TABLE)
    assert honest.guide == find_tuned("single-dof-tuned", "everything", path=GUIDE_TABLE)


# --- who is told the worlds has no rank ---


class Informed(Honest):
    """An honest planner by its base class that plans on the true machine and hand."""

    begin = Privileged.begin


class Wrapping(BoundPolicy):
    """Lets a planner decide, and calls it in the name of a policy that plans, or of one that does not."""

    def __init__(self, planner: Privileged, layout: Layout, plans: Plans | None) -> None:
        self.layout, self.plans = layout, plans
        self._inner = planner.bind(BASELINE, layout)

    def reset_in(self, batch: Any) -> None:
        self._inner.reset_in(batch)

    def act(self, observations: Any) -> Any:
        return self._inner.act(observations)


class Forgetful(Wrapping):
    """Says that it plans until it has been told the worlds."""

    def reset_in(self, batch: Any) -> None:
        super().reset_in(batch)
        self.plans = None


class Binds:
    """A controller that binds as it is told."""

    sensors = "force"

    def __init__(self, make: Callable[[Layout], Any]) -> None:
        self._make = make

    def bind(self, machine: Machine, layout: Layout) -> Any:
        return self._make(layout)


BOUND = Privileged(Free(), SETTINGS)
ATTACKS = {
    "a subclass of the honest one": Informed(Free(), SETTINGS),
    "a wrapper that plans": Binds(lambda layout: Wrapping(BOUND, layout, Plans(1, 1))),
    "a wrapper that forgets that it plans": Binds(lambda layout: Forgetful(BOUND, layout, Plans(1, 1))),
    "the honest one behind a door": Binds(lambda layout: PlanningPolicy(Honest(Free(), SETTINGS), BASELINE, layout)),
}


@pytest.mark.parametrize("attack", ATTACKS)
def test_what_is_told_the_worlds_and_is_not_the_packages_own_has_no_rank(attack: str) -> None:
    (run,) = run_scenario("standard", {"attack": ATTACKS[attack]}, ["brisk"], episodes=1)
    assert run.planning is not None
    assert run.planning.privileged
    (board,) = leaderboards([run])
    assert board.standings[0].rank is None
    assert str(board.standings[0].reason).startswith("privileged")


def test_planners_take_no_attribute_afterwards() -> None:
    for planner, name in ((Honest(Free()), "begin"), (Privileged(Free()), "privileged")):
        with pytest.raises(AttributeError):
            object.__setattr__(planner, name, Privileged.begin)


class Watching(BoundPolicy):
    """Does not plan, and keeps all that it is told."""

    def __init__(self, layout: Layout) -> None:
        self.layout = layout
        self.told: list[Any] = []

    def reset(self, *told: Any) -> None:
        self.told += told

    def reset_in(self, batch: Any) -> None:
        self.told.append(batch)

    def act(self, observations: Any) -> Any:
        self.told += [observations.base] if observations.base is not None else []
        return np.zeros((len(observations), 4))


def test_what_does_not_plan_is_told_observations_alone() -> None:
    watching: list[Watching] = []
    policy = Binds(lambda layout: watching.append(Watching(layout)) or watching[-1])
    (run,) = run_scenario("standard", {"watching": policy}, ["brisk"], episodes=1)
    assert run.planning is None
    assert [each.told for each in watching] == [[]] * len(watching)
    hidden = Binds(lambda layout: Wrapping(BOUND, layout, None))
    with pytest.raises(ParameterError, match="batch must be given to reset_in"):
        run_scenario("standard", {"hidden": hidden}, ["brisk"], episodes=1)


@pytest.mark.parametrize("order", [("honest", "bound"), ("free", "bound")])
def test_a_privileged_planner_among_training_seeds_makes_all_of_them_privileged(order: tuple[str, str]) -> None:
    mixed = PerSeed(tuple(POLICIES[name] for name in order))
    (board,) = leaderboards(run_scenario("standard", {"mixed": mixed}, ["brisk"], episodes=1))
    assert board.standings[0].privileged
    assert board.standings[0].rank is None
