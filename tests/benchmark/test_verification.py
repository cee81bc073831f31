"""Results that are run again: whoever computes every hash again has still scores that nobody else gets."""

import itertools
import json
import shutil
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from pter_gym._commands import main as cli
from pter_gym.benchmark import PerSeed, ResultsFolder, Verdict, _results, _run_files, _runs, run_scenario, verify
from pter_gym.benchmark import _verification as verification_module
from pter_gym.benchmark._run_files import HASH, file_hash
from pter_gym.benchmark._verification import SAME
from pter_gym.controllers import Free, Locked, Random
from pter_gym.controllers._predictive import Honest, Settings

PLANNER = Honest(Free(), Settings(samples=4, rounds=1, elite=1, horizon=5))


def release(obs: NDArray[np.float32]) -> NDArray[np.float32]:
    return np.zeros((len(obs), 4), np.float32)


POLICIES: dict[str, Any] = {
    "agent": PerSeed((Random(seed=1), Random(seed=2))),
    "mine": release,
    "planner": PLANNER,
    "said": Locked(),
}


@pytest.fixture(scope="module")
def original(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = ResultsFolder(tmp_path_factory.mktemp("results"))
    run_scenario("standard", ["free", "torque-feedback"], ["brisk"], episodes=3, results=folder)
    run_scenario("standard", ["free"], ["brisk"], episodes=3, fresh=7, results=folder)
    run_scenario("standard", POLICIES, ["brisk"], episodes=1, results=folder)
    folder.summarise()
    return folder.path


@pytest.fixture
def folder(original: Path, tmp_path: Path) -> ResultsFolder:
    return ResultsFolder(Path(shutil.copytree(original, tmp_path / "results")))


def edit(folder: ResultsFolder, name: str, conditions: Any = (), **entries: Any) -> str:
    """Edit a file, compute its hash again and write the summary again."""
    path = folder.path / "runs" / name
    content = json.loads(path.read_text())
    content.update(entries)
    content["conditions"].update(conditions)
    content[HASH] = file_hash(content, name)
    path.write_text(json.dumps(content))
    folder.summarise()
    return name


def bad(verdicts: tuple[Verdict, ...]) -> dict[str, str]:
    return {verdict.file: verdict.finding for verdict in verdicts if not verdict.same}


def test_honest_results_are_the_same(folder: ResultsFolder) -> None:
    seen: list[str] = []
    before = {path: path.read_bytes() for path in folder.path.rglob("*.json")}
    verdicts = verify(folder, POLICIES, on_progress=seen.append)
    assert bad(verdicts) == {}
    files = {path.name for path in (folder.path / "runs").iterdir()}
    assert {verdict.file for verdict in verdicts} == files | {"benchmark.json"}
    assert sorted(seen) == sorted(files)
    assert {path: path.read_bytes() for path in folder.path.rglob("*.json")} == before


def test_a_score_that_nobody_gets_is_found(folder: ResultsFolder) -> None:
    name = "standard-brisk-free-3.json"
    scores = json.loads((folder.path / "runs" / name).read_text())["scores"]
    true = scores["path_error_m"][2]
    scores["path_error_m"][2] = np.nextafter(true, 0.0)
    edit(folder, name, scores=scores)
    assert bad(verify(folder, POLICIES)) == {
        name: f"differs: path_error_m of episode 2: {np.nextafter(true, 0.0).item()!r} instead of {true!r}"
    }


def test_planning_and_motion_are_compared_but_for_the_measured_time(folder: ResultsFolder) -> None:
    name = "standard-brisk-planner-1.json"
    planning = json.loads((folder.path / "runs" / name).read_text())["planning"]
    edit(folder, name, planning={**planning, "decision_ms": 123.0})
    assert bad(verify(folder, POLICIES)) == {}
    edit(folder, name, planning={**planning, "rollouts": 1})
    assert "planning" in bad(verify(folder, POLICIES))[name]
    samples = json.loads((folder.path / "runs" / "standard-brisk-mine-1.json").read_text())["samples"]
    samples["0"]["tip_m"][5][0] += 0.001
    edit(folder, "standard-brisk-mine-1.json", samples=samples)
    assert bad(verify(folder, POLICIES))["standard-brisk-mine-1.json"] == "differs: the motion of episode 0"


def test_another_policy_is_found(folder: ResultsFolder) -> None:
    name = edit(folder, "standard-brisk-torque-feedback-3.json", conditions={"identity": "0" * 64})
    assert bad(verify(folder, POLICIES))[name].startswith("other policy: the file says 00000000")
    found = bad(verify(folder, {**POLICIES, "said": Random(seed=3), "mine": Random(seed=3)}))
    assert found["standard-brisk-said-1.json"].startswith("other policy")
    assert found["standard-brisk-mine-1.json"].startswith("differs: "), "its scores alone tell"


def test_other_fresh_episodes_are_found(folder: ResultsFolder) -> None:
    name = edit(folder, "standard-brisk-free-3-fresh7.json", conditions={"data": "0" * 64})
    assert bad(verify(folder, POLICIES))[name].startswith("other episodes: the file says 00000000")


def test_what_cannot_be_run_again_is_told(folder: ResultsFolder) -> None:
    found = bad(verify(folder))
    assert found["standard-brisk-mine-1.json"].startswith("it cannot be run again: policies must be among")
    assert set(found) == {
        f"standard-brisk-{name}.json" for name in ("mine-1", "agent-1", "agent-1-seed1", "planner-1", "said-1")
    }
    found = bad(verify(folder, {**POLICIES, "agent": Random(seed=1)}))
    assert found == {
        "standard-brisk-agent-1-seed1.json": "it cannot be run again: there is no training seed 1 of 'agent'"
    }


def test_a_folder_of_an_older_score_is_told_as_one(folder: ResultsFolder, monkeypatch: pytest.MonkeyPatch) -> None:
    digest = _runs.code_digest()[:12]
    for module in (_runs, _run_files, _results):
        monkeypatch.setattr(module, "code_digest", lambda: "f" * 64)
    found = bad(verify(folder, POLICIES))
    files = {path.name for path in folder.path.rglob("*.json")}
    assert found == dict.fromkeys(files, f"it is of an older score, or of other code: {digest} instead of {'f' * 12}")


def test_a_summary_that_is_edited_is_found(folder: ResultsFolder) -> None:
    content = json.loads(folder.summary.read_text())
    content["leaderboards"][0]["policies"].popitem()
    for damage, finding in (
        (json.dumps(content), "differs from what the runs give: leaderboards"),
        ("[]", "it is of an older score, or of other code: unknown instead of"),
        ("{", "it cannot be read"),
    ):
        folder.summary.write_text(damage)
        assert bad(verify(folder, POLICIES))["benchmark.json"].startswith(finding)


def test_a_folder_without_runs_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["verify", str(tmp_path)]) == 2
    assert "RESULTS must be a folder with files in runs" in capsys.readouterr().err


