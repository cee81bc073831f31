"""One process at a time writes what others write too: each command waits for the lock."""

import errno
import logging
import os
import subprocess
import sys
import threading
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any
from unittest.mock import patch

import pytest

from pter_gym._internal import locks
from pter_gym._internal.files import write_files_atomic
from pter_gym._internal.locks import LOCK, lock_beside, locked
from pter_gym.benchmark import ResultsFolder

FILES = {"machine.toml": b"one", "identified.png": b"two"}


def write_results(folder: Path) -> None:
    ResultsFolder(folder).summarise()


def write_gains(folder: Path) -> None:
    gains_file = pytest.importorskip("pter_gym.tools.tuning.gains_file")
    search = pytest.importorskip("pter_gym.tools.tuning.search")
    from pter_gym.benchmark.rollout import Assessment

    scores = Assessment(0.0, 1.0, 0.0, 0.0)
    found = search.TunedGains("impedance", "standard", "slow", {}, scores, 1, 1, 0)
    gains_file.add_gains(found, folder / "gains.toml")


WRITERS: dict[str, tuple[Callable[[Path], object], Callable[[Path], Path]]] = {
    "several files": (lambda folder: write_files_atomic(folder, FILES), lock_beside),
    "results": (write_results, lambda folder: folder / LOCK),
    "gains": (write_gains, lambda folder: lock_beside(folder / "gains.toml")),
}


@pytest.mark.parametrize(("write", "lock"), WRITERS.values(), ids=WRITERS)
def test_a_writer_waits_for_the_one_before(write: Any, lock: Any, tmp_path: Path) -> None:
    with locked(lock(tmp_path)):
        writer = threading.Thread(target=write, args=(tmp_path,))
        writer.start()
        writer.join(0.5)
        assert writer.is_alive()
        assert not {path.name for path in tmp_path.iterdir()} & {*FILES, "benchmark.json"}
    writer.join(60.0)
    assert not writer.is_alive()
    assert [path for path in tmp_path.iterdir() if not path.name.startswith(".")]


@pytest.mark.parametrize("code", [errno.ENOLCK, errno.EOPNOTSUPP, errno.EINVAL, errno.ENOSYS])
@pytest.mark.parametrize("write", [write for write, _ in WRITERS.values()], ids=WRITERS)
def test_a_folder_without_locks_is_written_with_a_warning(
    write: Any, code: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As on NFS, Lustre and FUSE, whose servers may have none."""
    fcntl = pytest.importorskip("fcntl")

    def flock(*_: object) -> None:
        raise OSError(code, os.strerror(code))

    monkeypatch.setattr(fcntl, "flock", flock)
    locks.tell_once.cache_clear()
    with (
        patch.object(logging.getLogger("pter_gym"), "warning") as warning,
        warnings.catch_warnings(),
    ):
        warnings.simplefilter("ignore")  # filelock's own, where it has another kind of lock
        write(tmp_path)
    assert warning.called == (code != errno.ENOSYS)
    assert [path for path in tmp_path.iterdir() if not path.name.startswith(".")]


RECORD = """
import sys
import numpy as np
from pter_gym.tools.datasets import writing
from pter_gym.tools.datasets.recording import RecordedEpisode

writing.reference_score = lambda *_: 0.0
n = int(sys.argv[2])
episode = RecordedEpisode(
    0, np.zeros((n + 1, 24), np.float32), np.zeros((n, 4), np.float32), np.zeros(n),
    np.zeros(n, bool), np.ones(n, bool), arrived=False, distance=0.0,
)
print(flush=True)
for _ in range(8):
    writing.write_dataset("standard", "random", [episode], sys.argv[1], seed=0, command="")
"""


def test_two_records_into_one_data_set_leave_a_whole_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    minari = pytest.importorskip("minari")
    pytest.importorskip("h5py")
    writing = pytest.importorskip("pter_gym.tools.datasets.writing")
    command = [sys.executable, "-c", RECORD, str(tmp_path), "5"]
    other = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert other.stdout is not None
    monkeypatch.setattr(writing, "reference_score", None)
    monkeypatch.setattr(sys, "argv", ["", str(tmp_path), "9"])
    other.stdout.readline()  # it has begun to write
    exec(RECORD, {})
    assert (other.communicate()[1][-500:], other.returncode) == ("", 0)
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    assert minari.load_dataset("pter/standard/random-v0").total_steps in (5, 9)
    assert not list((tmp_path / "pter/standard").glob(".random-v0/*"))


def test_a_data_set_is_there_again_after_a_kill_between_old_and_new(tmp_path: Path) -> None:
    pytest.importorskip("minari")
    from pter_gym.errors import StorageError
    from pter_gym.tools.datasets.writing import replacing

    target = tmp_path / "set"
    with replacing(target) as new:
        (new / "data").write_text("first")
    (tmp_path / ".set").mkdir()
    target.rename(tmp_path / ".set" / "old")  # as a killed process leaves it

    def fail() -> None:
        with replacing(target):
            assert (target / "data").read_text() == "first"
            raise OSError(28, "No space left on device")

    with pytest.raises(StorageError):
        fail()
    assert (target / "data").read_text() == "first"
    assert [*tmp_path.iterdir()] == [target]
