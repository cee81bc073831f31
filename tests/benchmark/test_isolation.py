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

from benchmark.isolated_policies import TOLD
from pter_gym.benchmark import Isolated, ResultsFolder, find_policy, read_policy, run_scenario
from pter_gym.benchmark.identity import identity_of
from pter_gym.benchmark.simulation import AnyPolicy
from pter_gym.commands import main as cli
from pter_gym.controllers import bind
from pter_gym.engine.batch import Batch
from pter_gym.errors import ActionError, ParameterError, PolicyError
from pter_gym.params import BASELINE
from pter_gym.policies import SHIPPED
from pter_gym.tasks.path_following import PathFollowing, observation_layout

MODULE = "isolated_policies"
LAYOUT = observation_layout(BASELINE, "torque")
OBS = np.zeros((3, len(LAYOUT)), np.float32)


def content_of(policy: AnyPolicy) -> str | None:
    """What the benchmark takes a policy for."""
    return identity_of(policy, bind(policy, BASELINE, LAYOUT))


@pytest.fixture(autouse=True)
def importable(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(Path(__file__).parent))


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


NAMES = (
    "impedance",
    "torque-feedback-tuned",
    "random",
    "ppo-standard",
    f"{SHIPPED}/residual.json",
    f"{MODULE}:STIFF",
    f"{MODULE}:halves",
    f"{MODULE}:Counting",
)


@pytest.mark.slow
def test_scores_are_those_in_process_bit_for_bit(capfd: pytest.CaptureFixture[str]) -> None:
    inside = run_scenario("everything", {name: read_policy(name) for name in NAMES}, ["brisk"], episodes=3)
    capfd.readouterr()
    policies = {name: Isolated(name) for name in NAMES}
    isolated = run_scenario("everything", policies, ["brisk"], episodes=3)
    for name, one, two in zip(NAMES, inside, isolated, strict=True):
        for score in one.scores:
            assert one.scores[score].tobytes() == two.scores[score].tobytes(), (name, score)
        assert two.conditions.identity == (None if ":" in name else one.conditions.identity)
    printed = capfd.readouterr()
    assert printed.out == ""
    assert {"a new episode", "from a program"} <= set(printed.err.splitlines())
    for policy in policies.values():
        policy.close()


def test_no_world_can_be_found_in_its_process() -> None:
    held = np.full((1, 4), 24.0)
    batch = Batch(BASELINE, PathFollowing(), 1)
    assert bind(read_policy(f"{MODULE}:Peeking"), BASELINE, batch.layout)(OBS[:1]).tolist() == held.tolist()
    with Isolated(f"{MODULE}:Peeking") as policy:
        assert policy.bind(BASELINE, LAYOUT)(OBS[:1]).tolist() == (0.0 * held).tolist()


def test_bindings_remember_apart_and_take_any_number_of_worlds() -> None:
    with Isolated(f"{MODULE}:Counting") as policy:
        assert policy.sensors == "force"
        layout = observation_layout(BASELINE, "force")
        rows = np.zeros((5000, len(layout)), np.float32)
        bound = policy.bind(BASELINE, layout)
        bound.reset()
        assert [bound.act(rows[:count])[-1, 3] for count in (1, 7, 5000)] == pytest.approx([0.1, 0.2, 0.3])
        bound.reset()
        np.testing.assert_array_equal(bound.act(rows[:2]), np.full((2, 4), 0.1, np.float32))
    with Isolated("impedance") as policy:
        one, two = (policy.bind(BASELINE, LAYOUT) for _ in range(2))
        assert one.act(OBS).tobytes() == two.act(OBS).tobytes()


def test_a_laws_voltages_beyond_the_range_are_clipped_as_in_the_kernel() -> None:
    with Isolated(f"{MODULE}:Beyond") as policy:
        assert policy.bind(BASELINE, LAYOUT)(OBS[0]).tolist() == [0.0, 24.0, 3.0, 0.0]


