"""Figures of a scenario's scores: profiles, errors against pace and smoothness, and sample trajectories."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import NullFormatter, StrMethodFormatter
from numpy.typing import NDArray

from pter_gym.benchmark.episodes import Episodes
from pter_gym.benchmark.leaderboard import Leaderboard
from pter_gym.benchmark.ranking import PACE_ERROR, Standing
from pter_gym.benchmark.runs import Sample, ScenarioRun, join_seeds
from pter_gym.benchmark.statistics import performance_profile
from pter_gym.plots.benchmark import MILLIMETRE
from pter_gym.plots.style import COLOURS, DASHES, REFERENCE, WIDTH, label, styled
from pter_gym.render import style as picture
from pter_gym.render.geometry import FiveBar, five_bar, path_points, workspace
from pter_gym.scenarios import PACES

Array = NDArray[np.float64]

BELOW = 0.35
"""Opacity of a policy that is below the line."""

THRESHOLDS = 200

SLOWEST = 0.03
"""Mean pace [m/s] at which slower policies are drawn, as triangles."""

_NOTE = "filled: ranked   hollow: below the line"
_FAINT = "faint: below the line"


@styled
def profiles(boards: Sequence[Leaderboard], runs: Sequence[ScenarioRun]) -> Figure:
    """Return the performance profiles of a scenario: the share of episodes within an error, a panel for each pace.

    Parameters
    ----------
    boards
        Of one scenario, one per pace.
    runs
        The runs that they rank.
    """
    figure, panels = _panels(boards, 3.6)
    errors = np.concatenate([run.scores["path_error_m"] for run in runs])
    low, high = max(float(errors.min()), 1e-5), float(errors.max())
    thresholds = np.exp(np.linspace(math.log(0.9 * low), math.log(1.1 * max(low, high)), THRESHOLDS))
    looks = _looks(boards)
    for axes, board in zip(panels, boards, strict=True):
        axes.set_title(_pace(board))
        for standing in board.standings:
            run = _run_of(standing, board, runs)
            found = performance_profile(run.scores["path_error_m"], thresholds, strata=run.strata)
            colour, dashes = looks[standing.label]
            faint = BELOW if standing.reason else 1.0
            x = thresholds / MILLIMETRE
            axes.fill_between(x, found.low, found.high, color=colour, alpha=0.18 * faint, linewidth=0.0)
            axes.plot(x, found.fraction, color=colour, linestyle=dashes, alpha=faint)
        axes.set_xscale("log")
        plain_ticks(axes, "x", axes.get_xlim(), most=5)
        axes.set_xlabel("path error [mm]")
    panels[0].set_ylabel("share of episodes within it")
    _headline(figure, boards, "Performance profiles")
    _legend(figure, looks, _FAINT, marked=False)
    return figure


@styled
def error_against_pace(boards: Sequence[Leaderboard]) -> Figure:
    """Return each policy's front: path error over the mean pace that it kept, beside the commanded ones."""
    figure = Figure(figsize=(WIDTH, 4.6))
    axes = figure.add_subplot()
    looks = _looks(boards)
    for board in boards:
        pace = PACES[board.pace]
        axes.axvspan(pace * (1.0 - PACE_ERROR), pace * (1.0 + PACE_ERROR), color=picture.WORKSPACE, zorder=0)
        axes.axvline(pace, color=REFERENCE, linewidth=1.0, linestyle=":", zorder=1)
        axes.annotate(
            board.pace,
            (pace, 1.0),
            (0.0, 3.0),
            xycoords=("data", "axes fraction"),
            textcoords="offset points",
            ha="center",
            color="#646b75",
        )
    for name, standings in _by_policy(boards).items():
        x = np.array([max(standing.scores["mean_pace_m_s"].value, SLOWEST) for standing in standings])
        y = np.array([standing.scores["path_error_m"] for standing in standings]) / MILLIMETRE
        _front(axes, x, y, standings, looks[name])
    axes.set_xscale("log")
    axes.set_yscale("log")
    plain_ticks(axes, "x", axes.get_xlim())
    plain_ticks(axes, "y", axes.get_ylim())
    label(axes, "mean pace along the path [m/s]", "path error [mm]")
    axes.set_title(f"{boards[0].scenario}: error against pace", pad=20.0)
    _legend(figure, looks, _NOTE, marked=True)
    return figure


