"""``pter watch``: what it writes, what it says, what it refuses before it simulates."""

import csv
import os
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from pter_gym._commands.main import main
from pter_gym.benchmark import find_policy
from pter_gym.benchmark.rollout import record_episode
from pter_gym.scenarios import find_scenario


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_policies_side_by_side_and_their_table(here: Path, capsys: pytest.CaptureFixture[str]):
    arguments = ["--scenario", "hands", "--pace", "brisk", "--seed", "2"]
    files = ["--out", "end.png", "--csv", "both.csv", "--size", "640", "240"]
    assert main(["watch", "torque-feedback,residual", *arguments, *files]) == 0
    said = capsys.readouterr().out
    for part in (
        "torque-feedback: arrived after",
        "residual: arrived after",
        "wrote end.png",
        "wrote both.csv",
    ):
        assert part in said
    with Image.open(here / "end.png") as picture:
        assert picture.size == (640, 240)
    ((machine, task),) = find_scenario("hands").draws.pairs(1, 2, "brisk")
    policy = find_policy("torque-feedback", scenario="hands")
    expected = record_episode(policy, machine, task, 2).telemetry
    with (here / "both.csv").open(newline="", encoding="utf-8") as file:
        head, *rows = csv.reader(file)
    assert head[:3] == ["policy", "time [s]", "theta_a [rad]"]
    assert sorted({row[0] for row in rows}) == ["residual", "torque-feedback"]
    first = [[float(value) for value in row[1:]] for row in rows if row[0] == "torque-feedback"]
    np.testing.assert_array_equal(first, expected)


@pytest.mark.parametrize(
    ("arguments", "field"),
    [
        (["free", "--out", "x.avi"], "out"),
        (["free", "--out", "nowhere/x.mp4"], "out"),
        (["free", "--csv", "x.xlsx"], "csv"),
        (["free", "--csv", "x.csv", "--size", "10", "10"], "width"),
        (["free", "--csv", "x.csv", "--speed", "nan"], "speed"),
        (["free", "--csv", "x.csv", "--seed", "-1"], "seed"),
        (["free,impedence", "--csv", "x.csv"], "impedence"),
        ([",".join(f"p{k}" for k in range(17)), "--csv", "x.csv"], "policies"),
    ],
)
def test_a_wrong_argument_is_named(
    here: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    arguments: list[str],
    field: str,
):
    monkeypatch.setattr(
        "pter_gym.benchmark.rollout.record_episode", lambda *_: pytest.fail("it simulates first")
    )
    assert main(["watch", *arguments]) == 2
    assert field in capsys.readouterr().err.lower()
    assert not list(here.iterdir())


@pytest.mark.usefixtures("here")
def test_a_window_shows_the_film_where_there_is_a_display(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    pytest.importorskip("pygame")
    shown: list[tuple[object, ...]] = []
    monkeypatch.setattr(
        "pter_gym.tools.pictures.film.show_film", lambda *given: shown.append(given)
    )
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    assert main(["watch", "free"]) == 2
    assert "out" in capsys.readouterr().err
    monkeypatch.setattr("pter_gym.tools.pictures.viewer.INVISIBLE", ())
    assert main(["watch", "free,torque-feedback", "--pace", "brisk", "--speed", "0.5"]) == 0
    ((film, title),) = shown
    assert film.size == (720, 537)
    assert title == "PTER: free, torque-feedback"


@pytest.mark.parametrize(
    "command",
    [
        "watch free --pace brisk --out film.webp",
        pytest.param(
            "benchmark --policies free --paces brisk --episodes 1 --no-film --out results",
            marks=pytest.mark.long,
        ),
    ],
)
def test_commands_ignore_the_backend_of_a_notebook(command: str, here: Path):
    """It is for the notebook's Matplotlib; here, one whose package is not installed."""
    if find_spec("ipympl"):
        pytest.skip("ipympl is installed")
    program = [sys.executable, "-m", "pter_gym._commands.main", *command.split()]
    environment = {**os.environ, "MPLBACKEND": "module://ipympl.backend_nbagg"}
    result = subprocess.run(
        program, cwd=here, env=environment, capture_output=True, text=True, check=False
    )
    assert result.returncode == 0, result.stderr
    assert list(here.rglob("*.png")) or list(here.rglob("*.webp"))
