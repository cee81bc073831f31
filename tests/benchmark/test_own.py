"""Benchmarks of a path, a task and a scenario of one's own."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from pter_gym import paths
from pter_gym.benchmark import ResultsFolder, examine, run_scenario
from pter_gym.benchmark.episodes import find_episodes
from pter_gym.controllers import Free
from pter_gym.errors import ParameterError
from pter_gym.hands import MultiSineHand
from pter_gym.params import BASELINE
from pter_gym.paths import Arcs, Circle
from pter_gym.scenarios import find_scenario
from pter_gym.tasks.path_following import PathFollowing

TASK = PathFollowing(path=Circle(), pace=0.3, error_max=0.1)


def test_a_file_of_waypoints_replaces_the_path_and_narrows_the_workspace(tmp_path: Path) -> None:
    file = tmp_path / "mine.csv"
    file.write_text("# x_m, y_m\n-0.2,0.6\n-0.1,0.62\n0.0,0.6\n0.1,0.65\n")
    for name in ("standard", "everything"):
        found = find_scenario(name, path=str(file))
        drawn = find_episodes(found, "0.3", 0)
        (path,) = {task.path for task in drawn.tasks}
        assert {(task.pace, task.error_max < 1.0 / path.max_curvature) for task in drawn.tasks} == {
            (0.3, True)
        }
        assert drawn.scenario == f"{name}-on-mine"
        assert len({task.hand for task in drawn.tasks}) == len(drawn)
    for bad in (
        {"path": "cirle"},
        {"path": str(tmp_path / "none.csv")},
        {"path": Circle(center_y=3.0)},
    ):
        with pytest.raises(ParameterError, match=r"path|none"):
            find_scenario("standard", **bad)
    with pytest.raises(ParameterError, match="path"):
        find_scenario("wall", path=Circle(radius=0.05))


def test_a_task_is_run_at_its_pace_with_random_phases(tmp_path: Path) -> None:
    (found,) = run_scenario(TASK, {"mine": "impedance-tuned"}, episodes=3, results=tmp_path)
    assert (found.scenario, found.pace, found.seed, found.policy) == ("circle", "0.3", 0, "mine")
    assert len(set(found.scores["path_error_m"])) == 3
    assert isinstance(TASK.hand, MultiSineHand)
    assert "mine" in examine({"mine": Free()}, TASK, "slow", episodes=1)
    (board,) = ResultsFolder(tmp_path).summarise()
    assert board.as_json()["pace_m_s"] == 0.3


def test_other_paths_of_one_name_have_other_boards(tmp_path: Path) -> None:
    for task in (TASK, replace(TASK, path=Circle(radius=0.2))):
        run_scenario(task, "free", episodes=1, results=tmp_path)
    assert len(ResultsFolder(tmp_path).summarise()) == 2


def test_a_scenario_with_an_own_machine_is_run_on_it() -> None:
    arm = replace(BASELINE.arm, inertia_a=2.0 * BASELINE.arm.inertia_a)
    own = find_scenario("standard", replace(BASELINE, arm=arm))
    runs: list[Any] = [
        *run_scenario(own, "free", 0.5, episodes=1),
        *run_scenario("standard", "free", 0.5, episodes=1),
    ]
    assert runs[0].scores["duration_s"] > runs[1].scores["duration_s"]
    assert (runs[0].digest != "", runs[1].digest) == (True, "")


def test_what_no_other_process_can_tell_apart_is_not_stored() -> None:
    class Unnamed(paths.Path):
        def make_arcs(self) -> Arcs:
            return Circle().arcs

    with pytest.raises(ParameterError, match=r"make .*Unnamed a frozen dataclass"):
        run_scenario(replace(TASK, path=Unnamed()), "free", episodes=1)
