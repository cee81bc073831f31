"""Files of runs that are damaged, edited, copied or renamed: each is left out alone, with its reason."""

import json
import os
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pter_gym import __version__
from pter_gym._internal.reading import MOST_JSON
from pter_gym.benchmark import ResultsFolder
from pter_gym.benchmark._run_files import HASH, file_hash, read_run, run_path, write_run
from pter_gym.benchmark._runs import Conditions, Planning, Sample, ScenarioRun, code_digest, sample_numbers
from pter_gym.benchmark.episodes import stored_checksum, strata_of
from pter_gym.benchmark.metrics import METRICS

COUNT = 5
PLANNING = Planning(privileged=True, horizon_s=0.05, rollouts=4, decision_ms=1.5)
FREE = "standard-brisk-free-5"
Content = dict[str, Any]


def made_up(policy: str, seed: int, planning: Planning | None = None) -> ScenarioRun:
    """A run that nobody has simulated: numbers from their ranges."""
    checksum, strata = stored_checksum("standard"), strata_of("standard", "brisk", None)[:COUNT]
    rng = np.random.default_rng([seed, *policy.encode()])
    scores = {
        name: rng.uniform(0.0, 1.0, COUNT) if metric.high != 0.0 else rng.uniform(-9.0, 0.0, COUNT)
        for name, metric in METRICS.items()
    }
    samples = tuple(Sample(k, *rng.normal(size=(2, 7, 2))) for k in sample_numbers(strata))
    at = Conditions("standard", "brisk", policy, seed, COUNT, checksum, f"{seed}" * 64, __version__, code_digest())
    return ScenarioRun(at, strata, {**scores, "completed": rng.random(COUNT) < 0.5}, samples, planning)


