"""The campaign against files, small: it finds nothing, and it finds what there is."""

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from random import Random
from typing import Any

import pytest

from campaigns import corruption

ROOT = Path(__file__).parents[1]
LINUX = pytest.mark.skipif(sys.platform != "linux", reason="reads /proc/self")


@LINUX
@pytest.mark.slow
def test_damaged_files_of_each_format_are_refused_as_they_should_be() -> None:
    command = [sys.executable, "-m", "tests.campaigns.files", "--variants", "12"]
    found = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert found.returncode == 0, found.stdout + found.stderr
    for name in ("card", "safetensors", "preset", "gains", "episodes", "path (CSV)", "results"):
        assert f"\n| {name} | 12 | " in found.stdout


BAD_READERS: dict[str, tuple[str, str]] = {
    "another error": ("raise KeyError('a')", "KeyError"),
    "code": ("exec('1')", "it does exec"),
    "a file written": ("open(file + '.more', 'w').close()", "it does open"),
    "a process": ("__import__('subprocess').run(['true'])", "it does subprocess.Popen"),
    "a socket": ("__import__('socket').socket().close()", "it does socket"),
    "time": ("sum(range(3 * 10**7))", "it takes"),
    "memory": ("bytearray(2**29)[::4096].count(1)", "it takes"),
}

PROGRAM = """
import sys, tempfile
from pathlib import Path
from tests.campaigns import files
from tests.campaigns.formats import Format
from pter_gym.errors import DataError
files.MOST_SECONDS = 0.2
folder = Path(tempfile.mkdtemp())
path = folder / "file"
path.write_text("good " * 20)
file = str(path)
def read():
    data = path.read_bytes()
    if data and not data.startswith(b"good good"):
        {bad}
        raise DataError("refused")
    if data != b"good " * 20:
        raise DataError("refused")
files.formats = lambda _: [Format("one", path, read)]
for found in files.campaign(folder, 20, seed=1):
    print(*found.findings, sep="\\n")
"""


@LINUX
@pytest.mark.slow
@pytest.mark.parametrize("kind", BAD_READERS)
def test_what_a_reader_should_not_do_is_found(kind: str) -> None:
    bad, told = BAD_READERS[kind]
    program = PROGRAM.replace("{bad}", bad)
    found = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=True)
    assert told in found.stdout


CHANGES: list[Callable[[bytes, Random], bytes]] = sorted(set(corruption.CHANGES), key=lambda change: change.__name__)


@pytest.mark.parametrize("change", CHANGES, ids=lambda change: change.__name__)
def test_each_damage_changes_something_and_follows_from_its_seed(change: Any) -> None:
    data = b'{"name": "some", "numbers": [1.5, 2, 3e4],\n "more": {"a": true}}' * 3
    found = [change(data, Random(seed)) for seed in range(30)]
    assert sum(each != data for each in found) > 15
    assert found == [change(data, Random(seed)) for seed in range(30)]
    for seed in range(10):
        change(b"", Random(seed))