def test_code_is_imported_only_if_it_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "mine_to_verify.py").write_text(
        "import numpy as np\n\ndef release(obs):\n    return np.zeros((len(obs), 4))\n"
    )
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    name = "mine_to_verify:release"
    arguments = ["--policies", name, "--paces", "brisk", "--episodes", "1", "--no-film", "--out", "out"]
    assert cli.main(["benchmark", "--scenario", "standard", *arguments]) == 0
    monkeypatch.delitem(sys.modules, "mine_to_verify")
    assert cli.main(["verify", "out"]) == 1
    assert "mine_to_verify" not in sys.modules
    assert "it cannot be run again: policies must name the code that may be imported" in capsys.readouterr().out
    assert cli.main(["verify", "out", "--policies", name]) == 0
    assert "mine_to_verify" not in sys.modules, "it runs in a process of its own"


@pytest.mark.parametrize("options", [[], ["--fresh", "7"]])
def test_a_law_of_ones_own_is_compared_with_what_an_isolated_one_does(options: list[str], tmp_path: Path) -> None:
    name = "benchmark.isolated_policies:STIFF"
    run = ["--policies", name, "--paces", "brisk", "--episodes", "2", "--no-film", "--out", str(tmp_path), *options]
    assert cli.main(["benchmark", "--scenario", "standard", *run]) == 0
    assert cli.main(["verify", str(tmp_path), "--policies", name]) == 0


def test_command(tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    results = ResultsFolder(tmp_path)
    for fresh in (None, "derived"):
        run_scenario("standard", ["free", "locked"], ["brisk"], episodes=2, fresh=fresh, results=results)
    results.summarise()
    assert cli.main(["verify", str(tmp_path)]) == 0
    assert "5 of 5 files are the same" in capsys.readouterr().out
    monkeypatch.setattr(verification_module, "find_policy", lambda *_: Free())
    assert cli.main(["verify", str(tmp_path)]) == 1
    shown = capsys.readouterr().out
    assert f"standard-brisk-free-2.json: {SAME}" in shown
    assert "standard-brisk-locked-2.json: other policy" in shown
    assert "3 of 5 files are the same" in shown


def test_a_built_in_policy_that_is_named_has_the_gains_of_each_scenario(tmp_path: Path) -> None:
    results = ResultsFolder(tmp_path)
    run_scenario("hands", ["single-dof-tuned"], ["slow"], episodes=1, results=results)
    results.summarise()
    assert cli.main(["verify", str(tmp_path), "--policies", "single-dof-tuned"]) == 0


def by_the_count_of_its_calls(obs: Any, calls: Any = itertools.count()) -> Any:  # noqa: B008
    return np.full((len(obs), 4), 0.001 * next(calls))


def test_a_score_that_does_not_come_again_is_found(tmp_path: Path) -> None:
    results = ResultsFolder(tmp_path)
    policies = {"mine": by_the_count_of_its_calls}
    run_scenario("standard", policies, ["brisk"], episodes=1, results=results)
    results.summarise()
    finding = next(verdict.finding for verdict in verify(results, policies) if not verdict.same)
    assert finding.startswith("differs: ")
