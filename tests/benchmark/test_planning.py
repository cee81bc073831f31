"""Policies that plan, in the benchmark: marked, resumed, and a privileged one without a rank."""

import io
import json
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from pter_gym.benchmark import (
    Leaderboard,
    PerSeed,
    ResultsFolder,
    evaluation,
    find_policy,
    leaderboards,
    run_scenario,
)
from pter_gym.benchmark.episodes import load_episodes
from pter_gym.benchmark.identity import identity_of
from pter_gym.benchmark.leaderboard import table
from pter_gym.benchmark.naming import GUIDE_TABLE
from pter_gym.benchmark.runs import Planning, ScenarioRun
from pter_gym.benchmark.tuned import find_tuned
from pter_gym.compiled.layout import Layout
from pter_gym.controllers import BoundPolicy, Free, Locked, bind
from pter_gym.controllers.base import Plans
from pter_gym.controllers.predictive import Honest, Privileged, Settings
from pter_gym.controllers.predictive.policies import PlanningPolicy
from pter_gym.errors import ParameterError
from pter_gym.params import BASELINE, Machine
from pter_gym.plots import leaderboard as plots
from pter_gym.tasks.path_following import observation_layout

SETTINGS = Settings(samples=8, rounds=1, elite=1, horizon=10)
POLICIES = {"bound": Privileged(Free(), SETTINGS), "honest": Honest(Free(), SETTINGS), "free": Free()}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> ResultsFolder:
    return ResultsFolder(tmp_path_factory.mktemp("results"))


@pytest.fixture(scope="module")
def runs(folder: ResultsFolder) -> tuple[ScenarioRun, ...]:
    return run_scenario("standard", POLICIES, ["brisk"], episodes=2, results=folder)


@pytest.fixture(scope="module")
def board(runs: tuple[ScenarioRun, ...]) -> Leaderboard:
    (found,) = leaderboards(runs)
    return found


