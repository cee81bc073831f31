"""Section IV-C: the standard test over the time constant, Figs. 7 and 8 and Table I."""

from collections.abc import Callable, Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from pter_gym.paper.experiments.claims import COLUMNS, TABLE_TOLERANCE
from pter_gym.paper.experiments.measures import paper_units
from pter_gym.paper.experiments.time_constants import PAPER_TABLE, Sweep, TableRow
from pter_gym.paper.plots.marks import FAINT, MILLIMETRE, mark, mark_line, name_of
from pter_gym.params import TIME_CONSTANT
from pter_gym.plots.legends import legend_of
from pter_gym.plots.style import (
    COLOURS,
    LOOKS,
    REFERENCE,
    WIDTH,
    inches_right,
    label,
    percent,
    scaled,
    styled,
)
from pter_gym.units import INCH

Array = NDArray[np.float64]


def error_over_time_constant(sweeps: Mapping[str, Sweep]) -> Figure:
    """Return Fig. 7: the average position error over the time constant."""
    return _over_time_constant(
        sweeps, lambda sweep: sweep.position_error / MILLIMETRE, "average position error", "mm", MILLIMETRE, ""
    )


def peak_acceleration_over_time_constant(sweeps: Mapping[str, Sweep]) -> Figure:
    """Return Fig. 8: the peak acceleration of the tip over the time constant."""
    return _over_time_constant(
        sweeps, lambda sweep: sweep.peak_acceleration, "peak tip acceleration", "m/s²", 1.0, "/s²"
    )


@styled
def _over_time_constant(
    sweeps: Mapping[str, Sweep], value: Callable[[Sweep], Array], name: str, unit: str, metres: float, per: str
) -> Figure:
    figure = Figure(figsize=(WIDTH, 3.4))
    axes = figure.add_subplot()
    _draw_sweeps(axes, sweeps, value)
    label(axes, "time constant of the clutches [s]", f"{name} [{unit}]")
    inches_right(axes, name, metres, per)
    mark_line(axes, "manufacturer", TIME_CONSTANT, top=False)
    legend_of(figure, axes)
    return figure


def _draw_sweeps(axes: Axes, sweeps: Mapping[str, Sweep], value: Callable[[Sweep], Array]) -> None:
    axes.axvline(TIME_CONSTANT, color=FAINT, linestyle=":", linewidth=1.0)
    for k, (machine, sweep) in enumerate(sweeps.items()):
        colour, marker, dashes = LOOKS[k]
        axes.plot(
            sweep.time_constant,
            value(sweep),
            color=colour,
            linestyle=dashes,
            marker=marker,
            linewidth=1.2,
            label=name_of(machine),
        )
        lost = ~sweep.completed
        axes.plot(sweep.time_constant[lost], value(sweep)[lost], color=REFERENCE, marker="x", linestyle="none")
    axes.set_ylim(bottom=0.0)


@styled
def way_and_speed_over_time_constant(sweeps: Mapping[str, Sweep]) -> Figure:
    """Return path length and mean speed of the tip over the time constant (section IV-C.1, in the text only)."""
    figure = Figure(figsize=(WIDTH, 3.1))
    left, right = figure.subplots(1, 2)
    _draw_sweeps(left, sweeps, lambda sweep: sweep.path_length)
    _draw_sweeps(right, sweeps, lambda sweep: sweep.tip_speed)
    left.set_ylim(auto=True)
    left.relim()
    left.autoscale(axis="y")
    label(left, "time constant of the clutches [s]", "path length of the tip [m]")
    label(right, "time constant of the clutches [s]", "mean tip speed [m/s]")
    inches_right(left, "path length of the tip")
    inches_right(right, "mean tip speed", per="/s")
    legend_of(figure, left)
    return figure


@styled
def table_comparison(table: Mapping[str, TableRow]) -> Figure:
    """Return Table I as a picture: the paper's numbers with their tolerance, and ours."""
    figure = Figure(figsize=(WIDTH, 2.9))
    panels = figure.subplots(1, 3, sharey=True)
    models = list(PAPER_TABLE)
    for column, (axes, (name, unit)) in enumerate(zip(panels, COLUMNS, strict=True)):
        for row, model in enumerate(models):
            _compare(axes, row, PAPER_TABLE[model][column], paper_units(table[model])[column])
        axes.set_xlim(0.0, 1.15 * axes.get_xlim()[1])
        axes.set_ylim(len(models) - 0.5, -0.6)
        axes.set_yticks(range(len(models)), [name_of(model) for model in models])
        axes.set_xlabel(f"{name} [{unit}]")
        axes.secondary_xaxis("top", functions=scaled(INCH)).set_xlabel(f"[{unit.replace('in', 'm')}]")
    legend_of(figure, panels[0])
    return figure


def _compare(axes: Axes, row: int, paper: float, ours: float) -> None:
    axes.errorbar(
        paper,
        row,
        xerr=TABLE_TOLERANCE * paper,
        color=REFERENCE,
        marker="D",
        markerfacecolor="white",
        markersize=6.5,
        capsize=4.0,
        elinewidth=1.2,
        linestyle="none",
        label=f"paper ± {percent(TABLE_TOLERANCE)}" if row == 0 else None,
    )
    axes.plot(
        ours,
        row,
        color=COLOURS[0],
        marker="o",
        markersize=6.5,
        linestyle="none",
        label="simulated" if row == 0 else None,
    )
    mark(
        axes, percent(ours / paper - 1.0, 1, signed=True), (ours, row), (0.0, 8.0), aligned="center", colour=COLOURS[0]
    )
