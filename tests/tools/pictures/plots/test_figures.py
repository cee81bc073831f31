"""Figures: what they show, with units; files whole, the same each time, without pyplot or a display."""

import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.figure import Figure
from mpl_toolkits.axes_grid1.anchored_artists import AnchoredSizeBar

from pter_gym.errors import ParameterError
from pter_gym.tasks.path_following import COLUMN, TELEMETRY, PathFollowing
from pter_gym.tools.figures import STYLE, percent
from pter_gym.tools.pictures.plots import looks, save
from pter_gym.tools.pictures.plots.benchmark import error_against_time, tip_paths
from pter_gym.tools.pictures.plots.legends import scale_bar, shown
from pter_gym.tools.pictures.plots.ticks import plain_ticks


def run(steps: int, error: float, completed: bool = True, time_constant: float = 0.105) -> SimpleNamespace:
    telemetry = np.zeros((steps + 1, len(TELEMETRY)))
    telemetry[:, COLUMN.time] = 0.01 * np.arange(steps + 1)
    telemetry[:, COLUMN.normal_error] = error * np.sin(telemetry[:, COLUMN.time])
    telemetry[:, COLUMN.tip.x] = np.linspace(-0.2, 0.2, steps + 1)
    telemetry[:, COLUMN.tip.y] = 0.5 + telemetry[:, COLUMN.normal_error]
    return SimpleNamespace(time_constant=time_constant, score=SimpleNamespace(completed=completed), telemetry=telemetry)


RUNS = {"impedance": run(80, 0.05), "torque-feedback": run(100, 0.02), "locked": run(1000, 0.01, False)}
RESULT: Any = SimpleNamespace(task=PathFollowing(), runs={name: (each,) for name, each in RUNS.items()})


def lines(figure: Figure) -> dict[str, np.ndarray]:
    return {str(line.get_label()): np.asarray(line.get_xydata()) for line in figure.axes[0].get_lines()}


def labels(figure: Figure) -> list[str]:
    (main,) = figure.axes
    names = [text for axes in (main, *main.child_axes) for text in (axes.get_xlabel(), axes.get_ylabel())]
    return [name for name in names if name]


def test_tip_paths_show_each_policy_to_scale():
    figure = tip_paths(RESULT)
    for name, each in RUNS.items():
        np.testing.assert_array_equal(lines(figure)[name], each.telemetry[:, [*COLUMN.tip]])
    assert figure.axes[0].get_aspect() == 1.0
    assert labels(figure) == ["x [m]", "y [m]", "x [in]", "y [in]"]
    figure.draw_without_rendering()
    above, right = figure.axes[0].child_axes
    np.testing.assert_allclose(np.array(above.get_xlim()) * 0.0254, figure.axes[0].get_xlim())
    np.testing.assert_allclose(np.array(right.get_ylim()) * 0.0254, figure.axes[0].get_ylim())


def test_errors_are_in_millimetres_until_soon_after_the_last_arrival():
    figure = error_against_time(RESULT)
    np.testing.assert_allclose(
        lines(figure)["impedance"], RUNS["impedance"].telemetry[:, [COLUMN.time, COLUMN.normal_error]] * (1, 1000)
    )
    assert "locked (until 10 s)" in [text.get_text() for text in figure.legends[0].get_texts()]
    assert labels(figure) == ["time [s]", "normal error [mm]", "normal error [in]"]
    assert figure.axes[0].get_xlim() == (0.0, pytest.approx(1.1))


def test_the_nearest_time_constant_is_shown():
    runs = {"free": (run(10, 0.1, time_constant=0.03), run(10, 0.2))}
    result: Any = SimpleNamespace(task=RESULT.task, runs=runs)
    for given, nearest in ((0.02, 0), (0.1, 1)):
        drawn = lines(tip_paths(result, given))["free"]
        np.testing.assert_array_equal(drawn, runs["free"][nearest].telemetry[:, [*COLUMN.tip]])