@pytest.mark.parametrize(
    ("name", "kind", "match"),
    [
        (f"{MODULE}:wrong_length", ActionError, r"action must have the shape \(3, 4\), got \(3, 3\)"),
        (f"{MODULE}:transposed", ActionError, r"action must have the shape \(3, 4\), got \(4, 3\)"),
        (f"{MODULE}:flat", ActionError, r"action must have the shape \(N, 4\), got \(12,\)"),
        (f"{MODULE}:words", ActionError, "action must hold real numbers"),
        (f"{MODULE}:raises", PolicyError, f"'{MODULE}:raises' has failed: LookupError: no such thing"),
        (f"{MODULE}:leaves", PolicyError, f"'{MODULE}:leaves' has failed: SystemExit: 3"),
        (f"{MODULE}:dies", PolicyError, f"exit status -{int(signal.SIGABRT)}"),
        (f"{MODULE}:hangs", PolicyError, f"'{MODULE}:hangs' must answer within 1 s"),
        (f"{MODULE}:babbles", PolicyError, f"'{MODULE}:babbles'"),
    ],
)
def test_a_fault_in_a_decision_is_told_by_name(name: str, kind: type[Exception], match: str) -> None:
    with Isolated(name) as policy:
        bound = policy.bind(BASELINE, LAYOUT)
        policy._session.timeout = 1.0 if "must answer" in match or "babbles" in name else 60.0
        with pytest.raises(kind, match=match):
            bound.act(OBS)


@pytest.mark.parametrize(
    ("name", "kind", "ends"),
    [
        ("raises", PolicyError, True),
        ("leaves", PolicyError, True),
        ("wrong_length", ActionError, True),
        ("flat", ActionError, False),
        ("words", ActionError, False),
    ],
)
def test_a_fault_ends_the_process_unless_it_can_go_on(name: str, kind: type[Exception], ends: bool) -> None:
    with Isolated(f"{MODULE}:{name}") as policy:
        bound = policy.bind(BASELINE, LAYOUT)
        with pytest.raises(kind):
            bound.act(OBS)
        assert (policy._session.process.poll() is not None) == ends
        with pytest.raises(PolicyError if ends else kind, match="has no process any more" if ends else "action must"):
            bound.act(OBS)


