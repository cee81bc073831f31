"""The campaign against files, small: it finds nothing, and it finds what there is."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]

pytestmark = [pytest.mark.skipif(sys.platform != "linux", reason="reads /proc/self"), pytest.mark.slow]


def test_damaged_files_of_each_format_are_refused_as_they_should_be() -> None:
    command = [sys.executable, "-m", "tests.campaigns.files", "--variants", "3"]
    found = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert found.returncode == 0, found.stdout + found.stderr
    for name in ("card", "safetensors", "preset", "gains", "episodes", "path (CSV)", "results"):
        assert f"\n| {name} | 3 | " in found.stdout


BAD_READERS: dict[str, tuple[str, str]] = {
    "another error": ("raise KeyError('a')", "KeyError"),
    "code": ("exec('1')", "it does exec"),
    "a process": ("__import__('subprocess').run(['true'])", "it does subprocess.Popen"),
    "time": ("sum(range(3 * 10**7))", "it takes"),
    "memory": ("bytearray(2**29)[::4096].count(1)", "it takes"),
}

PROGRAM = """
import tempfile
from pathlib import Path
from tests.campaigns import files
from tests.campaigns.formats import Format
from pter_gym.errors import DataError
files.MOST_SECONDS = 0.2
path = Path(tempfile.mkdtemp()) / "file"
path.write_text("good " * 20)
def read():
    data = path.read_bytes()
    if data and not data.startswith(b"good good"):
        {bad}
    if data != b"good " * 20:
        raise DataError("refused")
files.formats = lambda _: [Format("one", path, read)]
for found in files.campaign(path.parent, 20, seed=1):
    print(*found.findings, sep="\\n")
"""


@pytest.mark.long
@pytest.mark.parametrize("kind", BAD_READERS)
def test_what_a_reader_should_not_do_is_found(kind: str) -> None:
    bad, told = BAD_READERS[kind]
    command = [sys.executable, "-c", PROGRAM.replace("{bad}", bad)]
    assert told in subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout
