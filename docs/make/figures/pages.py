"""Pictures of the documents: error against the commanded pace, and what policies do with the clutches."""

from collections.abc import Collection, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray
from studies.clutch_use import stuck_clutches

from pter_gym.benchmark.measures import column, four
from pter_gym.benchmark.statistics import Interval
from pter_gym.internal import palette
from pter_gym.plots.benchmark import MILLIMETRE
from pter_gym.plots.leaderboard import plain_ticks
from pter_gym.plots.style import COLOURS, REFERENCE, WIDTH, label, styled
from pter_gym.scenarios import PACES

Array = NDArray[np.float64]

INK = "#1f2328"
MUTED = "#646b75"

LEARNED: Any = "-"
TUNED: Any = (0, (6, 1.5))
PAPER: Any = (0, (1.5, 1.2))
PRIVILEGED: Any = (0, (4, 1.5, 1, 1.5))
"""Dashes of trained policies, tuned controllers, those of the paper, and those that know what no robot can."""

LOOKS: Mapping[str, tuple[str, Any]] = {
    "ppo-standard": (palette.BLUE, LEARNED),
    "residual": (palette.PURPLE, LEARNED),
    "single-dof-tuned": (palette.GREEN, TUNED),
    "velocity-ratio-tuned": (palette.BLACK, TUNED),
    "torque-feedback-tuned": (palette.VERMILLION, TUNED),
    "impedance-tuned": (palette.ORANGE, TUNED),
    "torque-feedback": (palette.VERMILLION, PAPER),
    "impedance": (palette.ORANGE, PAPER),
    "predictive": (MUTED, PRIVILEGED),
}
"""Colour and dashes of the policies that have their own; a controller has one colour with and without tuning."""

SHIFT = 0.022
"""Factor, less 1, between the places of two policies at the same pace, so their intervals stay apart."""

LINE = 0.05
"""Smallest distance of two names relative to the height of the axes."""


CLUTCH_COLOURS = (palette.BLUE, palette.VERMILLION, palette.GREEN, palette.PURPLE)

CLUTCHES = ("1: brakes A", "2: brakes B", "3: couples", "4: inverts")

FILLED = 0.3
"""Opacity of the areas below the voltages."""

STUCK = 0.3
"""Depth of the strip that tells when a clutch sticks, relative to the largest voltage."""


class Score(NamedTuple):
    """What a policy reached at one commanded pace.

    Attributes
    ----------
    pace
        Commanded pace [m/s].
    path_error
        With its interval [m].
    ranked
        Whether it arrives and keeps the pace.
    """

    pace: float
    path_error: Interval
    ranked: bool


@styled
def error_against_commanded_pace(fronts: Mapping[str, Sequence[Score]], title: str) -> Figure:
    """Return path error over commanded pace for each policy, with the policies' names beside their last points.

    Parameters
    ----------
    fronts
        Scores by policy, in order of the pace; hollow where they have no rank.
    title
        Above the picture.
    """
    figure = Figure(figsize=(WIDTH, 4.9))
    axes = figure.add_subplot()
    last = {name: front[-1].path_error.value for name, front in fronts.items()}
    looks = {name: _look(name, k) for k, name in enumerate(sorted(last, key=lambda name: last[name]))}
    for place, (name, look) in enumerate(looks.items()):
        _draw_front(axes, fronts[name], (1.0 + SHIFT) ** (place - 0.5 * (len(looks) - 1)), *look)
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlim(min(PACES.values()) / 1.25, max(PACES.values()) * 1.18)
    axes.margins(y=0.06)
    axes.set_xticks(list(PACES.values()), [f"{pace:g}\n{name}" for name, pace in PACES.items()])
    axes.set_xticks([], minor=True)
    plain_ticks(axes, "y", axes.get_ylim())
    axes.grid(visible=False, axis="x")
    label(axes, "commanded pace [m/s]", "path error [mm]")
    axes.set_title(title)
    _name_fronts(axes, looks, last)
    _explain(figure, {dashes for _, dashes in looks.values()})
    return figure


def _explain(figure: Figure, used: Collection[Any]) -> None:
    """Say below the axes what points and dashes mean."""
    kinds = ((LEARNED, "trained"), (TUNED, "tuned"), (PAPER, "the paper's"), (PRIVILEGED, "knows the future"))
    shown = [(Line2D([], [], color=MUTED, linestyle=dashes), kind) for dashes, kind in kinds if dashes in used]
    shown += [(_dot(filled=True), "ranked"), (_dot(filled=False), "no rank")]
    figure.legend(*zip(*shown, strict=True), loc="outside lower center", ncols=len(shown), fontsize=9.0)


def _dot(*, filled: bool) -> Line2D:
    return Line2D([], [], color=MUTED, marker="o", linestyle="none", markerfacecolor=MUTED if filled else "white")


def _look(name: str, place: int) -> tuple[str, Any]:
    return LOOKS.get(name, (COLOURS[place % len(COLOURS)], LEARNED))


def _draw_front(axes: Axes, front: Sequence[Score], shift: float, colour: str, dashes: Any) -> None:
    """Draw one policy's errors with their intervals, moved a little along the pace."""
    x = np.array([score.pace for score in front]) * shift
    y = np.array([score.path_error for score in front]) / MILLIMETRE
    axes.plot(x, y[:, 0], color=colour, linestyle=dashes, linewidth=1.5)
    bars = np.maximum([y[:, 0] - y[:, 1], y[:, 2] - y[:, 0]], 0.0)
    axes.errorbar(x, y[:, 0], bars, fmt="none", ecolor=colour, elinewidth=1.4, capsize=2.5, zorder=3)
    for at, error, score in zip(x, y[:, 0], front, strict=True):
        face = colour if score.ranked else "white"
        axes.plot(at, error, color=colour, marker="o", markersize=6.0, markerfacecolor=face, linestyle="none", zorder=4)


