"""Folders of results: reused, resumed, shared, and whole whatever happens."""

import json
import os
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from filelock import FileLock
from numpy.typing import NDArray
from PIL import Image

from pter_gym._commands import main as cli
from pter_gym.benchmark import PerSeed, ResultsFolder, run_scenario
from pter_gym.benchmark import _evaluation as evaluation_module
from pter_gym.benchmark._results import LOCK
from pter_gym.benchmark._run_files import read_run, run_path
from pter_gym.benchmark._runs import sample_numbers
from pter_gym.benchmark.metrics import SCORES
from pter_gym.controllers import Free, Impedance, Random

COUNT = 5
MAIN = "import sys; from pter_gym._commands.main import main; sys.exit(main())"


@pytest.fixture
def simulated(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Grows by one with each run that is simulated rather than taken from the folder."""
    calls: list[int] = []
    evaluate = evaluation_module.evaluate

    def counted(*arguments: object) -> object:
        calls.append(1)
        return evaluate(*arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(evaluation_module, "evaluate", counted)
    return calls


def release(obs: NDArray[np.float32]) -> NDArray[np.float32]:
    return np.zeros((len(obs), 4), np.float32)


def summary_of(folder: Path) -> dict[tuple[str, int], list[str]]:
    boards = json.loads((folder / "benchmark.json").read_text())["leaderboards"]
    return {(board["pace"], board["episodes"]): sorted(board["policies"]) for board in boards}


# --- the scores ---


@pytest.mark.slow
def test_scores_depend_neither_on_threads_nor_on_the_number_of_episodes() -> None:
    (alone,) = run_scenario("standard", ["torque-feedback"], ["medium"], episodes=70, num_threads=1)
    (shared,) = run_scenario("standard", ["torque-feedback"], ["medium"], episodes=70, num_threads=2)
    (few,) = run_scenario("standard", ["torque-feedback"], ["medium"], episodes=3)
    for name in SCORES:
        assert alone.scores[name].tolist() == shared.scores[name].tolist()
        np.testing.assert_allclose(few.scores[name], alone.scores[name][:3], rtol=1e-12)


def test_any_callable_is_a_policy() -> None:
    mine, free = run_scenario("standard", {"mine": release, "free": Free()}, ["brisk"], episodes=COUNT)
    for name in SCORES:
        np.testing.assert_allclose(mine.scores[name], free.scores[name], rtol=1e-12, atol=1e-15)


def test_samples_come_from_each_stratum_first() -> None:
    assert sample_numbers(["a"] * 10) == [0, 1, 2, 3]
    assert sample_numbers(["a", "a", "b", "c", "c", "b"]) == [0, 1, 2, 3]
    assert sample_numbers(["a"] * 5 + ["b"] * 5 + ["c"] * 5) == [0, 1, 5, 10]
    assert sample_numbers(list("aabbccddee")) == [0, 2, 4, 6]
    assert sample_numbers(["a"]) == [0]


# --- reuse ---


def test_finished_runs_are_reused(tmp_path: Path, simulated: list[int]) -> None:
    folder = ResultsFolder(tmp_path)
    first = run_scenario("standard", ["free", "locked"], ["brisk"], episodes=COUNT, results=folder)
    assert len(simulated) == 2
    again = run_scenario("standard", ["free", "locked", "impedance"], ["brisk"], episodes=COUNT, results=folder)
    assert len(simulated) == 3
    for one, two in zip(first, again, strict=False):
        assert one.conditions == two.conditions
        assert all(one.scores[name].tolist() == two.scores[name].tolist() for name in SCORES)
        np.testing.assert_array_equal(one.samples[0].tip, two.samples[0].tip)


def test_other_conditions_are_other_runs(tmp_path: Path, simulated: list[int], monkeypatch: pytest.MonkeyPatch) -> None:
    folder = ResultsFolder(tmp_path)

    def times_simulated(policy: Any, **others: Any) -> int:
        before = len(simulated)
        run_scenario("standard", {"policy": policy}, ["brisk"], results=folder, **{"episodes": COUNT, **others})
        return len(simulated) - before

    assert times_simulated(Impedance()) == 1
    assert times_simulated(Impedance()) == 0
    assert times_simulated(Impedance(stiffness=1.0)) == 1
    assert times_simulated(Impedance(stiffness=1.0), episodes=2) == 1
    assert times_simulated(Random(seed=1)) == 1
    assert times_simulated(Random(seed=2)) == 1
    assert times_simulated(release) == 1
    assert times_simulated(release) == 1, "nobody can tell whether a plain function is still the same"
    assert times_simulated(Free()) == 1
    assert times_simulated(Free(), fresh=1) == 1
    assert times_simulated(Free(), fresh=np.int64(1)) == 0
    assert times_simulated(Free(), fresh=2) == 1
    monkeypatch.setattr(evaluation_module, "code_digest", lambda: "other code")
    assert times_simulated(Free()) == 1


def test_training_seeds_have_runs_of_their_own(tmp_path: Path, simulated: list[int]) -> None:
    folder = ResultsFolder(tmp_path)
    trained = PerSeed((Random(seed=1), Random(seed=2)))
    first = run_scenario("standard", {"agent": trained}, ["brisk"], episodes=COUNT, results=folder)
    assert [run.conditions.seed for run in first] == [0, 1]
    assert first[0].scores["path_error_m"].tolist() != first[1].scores["path_error_m"].tolist()
    run_scenario("standard", {"agent": trained}, ["brisk"], episodes=COUNT, results=folder)
    assert len(simulated) == 2
    (board,) = folder.summarise()
    assert [standing.policy for standing in board.standings] == ["agent"]
    both = np.concatenate([run.scores["path_error_m"] for run in first])
    assert board.standings[0].scores["path_error_m"].value == pytest.approx(both.mean())


def test_a_damaged_run_is_run_again(tmp_path: Path, simulated: list[int]) -> None:
    folder = ResultsFolder(tmp_path)
    (run,) = run_scenario("standard", ["free"], ["brisk"], episodes=COUNT, results=folder)
    path = run_path(tmp_path, run.conditions)
    path.write_text("{")
    folder.summarise()
    assert summary_of(tmp_path) == {}
    run_scenario("standard", ["free"], ["brisk"], episodes=COUNT, results=folder)
    assert len(simulated) == 2
    assert read_run(path).conditions == run.conditions


# --- several at once, and interrupts ---


def test_the_summary_is_read_and_written_under_a_lock(tmp_path: Path) -> None:
    """A run that another benchmark adds while a summary waits is in it: none is written from older runs."""
    folder = ResultsFolder(tmp_path)
    run_scenario("standard", ["free"], ["brisk"], episodes=COUNT, results=folder)
    with FileLock(tmp_path / LOCK):
        other = threading.Thread(target=folder.summarise)
        other.start()
        other.join(0.5)
        assert other.is_alive()
        assert not folder.summary.exists()
        run_scenario("standard", ["locked"], ["brisk"], episodes=COUNT, results=folder)
    other.join(30.0)
    assert summary_of(tmp_path) == {("brisk", COUNT): ["free", "locked"]}


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="sends POSIX signals")
def test_a_benchmark_that_is_killed_goes_on(tmp_path: Path, simulated: list[int]) -> None:
    out = tmp_path / "out"
    arguments = ["--policies", "free,impedance,torque-feedback", "--episodes", "16", "--no-film", "--out", str(out)]
    process = subprocess.Popen([sys.executable, "-c", MAIN, "benchmark", "--scenario", "standard", *arguments])
    while not list(out.glob("runs/*.json")):
        assert process.poll() is None
        time.sleep(0.005)
    process.kill()
    process.wait(60)
    finished = list(out.glob("runs/*.json"))
    assert 0 < len(finished) < 9
    assert {read_run(path).conditions.policy for path in finished} <= {"free", "impedance", "torque-feedback"}
    before = {path: path.read_bytes() for path in finished}
    assert cli.main(["benchmark", "--scenario", "standard", *arguments]) == 0
    assert len(simulated) == 9 - len(finished)
    assert {path: path.read_bytes() for path in finished} == before
    assert all(len(names) == 3 for names in summary_of(out).values())


# --- the command ---


@pytest.mark.slow
def test_command(tmp_path: Path) -> None:
    out = tmp_path / "new" / "folder"
    arguments = ["--policies", "free, impedance", "--paces", "brisk", "--episodes", str(COUNT), "--out", str(out)]
    assert cli.main(["benchmark", "--scenario", "standard", *arguments]) == 0
    pictures = {"profiles", "error-against-pace", "error-against-smoothness", "trajectories-brisk"}
    assert {path.name for path in out.iterdir()} == {
        "runs",
        "benchmark.json",
        LOCK,
        "standard-brisk.gif",
        *(f"standard-{name}.{kind}" for name in pictures for kind in ("png", "pdf")),
    }
    with Image.open(out / "standard-brisk.gif") as film:
        assert getattr(film, "n_frames", 1) > 1
    assert cli.main(["verify", str(out)]) == 0


SCENARIO = ["--scenario", "standard"]
PAPER = ["--scenario", "paper"]
WRONG = {
    "scenario": (["--scenario", "standerd"], "did you mean 'standard'"),
    "policy": ([*SCENARIO, "--policies", "impedence"], "did you mean 'impedance'"),
    "pace": ([*SCENARIO, "--paces", "slo"], "did you mean 'slow'"),
    "no policy": ([*SCENARIO, "--policies", ","], "policies must hold at least one name"),
    "too many episodes": ([*SCENARIO, "--episodes", "100000"], "episodes must be from 1 to"),
    "seed": ([*SCENARIO, "--policies", "random", "--seed=-1"], "seed"),
    "a word for fresh": ([*SCENARIO, "--fresh", "new"], "or the word derived, got 'new'"),
    "a large seed": ([*SCENARIO, "--fresh", str(2**64)], "within [0, 2⁶⁴)"),
    "fresh episodes of the standard test": ([*PAPER, "--fresh", "1"], "fresh needs another scenario than paper"),
    "machine": ([*SCENARIO, "--machine", "delrin_experimental"], "machine needs --scenario paper"),
    "standard test: tuned": ([*PAPER, "--policies", "impedance-tuned"], "'impedance-tuned' needs a scenario"),
    "standard test: policy": (
        [*PAPER, "--policies", "pid"],
        "impedance, torque-feedback, single-dof, velocity-ratio, free, locked, random",
    ),
    "standard test: time constant": ([*PAPER, "--time-constants", "fast"], "numbers"),
    "standard test: machine": ([*PAPER, "--machine", "steel"], "baseline, delrin_experimental, delrin_theoretical"),
}


@pytest.mark.parametrize(("arguments", "accepted"), WRONG.values(), ids=WRONG)
def test_a_wrong_argument_names_what_is_accepted(
    arguments: list[str], accepted: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["benchmark", *arguments, "--out", str(tmp_path / "out")]) == 2
    assert accepted in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
