"""Figures of a scenario's scores: what they show, and the same bytes whatever the user has set."""

import itertools
import sys
import warnings
from dataclasses import replace
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.figure import Figure

from pter_gym.benchmark import leaderboards, run_scenario
from pter_gym.errors import ParameterError
from pter_gym.params import BASELINE
from pter_gym.tasks.path_following import PathFollowing
from pter_gym.tools.figures import name_lines, save
from pter_gym.tools.pictures import plots
from pter_gym.tools.pictures.drawing import (
    POLICY_COLOURS,
    Picture,
    Subject,
    drawable,
    policy_colours,
    shortened,
    text_width,
)

POLICIES, PACES = ["impedance", "free", "locked"], ["slow", "medium"]


@pytest.fixture(scope="module")
def scored():
    return leaderboards(run_scenario("standard", POLICIES, PACES, episodes=6))


def test_a_policy_has_one_colour_in_all_pictures_and_no_other_policy_has_it():
    few, many = policy_colours(["residual", "mine"]), policy_colours([*POLICY_COLOURS, "mine"])
    assert few["residual"] == many["residual"] == POLICY_COLOURS["residual"]
    assert len(set(many.values())) == len(many)


def test_profiles_show_each_policy_at_each_pace(scored):
    figure = plots.profiles(scored)
    assert [axes.get_title(loc="left").partition(" ")[0] for axes in figure.axes] == PACES
    for axes, board in zip(figure.axes, scored, strict=True):
        for standing, line in zip(board.standings, axes.get_lines(), strict=True):
            x, shares = np.asarray(line.get_xydata()).T
            np.testing.assert_allclose(
                shares, (standing.errors[0] <= 1e-3 * x[:, None]).mean(axis=1)
            )
            assert line.get_color() == policy_colours([standing.policy])[standing.policy]


def test_errors_are_drawn_at_the_paces_that_were_reached(scored):
    (axes,) = plots.error_against_pace(scored).axes
    found = [
        np.asarray(line.get_xydata())[0]
        for line in axes.get_lines()
        if line.get_markersize() == 6.0
    ]
    standings = [standing for board in scored for standing in board.standings]
    paces = np.clip(
        [each.scores["mean_pace_m_s"] for each in standings], plots.MIN_PACE, plots.MAX_PACE
    )
    expected = [
        (pace, 1e3 * each.error.value) for pace, each in zip(paces.tolist(), standings, strict=True)
    ]
    np.testing.assert_allclose(sorted(map(tuple, found)), sorted(expected))
    assert (axes.get_xlabel(), axes.get_ylabel()) == (
        "mean pace along the path [m/s]",
        "path error [mm]",
    )


def test_one_policy_and_one_episode_can_be_drawn(tmp_path: Path):
    runs = run_scenario("standard", ["locked"], ["brisk"], episodes=1)
    paths = plots.draw_scenario(leaderboards(runs), tmp_path)
    assert sorted(tmp_path.iterdir()) == sorted(paths)
    assert [path.name for path in paths] == [
        "standard-profiles.png",
        "standard-error-against-pace.png",
    ]
    assert "matplotlib.pyplot" not in sys.modules


@pytest.mark.parametrize("name", ["日本語" * 40, "a $x$ \udcff 🧪 b$", "τ=0.1, ё"])
def test_letters_that_the_typeface_lacks_are_escaped(name: str, tmp_path: Path):
    """Matplotlib warns of a letter that it draws as a box, and fails at half a formula."""
    runs = run_scenario("standard", ["locked"], "brisk", episodes=1)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        plots.draw_scenario(
            leaderboards([replace(runs[0], policy=name, scenario=name[:8])]), tmp_path
        )
        picture = Picture(Subject(BASELINE, PathFollowing(), name), 400, 300)
    assert picture
    assert text_width(drawable(name), 12) == text_width(name, 12)
    short = shortened(name, 12, 150.0)
    assert text_width(short, 12) <= 150.0
    assert short[0] == drawable(name)[0]
    assert short[-1] == drawable(name)[-1]
    assert drawable("τ=0.1, ё é") == "τ=0.1, ё é"
    assert drawable("本") == r"\u672c"


def test_the_same_figure_gives_the_same_bytes(scored, tmp_path: Path):
    before = mpl.rcParams.copy()
    for kind, beginning in (("png", b"\x89PNG\r\n\x1a\n"), ("pdf", b"%PDF-")):
        first = save(plots.error_against_pace(scored), tmp_path / f"a.{kind}").read_bytes()
        with mpl.rc_context(
            {"font.size": 20.0, "axes.grid": False, "savefig.dpi": 50, "axes.facecolor": "black"}
        ):
            second = save(plots.error_against_pace(scored), tmp_path / f"b.{kind}").read_bytes()
        assert first == second
        assert first.startswith(beginning)
    assert mpl.rcParams.copy() == before
    with pytest.raises(ParameterError, match="path"):
        save(plots.error_against_pace(scored), tmp_path / "figure.svg")
    assert len(list(tmp_path.iterdir())) == 4


@pytest.mark.parametrize("apart", [True, False])
def test_names_stand_beside_their_lines_or_in_a_legend(apart: bool):
    figure = Figure()
    axes, x = figure.add_subplot(), np.linspace(0.0, 1.0, 50)
    for name, height in {"upper": 1.0, "lower": 0.0}.items():
        axes.plot(x, x**2 + height * apart, label=name)
    name_lines(figure, axes)
    assert [text.get_text() for text in axes.texts] == (["upper", "lower"] if apart else [])
    assert bool(figure.legends) != apart
    boxes = [text.get_window_extent() for text in axes.texts]
    for line in axes.lines:
        points = line.get_transform().transform(line.get_xydata())
        assert not any(box.count_contains(points) for box in boxes)
    assert not any(one.overlaps(other) for one, other in itertools.combinations(boxes, 2))
