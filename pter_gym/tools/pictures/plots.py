"""Figures of a scenario's scores, drawn with Matplotlib."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullLocator, StrMethodFormatter
from numpy.typing import NDArray

from pter_gym.benchmark.boards import PACE_ERROR, Leaderboard, Standing
from pter_gym.benchmark.cells import shorten
from pter_gym.controllers import CONTROLLERS
from pter_gym.policies.tuned import tuned_policies
from pter_gym.scenarios import PACES
from pter_gym.scenarios.paces import find_pace, title_of_pace
from pter_gym.tools.figures import (
    MILLIMETRE,
    REFERENCE,
    SMALL,
    WIDTH,
    Look,
    label,
    looks,
    save,
    styled,
)
from pter_gym.tools.pictures.drawing import WORKSPACE, apart, drawable, policy_colours

__all__ = ["draw_scenario", "error_against_pace", "profiles"]

MAX_LABEL = 60
"""Most characters of a name in a picture."""

FAINT = 0.35
"""Opacity of a policy that is not ranked."""

MIN_PACE, MAX_PACE = 0.03, 1.0
"""Mean paces [m/s] at which slower and faster policies are drawn."""


def draw_scenario(boards: Sequence[Leaderboard], folder: Path) -> list[Path]:
    """Draw the leaderboards of one scenario into a folder as PNG files; return their paths."""
    figures = {"profiles": profiles(boards), "error-against-pace": error_against_pace(boards)}
    return [
        save(figure, folder / f"{boards[0].scenario}-{name}.png")
        for name, figure in figures.items()
    ]


@styled
def profiles(boards: Sequence[Leaderboard]) -> Figure:
    """Return the performance profiles of a scenario: the fraction of episodes within an error.

    ``boards`` are leaderboards of one scenario; each pace has its panel.
    """
    figure = Figure(figsize=(WIDTH, 3.0))
    panels: list[Axes] = np.ravel(figure.subplots(1, len(boards), sharey=True)).tolist()
    every = [standing.errors.ravel() for board in boards for standing in board.standings]
    low, high = (max(float(end(np.concatenate(every))), 1e-5) for end in (np.min, np.max))
    thresholds = np.geomspace(0.9 * low, 1.1 * high, 200)
    millimetres = thresholds / MILLIMETRE
    by_policy, curves = _looks(boards), dict[str, tuple[NDArray[np.float64], str]]()
    for axes, board in zip(panels, boards, strict=True):
        axes.set_title(title_of_pace(board.pace))
        for standing in board.standings:
            errors = np.sort(standing.errors, axis=None)
            shares = np.searchsorted(errors, thresholds, side="right") / len(errors)
            colour, _, dashes = by_policy[standing.policy]
            alpha = FAINT if standing.reason else 1.0
            axes.plot(millimetres, shares, color=colour, linestyle=dashes, alpha=alpha)
            if axes is panels[-1]:
                curves[titled(standing.policy, [standing])] = shares, colour
        axes.set_xscale("log")
        plain_ticks(axes, "x")
        axes.set_xlabel("path error [mm]")
    panels[0].set_ylabel("share of episodes within it")
    # each curve is labelled at a height of its own
    heights: list[float] = np.linspace(0.95, 0.05, len(curves)).tolist()
    ends = {
        name: (float(np.interp(height, shares, millimetres)), height)
        for height, (name, (shares, _)) in zip(heights, curves.items(), strict=True)
    }
    label_ends(panels[-1], ends, {name: colour for name, (_, colour) in curves.items()})
    board_note(figure, boards[0], "dashed: control laws; faint: not ranked")
    return figure


@styled
def error_against_pace(boards: Sequence[Leaderboard]) -> Figure:
    """Return the path error of each policy over its mean pace, with the commanded paces marked."""
    figure = Figure(figsize=(WIDTH, 3.9))
    axes = figure.add_subplot()
    for board in boards:
        pace = find_pace(board.pace)
        low, high = pace * (1.0 - PACE_ERROR), pace * (1.0 + PACE_ERROR)
        axes.axvspan(low, high, color=WORKSPACE, zorder=0)
        axes.axvline(pace, color=REFERENCE, linewidth=1.0, linestyle=":", zorder=1)
    ends, colours = dict[str, tuple[float, float]](), dict[str, str]()
    for name, (colour, marker, dashes) in _looks(boards).items():
        standings = [
            standing for board in boards for standing in board.standings if standing.policy == name
        ]
        x = np.clip(
            [standing.scores["mean_pace_m_s"] for standing in standings], MIN_PACE, MAX_PACE
        )
        y = np.array([standing.error for standing in standings], np.float64) / MILLIMETRE
        axes.plot(x, y[:, 0], color=colour, linestyle=dashes, linewidth=1.2, alpha=0.6)
        spread = np.maximum([y[:, 0] - y[:, 1], y[:, 2] - y[:, 0]], 0.0)
        axes.errorbar(x, y[:, 0], spread, fmt="none", ecolor=colour, elinewidth=1.2)
        look: dict[str, Any] = {
            "color": colour,
            "marker": marker,
            "markersize": 6.0,
            "linestyle": "none",
        }
        for at, error, standing in zip(x, y[:, 0], standings, strict=True):
            axes.plot(at, error, **look, markerfacecolor="white" if standing.reason else colour)
        title = titled(name, standings)
        ends[title], colours[title] = max(zip(x.tolist(), y[:, 0].tolist(), strict=True)), colour
    axes.set_xscale("log")
    axes.set_yscale("log")
    _pace_ticks(axes, {board.pace: find_pace(board.pace) for board in boards})
    plain_ticks(axes, "y")
    label(axes, "mean pace along the path [m/s]", "path error [mm]")
    label_ends(axes, ends, colours)
    note = "dashed: control laws; hollow: not ranked; bars: 95 % intervals\n"
    note += f"shaded: mean pace within {100 * PACE_ERROR:g} % of the commanded one"
    board_note(figure, boards[0], note)
    return figure


# --- names, legends, ticks ---


def plain(text: str) -> str:
    """Return text that Matplotlib draws as it is, without mathematical markup."""
    return drawable(text).replace("$", r"\$")


def titled(name: str, standings: Iterable[Standing]) -> str:
    """Return a policy's name and, in brackets, why it has no rank somewhere."""
    words = dict.fromkeys(each.reason.word for each in standings if each.reason)
    return f"{name} ({', '.join(words)})" if words else name


