"""Files of runs that are broken, edited, copied or renamed: each is left out alone, with its reason."""

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
from pter_gym.benchmark import PerSeed, ResultsFolder, run_scenario
from pter_gym.benchmark.episodes import SEEDS, stored_strata
from pter_gym.benchmark.metrics import METRICS, SCORES
from pter_gym.benchmark.run_files import HASH, file_hash, read_run, run_path, write_run
from pter_gym.benchmark.runs import (
    INSTANTS,
    Conditions,
    Planning,
    Sample,
    ScenarioRun,
    code_digest,
    sample_numbers,
)
from pter_gym.commands import main as cli
from pter_gym.controllers import Free, Random
from pter_gym.controllers.predictive import Privileged, Settings
from pter_gym.internal.reading import MOST_JSON

COUNT = 5
PLANNER = Privileged(Free(), Settings(samples=4, rounds=1, elite=1, horizon=5))
Content = dict[str, Any]


def made_up(policy: str, seed: int, episodes: int, planning: Planning | None = None) -> ScenarioRun:
    """A run that nobody has simulated: numbers from their ranges."""
    checksum, strata = stored_strata("standard")
    strata = strata[:episodes]
    rng = np.random.default_rng([seed, *policy.encode()])
    scores = {
        name: rng.uniform(0.0, 1.0, episodes) if metric.high != 0.0 else rng.uniform(-9.0, 0.0, episodes)
        for name, metric in METRICS.items()
    }
    samples = tuple(Sample(k, *rng.normal(size=(2, 7, 2))) for k in sample_numbers(strata))
    at = Conditions("standard", "brisk", policy, seed, episodes, checksum, f"{seed}" * 64, __version__, code_digest())
    return ScenarioRun(at, strata, {**scores, "completed": rng.random(episodes) < 0.5}, samples, planning)


