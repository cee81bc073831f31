"""Policies in processes of their own: the same scores, nothing else crosses, and faults leave nothing behind."""

import gc
import os
import signal
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pter_gym._commands import main as cli
from pter_gym.benchmark import Isolated, ResultsFolder, find_policy, run_scenario
from pter_gym.errors import ActionError, ParameterError, PolicyError
from pter_gym.params import BASELINE
from pter_gym.tasks.path_following import observation_layout

MODULE = "benchmark.isolated_policies"
OBS = np.zeros((3, len(observation_layout(BASELINE, "torque"))), np.float32)


@pytest.fixture(autouse=True)
def importable(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(Path(__file__).parents[1]))


def children() -> set[int]:
    """Processes that this one has started and not waited for, zombies too; none where the system does not tell."""
    tasks = Path(f"/proc/{os.getpid()}/task")
    listed = tasks.iterdir() if tasks.exists() else ()
    return {int(child) for task in listed for child in (task / "children").read_text().split()}


@pytest.fixture(autouse=True)
def nothing_is_left() -> Iterator[None]:
    before = children()
    yield
    gc.collect()
    assert children() <= before


@pytest.mark.slow
def test_scores_are_those_in_process_bit_for_bit(capfd: pytest.CaptureFixture[str]) -> None:
    names = [f"{MODULE}:{name}" for name in ("STIFF", "Counting")]
    inside = run_scenario("everything", {name: find_policy(name) for name in names}, ["brisk"], episodes=2)
    capfd.readouterr()
    policies = {name: Isolated(name) for name in names}
    isolated = run_scenario("everything", policies, ["brisk"], episodes=2)
    for name, one, two in zip(names, inside, isolated, strict=True):
        for score in one.scores:
            assert one.scores[score].tobytes() == two.scores[score].tobytes(), (name, score)
        assert two.conditions.identity is None
    printed = capfd.readouterr()
    assert printed.out == ""
    assert {"to stdout", "from a program"} <= set(printed.err.splitlines())
    for policy in policies.values():
        policy.close()
    with pytest.raises(PolicyError, match="has no process any more"):
        policy.act(OBS)


def test_a_compiled_law_is_clipped_to_the_range_in_its_process_too() -> None:
    with Isolated(f"{MODULE}:Beyond") as policy:
        np.testing.assert_array_equal(policy.act(OBS), [[0.0, 24.0, 3.0, 0.0]] * 3)


def test_a_policy_that_cannot_act_may_be_asked_again() -> None:
    with Isolated(f"{MODULE}:wrong_length") as policy:
        for _ in range(2):
            with pytest.raises(ActionError, match=r"action must have the shape \(3, 4\), got \(3, 3\)"):
                policy.act(OBS)


@pytest.mark.parametrize(
    ("name", "match"),
    [
        ("raises", "has failed: LookupError: no such thing"),
        ("dies", f"has ended its process, with exit status -{int(signal.SIGABRT)}"),
        ("trickles", "must answer within 1 s"),
        ("answers", "has sent something that is not an answer"),
    ],
)
def test_a_policy_that_fails_ends_its_process(name: str, match: str) -> None:
    with Isolated(f"{MODULE}:{name}") as policy:
        policy.timeout = 1.0 if "within 1 s" in match else 60.0
        with pytest.raises(PolicyError, match=f"^policy '{MODULE}:{name}' {match}"):
            policy.act(OBS)
        assert policy.process.poll() is not None
        with pytest.raises(PolicyError, match="has no process any more"):
            policy.act(OBS)


def test_one_that_hangs_takes_what_it_started_with_it() -> None:
    with Isolated(f"{MODULE}:hangs") as policy:
        policy.timeout = 1.0
        with pytest.raises(PolicyError, match="must answer within 1 s"):
            policy.act(OBS)
        group = policy.process.pid
    for _ in range(100):
        try:
            os.killpg(group, 0)
        except ProcessLookupError:
            return
        time.sleep(0.05)
    pytest.fail("there is still a process of the group")


@pytest.mark.parametrize(
    ("name", "match"),
    [
        ("PLANNER", f"'{MODULE}:PLANNER' plans in the simulated worlds and cannot be isolated"),
        ("Refuses", r"^\\x1b\[2J\\u202e owned$"),
    ],
)
def test_an_error_crosses_with_escapes_for_what_no_terminal_should_get(name: str, match: str) -> None:
    with pytest.raises(ParameterError, match=match):
        Isolated(f"{MODULE}:{name}")


@pytest.mark.parametrize(
    ("name", "timeout", "match"),
    [
        ("impedance", 1.0, "name must be a text such as 'package"),
        (len, 1.0, "name must be a text such as 'package"),
        *((f"{MODULE}:STIFF", wrong, r"timeout must lie within \(0, 86400\] s") for wrong in (0.0, float("nan"), "1")),
    ],
)
def test_wrong_arguments_start_no_process(name: Any, timeout: Any, match: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pter_gym.benchmark._isolation._start", None)
    with pytest.raises(ParameterError, match=match):
        Isolated(name, timeout=timeout)


def test_without_an_interpreter_nothing_stays_open(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "executable", "/nowhere/python")
    before = len(list(Path("/dev/fd").iterdir()))
    with pytest.raises(PolicyError, match=r"STIFF': its process cannot be started: .*'/nowhere/python'") as caught:
        Isolated(f"{MODULE}:STIFF")
    assert len(list(Path("/dev/fd").iterdir())) == before, caught


@pytest.mark.slow
def test_the_command_runs_what_a_user_writes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    names = ["impedance", f"{MODULE}:STIFF"]
    command = [
        "benchmark",
        "--scenario",
        "standard",
        "--paces",
        "brisk",
        "--episodes",
        "1",
        "--no-film",
        "--out",
        str(tmp_path),
    ]
    assert cli.main([*command, "--policies", ",".join(names), "--isolated"]) == 0
    assert sorted(run.conditions.policy for run in ResultsFolder(tmp_path).runs()) == sorted(names)
    assert cli.main([*command, "--policies", "free,nowhere:thing", "--isolated"]) == 2
    assert "there is no 'nowhere:thing': No module named 'nowhere'" in capsys.readouterr().err
