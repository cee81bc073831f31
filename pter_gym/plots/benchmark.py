"""Figures of the standard test: where the tips went, and how far from the path over time."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from pter_gym.benchmark.measures import column, vector
from pter_gym.benchmark.standard import Result
from pter_gym.internal.looks import Look, looks
from pter_gym.params import TIME_CONSTANT
from pter_gym.plots.legends import dots, entries, legend_below, shown
from pter_gym.plots.style import REFERENCE, WIDTH, inches_above, inches_right, label, styled

Array = NDArray[np.float64]

MILLIMETRE = 1e-3

_PATH_SAMPLES = 257
_DESIRED: Any = {"color": REFERENCE, "linestyle": "-", "linewidth": 4.0, "alpha": 0.3, "label": "desired path"}


class Trace(NamedTuple):
    """One episode of one policy.

    Attributes
    ----------
    name
        The policy.
    time
        Since the start of the episode [s], shape (T,).
    tip
        Tip position [m], shape (T, 2).
    normal_error
        Distance from the path, positive to its left [m], shape (T,).
    completed
        Whether the tip passed the end of the path.
    """

    name: str
    time: Array
    tip: Array
    normal_error: Array
    completed: bool


def tip_paths(result: Result, time_constant: float = TIME_CONSTANT) -> Figure:
    """Return the desired path and the tip's path for each policy, as in Fig. 11.

    Parameters
    ----------
    result
        Of the standard test.
    time_constant
        Of the clutches [s]; the nearest one in the result is shown, by default the manufacturer's.
    """
    shown = nearest_time_constant(result, time_constant)
    path = result.task.path
    points = np.array([path.point(float(s)) for s in np.linspace(0.0, path.length, _PATH_SAMPLES)])
    return tip_path_figure(traces(result, shown), points, f"line-following test, τ = {shown:g} s")


def error_against_time(result: Result, time_constant: float = TIME_CONSTANT) -> Figure:
    """Return the normal error over time for each policy; parameters as in ``tip_paths``."""
    shown = nearest_time_constant(result, time_constant)
    return error_figure(traces(result, shown), f"line-following test, τ = {shown:g} s")


def nearest_time_constant(result: Result, time_constant: float) -> float:
    """Return the time constant [s] of the result that is nearest to a given one."""
    available = [run.time_constant for run in next(iter(result.runs.values()))]
    return min(available, key=lambda tau: abs(tau - time_constant))


def traces(result: Result, time_constant: float) -> list[Trace]:
    """Return each policy's episode at one of the result's time constants [s]."""
    return [
        Trace(
            name,
            column(run.telemetry, "time"),
            vector(run.telemetry, "tip"),
            column(run.telemetry, "normal_error"),
            run.score.completed,
        )
        for name, runs in result.runs.items()
        for run in runs
        if run.time_constant == time_constant
    ]


@styled
def tip_path_figure(episodes: Sequence[Trace], path: Array, what: str) -> Figure:
    """Return the tip's paths over the desired path, points (K, 2) [m], both axes to the same scale.

    ``what`` is above the legend.
    """
    everything = np.vstack([path, *(episode.tip for episode in episodes)])
    width, height = np.ptp(everything, axis=0) + 0.02
    figure = Figure(figsize=(WIDTH, min(max(1.0 + 6.0 * height / width, 2.4), 6.2)))
    axes = figure.add_subplot()
    axes.plot(*path.T, **_DESIRED)
    for place, episode in enumerate(episodes):
        x, y = episode.tip.T
        draw_episode(axes, episode, x, y, looks_of(episodes)[episode.name], dots(place, len(episodes)))
    axes.set_aspect("equal", adjustable="datalim")
    label(axes, "x [m]", "y [m]")
    inches_above(axes, "x")
    inches_right(axes, "y")
    finish(figure, {episode.name: episode.name for episode in episodes}, what)
    return figure


@styled
def error_figure(episodes: Sequence[Trace], what: str) -> Figure:
    """Return the normal errors over time. Episodes that go on after the last arrival are cut soon after it.

    ``what`` is above the legend.
    """
    figure = Figure(figsize=(WIDTH, 3.0))
    axes = figure.add_subplot()
    axes.axhline(0.0, **_DESIRED)
    end = last_time_shown(episodes)
    names: dict[str, str] = {}
    for place, episode in enumerate(episodes):
        cut = float(episode.time[-1]) > end
        names[episode.name] = f"{episode.name} (until {episode.time[-1]:.3g} s)" if cut else episode.name
        look, at = looks_of(episodes)[episode.name], dots(place, len(episodes))
        draw_episode(axes, episode, episode.time, episode.normal_error / MILLIMETRE, look, at)
    axes.set_xlim(0.0, end)
    label(axes, "time [s]", "normal error [mm]")
    inches_right(axes, "normal error", MILLIMETRE)
    finish(figure, names, what)
    return figure


def looks_of(episodes: Sequence[Trace]) -> dict[str, Look]:
    """Return the looks of the policies of some episodes."""
    return looks(episode.name for episode in episodes)


def last_time_shown(episodes: Sequence[Trace]) -> float:
    """Return where the time axis ends [s]: a little after the last arrival, or with the longest episode."""
    longest = max(float(episode.time[-1]) for episode in episodes)
    arrivals = [float(episode.time[-1]) for episode in episodes if episode.completed]
    return min(1.1 * max(arrivals), 1.02 * longest) if arrivals else longest


def draw_episode(axes: Axes, episode: Trace, x: Array, y: Array, look: Look, at: tuple[float, float]) -> None:
    """Draw one episode with markers on its line; its end has a large one, hollow if it is not the end of the path."""
    axes.plot(
        x,
        y,
        label=episode.name,
        color=look.colour,
        linestyle=look.dashes,
        marker=look.marker,
        markevery=at,
        markersize=4.0,
    )
    face = look.colour if episode.completed else "white"
    axes.plot(
        x[-1:], y[-1:], linestyle="none", marker=look.marker, markersize=7.0, color=look.colour, markerfacecolor=face
    )


def finish(figure: Figure, names: Mapping[str, str], what: str) -> None:
    """Add the legend below the axes: what the policies are called, by their names."""
    desired = Line2D([], [], **_DESIRED)
    note = f"{what}; large markers: the end, filled if the tip passed the end of the path"
    legend_below(figure, [desired, *entries(looks(names))], ["desired path", *map(shown, names.values())], note)
