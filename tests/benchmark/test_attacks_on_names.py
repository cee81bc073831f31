"""Names of policies, and training seeds that are none."""

import io
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from pter_gym.benchmark import PerSeed, ResultsFolder, leaderboards, run_scenario, verify
from pter_gym.benchmark.leaderboard import table
from pter_gym.controllers import Free, Locked
from pter_gym.errors import ParameterError


def release(obs: Any) -> Any:
    return np.zeros((len(obs), 4))


def release_too(obs: Any) -> Any:
    return np.zeros((len(obs), 4))


REFUSED: dict[str, Any] = {
    "a name without a character": "",
    "a name with a control sequence": "mine\x1b[2J",
    "a name of two lines": "mine\nother",
    "a name that is no Unicode": "\ud800",
    "a name that no file can have": "n" * 300,
    "a number as a name": 7,
    "a callable named as a built-in policy": "ppo-standard",
    "a callable named as a planner": "predictive-honest",
}


@pytest.mark.parametrize("attack", REFUSED)
def test_a_name_that_cannot_be_one_is_refused_before_anything_runs(attack: str, tmp_path: Path) -> None:
    results = ResultsFolder(tmp_path)
    with pytest.raises(ParameterError, match="policies must have names"):
        run_scenario("standard", {REFUSED[attack]: release}, ["brisk"], episodes=1, results=results)
    assert results.runs() == ()


@pytest.mark.parametrize("name", ["../../../etc/mine", "[/] [red]mine", r"$\frac$ mine"])
def test_a_strange_name_is_shown_as_it_is_and_stays_in_its_folder(name: str, tmp_path: Path) -> None:
    results = ResultsFolder(tmp_path / "in" / "results")
    policies = {name: release, "free": Free()}
    runs = run_scenario("standard", policies, ["brisk"], episodes=1, results=results)
    (board,) = results.summarise()
    console = Console(file=io.StringIO(), width=120)
    console.print(table(board))
    assert name in console.file.getvalue()  # type: ignore[attr-defined]
    assert {path.parent for path in tmp_path.rglob("*.json")} == {results.path, results.path / "runs"}
    if find_spec("pter_gym.tools.pictures"):
        plots = import_module("pter_gym.tools.pictures.plots.leaderboard")
        plots.trajectories(board, runs).canvas.draw()
    assert [verdict.file for verdict in verify(results) if not verdict.same] == [
        path.name for path in (results.path / "runs").iterdir() if "free" not in path.name
    ], "nobody finds a policy of this name"


def test_the_same_policy_is_no_further_training_seed(tmp_path: Path) -> None:
    with pytest.raises(ParameterError, match="policies must be one or more, all of them different"):
        PerSeed((release, release))
    with pytest.raises(ParameterError, match="policies must be one or more"):
        PerSeed(())
    results = ResultsFolder(tmp_path)
    run_scenario("standard", {"mine": PerSeed((release, release_too))}, ["brisk"], episodes=8, results=results)
    (left,) = results.read().left_out
    assert left.reason == "it is the policy of seed 0"
    (alone,) = leaderboards(run_scenario("standard", {"mine": release}, ["brisk"], episodes=8))
    assert results.summarise()[0].standings[0].scores == alone.standings[0].scores


def test_training_seeds_of_an_earlier_policy_of_the_name_do_not_stay(tmp_path: Path) -> None:
    results = ResultsFolder(tmp_path)
    other = PerSeed((Free(), release, release_too))
    run_scenario("standard", {"mine": other, "other": other}, ["brisk"], episodes=2, results=results)
    (alone,) = run_scenario("standard", {"mine": Locked()}, ["brisk"], episodes=2, results=results)
    mine = [path.name for path in (tmp_path / "runs").iterdir() if "mine" in path.name]
    assert len(mine) == 1
    (kept,) = (run for run in results.runs() if run.conditions.policy == "mine")
    assert kept.conditions == alone.conditions
    assert len([path for path in (tmp_path / "runs").iterdir() if "other" in path.name]) == 3


def test_what_is_no_policy_is_refused_before_anything_runs(tmp_path: Path) -> None:
    policies: Any = {"mine": Free(), "three": 3}
    with pytest.raises(ParameterError, match="policies must have a method bind or be callable, 'three' is 3"):
        run_scenario("standard", policies, ["brisk"], episodes=1, results=ResultsFolder(tmp_path / "results"))
    assert not (tmp_path / "results").exists()
