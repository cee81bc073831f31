"""Figures of a scenario's scores: profiles, errors against pace and smoothness, and sample trajectories."""

import math
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from pter_gym.benchmark._runs import Sample, ScenarioRun, join_seeds
from pter_gym.benchmark.episodes import Episodes, find_episodes
from pter_gym.benchmark.leaderboard import Leaderboard
from pter_gym.benchmark.ranking import PACE_ERROR, Standing
from pter_gym.benchmark.statistics import performance_profile
from pter_gym.scenarios import PACES
from pter_gym.tools.figures import MILLIMETRE, REFERENCE, WIDTH, Look, label, looks, styled
from pter_gym.tools.pictures.plots.legends import dots, name_policies, scale_bar, shown
from pter_gym.tools.pictures.plots.ticks import pace_ticks, plain_ticks
from pter_gym.tools.pictures.render import style as picture
from pter_gym.tools.pictures.render.geometry import FiveBar, five_bar, path_points, workspace

Array = NDArray[np.float64]

BELOW = 0.35
"""Opacity of a policy that is below the line."""

THRESHOLDS = 200

SLOWEST = 0.03
"""Mean pace [m/s] at which slower policies are drawn."""

_DESIRED: Any = {"color": REFERENCE, "linestyle": "-", "linewidth": 4.0, "alpha": 0.3}
_ARM: Any = {"linestyle": "-", "linewidth": 4.0, "alpha": 0.5}
_NOTE = "filled: ranked; hollow: below the line; bars: 95 % intervals"
_FAINT = "hollow and faint: below the line"


@styled
def profiles(boards: Sequence[Leaderboard], runs: Sequence[ScenarioRun]) -> Figure:
    """Return the performance profiles of a scenario: the share of episodes within an error, a panel for each pace.

    Parameters
    ----------
    boards
        Leaderboards of one scenario, one per pace.
    runs
        The runs behind them.
    """
    figure, panels = _panels(boards, 3.0)
    errors = np.concatenate([run.scores["path_error_m"] for run in runs])
    low, high = max(float(errors.min()), 1e-5), float(errors.max())
    thresholds = np.exp(np.linspace(math.log(0.9 * low), math.log(1.1 * max(low, high)), THRESHOLDS))
    by_policy = _looks(boards)
    for axes, board in zip(panels, boards, strict=True):
        axes.set_title(_pace(board))
        for standing in board.standings:
            run = join_seeds(_runs_of(standing, board, runs))
            found = performance_profile(run.scores["path_error_m"], thresholds, strata=run.strata)
            look = _look(by_policy, standing)
            alpha = BELOW if standing.reason else 1.0
            x = thresholds / MILLIMETRE
            axes.fill_between(x, found.low, found.high, color=look["color"], alpha=0.18 * alpha, linewidth=0.0)
            axes.plot(x, found.fraction, alpha=alpha, **look)
        axes.set_xscale("log")
        plain_ticks(axes, "x")
        axes.set_xlabel("path error [mm]")
    panels[0].set_ylabel("share of episodes within it")
    _legend(figure, boards, f"{_FAINT}; bands: 95 % intervals")
    return figure


@styled
def error_against_pace(boards: Sequence[Leaderboard]) -> Figure:
    """Return each policy's path error over its actual mean pace, with the commanded paces marked."""
    figure = Figure(figsize=(WIDTH, 3.9))
    axes = figure.add_subplot()
    by_policy = _looks(boards)
    for board in boards:
        pace = PACES[board.pace]
        axes.axvspan(pace * (1.0 - PACE_ERROR), pace * (1.0 + PACE_ERROR), color=picture.WORKSPACE, zorder=0)
        axes.axvline(pace, color=REFERENCE, linewidth=1.0, linestyle=":", zorder=1)
    for name, look in by_policy.items():
        standings = [standing for board in boards for standing in board.standings if standing.policy == name]
        paces = np.array([standing.scores["mean_pace_m_s"].value for standing in standings])
        _front(axes, np.maximum(paces, SLOWEST), standings, look)
    axes.set_xscale("log")
    axes.set_yscale("log")
    pace_ticks(axes, {board.pace: PACES[board.pace] for board in boards}, SLOWEST)
    plain_ticks(axes, "y")
    label(axes, "mean pace along the path [m/s]", "path error [mm]")
    _legend(figure, boards, f"{_NOTE}\nshaded: paces that rank")
    return figure


