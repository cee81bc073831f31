"""Runs are stored, read and summarised."""

import json
import logging
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pter_gym._commands.main import main
from pter_gym.benchmark import ResultsFolder, ScenarioRun, leaderboards, run_scenario
from pter_gym.benchmark.results import read_run, run_path
from pter_gym.benchmark.scores import OPTIONAL
from pter_gym.controllers import Free, Locked, PerClutch, compiled
from pter_gym.controllers._policy import CompiledLaw
from pter_gym.errors import DataError, ParameterError
from pter_gym.policies._code import code_digest


@pytest.fixture
def run(tmp_path: Path) -> ScenarioRun:
    (found,) = run_scenario("standard", ["free"], ["brisk"], episodes=2, results=tmp_path)
    return found


def test_a_run_comes_back_bit_for_bit_and_is_summarised(run: ScenarioRun, tmp_path: Path) -> None:
    (again,) = ResultsFolder(tmp_path).runs()
    for name, values in run.scores.items():
        np.testing.assert_array_equal(again.scores[name], values)
    assert (again.strata, again.seed, again.version) == (run.strata, None, run.version)
    boards = ResultsFolder(tmp_path).summarise()
    assert boards == leaderboards([run])
    summary = json.loads((tmp_path / "benchmark.json").read_text())
    assert summary == {"leaderboards": [json.loads(json.dumps(boards[0].as_json()))]}
    error = summary["leaderboards"][0]["policies"]["free"]["path_error_m"]
    assert error == {"value": run.scores["path_error_m"].mean(), "low": None, "high": None}


def test_scores_that_are_not_defined_or_that_an_older_file_lacks_are_left_out(
    tmp_path: Path,
) -> None:
    (run,) = run_scenario("wall", ["impedance"], ["brisk"], episodes=2, results=tmp_path)
    (free,) = run_scenario("standard", ["free"], ["brisk"], episodes=2, results=tmp_path)
    assert run.scores.keys() - free.scores.keys() == OPTIONAL
    path = run_path(tmp_path, run)
    older = {
        name: part for name, part in json.loads(path.read_text()).items() if name not in OPTIONAL
    }
    path.write_text(json.dumps(older))
    assert [found.scores.keys() for found in ResultsFolder(tmp_path).runs()] == [
        free.scores.keys()
    ] * 2
    assert len(ResultsFolder(tmp_path).summarise()) == 2


@pytest.mark.parametrize(
    "damage",
    [
        "",
        "[]",
        '{"version": "0"}',
        *({name: "unknown"} for name in ("pace", "seed", "policy")),
        {"pace": "1e-06"},  # whose episodes would not end
    ],
)
def test_a_damaged_file_is_named_and_left_out(
    damage: str | dict[str, str], run: ScenarioRun, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = run_path(tmp_path, run)
    content = json.loads(path.read_text())
    path.write_text(damage if isinstance(damage, str) else json.dumps(content | damage))
    with pytest.raises(DataError, match=path.name):
        read_run(path)
    with caplog.at_level(logging.WARNING, "pter_gym"):
        assert ResultsFolder(tmp_path).runs() == []
    assert path.name in caplog.text


@pytest.mark.parametrize("name", ["runs", "benchmark.json"])
def test_a_link_is_not_written_through(name: str, tmp_path: Path) -> None:
    (tmp_path / "results").mkdir()
    (tmp_path / "results" / name).symlink_to(tmp_path / "elsewhere")
    with pytest.raises(ParameterError, match="results"):
        run_scenario("standard", ["free"], ["brisk"], episodes=1, results=tmp_path / "results")
    assert not (tmp_path / "elsewhere").exists()


@pytest.mark.parametrize("name", ["../../../etc/mine", "[/] [red]mine"])
def test_a_strange_name_stays_in_its_folder(name: str, tmp_path: Path) -> None:
    run_scenario("standard", {name: Free()}, ["brisk"], episodes=1, results=tmp_path / "results")
    assert ResultsFolder(tmp_path / "results").runs()[0].policy == name
    assert len(list((tmp_path / "results" / "runs").iterdir())) == 1


def test_training_seeds_replace_those_of_an_earlier_policy(tmp_path: Path) -> None:
    for policies in ((Free(), Locked()), (Free(),)):
        run_scenario("standard", {"mine": policies}, ["brisk"], episodes=1, results=tmp_path)
        assert len(ResultsFolder(tmp_path).runs()) == len(policies)


def test_fresh_episodes_depend_on_the_seed_alone() -> None:
    def errors(seed: int | None) -> list[float]:
        (found,) = run_scenario("standard", {"mine": Free()}, ["brisk"], episodes=2, seed=seed)
        return found.scores["path_error_m"].tolist()

    assert errors(3) == errors(3) != errors(None)


def test_one_row_is_one_policy(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A file that has changed between two commands is another policy under the same name."""
    file, out = tmp_path / "my.py", tmp_path / "out"
    name = f"{file}:policy"
    text = "import numpy as np\ndef policy(obs):\n    return np.full((len(obs), 4), {volts})\n"
    line = ["benchmark", "--policies", name, "free", "--episodes", "2", "--no-film", "--out"]
    for volts, paces in ((0.0, ["medium", "brisk"]), (24.0, ["brisk"])):
        file.write_text(text.format(volts=volts))
        assert main([*line, str(out), "--paces", *paces]) == 0
    printed = capsys.readouterr().out.rpartition("test episodes")[2]
    words = "".join(printed.partition("Also in the folder")[2].split())  # lines break anywhere
    assert "freeatmedium" in words
    assert "my.py:policyatmedium" in words
    by_pace = {board.pace: board for board in ResultsFolder(out).summarise()}
    old, new = (
        {each.policy for each in by_pace[pace].standings} - {"free"} for pace in ("medium", "brisk")
    )
    assert old.isdisjoint(new)
    assert all(each.startswith(f"{name} (") for each in old | new)
    assert {"free"} == (
        {each.policy for each in by_pace["medium"].standings}
        & {each.policy for each in by_pace["brisk"].standings}
    )


@compiled
def low(obs: Any, scales: Any, gains: Any, memory: Any) -> PerClutch:
    return PerClutch(1.0, 0.0, 0.0, 0.0)


@compiled
def high(obs: Any, scales: Any, gains: Any, memory: Any) -> PerClutch:
    return PerClutch(2.0, 0.0, 0.0, 0.0)


def test_laws_with_the_same_gains_have_digests_of_their_own() -> None:
    digests = {
        code_digest(SimpleNamespace(law=CompiledLaw(law, np.zeros(0), {}, np.ones(1), 4, 24.0)))
        for law in (low, high)
    }
    assert len(digests) == 2
    assert "" not in digests
