"""A writer that is killed at any moment leaves the old file or the new one, whole."""

import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from pter_gym._internal.files import remove_leftovers, write_bytes_atomic

pytestmark = pytest.mark.skipif(os.name != "posix", reason="sends SIGKILL")

KILLS = 12
SIZE = 2_000_000

WRITER = f"""
import sys
from pter_gym._internal.files import write_bytes_atomic
for number in range(int(sys.argv[2]), 256):
    write_bytes_atomic(sys.argv[1], bytes([number]) * {SIZE})
    print(number, flush=True)
"""
"""Writes a file again and again, each time with another byte."""


def begin(path: Path, first: int) -> "subprocess.Popen[str]":
    """Start a writer, and wait until it has written once."""
    process = subprocess.Popen(
        [sys.executable, "-c", WRITER, path, str(first)], stdout=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    process.stdout.readline()
    return process


def kill(process: "subprocess.Popen[str]", after: float) -> list[int]:
    """Kill a writer after some seconds, and return the numbers that it finished after the first."""
    time.sleep(after)
    process.send_signal(signal.SIGKILL)
    return [int(line) for line in process.communicate()[0].split()]


def byte_of(path: Path) -> int:
    """Return the byte of which a whole file consists."""
    content = path.read_bytes()
    assert len(content) == SIZE
    assert content.count(content[0]) == SIZE
    return content[0]


@pytest.mark.slow
def test_a_killed_writer_leaves_the_old_or_the_new_file(tmp_path: Path) -> None:
    path, rng = tmp_path / "file", random.Random(0)
    for first in range(0, 4 * KILLS, 4):
        finished = kill(begin(path, first), rng.uniform(0.0, 0.02))
        last = finished[-1] if finished else first
        assert byte_of(path) in (last, last + 1)
    leftovers = [each for each in tmp_path.iterdir() if each != path]
    assert all(each.name.startswith(".") for each in leftovers)
    remove_leftovers(tmp_path)
    write_bytes_atomic(path, b"next")
    assert [each.name for each in tmp_path.iterdir()] == ["file"]
