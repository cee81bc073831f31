"""``pter watch``: what it writes, what it says, what it refuses before it simulates."""

import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from pter_gym._commands.main import main
from pter_gym.benchmark import find_policy
from pter_gym.benchmark.simulation import record_episode, time_limit
from pter_gym.scenarios import find_scenario
from pter_gym.tasks.path_following import TELEMETRY
from pter_gym.tools.pictures import command


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def unseen(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing may be simulated."""
    monkeypatch.setattr(command, "simulate", lambda *_: pytest.fail("it simulates before it has looked"))


def test_policies_side_by_side_and_their_table(here: Path, capsys: pytest.CaptureFixture[str]):
    arguments = ["--pace", "brisk", "--seed", "5", "--out", "end.png", "--csv", "both.npz", "--size", "640x240"]
    assert main(["watch", "torque-feedback,residual", *arguments]) == 0
    said = capsys.readouterr().out
    for part in ("torque-feedback: arrived after", "residual: arrived after", "wrote end.png", "wrote both.npz"):
        assert part in said
    with Image.open(here / "end.png") as picture:
        assert picture.size == (640, 240)
    with np.load(here / "both.npz") as table:
        assert sorted(set(table["policy"].tolist())) == ["residual", "torque-feedback"]
        starts = {name: table["time"][table["policy"] == name][0] for name in ("residual", "torque-feedback")}
    assert set(starts.values()) == {0.0}


def test_the_episode_is_the_draw_of_the_seed(here: Path):
    """The one that `pter record` has for this seed; without a film no picture is drawn."""
    arguments = ["--scenario", "hands", "--pace", "brisk", "--seed", "2", "--csv", "x.npz"]
    assert main(["watch", "torque-feedback", *arguments]) == 0
    ((machine, task),) = find_scenario("hands").randomisation("brisk", contexts=1, seed=2).pairs()
    expected = record_episode(
        find_policy("torque-feedback", scenario="hands"), machine, task, 2, time_limit(task)
    ).telemetry
    with np.load(here / "x.npz") as table:
        for k, name in enumerate(TELEMETRY.names):
            np.testing.assert_array_equal(table[name], expected[:, k])


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["free", "--out", "x.avi"], "--out must end in .mp4, .gif, .png"),
        (["free", "--out", "nowhere/x.mp4"], "out must be a file in a folder that exists"),
        (["free", "--csv", "x.xlsx"], "--csv must end in .csv, .npz"),
        (["free", "--csv", "x.csv", "--size", "big"], "size must be WIDTHxHEIGHT in pixels"),
        (["free", "--csv", "x.csv", "--size", "10x10"], "width must be a whole number"),
        (["free", "--csv", "x.csv", "--speed", "nan"], "speed must be a number > 0"),
        (["free", "--csv", "x.csv", "--seed", "-1"], "seed must be a whole number"),
        (["free", "--csv", "x.csv", "--pace", "fast"], "pace"),
        (["free", "--csv", "x.csv", "--scenario", "standart"], "did you mean 'standard'"),
        ([",".join(f"p{k}" for k in range(17)), "--csv", "x.csv"], "POLICIES must be 1 to 16 names"),
    ],
)
@pytest.mark.usefixtures("unseen")
def test_a_wrong_argument_is_named(here: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], said: str):
    assert main(["watch", *arguments]) == 2
    assert said in capsys.readouterr().err
    assert not list(here.iterdir())


def test_an_unknown_policy_is_named(here: Path, capsys: pytest.CaptureFixture[str]):
    assert main(["watch", "free,impedence", "--csv", "x.csv"]) == 2
    assert "did you mean 'impedance'" in capsys.readouterr().err
    assert not list(here.iterdir())


@pytest.mark.usefixtures("unseen", "here")
def test_without_a_display_a_file_must_be_asked_for(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    pytest.importorskip("pygame")
    monkeypatch.setattr("pter_gym.tools.pictures.render.window.has_display", lambda: False)
    assert main(["watch", "free"]) == 2
    assert "--out must be given where there is no display" in capsys.readouterr().err


@pytest.mark.usefixtures("here")
def test_with_a_display_a_window_shows_the_film(monkeypatch: pytest.MonkeyPatch):
    pytest.importorskip("pygame")
    shown: list[tuple[object, ...]] = []
    monkeypatch.setattr("pter_gym.tools.pictures.render.window.has_display", lambda: True)
    monkeypatch.setattr("pter_gym.tools.pictures.render.film.show_film", lambda *given: shown.append(given))
    assert main(["watch", "free,torque-feedback", "--pace", "brisk", "--speed", "0.5"]) == 0
    ((film, rate, title),) = shown
    assert film.size == (960, 540)
    assert (rate, title) == (50, "PTER: free, torque-feedback")


@pytest.mark.usefixtures("unseen", "here")
def test_missing_pygame_is_named(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]):
    monkeypatch.setitem(sys.modules, "pygame", None)
    assert main(["watch", "free"]) == 2
    assert "pip install -e '.[render]'" in capsys.readouterr().err


def test_a_policy_of_ones_own(here: Path, monkeypatch: pytest.MonkeyPatch):
    """As `pter benchmark` finds it."""
    monkeypatch.setattr("pter_gym.benchmark.simulation.time_limit", lambda _: 2)
    (here / "mine_to_watch.py").write_text(
        "import numpy as np\n\ndef act(obs):\n    return np.full((len(obs), 4), 2.0)\n"
    )
    assert main(["watch", "random,mine_to_watch:act", "--csv", "x.npz"]) == 0
    with np.load(here / "x.npz") as table:
        assert table["policy"].tolist() == ["random"] * 3 + ["mine_to_watch:act"] * 3
        np.testing.assert_array_equal(table["volts_2"][-2:], 2.0)