def plain_ticks(axes: Axes, which: str) -> None:
    """Label a logarithmic axis at round numbers, without powers of ten."""
    axis = axes.xaxis if which == "x" else axes.yaxis
    low, high = axis.get_view_interval()
    digits = range(1, 10) if high < 4.0 * low else (1, 2, 5) if high < 100.0 * low else (1,)
    axis.set_major_locator(LogLocator(subs=[float(digit) for digit in digits]))
    axis.set_major_formatter(StrMethodFormatter("{x:.10g}"))
    axis.set_minor_locator(NullLocator())


def _pace_ticks(axes: Axes, paces: Mapping[str, float]) -> None:
    """Label a logarithmic axis at each commanded pace [m/s], and at the ends that are drawn."""
    low, high = axes.get_xlim()
    axes.set_xlim(min(low, 0.9 * min(paces.values())), max(high, 1.1 * max(paces.values())))
    labels = {
        pace: f"{pace:g}\n{name}" if name in PACES else f"{pace:g}" for name, pace in paces.items()
    }
    labels |= {MIN_PACE: f"≤ {MIN_PACE:g}"} if low <= MIN_PACE else {}
    labels |= {MAX_PACE: f"≥ {MAX_PACE:g}"} if high >= MAX_PACE else {}
    axes.set_xticks(list(labels), list(labels.values()))
    axes.xaxis.set_minor_locator(NullLocator())


def _looks(boards: Sequence[Leaderboard]) -> dict[str, Look]:
    """Return a look for each policy, dashed for a control law."""
    names = {standing.policy for board in boards for standing in board.standings}
    colours = policy_colours(names)
    return {
        name: Look(colour, look.marker, "--" if name in {*CONTROLLERS, *tuned_policies()} else "-")
        for (name, colour), look in zip(colours.items(), looks(colours).values(), strict=True)
    }


def label_ends(
    axes: Axes, ends: Mapping[str, tuple[float, float]], colours: Mapping[str, str]
) -> None:
    """Write names beside the axes, in the colours and at the heights of the ends (x, y)."""
    figure: Any = axes.figure
    to_axes = axes.transData + axes.transAxes.inverted()
    heights = {name: float(to_axes.transform(end)[1]) for name, end in ends.items()}
    names = sorted(heights, key=heights.__getitem__)
    line = 1.3 * SMALL / (58.0 * figure.get_figheight())
    places = apart(np.array([heights[name] for name in names]), line, 1.0)
    for name, place in zip(names, places, strict=True):
        colour = colours[name]
        axes.annotate(
            plain(shorten(drawable(name), MAX_LABEL)),
            ends[name],
            (1.03, place),
            textcoords="axes fraction",
            arrowprops={
                "arrowstyle": "-",
                "color": colour,
                "linewidth": 0.7,
                "alpha": 0.6,
                "shrinkB": 4.0,
            },
            color=colour,
            fontsize=SMALL,
            va="center",
            annotation_clip=False,
        )


def board_note(figure: Figure, board: Leaderboard, note: str) -> None:
    """Caption the panels with what was run, and a note."""
    figure.supxlabel(f"{plain(board.title)}; {note}", fontsize=8.5)
