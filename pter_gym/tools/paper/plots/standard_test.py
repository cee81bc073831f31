"""Section IV-C, the standard test: Figs. 7, 8, 10 and 11 and Table I."""

from collections.abc import Callable, Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from pter_gym.benchmark._measures import column
from pter_gym.params import TIME_CONSTANT
from pter_gym.tools import figures as style
from pter_gym.tools.figures import label, legend_of, styled
from pter_gym.tools.paper.experiments.claims import COLUMNS, TABLE_TOLERANCE
from pter_gym.tools.paper.experiments.feedback import BEST_GAIN, GainSweep, LineFollowing
from pter_gym.tools.paper.experiments.measures import PLATEAU_FROM, paper_units
from pter_gym.tools.paper.experiments.time_constants import PAPER_TABLE, Sweep, TableRow
from pter_gym.tools.paper.plots.marks import FAINT, MILLIMETRE, mark, mark_line, name_of
from pter_gym.units import INCH, to_inch_pounds

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
    figure = Figure(figsize=(style.WIDTH, 3.4))
    axes = figure.add_subplot()
    _draw_sweeps(axes, sweeps, value)
    label(axes, "time constant of the clutches [s]", f"{name} [{unit}]")
    style.inches_right(axes, name, metres, per)
    mark_line(axes, "manufacturer", TIME_CONSTANT, top=False)
    legend_of(figure, axes)
    return figure


def _draw_sweeps(axes: Axes, sweeps: Mapping[str, Sweep], value: Callable[[Sweep], Array]) -> None:
    axes.axvline(TIME_CONSTANT, color=FAINT, linestyle=":", linewidth=1.0)
    for k, (machine, sweep) in enumerate(sweeps.items()):
        colour, marker, dashes = style.numbered(k)
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
        axes.plot(sweep.time_constant[lost], value(sweep)[lost], color=style.REFERENCE, marker="x", linestyle="none")
    axes.set_ylim(bottom=0.0)


@styled
def way_and_speed_over_time_constant(sweeps: Mapping[str, Sweep]) -> Figure:
    """Return path length and mean speed of the tip over the time constant (section IV-C.1, in the text only)."""
    figure = Figure(figsize=(style.WIDTH, 3.1))
    left, right = figure.subplots(1, 2)
    _draw_sweeps(left, sweeps, lambda sweep: sweep.path_length)
    _draw_sweeps(right, sweeps, lambda sweep: sweep.tip_speed)
    left.set_ylim(auto=True)
    left.relim()
    left.autoscale(axis="y")
    label(left, "time constant of the clutches [s]", "path length of the tip [m]")
    label(right, "time constant of the clutches [s]", "mean tip speed [m/s]")
    style.inches_right(left, "path length of the tip")
    style.inches_right(right, "mean tip speed", per="/s")
    legend_of(figure, left)
    return figure


@styled
def table_comparison(table: Mapping[str, TableRow]) -> Figure:
    """Return Table I as a picture: the paper's numbers with their tolerance, and ours."""
    figure = Figure(figsize=(style.WIDTH, 2.9))
    panels = figure.subplots(1, 3, sharey=True)
    models = list(PAPER_TABLE)
    for place, (axes, (name, unit)) in enumerate(zip(panels, COLUMNS, strict=True)):
        for row, model in enumerate(models):
            _compare(axes, row, PAPER_TABLE[model][place], paper_units(table[model])[place])
        axes.set_xlim(0.0, 1.15 * axes.get_xlim()[1])
        axes.set_ylim(len(models) - 0.5, -0.6)
        axes.set_yticks(range(len(models)), [name_of(model) for model in models])
        axes.set_xlabel(f"{name} [{unit}]")
        axes.secondary_xaxis("top", functions=style.scaled(INCH)).set_xlabel(f"[{unit.replace('in', 'm')}]")
    legend_of(figure, panels[0])
    return figure


def _compare(axes: Axes, row: int, paper: float, ours: float) -> None:
    axes.errorbar(
        paper,
        row,
        xerr=TABLE_TOLERANCE * paper,
        color=style.REFERENCE,
        marker="D",
        markerfacecolor="white",
        markersize=6.5,
        capsize=4.0,
        elinewidth=1.2,
        linestyle="none",
        label=f"paper ± {style.percent(TABLE_TOLERANCE)}" if row == 0 else None,
    )
    axes.plot(
        ours,
        row,
        color=style.COLOURS[0],
        marker="o",
        markersize=6.5,
        linestyle="none",
        label="simulated" if row == 0 else None,
    )
    mark(
        axes,
        style.percent(ours / paper - 1.0, 1, signed=True),
        (ours, row),
        (0.0, 8.0),
        aligned="center",
        colour=style.COLOURS[0],
    )


@styled
def error_over_gain(result: GainSweep) -> Figure:
    """Return Fig. 10: position error over the gain of the torque feedback, and how much the clutches saturate."""
    figure = Figure(figsize=(style.WIDTH, 4.4))
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(2.2, 1.0))
    above.plot(
        result.gain, result.position_error / MILLIMETRE, marker="o", markersize=5.0, linewidth=1.2, clip_on=False
    )
    below.plot(
        result.gain,
        100.0 * result.saturated,
        color=style.COLOURS[1],
        linestyle="-",
        marker="s",
        markersize=4.5,
        linewidth=1.2,
        clip_on=False,
    )
    for axes in (above, below):
        axes.axvline(BEST_GAIN, color=FAINT, linestyle=":", linewidth=1.0)
        axes.axvspan(PLATEAU_FROM, result.gain[-1], color=style.REFERENCE, alpha=0.06, linewidth=0.0)
        axes.set_xlim(result.gain[0], result.gain[-1])
        axes.set_ylim(bottom=0.0)
    below.set_ylim(top=max(105.0 * float(result.saturated.max()), 5.0))
    mark_line(above, f"the paper's best gain, {BEST_GAIN:g}", BEST_GAIN, top=False)
    mark_line(above, "the paper: about constant here", PLATEAU_FROM, top=True)
    label(above, "", "average position error [mm]")
    label(below, "gain $K_p$ [V/(in·lbf)]", "saturated\ncommands [%]")
    style.inches_right(above, "average position error", MILLIMETRE)
    above.secondary_xaxis("top", functions=style.scaled(to_inch_pounds(1.0))).set_xlabel("gain $K_p$ [V/(N·m)]")
    return figure


@styled
def followed_lines(result: LineFollowing) -> Figure:
    """Return Fig. 11: the tip's distance from the line along it, without and with torque feedback."""
    figure = Figure(figsize=(style.WIDTH, 2.8))
    axes = figure.add_subplot()
    axes.axhline(0.0, color=style.REFERENCE, linestyle="-", linewidth=4.0, alpha=0.3, label="desired line")
    for run, name in (
        (result.without, "without torque feedback"),
        (result.with_feedback, f"with torque feedback, $K_p$ = {result.gain:g} V/(in·lbf)"),
    ):
        average = f"{result.setup.position_error(run.score) / MILLIMETRE:.1f} mm on average"
        arc_length, error = column(run.telemetry, "arc_length"), column(run.telemetry, "normal_error")
        axes.plot(arc_length, error / MILLIMETRE, label=f"{name}: {average}")
    axes.set_xlim(0.0, result.setup.task.path.length)
    label(axes, "distance along the line [m]", "distance from the line [mm]")
    style.inches_above(axes, "distance along the line")
    style.inches_right(axes, "distance from the line", MILLIMETRE)
    legend_of(figure, axes, f"line-following test, τ = {result.without.time_constant:g} s")
    return figure
