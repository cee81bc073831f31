"""What is printed comes out whatever the terminal is, and never costs a result."""

import errno
import io
import os
import re
import shlex
import subprocess
import sys
import time
from pathlib import Path

import pytest
from hypothesis import given, strategies as st
from rich.cells import cell_len
from rich.console import Console
from rich.table import Table

from pter_gym._commands.main import complain, main
from pter_gym._commands.terminal import progress_bar, say, terminal
from pter_gym._internal.reading import reading
from pter_gym.benchmark.cells import shorten
from pter_gym.errors import DataError

PTER = [sys.executable, "-m", "pter_gym._commands.main"]


class Ascii(io.TextIOWrapper):
    """A terminal that knows letters without accents alone."""

    def __init__(self) -> None:
        super().__init__(io.BytesIO(), encoding="ascii", write_through=True)

    @property
    def shown(self) -> str:
        return self.buffer.getvalue().decode("ascii")  # type: ignore[attr-defined]


def ascii_terminal(monkeypatch: pytest.MonkeyPatch) -> Ascii:
    """Print to an ASCII terminal; pytest restores its own between a fixture and its test."""
    stream = Ascii()
    monkeypatch.setattr("sys.stdout", stream)
    monkeypatch.setattr("sys.stderr", stream)
    return stream


def test_a_terminal_shows_what_it_does_not_know_by_numbers(monkeypatch: pytest.MonkeyPatch) -> None:
    stream = ascii_terminal(monkeypatch)
    say("wrote [/b] τ \udcff.npz")
    assert stream.shown == "wrote [/b] \\u03c4 \\udcff.npz\n"


def test_tables_and_errors_fit_an_ascii_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    stream = ascii_terminal(monkeypatch)
    table = Table("τ \\[s]", title="±5 %")
    table.add_row("θ")
    terminal().print(table)
    assert main(["standärd"]) == 2
    assert "[s]" in stream.shown
    assert "stand\\xe4rd" in stream.shown


@given(st.text(st.characters(exclude_categories=["Cc", "Zl", "Zp"])))
def test_text_is_printed_as_it_is(text: str) -> None:
    stream = io.TextIOWrapper(io.BytesIO(), encoding="utf-8", write_through=True)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("sys.stdout", stream)
        say(text)
    shown = stream.buffer.getvalue()  # type: ignore[attr-defined]
    assert shown.decode() == text.encode(errors="backslashreplace").decode() + "\n"


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
def test_a_full_disk_behind_standard_output_is_reported() -> None:
    with Path("/dev/full").open("w") as full:
        found = subprocess.run([*PTER, "--version"], stdout=full, stderr=subprocess.PIPE, text=True)
    assert found.returncode == 2
    assert found.stderr == "error: not everything could be printed: No space left on device\n"


@pytest.mark.skipif(sys.platform == "win32", reason="needs a shell")
@pytest.mark.parametrize("closed", [">&-", ">&- 2>&-", "<&- >&- 2>&-"])
def test_a_closed_output_is_no_error(closed: str, tmp_path: Path) -> None:
    """The file that is written must not get the number of standard output either."""
    program = (
        "import os, sys; from pter_gym._commands import main;"
        "main.load_command = lambda name: lambda: open('file', 'w') and os.write(1, b'lost');"
        "main.parse = lambda *_: {}; sys.argv = ['pter', 'benchmark']; sys.exit(main.main() - 4)"
    )
    command = f"{shlex.join([sys.executable, '-c', program])} {closed}"
    found = subprocess.run(command, shell=True, cwd=tmp_path, stderr=subprocess.PIPE, text=True)
    assert (found.returncode, found.stderr) == (0, "")
    assert (tmp_path / "file").read_text("utf-8") == ""
    found = subprocess.run(
        f"{shlex.join([*PTER, '--version'])} {closed}", shell=True, stderr=subprocess.PIPE
    )
    assert (found.returncode, found.stderr) == (0, b"")


def test_an_error_of_a_file_is_not_called_one_of_printing(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fill() -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("pter_gym._commands.main.load_command", lambda _: fill)
    assert main(["benchmark"]) == 2
    printed = capsys.readouterr().err
    assert "printed" not in printed
    assert __file__ in printed.replace("\n", "")


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere a folder in use stays")
def test_a_folder_that_is_gone_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "gone").mkdir()
    monkeypatch.chdir(tmp_path / "gone")
    (tmp_path / "gone").rmdir()
    out = str(tmp_path / "out")
    assert main(["benchmark", "--policies", "code:law", "--out", out]) == 2
    assert "current folder" in capsys.readouterr().err


def test_a_name_cannot_send_commands_to_the_terminal(capsys: pytest.CaptureFixture[str]) -> None:
    name = "a\x1b]0;title\x07\x9b31m\r\x08b"
    shown = r"a\x1b]0;title\x07\x9b31m\r\x08b"
    say(name)
    complain(name)
    table = Table("name", box=None)
    table.add_row(name)
    terminal().print(table)
    with reading(name):
        pass
    with pytest.raises(DataError) as error, reading(name):
        raise ValueError("it is damaged")
    printed = capsys.readouterr()
    assert shown in printed.out
    assert shown in printed.err
    assert shown in str(error.value)
    assert not set(printed.out + printed.err + str(error.value)) & set("\x1b\x07\x9b\r\x08")


@pytest.mark.parametrize("name", ["日本語" * 30, "a" * 200])
def test_a_long_name_leaves_room_for_numbers(name: str) -> None:
    assert cell_len(shorten(name, 40)) in (39, 40)
    stream = io.StringIO()
    console = Console(file=stream, width=80, force_terminal=True, color_system=None)
    with progress_bar(console) as progress:
        progress.add_task(name, total=12)
        progress.refresh()
    assert "0/12" in stream.getvalue()


def test_progress_that_is_piped_is_a_line_every_interval(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("pter_gym._commands.terminal.INTERVAL", 0.05)
    with progress_bar() as progress:
        progress.add_task("half", total=4, completed=2)
        lines: list[str] = []
        while len(lines) < 2:
            time.sleep(0.05)
            lines += capsys.readouterr().err.splitlines()
    assert all(re.fullmatch(r"half: 50 %, \d+ s", line) for line in lines)


@pytest.mark.skipif(sys.platform == "win32", reason="needs pipes")
@pytest.mark.parametrize("line", ["--help", "benchmark --help", "--version"])
def test_a_closed_pipe_is_no_error(line: str) -> None:
    read, write = os.pipe()
    os.close(read)
    command = [*PTER, *line.split()]
    found = subprocess.run(command, stdout=write, stderr=subprocess.PIPE, text=True)
    os.close(write)
    assert found.returncode in (1, 2)
    assert found.stderr == ""


@pytest.mark.parametrize("command", ["benchmark", "record"])
def test_folders_are_tried_before_any_work(
    command: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    if command == "record":
        pytest.importorskip("minari")

    monkeypatch.setattr("os.access", lambda *_: False)
    assert main([*command.split(), "--out", str(tmp_path / "out")]) == 2
    printed = capsys.readouterr()
    assert printed.err.startswith("error: out")