def test_many_policies_look_different():
    found = looks(f"policy {k}" for k in range(100))
    assert len({(look.colour, look.marker) for look in found.values()}) == 100
    few = list(found.values())[:15]
    assert len({look.colour for look in few}) == len({look.marker for look in few}) == 15


def test_long_names_lose_their_middle_and_dollars_are_dollars():
    assert shown("abcdefghijklmnop", 10) == "abcd…lmnop"
    assert shown("$x$") == r"\$x\$"


@pytest.mark.parametrize(("low", "high"), [(2.1, 4.5), (0.6, 1.1), (1.05, 1.7), (0.02, 900.0)])
def test_a_logarithmic_axis_has_two_ticks_or_more(low: float, high: float):
    axes = Figure().add_subplot()
    axes.set(xscale="log", xlim=(low, high))
    plain_ticks(axes, "x")
    assert sum(low <= tick <= high for tick in axes.get_xticks()) >= 2


@pytest.mark.parametrize("length", [0.013, 0.4, 7.0])
def test_a_scale_bar_is_as_long_as_it_says(length: float):
    axes = Figure(figsize=(4.0, 4.0)).add_subplot()
    axes.set(xlim=(0.0, length), ylim=(0.0, length))
    scale_bar(axes)
    (bar,) = axes.findobj(AnchoredSizeBar)
    said = float(bar.txt_label.get_text().split(" m ")[0])
    assert bar.size_bar.get_children()[0].get_width() == pytest.approx(said)
    assert 0.1 * length <= said <= 0.3 * length


def test_the_style_is_one_that_matplotlib_takes():
    with mpl.rc_context():
        mpl.style.use(STYLE)
        assert mpl.rcParams["axes.prop_cycle"] == STYLE["axes.prop_cycle"]


@pytest.mark.parametrize("share", [0.0, -0.0, -1e-9, -0.0004])
def test_nothing_is_minus_zero(share: float):
    assert percent(share) == "0 %"
    assert percent(share, 1, signed=True) == "+0.0 %"
    assert percent(share - 0.5, 1) == "−50.0 %"


def test_the_same_figure_gives_the_same_bytes_whatever_the_user_has_set(tmp_path: Path):
    before = mpl.rcParams.copy()
    save(error_against_time(RESULT), tmp_path / "a.png")
    assert mpl.rcParams.copy() == before
    with mpl.rc_context({"font.size": 20.0, "axes.grid": False, "savefig.dpi": 50, "axes.facecolor": "black"}):
        save(error_against_time(RESULT), tmp_path / "b.png")
    for kind, beginning in (("png", b"\x89PNG\r\n\x1a\n"), ("pdf", b"%PDF-")):
        data = (tmp_path / f"a.{kind}").read_bytes()
        assert data.startswith(beginning)
        assert data == (tmp_path / f"b.{kind}").read_bytes()


def test_a_figure_goes_to_a_png_file_and_one_beside_it(tmp_path: Path):
    figure = error_against_time(RESULT)
    with pytest.raises(ParameterError, match=r"path must end in \.png, got"):
        save(figure, tmp_path / "figure.pdf")
    assert not list(tmp_path.iterdir())
    assert save(figure, tmp_path / "figure.png") == (tmp_path / "figure.png", tmp_path / "figure.pdf")


def test_an_interrupted_write_leaves_the_old_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    path = tmp_path / "figure.png"
    path.write_bytes(b"earlier")
    monkeypatch.setattr("os.fsync", interrupt)
    with pytest.raises(KeyboardInterrupt):
        save(error_against_time(RESULT), path)
    assert [(p.name, p.read_bytes()) for p in tmp_path.iterdir()] == [("figure.png", b"earlier")]


def test_no_pyplot():
    program = "import sys, pter_gym.tools.pictures.plots.benchmark; print('matplotlib.pyplot' in sys.modules)"
    result = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert result.stdout.strip() == "False"
