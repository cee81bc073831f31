"""``pter speed``: what it writes, and what it does without its peers. No test looks at how fast it is."""

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from pter_gym._commands import main as cli
from pter_gym.tools.speed import Plan, make_plan
from pter_gym.tools.speed import ours as own
from pter_gym.tools.speed.ours import (
    Skipped,
)
from pter_gym.tools.speed.peers import (
    ENVPOOL,
    REACHER,
    ROLLOUT,
    ROLLOUT_SOFT,
    ROLLOUT_WHOLE,
    Kind,
    measure_peer,
    peers,
)
from pter_gym.tools.speed.timing import Effort, Load, block_rate, compare, rate

FIELDS = {
    "environment",
    "plan",
    "machine",
    "versions",
    "substeps_per_step",
    "all_threads",
    "one_thread",
    "cuda",
    "single_steps",
    "peers",
    "skipped",
}
SHORT = Effort(0.0, 1)


def nothing() -> None:
    """What a load without work does."""


OURS = dict.fromkeys(Kind, Load(nothing, 1, nothing))


def short_plan(**given: Any) -> Plan:
    """What was asked for, each rate measured by one call."""
    return replace(make_plan(**given), rates=SHORT, comparisons=SHORT, single_steps=10, single_rounds=1)


@pytest.fixture(scope="module")
def quick(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    """A quick run of the command without EnvPool: its folder and its JSON."""
    out = tmp_path_factory.mktemp("speed")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("pter_gym.tools.speed.make_plan", short_plan)
        patch.setitem(sys.modules, "envpool", None)
        assert cli.main(["speed", "--quick", "--max-worlds", "256", "--out", str(out)]) == 0
    return out, json.loads((out / "speed.json").read_text(encoding="utf-8"))


@pytest.mark.slow
def test_quick_run_writes_numbers_and_a_picture(quick: tuple[Path, dict[str, Any]]):
    out, content = quick
    assert set(content) == FIELDS
    assert [path.name for path in sorted(out.iterdir())] == ["speed.json", "speed.pdf", "speed.png"]
    assert content["machine"]["cores"] >= 1
    assert {"python", "pter-gym", "gymnasium", "numpy", "numba"} <= set(content["versions"])
    for sweep_of in ("all_threads", "one_thread"):
        rows = content[sweep_of]["rows"]
        assert [row["worlds"] for row in rows] == [1, 16, 256]
        assert all(row["steps_per_second"] * row["nanoseconds_per_step"] == pytest.approx(1e9) for row in rows)
    assert content["all_threads"]["bytes_per_world"] > 0.0


@pytest.mark.slow
def test_quick_run_names_peers_and_what_is_skipped(quick: tuple[Path, dict[str, Any]]):
    _, content = quick
    skipped = {row["what"]: row["why"] for row in content["skipped"]}
    assert "not installed" in skipped[ENVPOOL]
    assert skipped["1,000,000 worlds"] == "a quick run"
    found = {row["name"]: row for row in content["peers"]}
    assert {ROLLOUT, ROLLOUT_WHOLE, ROLLOUT_SOFT, REACHER} <= set(found)
    for row in found.values():
        assert row["version"][0].isdigit()
        assert row["our_worlds"] == 256
        assert row["ratio"] > 0.0
    assert [row["peer"] for row in content["single_steps"]] == ["CartPole-v1", "Reacher-v5"]


@pytest.mark.parametrize("module", ["mujoco", "envpool"])
def test_missing_peer_is_named(monkeypatch: pytest.MonkeyPatch, module: str):
    monkeypatch.setitem(sys.modules, module, None)
    missing = [peer for peer in peers(quick=True) if module in peer.modules]
    assert missing
    for peer in missing:
        found = measure_peer(peer, OURS, 1, SHORT)
        assert isinstance(found, Skipped)
        assert found.what == peer.name
        assert "not installed" in found.why
        assert module in found.why


def test_without_a_device_cuda_is_named(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("NUMBA_ENABLE_CUDASIM", "1")
    found = own.cuda([1], SHORT)
    assert isinstance(found, Skipped)
    assert found.what == "CUDA device"


@pytest.mark.gpu
def test_a_device_is_measured(monkeypatch: pytest.MonkeyPatch):
    """In numba's simulator: whether it runs."""
    pytest.importorskip("numba_cuda")
    program = """
from pter_gym.tools.speed import ours
ours._CUDA_STEPS = 2
found = ours.measure_device([1, 3, 10**9], ours.Effort(0.0, 1))
print([row.worlds for row in found.rows], found.compile_seconds > 0.0, found.overhead_microseconds > 0.0)
print([row.what for row in found.skipped])
"""
    monkeypatch.setenv("NUMBA_ENABLE_CUDASIM", "1")
    monkeypatch.setenv("NUMBA_DISABLE_JIT", "1")
    found = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert found.stdout == "[1, 3] True True\n['1,000,000,000 worlds on the CUDA device']\n"


class Clock:
    """A clock that moves when a load is called."""

    now = 0.0

    def load(self, seconds: float, steps: int) -> Load:
        def call() -> None:
            self.now += seconds

        return Load(call, steps, nothing)


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    found = Clock()
    monkeypatch.setattr("time.perf_counter", lambda: found.now)
    return found


def test_rates_are_steps_over_seconds(clock: Clock):
    load = clock.load(0.25, 100)
    assert block_rate(load, 1.0) == 400.0
    assert clock.now == 1.0
    assert block_rate(load, 0.0) == 400.0
    assert rate(load, Effort(0.5, 3)) == 400.0


def test_comparison_is_ours_over_the_peer(clock: Clock):
    found = compare(clock.load(0.25, 100), clock.load(0.5, 20), Effort(1.0, 3))
    assert (found.rate, found.peer_rate, found.ratio) == (400.0, 40.0, 10.0)