def _name_fronts(axes: Axes, looks: Mapping[str, tuple[str, Any]], last: Mapping[str, float]) -> None:
    """Write names beside the axes, as near to the last errors [m] as they fit one below the other."""
    low, high = np.log(axes.get_ylim())
    wanted = np.array([(np.log(last[name] / MILLIMETRE) - low) / (high - low) for name in looks])
    for name, y, at in zip(looks, spread(wanted, LINE), wanted, strict=True):
        colour, dashes = looks[name]
        axes.plot(
            [1.0, 1.03], [at, y], color=colour, linestyle="-", linewidth=1.0, transform=axes.transAxes, clip_on=False
        )
        axes.plot(
            [1.03, 1.075],
            [y, y],
            color=colour,
            linestyle=dashes,
            linewidth=1.8,
            transform=axes.transAxes,
            clip_on=False,
        )
        axes.text(1.085, y, name, transform=axes.transAxes, va="center", fontsize=9.0, color=INK)


def spread(wanted: Array, gap: float) -> Array:
    """Return places at least ``gap`` apart within [0, 1], in the same order and near to the wanted ones, rising.

    Those that would overlap share their mean; the places are not moved by more than that, unless the ends need it.
    """
    steps = gap * np.arange(len(wanted))
    groups: list[list[float]] = []
    for value in wanted - steps:
        groups.append([float(value)])
        while len(groups) > 1 and np.mean(groups[-2]) > np.mean(groups[-1]):
            groups[-2:] = [groups[-2] + groups[-1]]
    places = np.array([float(np.mean(group)) for group in groups for _ in group])
    return np.asarray(np.clip(places, 0.0, max(1.0 - float(steps[-1]), 0.0)) + steps, np.float64)


@styled
def clutches_over_time(episodes: Mapping[str, Array], voltage_max: float, title: str) -> Figure:
    """Return what policies do in an episode: distance from the path, and voltage and sticking of each clutch.

    Parameters
    ----------
    episodes
        Telemetry by policy, (T + 1, len(TELEMETRY)) each: the row of the reset, then one per control step.
    voltage_max
        Largest voltage of the clutches [V].
    title
        Above the picture.
    """
    figure = Figure(figsize=(WIDTH, 6.4))
    grid: Any = figure.subplots(5, len(episodes), sharex=True, sharey="row", height_ratios=(2.2, 1, 1, 1, 1))
    panels = np.reshape(grid, (5, len(episodes)))
    for column_of_panels, (name, telemetry) in zip(panels.T.tolist(), episodes.items(), strict=True):
        _draw_guided(column_of_panels, telemetry, voltage_max)
        column_of_panels[0].set_title(name)
    panels[0, 0].set_ylabel("distance from\nthe path [mm]")
    panels[0, 0].set_xlim(0.0, max(float(column(each, "time")[-1]) for each in episodes.values()))
    for name, axes in zip(CLUTCHES, panels[1:, 0], strict=True):
        axes.set_ylabel(f"{name}\n[V]")
        axes.set_yticks([0.0, voltage_max])
        axes.set_ylim(-STUCK * voltage_max, 1.04 * voltage_max)
    handles = [Patch(color=MUTED, alpha=FILLED, label="voltage"), Patch(color=INK, label="the clutch sticks")]
    figure.legend(handles=handles, loc="outside lower center", ncols=2)
    figure.suptitle(title, x=0.01, ha="left", fontsize=11.0)
    return figure


def _draw_guided(panels: Sequence[Axes], telemetry: Array, voltage_max: float) -> None:
    """Draw one policy's episode: the distance in the first panel, a clutch in each of the others."""
    time, volts = column(telemetry, "time"), four(telemetry, "volts")
    stuck = stuck_clutches(column(telemetry, "mode"))
    panels[0].axhline(0.0, color=REFERENCE, linestyle="-", linewidth=4.0, alpha=0.3)
    panels[0].plot(time, column(telemetry, "normal_error") / MILLIMETRE, color=INK, linestyle="-", linewidth=1.5)
    for clutch, axes in enumerate(panels[1:]):
        colour = CLUTCH_COLOURS[clutch]
        axes.fill_between(time, 0.0, volts[:, clutch], step="pre", color=colour, alpha=FILLED, linewidth=0.0)
        axes.plot(time, volts[:, clutch], color=colour, linestyle="-", linewidth=1.0, drawstyle="steps-pre")
        bottom = -STUCK * voltage_max
        axes.broken_barh(_spans(time, stuck[:, clutch]), (bottom, -0.6 * bottom), color=INK, linewidth=0.0)
    panels[-1].set_xlabel("time [s]")


def _spans(time: Array, stuck: NDArray[np.bool_]) -> list[tuple[float, float]]:
    """Return begin and length [s] of each time in which a clutch sticks, (T + 1,) by the end of each step."""
    ends = np.flatnonzero(np.diff(np.concatenate([[False], stuck[1:], [False]]).astype(np.int8)))
    return [(float(time[first]), float(time[last] - time[first])) for first, last in ends.reshape(-1, 2)]
