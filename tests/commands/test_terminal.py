"""What is printed comes out whatever the terminal is, and never costs a result."""

import io
import os
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.table import Table

from pter_gym._commands.main import main
from pter_gym._internal.terminal import say, terminal

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


@pytest.mark.skipif(sys.platform == "win32", reason="needs pipes")
def test_a_closed_pipe_is_no_error() -> None:
    read, write = os.pipe()
    os.close(read)
    found = subprocess.run([*PTER, "--help"], stdout=write, stderr=subprocess.PIPE, text=True)
    os.close(write)
    assert found.returncode in (1, 2)
    assert "Traceback" not in found.stderr
    assert "Exception ignored" not in found.stderr


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
