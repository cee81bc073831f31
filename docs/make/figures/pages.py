"""Pictures of the documents: error against the commanded pace, and what policies do with the clutches."""

from collections.abc import Mapping, Sequence
from math import ceil
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
from pter_gym.internal.looks import LEARNED, LOOKS, OF_PAPER, PLANS, PRIVILEGED, TUNED, Look, looks
from pter_gym.plots.benchmark import MILLIMETRE
from pter_gym.plots.legends import legend_below, shown
from pter_gym.plots.style import CLUTCH_COLOURS, INK, MUTED, REFERENCE, WIDTH, label, styled
from pter_gym.plots.ticks import plain_ticks
from pter_gym.scenarios import PACES

Array = NDArray[np.float64]

SHIFT = 0.022
"""Factor, less 1, between the places of two policies at the same pace, so their intervals stay apart."""

LINE = 0.055
"""Smallest distance of two names relative to the height of the axes."""

BESIDE = 3
"""Most policies beside each other where each has panels of its own."""

WIDE = 90
"""Most characters of all titles beside each other."""

KINDS = (
    (LEARNED, "trained"),
    (TUNED, "tuned"),
    (OF_PAPER, "the paper's"),
    (PLANS, "plans"),
    (PRIVILEGED, "knows the future"),
)
"""What the dashes of a policy say."""

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
def error_against_commanded_pace(fronts: Mapping[str, Sequence[Score]], note: str) -> Figure:
    """Return path error over commanded pace for each policy, with the policies' names beside their last points.

    Parameters
    ----------
    fronts
        Scores by policy, in order of the pace; hollow where they have no rank.
    note
        Above the legend: what was run.
    """
    figure = Figure(figsize=(WIDTH, 4.0))
    axes = figure.add_subplot()
    last = {name: front[-1].path_error.value for name, front in fronts.items()}
    by_policy = {name: _look(name, look) for name, look in looks(sorted(last, key=lambda name: last[name])).items()}
    for place, (name, look) in enumerate(by_policy.items()):
        _draw_front(axes, fronts[name], (1.0 + SHIFT) ** (place - 0.5 * (len(by_policy) - 1)), look)
    paces = {score.pace for front in fronts.values() for score in front}
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlim(min(paces) / 1.25, max(paces) * 1.18)
    axes.margins(y=0.06)
    names = {pace: name for name, pace in PACES.items() if pace in paces}
    axes.set_xticks(list(names), [f"{pace:g}\n{name}" for pace, name in names.items()])
    axes.set_xticks([], minor=True)
    plain_ticks(axes, "y")
    axes.grid(visible=False, axis="x")
    label(axes, "commanded pace [m/s]", "path error [mm]")
    _name_fronts(axes, by_policy, last)
    _explain(figure, [look.dashes for look in by_policy.values()], note)
    return figure


def _explain(figure: Figure, used: Sequence[Any], note: str) -> None:
    """Say below the axes what points and dashes mean."""
    entries = {kind: Line2D([], [], color=MUTED, linestyle=dashes) for dashes, kind in KINDS if dashes in used}
    entries |= {"ranked": _dot(filled=True), "no rank": _dot(filled=False)}
    legend_below(figure, list(entries.values()), list(entries), note)


def _dot(*, filled: bool) -> Line2D:
    return Line2D([], [], color=MUTED, marker="o", linestyle="none", markerfacecolor=MUTED if filled else "white")


def _look(name: str, look: Look) -> Look:
    """Return a policy's look; one that has none of its own is a trained one."""
    return look if name in LOOKS else look._replace(dashes=LEARNED)


def _draw_front(axes: Axes, front: Sequence[Score], shift: float, look: Look) -> None:
    """Draw one policy's errors with their intervals, moved a little along the pace."""
    colour, marker, dashes = look
    x = np.array([score.pace for score in front]) * shift
    y = np.array([score.path_error for score in front]) / MILLIMETRE
    axes.plot(x, y[:, 0], color=colour, linestyle=dashes)
    bars = np.maximum([y[:, 0] - y[:, 1], y[:, 2] - y[:, 0]], 0.0)
    axes.errorbar(x, y[:, 0], bars, fmt="none", ecolor=colour, elinewidth=1.2, zorder=3)
    for at, error, score in zip(x, y[:, 0], front, strict=True):
        face = colour if score.ranked else "white"
        axes.plot(
            at, error, color=colour, marker=marker, markersize=6.0, markerfacecolor=face, linestyle="none", zorder=4
        )


def _name_fronts(axes: Axes, by_policy: Mapping[str, Look], last: Mapping[str, float]) -> None:
    """Write names beside the axes, as near to the last errors [m] as they fit one below the other."""
    low, high = np.log(axes.get_ylim())
    wanted = np.array([(np.log(last[name] / MILLIMETRE) - low) / (high - low) for name in by_policy])
    beside: Any = {"transform": axes.transAxes, "clip_on": False}
    for name, y, at in zip(by_policy, spread(wanted, LINE), wanted, strict=True):
        colour, marker, dashes = by_policy[name]
        axes.plot([1.0, 1.03], [at, y], color=colour, linestyle="-", linewidth=1.0, **beside)
        axes.plot([1.03, 1.085], [y, y], color=colour, linestyle=dashes, **beside)
        axes.plot(1.057, y, color=colour, marker=marker, markersize=5.0, **beside)
        axes.text(1.095, y, shown(name, WIDE // 3), transform=axes.transAxes, va="center")


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
def clutches_over_time(episodes: Mapping[str, Array], voltage_max: float) -> Figure:
    """Return what policies do in an episode: distance from the path, and voltage and sticking of each clutch.

    Parameters
    ----------
    episodes
        Telemetry by policy, (T + 1, len(TELEMETRY)) each: the row of the reset, then one per control step.
    voltage_max
        Largest voltage of the clutches [V].
    """
    columns = min(len(episodes), BESIDE)
    blocks = ceil(len(episodes) / columns)
    figure = Figure(figsize=(WIDTH, 5.6 * blocks))
    heights = (2.2, 1, 1, 1, 1) * blocks
    grid: Any = figure.subplots(5 * blocks, columns, sharey="row", height_ratios=heights, squeeze=False)
    panels = grid.reshape(blocks, 5, columns).swapaxes(1, 2).reshape(-1, 5)
    for column_of_panels, (name, telemetry) in zip(panels.tolist(), episodes.items(), strict=False):
        _draw_guided(column_of_panels, telemetry, voltage_max)
        column_of_panels[0].set_title(shown(name, WIDE // columns))
    for axes in panels[len(episodes) :].ravel():
        axes.set_visible(False)
    end = max(float(column(each, "time")[-1]) for each in episodes.values())
    for axes in panels.ravel():
        axes.set_xlim(0.0, end)
    for axes in panels[:, :-1].ravel():
        axes.tick_params(labelbottom=False)
    for first in panels[::columns]:
        first[0].set_ylabel("distance from\nthe path [mm]")
        for name, axes in zip(CLUTCHES, first[1:], strict=True):
            axes.set_ylabel(f"{name}\n[V]")
            axes.set_yticks([0.0, voltage_max])
            axes.set_ylim(-STUCK * voltage_max, 1.1 * voltage_max)
    figure.align_ylabels(list(grid[:, 0]))
    legend_below(figure, [Patch(color=MUTED, alpha=FILLED), Patch(color=INK)], ["voltage", "the clutch sticks"])
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