@pytest.mark.parametrize("told", [told for told in TOLD if told != "a fault for terminals"])
def test_an_answer_of_a_policys_own_is_refused_by_its_name(told: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TOLD", told)
    with pytest.raises(PolicyError, match=f"^policy '{MODULE}:Tells': its answer is none$"):
        Isolated(f"{MODULE}:Tells")


def test_a_message_for_terminals_is_escaped(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TOLD", "a fault for terminals")
    with pytest.raises(ParameterError, match=r"^\\x1b\[2J\\u202e owned$"):
        Isolated(f"{MODULE}:Tells")


@pytest.mark.parametrize("name", ["not_a_number", "too_much"])
def test_what_is_no_voltage_is_refused_as_everywhere(name: str) -> None:
    with (
        Isolated(f"{MODULE}:{name}") as policy,
        pytest.raises(ActionError, match=r"action of world 0 must be finite and within \[0, 24\]"),
    ):
        run_scenario("standard", {"wrong": policy}, ["brisk"], episodes=1)


@pytest.mark.parametrize(
    ("name", "match"),
    [
        ("nowhere.at_all:thing", "there is no 'nowhere.at_all:thing': No module named 'nowhere'"),
        (f"{MODULE}:nothing", f"there is no '{MODULE}:nothing': module"),
        (f"{MODULE}:", f"there is no '{MODULE}:'"),
        (f"{MODULE}:MODULES.x", f"there is no '{MODULE}:MODULES.x'"),
        ("impedanze", "got 'impedanze'; did you mean 'impedance'"),
        ("some/where.json", "there is no exported policy 'some/where.json'"),
        ("predictive", "'predictive' plans in the simulated worlds and cannot be isolated"),
        (f"{MODULE}:PLANNER", f"'{MODULE}:PLANNER' plans in the simulated worlds"),
        (f"{MODULE}:Needy", f"'{MODULE}:Needy' must be made without arguments: Needy"),
        ("os:sep", "policy must have a method bind or be callable, got '/'"),
    ],
)
def test_what_cannot_be_found_is_named_as_it_was_written(name: str, match: str) -> None:
    with pytest.raises(ParameterError, match=match):
        Isolated(name)


@pytest.mark.parametrize("timeout", [0.0, -1.0, float("nan"), float("inf"), "10"])
def test_a_timeout_is_a_time(timeout: float) -> None:
    with pytest.raises(ParameterError, match=r"timeout must lie within \(0, 86400\] s"):
        Isolated("free", timeout=timeout)


@pytest.mark.parametrize(
    ("wrong", "match"),
    [
        ({"seed": "a"}, "seed must be a whole number ≥ 0, got 'a'"),
        ({"seed": 1.5}, "seed must be a whole number ≥ 0, got 1.5"),
        ({"seed": -1}, "seed must be a whole number ≥ 0, got -1"),
        ({"scenario": 3}, "scenario must be the name of one, got 3"),
    ],
)
def test_wrong_arguments_start_no_process(wrong: dict[str, Any], match: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pter_gym.benchmark.isolation.Session", None)
    with pytest.raises(ParameterError, match=match):
        Isolated("impedance", **wrong)


def test_without_an_interpreter_nothing_stays_open(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "executable", "/nowhere/python")
    before = len(list(Path("/dev/fd").iterdir()))
    with pytest.raises(PolicyError, match=r"'free': its process cannot be started: .*'/nowhere/python'") as caught:
        Isolated("free")
    assert len(list(Path("/dev/fd").iterdir())) == before, caught


def test_a_policy_is_named_and_not_given() -> None:
    with pytest.raises(ParameterError, match="name must be a text such as 'package"):
        Isolated(find_policy("free"))  # type: ignore[arg-type]


def test_a_closed_one_says_so() -> None:
    policy = Isolated("free")
    bound = policy.bind(BASELINE, LAYOUT)
    policy.close()
    policy.close()
    with pytest.raises(PolicyError, match="'free' has no process any more"):
        bound.act(OBS)


def test_one_that_hangs_takes_what_it_started_with_it() -> None:
    with Isolated(f"{MODULE}:hangs") as policy:
        bound = policy.bind(BASELINE, LAYOUT)
        policy._session.timeout = 1.0
        with pytest.raises(PolicyError):
            bound.act(OBS)
        group = policy._session.process.pid
    for _ in range(100):
        try:
            os.killpg(group, 0)
        except ProcessLookupError:
            return
        time.sleep(0.05)
    pytest.fail("there is still a process of the group")


@pytest.mark.parametrize("name", [".foo:bar", "a-b:bar", "os:", ":sep", "os:path:sep", "os..path:sep", "os:sep\n"])
def test_code_is_written_as_package_module_attribute(name: str) -> None:
    with pytest.raises(ParameterError, match=r"code must be written as package\.module:attribute") as caught:
        read_policy(name)
    assert f"there is no {name!r}" in str(caught.value)


@pytest.mark.slow
def test_the_command_runs_what_a_user_writes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    names = ["impedance", f"{SHIPPED}/residual", f"{MODULE}:STIFF"]
    command = ["benchmark", "--scenario", "standard", "--paces", "brisk", "--episodes", "2", "--policies"]
    found = []
    for extra in ([], ["--isolated"]):
        out = tmp_path / f"out{len(extra)}"
        assert cli.main([*command, ",".join(names), "--out", str(out), *extra]) == 0
        runs = {run.conditions.policy: run for run in ResultsFolder(out).runs()}
        assert sorted(runs) == sorted(names)
        found.append({name: run.scores["path_error_m"].tolist() for name, run in runs.items()})
    assert found[0] == found[1]
    capsys.readouterr()
    assert cli.main([*command, "free,nowhere:thing", "--isolated", "--out", str(tmp_path / "none")]) == 2
    assert "there is no 'nowhere:thing'" in capsys.readouterr().err
    assert cli.main(["benchmark", "--isolated", "--out", str(tmp_path / "none")]) == 2
    assert "isolated needs --scenario" in capsys.readouterr().err


@pytest.mark.parametrize("ending", ["", ".json", ".safetensors"])
def test_an_exported_policy_is_found_by_its_path(ending: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for path in SHIPPED.glob("residual.*"):
        (tmp_path / path.name).write_bytes(path.read_bytes())
    shipped = find_policy("residual")
    for name in (f"{tmp_path}/residual{ending}", f"./residual{ending}"):
        monkeypatch.chdir(tmp_path)
        assert content_of(find_policy(name)) == content_of(shipped)
    if ending:
        assert content_of(find_policy(f"residual{ending}")) == content_of(shipped)
    with pytest.raises(ParameterError, match=rf"there is no exported policy './resi{ending}': no resi.json"):
        find_policy(f"./resi{ending}")
