"""Figures: what they show, with units; files whole, the same each time, without pyplot or a display."""

import subprocess
import sys
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pter_gym.benchmark.measures import vector
from pter_gym.errors import ParameterError
from pter_gym.plots import save
from pter_gym.plots.benchmark import Trace, error_figure, last_time_shown, tip_path_figure
from pter_gym.plots.style import STYLE, percent

PATH = np.stack([np.linspace(-0.2, 0.2, 50), np.full(50, 0.5)], axis=1)


def episode(name: str, steps: int, error: float, completed: bool = True) -> Trace:
    time = 0.01 * np.arange(steps + 1)
    errors = error * np.sin(time)
    tip = np.stack([np.linspace(-0.2, 0.2, steps + 1), 0.5 + errors], axis=1)
    return Trace(name, time, tip, errors, completed)


EPISODES = [episode("impedance", 80, 0.05), episode("torque-feedback", 100, 0.02), episode("locked", 1000, 0.01, False)]


def main_axes(figure: Figure) -> Axes:
    return figure.axes[0]


def lines(figure: Figure) -> dict[str, np.ndarray]:
    drawn = main_axes(figure).get_lines()
    return {str(line.get_label()): np.asarray(line.get_xydata()) for line in drawn}


def labels(figure: Figure) -> list[str]:
    secondary = main_axes(figure).child_axes
    names = [text for axes in (main_axes(figure), *secondary) for text in (axes.get_xlabel(), axes.get_ylabel())]
    return [name for name in names if name]


def test_tip_paths_show_the_desired_path_and_each_policy():
    figure = tip_path_figure(EPISODES, PATH, "title")
    drawn = lines(figure)
    np.testing.assert_array_equal(drawn["desired path"], PATH)
    for trace in EPISODES:
        np.testing.assert_array_equal(drawn[trace.name], trace.tip)
    assert main_axes(figure).get_aspect() == 1.0
    assert figure.legends[0].get_title().get_text().startswith("title; ")
    assert not main_axes(figure).get_title(loc="left")
    assert labels(figure) == ["x [m]", "y [m]", "x [in]", "y [in]"]


def test_errors_are_in_millimetres_and_inches():
    figure = error_figure(EPISODES, "title")
    drawn = lines(figure)
    np.testing.assert_allclose(drawn["impedance"][:, 0], EPISODES[0].time)
    np.testing.assert_allclose(drawn["impedance"][:, 1], 1000.0 * EPISODES[0].normal_error)
    assert "locked (until 10 s)" in [text.get_text() for text in figure.legends[0].get_texts()]
    assert labels(figure) == ["time [s]", "normal error [mm]", "normal error [in]"]
    figure.draw_without_rendering()
    (inches,) = main_axes(figure).child_axes
    np.testing.assert_allclose(np.array(inches.get_ylim()) * 25.4, main_axes(figure).get_ylim())


def test_inches_of_the_tip_paths():
    figure = tip_path_figure(EPISODES, PATH, "title")
    figure.draw_without_rendering()
    above, right = main_axes(figure).child_axes
    np.testing.assert_allclose(np.array(above.get_xlim()) * 0.0254, main_axes(figure).get_xlim())
    np.testing.assert_allclose(np.array(right.get_ylim()) * 0.0254, main_axes(figure).get_ylim())


def test_time_axis_ends_soon_after_the_last_arrival():
    assert last_time_shown(EPISODES) == pytest.approx(1.1)
    assert last_time_shown(EPISODES[2:]) == pytest.approx(10.0)
    assert last_time_shown(EPISODES[:1]) == pytest.approx(0.8 * 1.02)


def test_the_style_is_one_that_matplotlib_takes():
    with mpl.rc_context():
        mpl.style.use(STYLE)
        assert mpl.rcParams["font.size"] == STYLE["font.size"]
        assert mpl.rcParams["axes.prop_cycle"] == STYLE["axes.prop_cycle"]


@pytest.mark.parametrize("share", [0.0, -0.0, -1e-9, -0.0004])
def test_nothing_is_minus_zero(share: float):
    assert percent(share) == "0 %"
    assert percent(share, 1, signed=True) == "+0.0 %"
    assert percent(share - 0.5, 1) == "−50.0 %"


def test_settings_of_matplotlib_stay_as_they_are(tmp_path: Path):
    before = mpl.rcParams.copy()
    save(tip_path_figure(EPISODES, PATH, "title"), tmp_path / "a.png")
    assert mpl.rcParams.copy() == before


def test_the_same_figure_gives_the_same_bytes_whatever_the_user_has_set(tmp_path: Path):
    save(error_figure(EPISODES, "title"), tmp_path / "a.png")
    with mpl.rc_context({"font.size": 20.0, "axes.grid": False, "savefig.dpi": 50, "axes.facecolor": "black"}):
        save(error_figure(EPISODES, "title"), tmp_path / "b.png")
    for kind, beginning in (("png", b"\x89PNG\r\n\x1a\n"), ("pdf", b"%PDF-")):
        data = (tmp_path / f"a.{kind}").read_bytes()
        assert data.startswith(beginning)
        assert data == (tmp_path / f"b.{kind}").read_bytes()
        assert not any(word in data for word in (b"Software", b"CreationDate", b"Producer"))


@pytest.mark.parametrize("name", ["figure", "figure.pdf", "figure.v2"])
def test_a_figure_goes_to_a_png_file_and_one_beside_it(name: str, tmp_path: Path):
    figure = error_figure(EPISODES, "title")
    with pytest.raises(ParameterError, match=r"path must end in \.png, got"):
        save(figure, tmp_path / name)
    assert not list(tmp_path.iterdir())
    assert save(figure, tmp_path / "a.b.png") == (tmp_path / "a.b.png", tmp_path / "a.b.pdf")
    assert {path.name for path in tmp_path.iterdir()} == {"a.b.png", "a.b.pdf"}


def test_an_interrupted_save_leaves_the_earlier_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    def interrupt(*_args: object) -> None:
        raise KeyboardInterrupt

    path = tmp_path / "figure.png"
    path.write_bytes(b"earlier")
    monkeypatch.setattr("os.fsync", interrupt)
    with pytest.raises(KeyboardInterrupt):
        save(error_figure(EPISODES, "title"), path)
    assert [p.name for p in tmp_path.iterdir()] == ["figure.png"]
    assert path.read_bytes() == b"earlier"


def test_figures_of_a_standard_test(tmp_path: Path):
    from pter_gym.benchmark import find_policy, run_standard_test
    from pter_gym.plots.benchmark import error_against_time, tip_paths

    policies = {name: find_policy(name, scenario=None) for name in ("impedance", "free")}
    result = run_standard_test(policies, time_constants=[0.03, 0.105])
    for figure in (tip_paths(result), error_against_time(result)):
        assert set(lines(figure)) >= {"desired path", "impedance", "free"}
        assert "τ = 0.105 s" in figure.legends[0].get_title().get_text()
    assert "τ = 0.03 s" in tip_paths(result, 0.02).legends[0].get_title().get_text()
    tip = vector(result.runs["free"][1].telemetry, "tip")
    np.testing.assert_array_equal(lines(tip_paths(result))["free"], tip)


def test_no_pyplot():
    program = "import sys, pter_gym.plots.benchmark; print('matplotlib.pyplot' in sys.modules)"
    result = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert result.stdout.strip() == "False"