def test_a_run_keeps_how_it_was_planned_and_is_not_repeated(
    runs: tuple[ScenarioRun, ...], folder: ResultsFolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    bound, honest, free = runs
    assert free.planning is None
    for run, privileged in ((bound, True), (honest, False)):
        assert run.planning is not None
        assert (run.planning.privileged, run.planning.horizon_s, run.planning.rollouts) == (privileged, 0.1, 8)
        assert run.planning.decision_ms > 0.0
    monkeypatch.setattr(evaluation, "evaluate", lambda *_: pytest.fail("it was run again"))
    again = run_scenario("standard", POLICIES, ["brisk"], episodes=2, results=folder)
    assert [run.planning for run in again] == [run.planning for run in runs]
    for one, two in zip(again, runs, strict=True):
        np.testing.assert_array_equal(one.scores["path_error_m"], two.scores["path_error_m"])


def test_other_settings_are_another_policy() -> None:
    layout = observation_layout(BASELINE, "force")
    others = (POLICIES["bound"], Privileged(Free()), Honest(Free()), Honest(Locked()))
    assert len({identity_of(policy, bind(policy, BASELINE, layout)) for policy in others}) == 4


def test_the_privileged_one_has_no_rank_and_is_marked(board: Leaderboard, folder: ResultsFolder) -> None:
    standings = {standing.policy: standing for standing in board.standings}
    bound, honest = standings["bound"], standings["honest"]
    assert bound.rank is None
    assert str(bound.reason).startswith("privileged")
    assert bound.label == "bound (privileged)"
    assert "privileged" not in str(honest.reason)
    assert honest.label == "honest"
    stored = board.as_json()["policies"]
    assert (stored["bound"]["privileged"], stored["honest"]["privileged"], stored["free"]["privileged"]) == (
        True,
        False,
        False,
    )
    assert (stored["bound"]["planning"]["rollouts"], stored["free"]["planning"]) == (8, None)
    folder.summarise()
    (summary,) = json.loads(folder.summary.read_text())["leaderboards"]
    assert summary["policies"] == json.loads(json.dumps(stored))


def test_the_table_tells_plans_and_times(board: Leaderboard) -> None:
    console = Console(file=io.StringIO(), width=80)
    console.print(table(board))
    shown = console.file.getvalue()  # type: ignore[attr-defined]
    assert "bound (privileged)" in shown
    assert "honest: 8 plans of 0.1 s, " in shown
    assert "free:" not in shown.split("plans of")[1]


def test_the_legends_are_marked(board: Leaderboard, runs: tuple[ScenarioRun, ...]) -> None:
    episodes = load_episodes("standard", "brisk").first(2)
    for figure in (
        plots.profiles([board], runs),
        plots.error_against_pace([board]),
        plots.error_against_smoothness([board]),
        plots.trajectories(board, runs, episodes),
    ):
        (legend,) = figure.legends
        assert [text.get_text() for text in legend.get_texts()][-3:] == ["bound (privileged)", "free", "honest"]


def test_they_are_found_by_name() -> None:
    bound, honest = find_policy("predictive"), find_policy("predictive-honest", seed=4, scenario="everything")
    assert isinstance(bound, Privileged)
    assert isinstance(honest, Honest)
    assert (bound.settings.seed, honest.settings.seed) == (0, 4)
    assert bound.guide == find_tuned("single-dof-tuned", "standard", path=GUIDE_TABLE)
    assert honest.guide == find_tuned("single-dof-tuned", "everything", path=GUIDE_TABLE)
    assert Planning(True, 0.3, bound.settings.rollouts, 1.0).rollouts >= 2000


# --- who is told the worlds has no rank ---


class Claims(Privileged):
    """Says of itself that it knows nothing special."""

    privileged = False
    plans = None


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


def renamed(layout: Layout) -> BoundPolicy:
    """An honest bound planner, whose instance decides as the privileged one."""
    bound = PlanningPolicy(Honest(Free(), SETTINGS), BASELINE, layout)
    bound._policy = Privileged(Free(), SETTINGS)  # type: ignore[assignment]
    return bound


BOUND = Privileged(Free(), SETTINGS)
ATTACKS = {
    "a subclass that denies it": Claims(Free(), SETTINGS),
    "a subclass of the honest one": Informed(Free(), SETTINGS),
    "a wrapper that plans": Binds(lambda layout: Wrapping(BOUND, layout, Plans(1, 1))),
    "a wrapper that forgets that it plans": Binds(lambda layout: Forgetful(BOUND, layout, Plans(1, 1))),
    "an instance that was changed": Binds(renamed),
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


@pytest.mark.parametrize("kind", [Honest, Privileged])
def test_planners_take_no_attribute_afterwards(kind: type[Honest | Privileged]) -> None:
    planner = kind(Free(), SETTINGS)
    for name in ("begin", "bind", "privileged"):
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

    def advance(self, worlds: Any, steps: int) -> None:
        self.told.append(worlds)

    def act(self, observations: Any) -> Any:
        self.told += [observations.base] if observations.base is not None else []
        return np.zeros((len(observations), 4))


def test_what_does_not_plan_is_told_observations_alone() -> None:
    watching: list[Watching] = []
    policy = Binds(lambda layout: watching.append(Watching(layout)) or watching[-1])
    (run,) = run_scenario("standard", {"watching": policy}, ["brisk"], episodes=1)
    assert run.planning is None
    assert [each.told for each in watching] == [[]] * len(watching)


def test_a_planner_inside_a_policy_that_does_not_plan_has_no_worlds_to_plan_in() -> None:
    hidden = Binds(lambda layout: Wrapping(BOUND, layout, None))
    with pytest.raises(ParameterError, match="batch must be given to reset_in"):
        run_scenario("standard", {"hidden": hidden}, ["brisk"], episodes=1)


@pytest.mark.parametrize("order", [("honest", "bound"), ("bound", "honest"), ("free", "bound")])
def test_a_privileged_planner_among_training_seeds_makes_all_of_them_privileged(order: tuple[str, str]) -> None:
    mixed = PerSeed(tuple(POLICIES[name] for name in order))
    ((standing,),) = (
        board.standings for board in leaderboards(run_scenario("standard", {"mixed": mixed}, ["brisk"], episodes=2))
    )
    assert standing.privileged
    assert standing.rank is None
    assert str(standing.reason).startswith("privileged")
