"""The campaign that kills, starves and crowds the commands that write: it finds faults, and none in good jobs."""

import random
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from campaigns import kill
from campaigns.jobs import Job, digests
from campaigns.kill import Campaign
from pter_gym._internal.files import write_bytes_atomic
from pter_gym._internal.locks import locked
from pter_gym.errors import StorageError

if not kill.can_trace():
    pytest.skip("needs strace, and the right to trace", allow_module_level=True)

ROOT = Path(__file__).parents[2]
CONTENT = b"0123456789" * 20_000


def atomic(folder: Path) -> int:
    """A good job: two files, one after the other."""
    try:
        for name in ("one", "two"):
            time.sleep(0.05)
            write_bytes_atomic(folder / name, CONTENT)
    except StorageError as error:
        print(f"error: {error}")  # noqa: T201
        return 2
    return 0


def torn(folder: Path) -> int:
    """Write a file bit by bit."""
    with (folder / "one").open("wb", buffering=0) as file:
        for k in range(0, len(CONTENT), 10_000):
            time.sleep(0.001)
            file.write(CONTENT[k : k + 10_000])
    return 0


def raw(folder: Path) -> int:
    """Do not expect that a disk is full."""
    write_bytes_atomic(folder / "one", CONTENT)
    return 0


def unlucky(folder: Path) -> int:
    """Give other results where something is there already."""
    write_bytes_atomic(folder / "one", b"other" if (folder / "one").exists() else CONTENT)
    return 0


def alone(folder: Path) -> int:
    """Fail where another one is at work, and say nothing."""
    with locked(folder / ".lock", busy="busy"):
        return atomic(folder)


def campaign(work: Callable[[Path], int], folder: Path) -> Campaign:
    return Campaign("job", Job(work, digests, digests), random.Random(0), folder)


def test_a_good_job_has_no_faults(tmp_path: Path) -> None:
    good = campaign(atomic, tmp_path)
    good.kill(4)
    good.fill()
    good.crowd(2)
    assert good.faults == []
    assert good.counts["killed: killed"] == 4
    assert good.counts["full: told"] >= 1
    assert good.counts["same results"] >= 5


@pytest.mark.long
@pytest.mark.parametrize(
    ("work", "trouble", "fault"),
    [
        (torn, "kill", "is not what it is undisturbed"),
        (raw, "fill", "Traceback"),
        (unlucky, "kill", "results differ"),
        (alone, "crowd", "status 70"),
    ],
    ids=lambda value: getattr(value, "__name__", None),
)
def test_faults_are_found(work: Callable[[Path], int], trouble: str, fault: str, tmp_path: Path) -> None:
    bad = campaign(work, tmp_path)
    for _ in range(20):
        getattr(bad, trouble)(2)
    assert any(fault in found for found in bad.faults), bad.faults


def run(*arguments: str) -> str:
    """Return what the campaign prints; it must end well."""
    command = [sys.executable, "-m", "tests.campaigns.kill", *arguments]
    found = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert found.returncode == 0, found.stdout + found.stderr
    return found.stdout


@pytest.mark.long
@pytest.mark.agents
def test_a_training_in_trouble() -> None:
    pytest.importorskip("stable_baselines3")
    assert "| train | 2 |" in run("--names", "train", "--kills", "2", "--fills", "1", "--crowds", "1")


@pytest.mark.long
@pytest.mark.agents
def test_all_commands_in_trouble() -> None:
    pytest.importorskip("stable_baselines3")
    pytest.importorskip("optuna")
    printed = run("--kills", "70", "--crowds", "14")
    for job in ("train", "export", "tune", "benchmark", "record", "fit", "reproduce"):
        assert f"| {job} | 10 |" in printed
