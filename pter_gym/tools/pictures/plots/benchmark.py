"""Figures of the standard test: the tips' paths, and their distance from the desired path over time."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from pter_gym.benchmark._measures import column, vector
from pter_gym.benchmark._standard import Result, Run
from pter_gym.params import TIME_CONSTANT
from pter_gym.tools.figures import (
    MILLIMETRE,
    REFERENCE,
    WIDTH,
    inches_above,
    inches_right,
    label,
    looks,
    numbered,
    styled,
)
from pter_gym.tools.pictures.plots.legends import dots, name_policies

Array = NDArray[np.float64]

_PATH_SAMPLES = 257
_DESIRED: Any = {"color": REFERENCE, "linestyle": "-", "linewidth": 4.0, "alpha": 0.3, "label": "desired path"}


@styled
def tip_paths(result: Result, time_constant: float = TIME_CONSTANT) -> Figure:
    """Return the desired path and the tip's path for each policy, as in Fig. 11, with both axes to the same scale.

    Parameters
    ----------
    result
        Result of the standard test.
    time_constant
        Of the clutches [s]; the nearest one in the result is shown, by default the manufacturer's.
    """
    runs = _runs(result, time_constant)
    path = result.task.path
    points = np.array([path.point(float(s)) for s in np.linspace(0.0, path.length, _PATH_SAMPLES)])
    tips = [vector(run.telemetry, "tip") for run in runs.values()]
    width, height = np.ptp(np.vstack([points, *tips]), axis=0) + 0.02
    figure = Figure(figsize=(WIDTH, min(max(1.0 + 6.0 * height / width, 2.4), 6.2)))
    axes = figure.add_subplot()
    axes.plot(*points.T, **_DESIRED)
    for place, (name, tip) in enumerate(zip(runs, tips, strict=True)):
        _draw(axes, name, runs[name], tip, place, len(runs))
    axes.set_aspect("equal", adjustable="datalim")
    label(axes, "x [m]", "y [m]")
    inches_above(axes, "x")
    inches_right(axes, "y")
    _finish(figure, runs, list(runs))
    return figure


@styled
def error_against_time(result: Result, time_constant: float = TIME_CONSTANT) -> Figure:
    """Return the normal error over time for each policy; parameters as in ``tip_paths``.

    Episodes that go on after the last arrival are cut soon after it.
    """
    runs = _runs(result, time_constant)
    figure = Figure(figsize=(WIDTH, 3.0))
    axes = figure.add_subplot()
    axes.axhline(0.0, **_DESIRED)
    ends = {name: float(column(run.telemetry, "time")[-1]) for name, run in runs.items()}
    arrivals = [ends[name] for name, run in runs.items() if run.score.completed]
    end = min(1.1 * max(arrivals, default=np.inf), 1.02 * max(ends.values()))
    for place, (name, run) in enumerate(runs.items()):
        errors = column(run.telemetry, "normal_error") / MILLIMETRE
        curve = np.stack([column(run.telemetry, "time"), errors], axis=1)
        _draw(axes, name, run, curve, place, len(runs))
    axes.set_xlim(0.0, end)
    label(axes, "time [s]", "normal error [mm]")
    inches_right(axes, "normal error", MILLIMETRE)
    _finish(figure, runs, [f"{name} (until {ends[name]:.3g} s)" if ends[name] > end else name for name in runs])
    return figure


def _runs(result: Result, time_constant: float) -> dict[str, Run]:
    """Return each policy's episode at the time constant [s] of the result that is nearest to a given one."""

    def distance(run: Run) -> float:
        return abs(run.time_constant - time_constant)

    return {name: min(runs, key=distance) for name, runs in result.runs.items()}


def _draw(axes: Axes, name: str, run: Run, curve: Array, place: int, count: int) -> None:
    """Draw one episode, a curve (T, 2); its end has a large marker, hollow if it is not the end of the path."""
    colour, marker, dashes = numbered(place)
    at = dots(place, count)
    axes.plot(*curve.T, label=name, color=colour, linestyle=dashes, marker=marker, markevery=at, markersize=4.0)
    face = colour if run.score.completed else "white"
    axes.plot(*curve[-1:].T, linestyle="none", marker=marker, markersize=7.0, color=colour, markerfacecolor=face)


def _finish(figure: Figure, runs: dict[str, Run], names: list[str]) -> None:
    """Add the legend below the axes."""
    tau = next(iter(runs.values())).time_constant
    note = f"line-following test, τ = {tau:g} s; large markers: the end, filled if the tip passed the end of the path"
    name_policies(figure, looks(runs), names, note, {"desired path": Line2D([], [], **_DESIRED)})