@pytest.fixture(scope="module")
def original(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a policy, another one with two training seeds, and one that plans."""
    path = tmp_path_factory.mktemp("results")
    ResultsFolder(path).make()
    for run in (made_up("free", 0, COUNT), made_up("agent", 0, COUNT), made_up("agent", 1, COUNT)):
        write_run(path, run)
    write_run(path, made_up("bound", 0, 1, Planning(privileged=True, horizon_s=0.05, rollouts=4, decision_ms=1.5)))
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
    planning = Planning(privileged=True, horizon_s=0.05, rollouts=4, decision_ms=1.5)
    written = made_up("bound", 0, 1, planning)
    run = read_run(run_path(folder.path, written.conditions))
    assert (run.conditions, run.strata, run.planning) == (written.conditions, written.strata, planning)
    for name, values in written.scores.items():
        assert run.scores[name].dtype == values.dtype
        assert run.scores[name].tolist() == values.tolist()
    assert isinstance(run.samples, tuple)
    for mine, its in zip(run.samples, written.samples, strict=True):
        assert (mine.episode, mine.tip.tolist(), mine.theta.tolist()) == (
            its.episode,
            its.tip.tolist(),
            its.theta.tolist(),
        )


def test_a_run_is_read_by_a_path_from_here(folder: ResultsFolder, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder.path)
    assert read_run("runs/standard-brisk-free-5.json").conditions.policy == "free"


def test_a_run_is_read_as_it_was_written(folder: ResultsFolder) -> None:
    for path in sorted((folder.path / "runs").glob("*.json")):
        run = read_run(path)
        before = path.read_bytes()
        write_run(folder.path, run)
        assert path.read_bytes() == before
    assert left_out(folder) == {}


def set_score(name: str, value: object) -> Callable[[Content], object]:
    def change(content: Content) -> None:
        content["scores"][name][1] = value

    return change


def give(**entries: object) -> Callable[[Content], object]:
    return lambda content: content.update(entries)


EDITS: dict[str, Callable[[Content], object]] = {
    "a better score": set_score("path_error_m", 0.001),
    "another policy": give(policy="locked"),
    "privileged no more": lambda content: content["planning"].update(privileged=False),
    "no plans": give(planning=None),
    "another identity": give(identity="f" * 64),
    "another seed": give(seed=1),
    "another pace": give(pace="slow"),
    "fresh episodes": give(fresh=3),
    "a sample": lambda content: content["samples"][0]["tip_m"].pop(),
}


@pytest.mark.parametrize("edit", EDITS)
def test_an_edited_file_is_left_out(edit: str, folder: ResultsFolder) -> None:
    path = of(
        folder, "standard-brisk-bound-1" if edit in ("privileged no more", "no plans") else "standard-brisk-free-5"
    )
    rewrite(path, EDITS[edit], seal=False)
    assert left_out(folder) == {path.name: "it was edited, copied or renamed: its SHA-256 is another"}


SEALED: dict[str, tuple[Callable[[Content], object], str]] = {
    "an error below 0": (set_score("path_error_m", -0.005), "path_error_m must be finite numbers from 0"),
    "completed seven times": (set_score("completed", 7), "completed must be"),
    "half completed": (set_score("completed", 0.5), "completed must be"),
    "a score that is text": (set_score("effort", "0.1"), "effort must be numbers"),
    "a score that is a list": (set_score("effort", [0.1]), "effort must be numbers"),
    "a score that is huge": (set_score("effort", 10**30), "effort must be numbers"),
    "a score less": (lambda content: content["scores"]["effort"].pop(), "effort must be numbers of the shape (5,)"),
    "no score": (lambda content: content["scores"].pop("effort"), "scores: 'effort' is missing"),
    "an unknown score": (lambda content: content["scores"].update(luck=[1.0] * COUNT), "scores: 'luck' is unknown"),
    "scores as a list": (give(scores=[]), "scores must be an object"),
    "no episode": (give(episodes=0), "episodes must be a whole number"),
    "part of an episode": (give(episodes=5.0), "episodes must be a whole number"),
    "seed below 0": (give(seed=-1), "seed must be a whole number from 0"),
    "true as a seed": (give(seed=True), "seed must be a whole number"),
    "fresh below 0": (give(fresh=-1), "fresh must be a whole number from 0"),
    "an unknown pace": (give(pace="leisurely"), "pace must be among"),
    "a pace that is a number": (give(pace=0.5), "pace must be a text"),
    "an unknown scenario": (give(scenario="easy"), "scenario must be among"),
    "other strata": (give(strata=["Arc"] * COUNT), "strata are not those of the episodes"),
    "other episodes": (give(data="0" * 64), "other episodes than those that are stored"),
    "other code": (give(code="0" * 64), "other code"),
    "an identity that is a number": (give(identity=7), "identity must be a text or null"),
    "a fresh seed beyond all": (give(fresh=SEEDS), "fresh must be a whole number from 0"),
    "a name that no file can have": (give(policy="a "), "policies must have names"),
    "more than the whole time": (set_score("effort", 1.5), "effort must be finite numbers from 0 to 1, got [1.5]"),
    "many scores beyond their range": (
        lambda content: content["scores"].update(effort=[1.5, 2.5, 3.5, 4.5, 5.5]),
        "effort must be finite numbers from 0 to 1, got [1.5]",
    ),
    "a sample without its episode": (
        lambda content: content["samples"][0].pop("episode"),
        "a sample: 'episode' is missing",
    ),
    "no sample": (give(samples=[]), "samples must be those of the episodes [0, 1, 2, 3]"),
    "samples as an object": (give(samples={}), "samples must be a list"),
    "a sample with more": (lambda content: content["samples"][0].update(more=1), "a sample: 'more' is unknown"),
    "a sample of one number": (lambda content: content["samples"][0].update(tip_m=1.0), "tip_m must be a list"),
    "a sample of too many": (
        lambda content: content["samples"][0].update(tip_m=[[0.0, 0.0]] * (INSTANTS + 1)),
        f"tip_m must be a list of 1 to {INSTANTS}",
    ),
    "a sample of nothing": (lambda content: content["samples"][0].update(tip_m=[]), "tip_m must be a list of 1"),
    "a sample that is text": (lambda content: content["samples"][0].update(tip_m=[["a", "b"]]), "tip_m must be"),
    "a planner without time": (
        give(planning={"privileged": False, "horizon_s": 0.1, "rollouts": 1}),
        "planning: 'decision_ms' is missing",
    ),
    "a planner that is hardly one": (
        give(planning={"privileged": 0, "horizon_s": 0.1, "rollouts": 1, "decision_ms": 1.0}),
        "privileged must be true or false",
    ),
    "a planner before its time": (
        give(planning={"privileged": True, "horizon_s": -0.1, "rollouts": 1, "decision_ms": 1.0}),
        "horizon_s must be finite numbers from 0",
    ),
    "a planner with part of a plan": (
        give(planning={"privileged": True, "horizon_s": 0.1, "rollouts": 0.5, "decision_ms": 1.0}),
        "rollouts must be a whole number from 0",
    ),
}


@pytest.mark.parametrize("edit", SEALED)
def test_a_hash_that_is_computed_again_does_not_make_nonsense_pass(edit: str, folder: ResultsFolder) -> None:
    change, reason = SEALED[edit]
    path = of(folder, "standard-brisk-free-5")
    target = of(folder, "easy-brisk-free-5") if edit == "an unknown scenario" else path
    rewrite(path, change, seal=True, to=target)
    if target != path:
        path.unlink()
    found = left_out(folder)
    assert list(found) == [target.name]
    assert reason in found[target.name]


ACCEPTED: dict[str, Callable[[Content], object]] = {
    "as it is": lambda _: None,
    "the first fresh seed": give(fresh=0),
    "the last fresh seed": give(fresh=SEEDS - 1),
    "a policy that nobody can tell": give(identity=None),
    "a sample of one instant": lambda content: content["samples"][0].update(tip_m=[[0.0, 0.0]], theta_rad=[[0.0, 0.0]]),
    "a sample of as many as may be": lambda content: content["samples"][0].update(
        tip_m=[[0.0, 0.0]] * INSTANTS, theta_rad=[[0.0, 0.0]] * INSTANTS
    ),
    "an effort of all": set_score("effort", 1.0),
    "a planner without plans": give(
        planning={"privileged": False, "horizon_s": 0.0, "rollouts": 0, "decision_ms": 0.0}
    ),
}


@pytest.mark.parametrize("edit", ACCEPTED)
def test_what_may_be_is_accepted(edit: str, folder: ResultsFolder) -> None:
    path = of(folder, "standard-brisk-free-5")
    content = json.loads(path.read_text())
    ACCEPTED[edit](content)
    path.unlink()
    fresh = "" if content["fresh"] is None else f"-fresh{content['fresh']}"
    target = of(folder, f"standard-brisk-free-5{fresh}")
    content[HASH] = file_hash(content, target.name)
    target.write_text(json.dumps(content))
    assert read_run(target).conditions.policy == "free"


@pytest.mark.parametrize("number", ["NaN", "Infinity", "-Infinity", "1e999"])
def test_numbers_are_finite(number: str, folder: ResultsFolder) -> None:
    path = of(folder, "standard-brisk-free-5")
    content = json.loads(path.read_text())
    content["scores"]["path_error_m"][0] = "here"
    path.write_text(json.dumps(content).replace('"here"', number))
    assert list(left_out(folder)) == [path.name]


JUNK: dict[str, tuple[bytes, str]] = {
    "nothing": (b"", "it is no JSON"),
    "a brace": (b"{", "it is no JSON"),
    "a list": (b"[]", "it must be an object"),
    "an empty object": (b"{}", "it: 'sha256' is missing"),
    "binary": (bytes(range(256)), "it is no JSON"),
    "deep": (b"[" * 100_000, "it is no JSON"),
    "digits": (b"9" * 10_000, "it is no JSON"),
    "huge": (b" " * (MOST_JSON + 1), f"it is larger than {MOST_JSON} bytes"),
}


@pytest.mark.parametrize("junk", JUNK)
def test_junk_is_left_out(junk: str, folder: ResultsFolder) -> None:
    content, reason = JUNK[junk]
    of(folder, "junk").write_bytes(content)
    found = left_out(folder)
    assert list(found) == ["junk.json"]
    assert reason in found["junk.json"]


def test_a_cut_file_is_left_out(folder: ResultsFolder) -> None:
    path = of(folder, "standard-brisk-free-5")
    path.write_bytes(path.read_bytes()[:1000])
    assert left_out(folder)[path.name].startswith("it is no JSON")


def test_what_is_no_file_is_left_out(folder: ResultsFolder) -> None:
    of(folder, "folder").mkdir()
    of(folder, "loop").symlink_to("loop.json")
    of(folder, "nowhere").symlink_to("missing.json")
    if hasattr(os, "mkfifo"):
        os.mkfifo(of(folder, "pipe"))
    found = left_out(folder)
    assert {"folder.json", "loop.json", "nowhere.json"} <= set(found)
    assert set(found.values()) == {"it is not a regular file"}


@pytest.mark.skipif(os.name != "posix", reason="other systems allow no such names")
def test_a_name_that_no_terminal_can_print_is_left_out_in_ascii(folder: ResultsFolder) -> None:
    (folder.path / "runs" / os.fsdecode(b"\xff\x1b[2J.json")).write_text("{}")
    folder.summarise()
    (found,) = json.loads(folder.summary.read_text())["left_out"]
    assert found["file"] == ascii("\udcff\x1b[2J.json")


# --- what a folder finds ---


def test_a_run_is_found_under_just_its_conditions(folder: ResultsFolder) -> None:
    run = made_up("free", 0, COUNT)
    found = folder.find(run.conditions)
    assert found is not None
    assert found.conditions == run.conditions
    assert folder.find(replace(run.conditions, identity="f" * 64)) is None
    assert folder.find(replace(run.conditions, policy="nobody")) is None
    write_run(folder.path, replace(run, conditions=replace(run.conditions, identity=None)))
    assert folder.find(replace(run.conditions, identity=None)) is None


def test_further_seeds_of_an_earlier_policy_are_deleted(folder: ResultsFolder) -> None:
    for seed in (2, 3):
        write_run(folder.path, made_up("agent", seed, COUNT))
    folder.end_seeds(made_up("agent", 1, COUNT).conditions)
    kept = [path.stem for path in sorted((folder.path / "runs").iterdir())]
    assert kept == ["standard-brisk-agent-5", "standard-brisk-bound-1", "standard-brisk-free-5"]


def test_what_a_folder_holds_is_told_in_order(folder: ResultsFolder) -> None:
    for name in ("z", "a"):
        of(folder, name).write_text("{")
    contents = folder.read()
    assert isinstance(contents.left_out, tuple)
    assert [each.file for each in contents.left_out] == ["a.json", "z.json"]
    found = [(run.conditions.policy, run.conditions.seed) for run in contents.runs]
    assert sorted(found) == [("agent", 0), ("agent", 1), ("bound", 0), ("free", 0)]


# --- copies ---


def test_a_copy_is_no_further_training_seed(folder: ResultsFolder) -> None:
    path = of(folder, "standard-brisk-free-5")
    (before, *_) = (b for b in folder.summarise() if b.episodes == COUNT)
    copy = of(folder, "standard-brisk-free-5-seed1")
    shutil.copy(path, copy)
    assert left_out(folder) == {copy.name: "it was edited, copied or renamed: its SHA-256 is another"}
    rewrite(path, give(seed=1), seal=True, to=copy)
    rewrite(path, give(seed=2), seal=True, to=of(folder, "standard-brisk-free-5-seed2"))
    reason = "it is the policy of seed 0"
    assert left_out(folder) == {copy.name: reason, "standard-brisk-free-5-seed2.json": reason}
    (after, *_) = (b for b in folder.summarise() if b.episodes == COUNT)
    assert before == after


def test_a_renamed_file_is_left_out(folder: ResultsFolder) -> None:
    path = of(folder, "standard-brisk-free-5")
    path.rename(of(folder, "standard-brisk-mine-5"))
    assert "renamed" in left_out(folder)["standard-brisk-mine-5.json"]
    rewrite(of(folder, "standard-brisk-mine-5"), lambda _: None, seal=True)
    assert left_out(folder)["standard-brisk-mine-5.json"].startswith("its name is not that of its run")


def test_the_command_tells_what_is_left_out(folder: ResultsFolder, capsys: pytest.CaptureFixture[str]) -> None:
    of(folder, "broken").write_text("{")
    arguments = ["--policies", "free", "--paces", "brisk", "--episodes", str(COUNT), "--out", str(folder.path)]
    assert cli.main(["benchmark", "--scenario", "standard", *arguments]) == 0
    assert "left out broken.json: it is no JSON" in capsys.readouterr().out


# --- ranges ---


def test_every_score_of_an_honest_run_is_in_its_range() -> None:
    agent = PerSeed((Random(seed=1), Random(seed=2)))
    runs = run_scenario("standard", {"free": Free(), "agent": agent}, ["brisk"], episodes=COUNT)
    runs += run_scenario("standard", {"bound": PLANNER}, ["brisk"], episodes=1)
    for run in runs:
        for name in SCORES:
            low, high = METRICS[name].low, METRICS[name].high
            assert low is None or run.scores[name].min() >= low
            assert high is None or run.scores[name].max() <= high