@styled
def error_against_smoothness(boards: Sequence[Leaderboard]) -> Figure:
    """Return path error over smoothness, a panel for each pace."""
    figure, panels = _panels(boards, 3.0)
    by_policy = _looks(boards)
    for axes, board in zip(panels, boards, strict=True):
        axes.set_title(_pace(board))
        for standing in board.standings:
            x = np.array([standing.scores["smoothness"].value])
            _front(axes, x, [standing], by_policy[standing.policy])
        axes.set_xlabel("smoothness, −ln of\ndimensionless jerk")
        axes.set_yscale("log")
        axes.margins(x=0.12)
        axes.locator_params(axis="x", nbins=4)
    plain_ticks(panels[0], "y")
    panels[0].set_ylabel("path error [mm]")
    _legend(figure, boards, _NOTE)
    return figure


@styled
def trajectories(board: Leaderboard, runs: Sequence[ScenarioRun]) -> Figure:
    """Return sample trajectories of the best policy on a leaderboard, and the arm half-way along each.

    All policies that had the same episodes are drawn.

    Parameters
    ----------
    board
        Leaderboard of one scenario at one pace.
    runs
        The runs behind it.
    """
    first = _runs_of(board.standings[0], board, runs)[0]
    best, at = first.samples, first.conditions
    episodes = find_episodes(at.scenario, at.pace, at.fresh_seed)
    rows, columns = (1, len(best)) if len(best) < 3 else (2, 2)
    edges = np.vstack([_shown(episodes, sample) for sample in best])
    low, high = edges.min(axis=0) - 0.03, edges.max(axis=0) + 0.03
    width, height = high - low
    figure = Figure(figsize=(WIDTH, rows * (WIDTH / columns * height / width + 0.25)))
    panels: list[Axes] = np.ravel(figure.subplots(rows, columns)).tolist()
    by_policy = _looks([board])
    for place, axes in enumerate(panels[: len(best)]):
        _draw_scene(axes, episodes, best[place])
        for standing in reversed(board.standings):
            run = _runs_of(standing, board, runs)[0]
            if run.conditions.data != at.data:
                continue
            x, y = run.samples[place].tip.T
            alpha = 0.55 if standing.reason else 1.0
            axes.plot(x, y, alpha=alpha, linewidth=1.2, zorder=4, **_look(by_policy, standing))
        k = best[place].episode
        axes.set_title(f"{episodes.strata[k]}, episode {k}")
        axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal", xticks=[], yticks=[])
        scale_bar(axes)
        for spine in axes.spines.values():
            spine.set_visible(False)
    for axes in panels[len(best) :]:
        axes.set_visible(False)
    scene = {
        f"the arm under {shown(board.standings[0].label)}, half-way": Line2D([], [], **_ARM, color=picture.LINK_A),
        "desired path": Line2D([], [], **_DESIRED),
    }
    _legend(figure, [board], f"{_pace(board)}; {_FAINT}", scene)
    return figure


def _shown(episodes: Episodes, sample: Sample) -> Array:
    """Return points [m] that a sample's panel must show: its workspace and its arm half-way."""
    task = episodes.tasks[sample.episode]
    return np.vstack([workspace(task.path, task.error_max), *_half_way(episodes, sample)])