@styled
def error_against_smoothness(boards: Sequence[Leaderboard]) -> Figure:
    """Return path error over smoothness, a panel for each pace."""
    figure, panels = _panels(boards, 3.6)
    looks = _looks(boards)
    for axes, board in zip(panels, boards, strict=True):
        axes.set_title(_pace(board))
        for standing in board.standings:
            x = np.array([standing.scores["smoothness"].value])
            y = np.array([standing.scores["path_error_m"]]) / MILLIMETRE
            _front(axes, x, y, [standing], looks[standing.label])
        axes.set_xlabel("smoothness, −ln of\ndimensionless jerk")
        axes.set_yscale("log")
        axes.margins(x=0.12)
    plain_ticks(panels[0], "y", panels[0].get_ylim())
    panels[0].set_ylabel("path error [mm]")
    _headline(figure, boards, "Error against smoothness")
    _legend(figure, looks, _NOTE, marked=True)
    return figure


@styled
def trajectories(board: Leaderboard, runs: Sequence[ScenarioRun], episodes: Episodes) -> Figure:
    """Return sample trajectories of all policies on a leaderboard, and the arm as the best one held it half-way.

    Parameters
    ----------
    board
        Of one scenario at one pace.
    runs
        Those that it ranks.
    episodes
        Those that were run.
    """
    numbers = [sample.episode for sample in _run_of(board.standings[0], board, runs).samples]
    rows, columns = (1, len(numbers)) if len(numbers) < 3 else (2, 2)
    edges = np.vstack([_shown(episodes, sample) for sample in _run_of(board.standings[0], board, runs).samples])
    low, high = edges.min(axis=0) - 0.03, edges.max(axis=0) + 0.03
    width, height = high - low
    figure = Figure(figsize=(WIDTH, rows * (WIDTH / columns * height / width + 0.25) + 0.8))
    panels: list[Axes] = np.ravel(figure.subplots(rows, columns)).tolist()
    looks = _looks([board])
    for axes, place in zip(panels, range(len(numbers)), strict=False):
        samples = {
            standing.policy: _run_of(standing, board, runs).samples[place] for standing in reversed(board.standings)
        }
        _draw_scene(axes, episodes, samples[board.standings[0].policy])
        for standing in reversed(board.standings):
            colour, dashes = looks[standing.label]
            tip = samples[standing.policy].tip
            faint = 0.55 if standing.reason else 1.0
            axes.plot(*tip.T, color=colour, linestyle=dashes, alpha=faint, linewidth=1.5, zorder=4)
            axes.plot(*tip[-1], color=colour, marker="o", markersize=3.5, alpha=faint, zorder=5)
        k = numbers[place]
        axes.set_title(f"{episodes.strata[k]}, episode {k}", fontsize=9.5)
        axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal", xticks=[], yticks=[])
        for spine in axes.spines.values():
            spine.set_visible(False)
    for axes in panels[len(numbers) :]:
        axes.set_visible(False)
    _headline(figure, [board], f"Sample trajectories, {_pace(board)}; the arm is {board.standings[0].label}'s")
    _legend(figure, looks, _FAINT, marked=False)
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
    outline = workspace(task.path, task.error_max)
    axes.fill(*outline.T, color=picture.WORKSPACE, zorder=0)
    axes.plot(*path_points(task.path).T, color=REFERENCE, linestyle="-", linewidth=4.0, alpha=0.3, zorder=3)
    base, elbow_a, elbow_b, tip = _half_way(episodes, sample)
    bars = (
        (elbow_b, tip, picture.PARALLEL_A, 2.5),
        (elbow_a, tip, picture.PARALLEL_B, 2.5),
        (base, elbow_b, picture.LINK_B, 4.0),
        (base, elbow_a, picture.LINK_A, 4.0),
    )
    for start, end, colour, width in bars:
        both = np.stack([start, end])
        axes.plot(*both.T, color=colour, linestyle="-", linewidth=width, solid_capstyle="round", alpha=0.5, zorder=1)
    for pivot in (base, elbow_a, elbow_b):
        axes.plot(*pivot, color=picture.INK, marker="o", markersize=4.0, markerfacecolor="white", zorder=2)
    axes.plot(*tip, color=picture.INK, marker="o", markersize=5.0, zorder=6)


