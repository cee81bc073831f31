"""Kernels on the disk: damage is noticed and mended, and a full disk is no reason to fail."""

import hashlib
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba
import pytest

from pter_gym._compiled import pipeline
from pter_gym._compiled.compiler import compile_kernel

pytestmark = pytest.mark.skipif(numba.config.DISABLE_JIT, reason="nothing is compiled")


def build(digest: str) -> Any:
    def kernel(x: float) -> float:
        _ = digest
        return 2.0 * x + 1.0

    return kernel


def run() -> int:
    """Run the kernel as a fresh process does, and return how often it was found on the disk."""
    kernel: Any = compile_kernel(build)
    assert kernel(3.0) == 7.0
    return sum(kernel.stats.cache_hits.values())


@pytest.fixture
def stored(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The file of the kernel."""
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(pipeline, "_told", set[str]())
    monkeypatch.setattr(pipeline, "PATIENCE", 600.0)
    assert run() == 0
    (file,) = tmp_path.rglob("*.nbc")
    return file


def flipped(data: bytes, bit: int) -> bytes:
    changed = bytearray(data)
    changed[bit // 8] ^= 1 << (bit % 8)
    return bytes(changed)


DAMAGE: dict[str, Callable[[bytes], bytes]] = {
    "half": lambda data: data[: len(data) // 2],
    "a bit of the code": lambda data: flipped(data, 4 * len(data)),
    "another kernel": lambda data: hashlib.sha256(b"another\0" + data[32:]).digest() + data[32:],
}


def test_a_whole_file_is_used(stored: Path, caplog: pytest.LogCaptureFixture) -> None:
    before = stored.read_bytes()
    assert run() == 1
    assert stored.read_bytes() == before
    assert caplog.records == []


@pytest.mark.parametrize("kind", DAMAGE)
def test_a_damaged_file_is_told_once_and_compiled_again(
    stored: Path, kind: str, caplog: pytest.LogCaptureFixture
) -> None:
    whole = stored.read_bytes()
    damaged = DAMAGE[kind](whole)
    assert damaged != whole
    stored.write_bytes(damaged)
    assert run() == 0
    (line,) = [record.getMessage() for record in caplog.records]
    assert line.startswith(f"pter_gym: stored code in {stored.parent} is damaged or cannot be read")
    assert stored.read_bytes() != damaged
    assert run() == 1
    assert len(caplog.records) == 1


def test_what_cannot_be_read_is_compiled_in_memory(stored: Path, caplog: pytest.LogCaptureFixture) -> None:
    stored.unlink()
    stored.mkdir()
    assert run() == 0
    assert any("cannot be read" in record.getMessage() for record in caplog.records)


FULL_DISK = """
import resource, signal, sys
import numba
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[1]), resource.RLIM_INFINITY))
from pter_gym._compiled.compiler import compile_kernel

def build(digest):
    def kernel(x):
        digest
        return 2.0 * x + 1.0
    return kernel

kernel = compile_kernel(build)
print(kernel(3.0), kernel(1), sum(kernel.stats.cache_hits.values()))
"""


@pytest.mark.skipif(sys.platform == "win32", reason="needs limits of a process")
def test_a_full_disk_is_told_and_nothing_is_left_half_written(tmp_path: Path) -> None:
    """A limit on the size of files stands for the disk."""
    script = tmp_path / "script.py"
    script.write_text(FULL_DISK)
    settings = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    for _ in range(2):
        found = subprocess.run(
            [sys.executable, str(script), "1000"], capture_output=True, text=True, check=False, env=settings
        )
        assert found.stdout == "7.0 3.0 0\n", found.stderr
        (line,) = [line for line in found.stderr.splitlines() if line.startswith("pter_gym: compiled code")]
        assert "cannot be stored in" in line
        assert [path for path in (tmp_path / "cache").rglob("*") if path.is_file()] == []
