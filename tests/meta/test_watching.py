"""The page on watching: its commands are accepted, its code runs, and it names what there is."""

import re
import shlex
from pathlib import Path

import pytest

from documents import ROOT, blocks_of, run_program
from pter_gym.benchmark.naming import is_built_in
from pter_gym.commands import watch as command
from pter_gym.commands.main import main
from pter_gym.render.viewer import MOST_WORLDS
from pter_gym.scenarios import PACES, SCENARIOS

PAGE = ROOT / "docs" / "watching.md"
TEXT = PAGE.read_text("utf-8")
COMMANDS = [shlex.split(line)[1:] for line in re.findall(r"^    (pter .*)$", TEXT, re.MULTILINE)]
TABLES = [given for given in COMMANDS if "--csv" in given]
READ_TABLES = [block for block in blocks_of(PAGE) if "both." in block]


class Reached(Exception):
    """A command was accepted up to the simulation."""


def test_the_page_has_commands_and_code():
    assert len(COMMANDS) >= 6
    assert len(READ_TABLES) == len(TABLES) == 2


@pytest.mark.parametrize("given", COMMANDS, ids=" ".join)
def test_a_command_is_accepted(given: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    pytest.importorskip("pygame")
    pytest.importorskip("imageio_ffmpeg")

    def stop(*_: object) -> None:
        raise Reached

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("pter_gym.render.window.has_display", lambda: True)
    monkeypatch.setattr(command, "simulate", stop)
    with pytest.raises(Reached):
        main(given)


def test_tables_are_read_as_the_page_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("pter_gym.benchmark.simulation.time_limit", lambda _: 20)
    for given in TABLES:
        assert main(given) == 0
    for block in READ_TABLES:
        if "pandas" not in block:
            run_program([block], str(PAGE))
    assert re.search(r"voltage of clutch 1: up to \d+\.\d V\nwork of the hand: \d+\.\d\d J\n", capsys.readouterr().out)


def test_pandas_reads_the_table_as_the_page_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    pytest.importorskip("pandas")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("pter_gym.benchmark.simulation.time_limit", lambda _: 20)
    assert main(TABLES[0]) == 0
    run_program([block for block in READ_TABLES if "pandas" in block], str(PAGE))
    assert re.search(r"residual +\d", capsys.readouterr().out)


@pytest.mark.long
def test_the_whole_page_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    for module in ("pygame", "moviepy", "pandas"):
        pytest.importorskip(module)
    monkeypatch.chdir(tmp_path)
    for given in (each for each in COMMANDS if "--out" in each or "--csv" in each):
        assert main(given) == 0
        assert (tmp_path / given[-1]).exists() or (tmp_path / given[given.index("--out") + 1]).exists()
    run_program(blocks_of(PAGE), str(PAGE))
    assert [path.suffix for folder in ("videos", "grids") for path in (tmp_path / folder).iterdir()] == [".mp4"] * 2


def test_the_page_names_what_there_is():
    for name in (*SCENARIOS, *PACES):
        assert f"`{name}`" in TEXT
    assert f"at most {MOST_WORLDS} worlds" in TEXT
    assert f"Up to {command.MOST_POLICIES} fit" in TEXT
    policies = next(paragraph for paragraph in TEXT.split("\n\n") if paragraph.startswith("Policies are those"))
    named = re.findall(r"`([a-z-]+)`", policies)
    assert all(is_built_in(name) for name in named if name != "-tuned")