def _front(axes: Axes, x: Array, y: Array, standings: Sequence[Standing], look: tuple[str, Any]) -> None:
    """Draw one policy's points (K,) with the intervals (K, 3) of their errors, joined in order of the pace."""
    colour, dashes = look
    axes.plot(x, y[:, 0], color=colour, linestyle=dashes, linewidth=1.2, alpha=0.6)
    spread = np.maximum([y[:, 0] - y[:, 1], y[:, 2] - y[:, 0]], 0.0)
    axes.errorbar(x, y[:, 0], spread, fmt="none", ecolor=colour, elinewidth=1.4, capsize=2.5)
    for at, error, standing in zip(x, y[:, 0], standings, strict=True):
        face = "white" if standing.reason else colour
        marker = "<" if at == SLOWEST else "o"
        axes.plot(at, error, color=colour, marker=marker, markersize=6.5, markerfacecolor=face, linestyle="none")


def _panels(boards: Sequence[Leaderboard], height: float) -> tuple[Figure, list[Axes]]:
    figure = Figure(figsize=(WIDTH, height))
    return figure, np.ravel(figure.subplots(1, len(boards), sharey=True)).tolist()


def _looks(boards: Sequence[Leaderboard]) -> Mapping[str, tuple[str, Any]]:
    """Return colour and dashes of each policy, the same in all panels."""
    names = sorted({standing.label for board in boards for standing in board.standings})
    return {name: (COLOURS[k % len(COLOURS)], DASHES[k % len(DASHES)]) for k, name in enumerate(names)}


def _by_policy(boards: Sequence[Leaderboard]) -> dict[str, list[Standing]]:
    found: dict[str, list[Standing]] = {}
    for board in boards:
        for standing in board.standings:
            found.setdefault(standing.label, []).append(standing)
    return found


def _run_of(standing: Standing, board: Leaderboard, runs: Sequence[ScenarioRun]) -> ScenarioRun:
    wanted = (board.scenario, board.pace, board.episodes, board.data, standing.policy)
    conditions = ((run, run.conditions) for run in runs)
    return join_seeds([run for run, c in conditions if (c.scenario, c.pace, c.episodes, c.data, c.policy) == wanted])


def _pace(board: Leaderboard) -> str:
    return f"{board.pace}, {PACES[board.pace]:g} m/s"


def plain_ticks(axes: Axes, which: str, limits: tuple[float, float], most: int = 8) -> None:
    """Label a logarithmic axis at round numbers."""
    low, high = limits
    for steps in ((1, 1.5, 2, 3, 5, 7), (1, 2, 5), (1, 3), (1,)):
        decades = range(int(np.floor(np.log10(low))), int(np.ceil(np.log10(high))) + 1)
        ticks = [step * 10.0**decade for decade in decades for step in steps if low <= step * 10.0**decade <= high]
        if len(ticks) <= most:
            break
    axis = axes.xaxis if which == "x" else axes.yaxis
    axis.set_ticks(ticks)
    axis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axis.set_minor_formatter(NullFormatter())
    axis.set_ticks([], minor=True)


def _headline(figure: Figure, boards: Sequence[Leaderboard], text: str) -> None:
    figure.suptitle(
        f"{boards[0].scenario}: {text[0].lower()}{text[1:]}", x=0.01, ha="left", fontsize=11.0, parse_math=False
    )


def _legend(figure: Figure, looks: Mapping[str, tuple[str, Any]], note: str, *, marked: bool) -> None:
    handles = [
        Line2D([], [], color=colour, linestyle=dashes, marker="o" if marked else None)
        for colour, dashes in looks.values()
    ]
    legend = figure.legend(handles, list(looks), loc="outside lower center", ncols=min(5, len(looks)), title=note)
    for text in legend.get_texts():
        text.set_parse_math(False)  # a name is shown as it is