def _half_way(episodes: Episodes, sample: Sample) -> FiveBar:
    """Return the arm of a sample half-way through its episode."""
    return five_bar(episodes.machines[sample.episode].arm, *sample.theta[len(sample.theta) // 2])


def _draw_scene(axes: Axes, episodes: Episodes, sample: Sample) -> None:
    """Draw workspace and path of a sample, and the arm half-way."""
    task = episodes.tasks[sample.episode]
    axes.fill(*workspace(task.path, task.error_max).T, color=picture.WORKSPACE, zorder=0)
    axes.plot(*path_points(task.path).T, **_DESIRED, zorder=3)
    base, elbow_a, elbow_b, tip = _half_way(episodes, sample)
    for elbow, colour in ((elbow_b, picture.LINK_B), (elbow_a, picture.LINK_A)):
        axes.plot(*np.stack([base, elbow, tip]).T, **_ARM, color=colour, marker="o", markerfacecolor="white", zorder=1)


def _look(by_policy: Mapping[str, Look], standing: Standing) -> dict[str, Any]:
    """Return Matplotlib's settings for a policy's line, with some markers on it, hollow if the policy is not ranked."""
    colour, marker, dashes = by_policy[standing.policy]
    return {
        "color": colour,
        "linestyle": dashes,
        "marker": marker,
        "markevery": dots(list(by_policy).index(standing.policy), len(by_policy)),
        "markerfacecolor": "white" if standing.reason else colour,
    }


def _front(axes: Axes, x: Array, standings: Sequence[Standing], look: Look) -> None:
    """Draw one policy's errors over x (K,) with their intervals, joined in order of the pace."""
    y = np.array([standing.scores["path_error_m"] for standing in standings]) / MILLIMETRE
    axes.plot(x, y[:, 0], color=look.colour, linestyle=look.dashes, linewidth=1.2, alpha=0.6)
    spread = np.maximum([y[:, 0] - y[:, 1], y[:, 2] - y[:, 0]], 0.0)
    axes.errorbar(x, y[:, 0], spread, fmt="none", ecolor=look.colour, elinewidth=1.2)
    for at, error, standing in zip(x, y[:, 0], standings, strict=True):
        face = "white" if standing.reason else look.colour
        axes.plot(
            at, error, color=look.colour, marker=look.marker, markersize=6.0, markerfacecolor=face, linestyle="none"
        )


def _panels(boards: Sequence[Leaderboard], height: float) -> tuple[Figure, list[Axes]]:
    figure = Figure(figsize=(WIDTH, height))
    return figure, np.ravel(figure.subplots(1, len(boards), sharey=True)).tolist()


def _labels(boards: Sequence[Leaderboard]) -> dict[str, str]:
    """Return each policy's label by its name, in order of the names."""
    return dict(sorted((standing.policy, standing.label) for board in boards for standing in board.standings))


def _looks(boards: Sequence[Leaderboard]) -> dict[str, Look]:
    return looks(_labels(boards))


def _runs_of(standing: Standing, board: Leaderboard, runs: Sequence[ScenarioRun]) -> list[ScenarioRun]:
    """Return the runs of a policy's training seeds."""
    wanted = board.pace, standing.policy
    own = (run for run in runs if board.has_episodes_of(run))
    return [run for run in own if (run.conditions.pace, run.conditions.policy) == wanted]


def _pace(board: Leaderboard) -> str:
    return f"{board.pace}, {PACES[board.pace]:g} m/s"


def _legend(
    figure: Figure, boards: Sequence[Leaderboard], note: str, more: Mapping[str, Line2D] = MappingProxyType({})
) -> None:
    """Add a legend of all policies below the panels, and a note on what was run."""
    kind = "stored" if boards[0].fresh is None else "fresh"
    ran = f"{boards[0].scenario}, {boards[0].episodes} {kind} episode{'s' if boards[0].episodes > 1 else ''}"
    name_policies(figure, _looks(boards), list(_labels(boards).values()), f"{ran}; {note}", more)