@pytest.fixture(scope="module")
def original(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a policy, another one with two training seeds, and one that plans."""
    path = tmp_path_factory.mktemp("results")
    ResultsFolder(path).make()
    for run in (made_up("free", 0), made_up("agent", 0), made_up("agent", 1), made_up("bound", 0, PLANNING)):
        write_run(path, run)
    return path


@pytest.fixture
def folder(original: Path, tmp_path: Path) -> ResultsFolder:
    return ResultsFolder(Path(shutil.copytree(original, tmp_path / "results")))


def of(folder: ResultsFolder, name: str) -> Path:
    return folder.path / "runs" / f"{name}.json"


def rewrite(path: Path, change: Callable[[Content], object], *, seal: bool, to: Path | None = None) -> None:
    """Edit a file, with the hash that it should have or with the old one."""
    content = json.loads(path.read_text())
    change(content)
    target = to or path
    if seal:
        content[HASH] = file_hash(content, target.name)
    target.write_text(json.dumps(content))


def left_out(folder: ResultsFolder) -> dict[str, str]:
    """Reasons by file; whatever is left out, the summary is written and all other files are in it."""
    folder.summarise()
    summary = json.loads(folder.summary.read_text())
    found = {each["file"]: each["reason"] for each in summary["left_out"]}
    files = {path.name for path in (folder.path / "runs").iterdir()}
    counted = {run_path(folder.path, run.conditions).name for run in folder.runs()}
    assert counted | set(found) == files
    assert not counted & set(found)
    return found


def test_a_run_is_what_was_written(folder: ResultsFolder) -> None:
    written = made_up("bound", 0, PLANNING)
    path = run_path(folder.path, written.conditions)
    run, before = read_run(path), path.read_bytes()
    assert (run.conditions, run.strata, run.planning) == (written.conditions, written.strata, PLANNING)
    for name, values in written.scores.items():
        assert run.scores[name].dtype == values.dtype
        assert run.scores[name].tolist() == values.tolist()
    for mine, its in zip(run.samples, written.samples, strict=True):
        assert (mine.episode, mine.tip.tolist(), mine.theta.tolist()) == (
            its.episode,
            its.tip.tolist(),
            its.theta.tolist(),
        )
    write_run(folder.path, run)
    assert path.read_bytes() == before
    assert left_out(folder) == {}


def test_a_run_is_found_under_just_its_conditions(folder: ResultsFolder) -> None:
    run = made_up("agent", 1)
    found = folder.find(run.conditions)
    assert found is not None
    assert found.conditions == run.conditions
    for other in ({"identity": "2" * 64}, {"version": "0"}, {"seed": 2}):
        assert folder.find(replace(run.conditions, **other)) is None
    unknown = replace(run.conditions, identity=None)
    folder.add(replace(run, conditions=unknown))
    assert folder.find(unknown) is None, "nobody knows whether it is the same policy"


def test_further_training_seeds_of_an_earlier_policy_are_deleted(folder: ResultsFolder) -> None:
    kept = {path.name for path in (folder.path / "runs").iterdir()}
    for seed in (2, 3, 4):
        folder.add(made_up("agent", seed))
    folder.end_seeds(made_up("agent", 2).conditions)
    assert {path.name for path in (folder.path / "runs").iterdir()} == kept


def test_an_edited_file_is_left_out(folder: ResultsFolder) -> None:
    path = of(folder, "standard-brisk-bound-5")
    rewrite(path, lambda content: content["planning"].update(privileged=False), seal=False)
    assert left_out(folder) == {path.name: "it was edited, copied or renamed: its SHA-256 is another"}


def score(name: str, value: object) -> Callable[[Content], object]:
    def change(content: Content) -> None:
        content["scores"][name][1] = value

    return change


def at(**entries: object) -> Callable[[Content], object]:
    return lambda content: content["conditions"].update(entries)


def plans(**entries: object) -> Callable[[Content], object]:
    return lambda content: content.update(planning={**vars(PLANNING), **entries})


def points(count: int) -> Callable[[Content], object]:
    return lambda content: content["samples"]["0"].update(tip_m=[[0.0, 0.0]] * count, theta_rad=[[0.0, 0.0]] * count)


SEALED: dict[str, tuple[Callable[[Content], object], str]] = {
    "an error below 0": (score("path_error_m", -0.005), "path_error_m must be within [0, inf], got "),
    "more than the whole time": (score("effort", 1.5), "effort must be within [0, 1], got "),
    "a score that is text": (score("effort", "0.1"), "effort must be numbers"),
    "a score less": (lambda content: content["scores"]["effort"].pop(), "effort must be numbers of the shape (5,)"),
    "no score": (lambda content: content["scores"].pop("effort"), "'effort' is missing"),
    "no episode": (at(episodes=0), "its name is not that of its run"),
    "true as a seed": (at(seed=True), "seed must be int, got True"),
    "an unknown pace": (at(pace="leisurely"), "pace must be among"),
    "other episodes": (at(data="0" * 64), "other episodes than those that are stored"),
    "an older score": (at(code="0" * 64), "older score, or of other code: 000000000000 instead of "),
    "an identity that is a number": (at(identity=7), "identity must be str | None, got 7"),
    "a fresh seed below 0": (at(fresh=-1), "fresh must be a whole number"),
    "another word than derived": (at(fresh="other"), "fresh must be a whole number"),
    "a name that no file can have": (at(policy="a "), "policies must have names"),
    "a sample of too many": (points(201), "instants of a sample must be within [1, 200]"),
    "a planner that is hardly one": (plans(privileged=0), "privileged must be bool, got 0"),
    "a planner before its time": (plans(horizon_s=-0.1), "horizon_s must be within [0, inf], got -0.1"),
}


@pytest.mark.parametrize("edit", SEALED)
def test_a_hash_that_is_computed_again_does_not_make_nonsense_pass(edit: str, folder: ResultsFolder) -> None:
    change, reason = SEALED[edit]
    path = of(folder, FREE)
    rewrite(path, change, seal=True)
    found = left_out(folder)
    assert list(found) == [path.name]
    assert reason in found[path.name]


@pytest.mark.parametrize(
    "edit",
    [
        at(identity=None),
        points(1),
        points(200),
        score("effort", 1.0),
        plans(privileged=False, horizon_s=0.0, rollouts=0),
    ],
)
def test_the_ends_of_the_ranges_are_accepted(edit: Callable[[Content], object], folder: ResultsFolder) -> None:
    rewrite(of(folder, FREE), edit, seal=True)
    assert left_out(folder) == {}


def test_no_run_has_more_episodes_than_its_scenario(folder: ResultsFolder) -> None:
    most = len(strata_of("standard", "brisk", None))

    def change(content: Content) -> None:
        content["conditions"].update(episodes=most + 1)
        content["scores"] = {name: (values * most)[: most + 1] for name, values in content["scores"].items()}

    path = of(folder, f"standard-brisk-free-{most + 1}")
    rewrite(of(folder, FREE), change, seal=True, to=path)
    assert left_out(folder) == {path.name: f"episodes must be within [1, {most}], got {most + 1}"}


JUNK: dict[str, tuple[bytes, str]] = {
    "a brace": (b"{", "it is not JSON"),
    "a list": (b"[]", "list indices"),
    "an empty object": (b"{}", "'sha256' is missing"),
    "huge": (b" " * (MOST_JSON + 1), f"it is larger than {MOST_JSON} bytes"),
}


@pytest.mark.parametrize("junk", JUNK)
def test_junk_is_left_out(junk: str, folder: ResultsFolder) -> None:
    content, reason = JUNK[junk]
    of(folder, "junk").write_bytes(content)
    found = left_out(folder)
    assert list(found) == ["junk.json"]
    assert reason in found["junk.json"]


def test_what_is_not_a_file_is_left_out(folder: ResultsFolder) -> None:
    of(folder, "folder").mkdir()
    of(folder, "loop").symlink_to("loop.json")
    if hasattr(os, "mkfifo"):
        os.mkfifo(of(folder, "pipe"))
    found = left_out(folder)
    assert {"folder.json", "loop.json"} <= set(found)
    assert len(set(found.values())) == 1


def test_a_copy_is_not_a_further_training_seed(folder: ResultsFolder) -> None:
    path = of(folder, FREE)
    (before,) = folder.summarise()
    copy = of(folder, f"{FREE}-seed1")
    shutil.copy(path, copy)
    assert left_out(folder) == {copy.name: "it was edited, copied or renamed: its SHA-256 is another"}
    rewrite(path, at(seed=1), seal=True, to=copy)
    assert left_out(folder) == {copy.name: "it is the policy of seed 0"}
    assert folder.summarise() == (before,)
    of(folder, "torn").write_bytes(b"{")
    found = folder.read().left_out
    assert found == tuple(sorted(found))
    assert [each.file for each in found] == [copy.name, "torn.json"]


def test_a_renamed_file_is_left_out(folder: ResultsFolder) -> None:
    renamed = of(folder, "standard-brisk-mine-5")
    of(folder, FREE).rename(renamed)
    assert "renamed" in left_out(folder)[renamed.name]
    rewrite(renamed, lambda _: None, seal=True)
    assert left_out(folder)[renamed.name].startswith("its name is not that of its run")
