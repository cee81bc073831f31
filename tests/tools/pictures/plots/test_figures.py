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
from pter_gym.tools.pictures.plots.benchmark import error_against_time, tip_paths

from pter_gym.errors import ParameterError
from pter_gym.tasks.path_following import COLUMN, TELEMETRY, PathFollowing
from pter_gym.tools.pictures.plots import save


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


def test_no_pyplot():
    program = "import sys, pter_gym.tools.pictures.plots.benchmark; print('matplotlib.pyplot' in sys.modules)"
    result = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert result.stdout.strip() == "False"
