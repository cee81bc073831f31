"""The paper's figures from the results of the experiments: one function per figure."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from pter_gym.benchmark.measures import column
from pter_gym.tools import figures as style
from pter_gym.tools.figures import MILLIMETRE, label, legend_of, name_lines, styled
from pter_gym.tools.paper.claims import COLUMNS, NAMES, TABLE_TOLERANCE
from pter_gym.tools.paper.clutch_tests import (
    FORCE_TIME,
    MEASURED_FROM,
    STEP_VOLTS,
    MaterialCurves,
    Reversal,
    SingleDofTest,
    StepResponse,
)
from pter_gym.tools.paper.experiments import Experiments
from pter_gym.tools.paper.parameters import BREAKAWAY_SMALL_VOLTAGE, TIME_CONSTANT
from pter_gym.tools.paper.path_tests import BEST_GAIN, PAPER_TABLE, PLATEAU_FROM, GainSweep, Sweep
from pter_gym.tools.paper.standard_test import Result
from pter_gym.units import INCH, to_inch_pounds

Array = NDArray[np.float64]

FIRST: dict[str, Any] = {"color": style.COLOURS[0], "linestyle": "-"}
SECOND: dict[str, Any] = {"color": style.COLOURS[1], "linestyle": style.DASHES[1]}
GUIDE: dict[str, Any] = {"color": "#8b929c", "linestyle": ":", "linewidth": 1.0}
"""Looks of the first and second line of a panel, and of lines beside the data."""

ZOOM = 8.0
"""Half the time that a close-up of a reversal shows [ms]."""


def mark(
    axes: Axes, text: str, position: tuple[float, float], offset: tuple[float, float], **looks: Any
) -> None:
    """Write a remark at a position in the data, moved by an offset in points."""
    looks = {"color": style.MUTED, "fontsize": style.SMALL, "annotation_clip": False, **looks}
    axes.annotate(text, position, offset, textcoords="offset points", **looks)


def name_of(machine: str) -> str:
    """Return a machine's readable name."""
    return NAMES.get(machine, machine.replace("_", " ")).removeprefix("the ")


@styled
def single_dof_paths(result: Sequence[SingleDofTest]) -> Figure:
    """Return Figure 3 for each clutch: the tip's path on the line that a locked clutch allows."""
    figure = Figure(figsize=(style.WIDTH, 5.8))
    grid = figure.subplots(2, 2)
    for k, (axes, test) in enumerate(zip(grid.flat, result, strict=True)):
        tip = test.trajectory.tip_position
        axes.plot(
            *test.line.T, color=style.MUTED, linestyle="--", linewidth=1.2, label="single-DOF line"
        )
        axes.plot(*tip.T, color=style.COLOURS[0], linewidth=3.0, label="path of the tip")
        axes.plot(
            *tip[0],
            color=style.COLOURS[0],
            marker="o",
            markersize=6.5,
            linestyle="none",
            label="start",
        )
        axes.set_aspect("equal", adjustable="datalim")
        axes.set_title(f"clutch {test.clutch}, clutch {test.locked} locked")
        label(axes, "x [m]", "y [m]")
        if k < 2:
            style.inches_above(axes, "x")
        if k % 2:
            style.inches_right(axes, "y")
    name_lines(figure, grid[0, 0])
    return figure


@styled
def single_dof_torques(result: Sequence[SingleDofTest]) -> Figure:
    """Return Fig. 4 for each clutch: torques over time while the input torque rises."""
    figure = Figure(figsize=(style.WIDTH, 5.4))
    grid = figure.subplots(2, 2)
    level = BREAKAWAY_SMALL_VOLTAGE
    for k, (axes, test) in enumerate(zip(grid.flat, result, strict=True)):
        time = test.trajectory.time
        axes.plot(
            time,
            test.input_torque,
            color=style.MUTED,
            linestyle="-",
            linewidth=1.2,
            label="input torque",
        )
        axes.plot(time, test.torque, color=style.COLOURS[0], label="clutch under test")
        axes.plot(time, np.abs(test.locked_torque), **SECOND, label="locked clutch")
        axes.axhline(level, color=style.REFERENCE, linestyle=":", linewidth=1.0)
        mark(axes, f"{to_inch_pounds(level):.1f} in·lbf", (0.0, level), (4.0, 4.0))
        axes.set(
            xlim=(0.0, time[-1]),
            ylim=(0.0, 2.6 * level),
            title=f"clutch {test.clutch}, clutch {test.locked} locked",
        )
        label(axes, "time [s]" if k > 1 else "", "torque [N·m]" if k % 2 == 0 else "")
        if k % 2:
            style.inch_pounds_right(axes)
    name_lines(figure, grid[0, 1])
    return figure


@styled
def clutch_step(result: StepResponse) -> Figure:
    """Return the step response of the four clutches and a first-order response."""
    figure = Figure(figsize=(style.WIDTH, 3.1))
    axes = figure.add_subplot()
    time, tau, every = result.time, result.time_constant, max(len(result.time) // 18, 1)
    axes.plot(
        time,
        result.first_order,
        color=style.REFERENCE,
        alpha=0.3,
        linewidth=5.0,
        label="first order",
    )
    for k, torque in enumerate(result.torque):
        dots: dict[str, Any] = {
            "marker": style.MARKERS[k],
            "markersize": 4.5,
            "markevery": (k * every // 4, every),
        }
        axes.plot(
            time,
            torque,
            color=style.CLUTCH_COLOURS[k],
            linestyle="none",
            **dots,
            label=f"clutch {k + 1}",
        )
    rise = (1.0 - np.exp(-1.0)) * result.final
    axes.plot([tau, tau, time[0]], [0.0, rise, rise], **GUIDE)
    mark(axes, f"63 % at τ = {tau:g} s", (tau, rise), (8.0, -10.0))
    axes.set(xlim=(time[0], time[-1]), ylim=(0.0, 1.08 * result.final))
    label(axes, "time since the step [s]", "generated torque [N·m]")
    style.inch_pounds_right(axes, "generated torque")
    legend_of(figure, axes, f"voltage steps to {STEP_VOLTS:.2f} V under a constant tip force")
    return figure


@styled
def torque_over_voltage(result: Mapping[str, MaterialCurves]) -> Figure:
    """Return Fig. 5: breakaway and dynamic torque of clutch 1, one panel per material."""
    figure = Figure(figsize=(style.WIDTH, 3.1))
    panels = figure.subplots(1, len(result), sharey=True, squeeze=False)[0]
    dots: dict[str, Any] = {
        "linestyle": "none",
        "markerfacecolor": "white",
        "clip_on": False,
        "zorder": 3.0,
    }
    first = {**FIRST, **dots, "marker": "o", "markersize": 7.5}
    slipping = {**SECOND, **dots, "marker": "s", "markersize": 4.0}
    for k, (axes, (name, curves)) in enumerate(zip(panels, result.items(), strict=True)):
        axes.axvspan(0.0, MEASURED_FROM, color=style.REFERENCE, alpha=0.07, linewidth=0.0)
        axes.plot(curves.volts, curves.breakaway, **FIRST, label="breakaway $T_s$")
        axes.plot(curves.volts, curves.dynamic, **SECOND, label="dynamic $T_k$")
        axes.plot(curves.volts, curves.bench_breakaway, **first)
        axes.plot(curves.volts, curves.bench_dynamic, **slipping)
        axes.set(xlim=(0.0, curves.volts[-1]), title=name_of(name))
        axes.set_ylim(bottom=0.0)
        label(axes, "voltage [V]", "torque [N·m]" if k == 0 else "")
    text, transform = f"not measured below {MEASURED_FROM:g} V", panels[0].get_xaxis_transform()
    looks: dict[str, Any] = {"rotation": 90.0, "ha": "center", "va": "top", "transform": transform}
    panels[0].text(
        MEASURED_FROM / 2.0, 0.97, text, color=style.MUTED, fontsize=style.SMALL, **looks
    )
    style.inch_pounds_right(panels[-1])
    name_lines(figure, panels[0], "bench test: circles at the first slip, squares while slipping")
    return figure


@styled
def reversal_torques(result: Mapping[str, Reversal]) -> Figure:
    """Return Figure 9: torque of clutch 1 while the motion reverses, and a close-up.

    The close-up is relative to the dynamic torque.
    """
    figure = Figure(figsize=(style.WIDTH, 3.8))
    count = len(result)
    grid = figure.add_gridspec(count, 2, width_ratios=(1.7, 1.0), wspace=0.06)
    whole = figure.add_subplot(grid[:, 0])
    for k, (name, reversal) in enumerate(result.items()):
        colour, _, dashes = style.numbered(k)
        whole.plot(
            reversal.trajectory.time,
            reversal.torque,
            color=colour,
            linestyle=dashes,
            label=name_of(name),
        )
        close = figure.add_subplot(grid[k, 1])
        _close_up(close, reversal, colour)
        if k < count - 1:
            close.tick_params(labelbottom=False)
        else:
            close.set_xlabel("time from zero slip [ms]")
        if k == count // 2:
            close.set_ylabel("torque / dynamic torque")
    label(whole, "time [s]", "torque of clutch 1 [N·m]")
    style.inch_pounds_right(whole)
    first = next(iter(result.values()))
    force = f"the force at the tip steps to {first.force:.0f} N at {FORCE_TIME:g} s"
    name_lines(figure, whole, f"clutch 1 at {first.volts:.2f} V; {force}")
    return figure


def _close_up(axes: Axes, reversal: Reversal, colour: str) -> None:
    time = 1e3 * (reversal.trajectory.time - reversal.trajectory.time[reversal.index])
    ratio, shown = reversal.torque / reversal.dynamic, np.abs(time) < ZOOM + 1.0
    for level in (-1.0, 1.0):
        axes.axhline(level, **GUIDE)
    axes.plot(
        time[shown], ratio[shown], color=colour, linestyle="-", drawstyle="steps-pre", linewidth=1.5
    )
    axes.set(xlim=(-ZOOM, ZOOM), ylim=(-1.5, 1.5), yticks=[-1.0, 0.0, 1.0])
    jump = f"jump {style.percent(reversal.jump)}"
    axes.text(0.97, 0.62, jump, transform=axes.transAxes, ha="right", va="center", color=colour)


@styled
def error_over_time_constant(sweeps: Mapping[str, Sweep]) -> Figure:
    """Return Fig. 7: the average position error over the time constant."""
    figure = Figure(figsize=(style.WIDTH, 3.4))
    axes = figure.add_subplot()
    _draw_sweeps(
        axes, sweeps, lambda sweep: sweep.position_error / MILLIMETRE, "average position error [mm]"
    )
    style.inches_right(axes, "average position error", MILLIMETRE)
    mark(axes, "manufacturer", (TIME_CONSTANT, 0.0), (4.0, 5.0))
    name_lines(figure, axes)
    return figure


@styled
def peak_acceleration_over_time_constant(sweeps: Mapping[str, Sweep]) -> Figure:
    """Return Fig. 8: the peak acceleration of the tip over the time constant."""
    figure = Figure(figsize=(style.WIDTH, 3.4))
    axes = figure.add_subplot()
    _draw_sweeps(
        axes, sweeps, lambda sweep: sweep.peak_acceleration, "peak tip acceleration [m/s²]"
    )
    style.inches_right(axes, "peak tip acceleration", per="/s²")
    mark(axes, "manufacturer", (TIME_CONSTANT, 0.0), (4.0, 5.0))
    name_lines(figure, axes)
    return figure


@styled
def way_and_speed_over_time_constant(sweeps: Mapping[str, Sweep]) -> Figure:
    """Return the tip's path length and mean speed over the time constant (section IV-C.1)."""
    figure = Figure(figsize=(style.WIDTH, 3.1))
    length_axes, right = figure.subplots(1, 2)
    _draw_sweeps(length_axes, sweeps, lambda sweep: sweep.path_length, "path length of the tip [m]")
    _draw_sweeps(right, sweeps, lambda sweep: sweep.tip_speed, "mean tip speed [m/s]")
    length_axes.set_ylim(auto=True)
    length_axes.relim()
    length_axes.autoscale(axis="y")
    style.inches_right(length_axes, "path length of the tip")
    style.inches_right(right, "mean tip speed", per="/s")
    name_lines(figure, right)
    return figure


def _draw_sweeps(
    axes: Axes, sweeps: Mapping[str, Sweep], value: Callable[[Sweep], Array], name: str
) -> None:
    axes.axvline(TIME_CONSTANT, **GUIDE)
    for k, (machine, sweep) in enumerate(sweeps.items()):
        time, values, (colour, marker, dashes) = (
            sweep.time_constant,
            value(sweep),
            style.numbered(k),
        )
        looks: dict[str, Any] = {
            "color": colour,
            "linestyle": dashes,
            "marker": marker,
            "linewidth": 1.2,
        }
        axes.plot(time, values, **looks, label=name_of(machine))
        lost = ~sweep.completed
        axes.plot(time[lost], values[lost], color=style.REFERENCE, marker="x", linestyle="none")
    axes.set_ylim(bottom=0.0)
    label(axes, "time constant of the clutches [s]", name)


@styled
def table_comparison(table: Mapping[str, tuple[float, ...]]) -> Figure:
    """Return Table I as a picture: the paper's numbers with their tolerance, and ours."""
    figure = Figure(figsize=(style.WIDTH, 2.9))
    panels = figure.subplots(1, 3, sharey=True)
    rows = range(len(PAPER_TABLE))
    ours, published = (
        np.array([table[model] for model in PAPER_TABLE]),
        np.array(list(PAPER_TABLE.values())),
    )
    dots: dict[str, Any] = {"linestyle": "none", "markersize": 6.5}
    diamonds = dots | {
        "color": style.REFERENCE,
        "marker": "D",
        "markerfacecolor": "white",
        "capsize": 4.0,
    }
    name = f"paper ± {style.percent(TABLE_TOLERANCE)}"
    for axes, (title, unit), our, paper in zip(panels, COLUMNS, ours.T, published.T, strict=True):
        axes.errorbar(
            paper, rows, xerr=TABLE_TOLERANCE * paper, elinewidth=1.2, **diamonds, label=name
        )
        axes.plot(our, rows, color=style.COLOURS[0], marker="o", **dots, label="simulated")
        for row in rows:
            text = style.percent(our[row] / paper[row] - 1.0, 1, signed=True)
            mark(axes, text, (our[row], row), (0.0, 8.0), ha="center", color=style.COLOURS[0])
        axes.set_xlim(0.0, 1.15 * axes.get_xlim()[1])
        axes.set_ylim(len(rows) - 0.5, -0.6)
        axes.set_yticks(rows, [name_of(model) for model in PAPER_TABLE])
        axes.set_xlabel(f"{title} [{unit}]")
        axes.secondary_xaxis("top", functions=style.scaled(INCH)).set_xlabel(
            f"[{unit.replace('in', 'm')}]"
        )
    legend_of(figure, panels[0])
    return figure


@styled
def error_over_gain(result: GainSweep) -> Figure:
    """Return Figure 10: position error and saturation over the gain of the torque feedback."""
    figure = Figure(figsize=(style.WIDTH, 4.4))
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(2.2, 1.0))
    looks: dict[str, Any] = {"linestyle": "-", "linewidth": 1.2, "clip_on": False}
    above.plot(result.gain, result.position_error / MILLIMETRE, marker="o", markersize=5.0, **looks)
    below.plot(
        result.gain,
        100.0 * result.saturated,
        color=style.COLOURS[1],
        marker="s",
        markersize=4.5,
        **looks,
    )
    for axes in (above, below):
        axes.axvline(BEST_GAIN, **GUIDE)
        axes.axvspan(
            PLATEAU_FROM, result.gain[-1], color=style.REFERENCE, alpha=0.06, linewidth=0.0
        )
        axes.set_xlim(result.gain[0], result.gain[-1])
        axes.set_ylim(bottom=0.0)
    below.set_ylim(top=max(105.0 * float(result.saturated.max()), 5.0))
    mark(above, f"the paper's best gain, {BEST_GAIN:g}", (BEST_GAIN, 0.0), (4.0, 5.0))
    mark(above, "the paper: about constant here", (PLATEAU_FROM, above.get_ylim()[1]), (4.0, -11.0))
    label(above, "", "average position error [mm]")
    label(below, "gain $K_p$ [V/(in·lbf)]", "saturated\ncommands [%]")
    style.inches_right(above, "average position error", MILLIMETRE)
    above.secondary_xaxis("top", functions=style.scaled(to_inch_pounds(1.0))).set_xlabel(
        "gain $K_p$ [V/(N·m)]"
    )
    return figure


@styled
def followed_lines(result: Result) -> Figure:
    """Return Figure 11: the tip's distance from the line, without and with torque feedback."""
    figure = Figure(figsize=(style.WIDTH, 2.8))
    axes = figure.add_subplot()
    axes.axhline(
        0.0, color=style.REFERENCE, linestyle="-", linewidth=4.0, alpha=0.3, label="desired line"
    )
    names = "without torque feedback", f"with torque feedback, $K_p$ = {BEST_GAIN:g} V/(in·lbf)"
    for (run,), name in zip(result.runs.values(), names, strict=True):
        average = f"{run.score.path_average_error_m / MILLIMETRE:.1f} mm on average"
        arc_length, error = (
            column(run.telemetry, "arc_length"),
            column(run.telemetry, "normal_error"),
        )
        axes.plot(arc_length, error / MILLIMETRE, label=f"{name}: {average}")
    axes.set_xlim(0.0, result.task.path.length)
    label(axes, "distance along the line [m]", "distance from the line [mm]")
    style.inches_above(axes, "distance along the line")
    style.inches_right(axes, "distance from the line", MILLIMETRE)
    name_lines(figure, axes, f"line-following test, τ = {TIME_CONSTANT:g} s")
    return figure


PICTURES: dict[str, Callable[[Experiments], Figure]] = {
    "fig3": lambda experiments: single_dof_paths(experiments.single_dof),
    "fig4": lambda experiments: single_dof_torques(experiments.single_dof),
    "step": lambda experiments: clutch_step(experiments.step_response),
    "fig5": lambda experiments: torque_over_voltage(experiments.torque_curves),
    "fig7": lambda experiments: error_over_time_constant(experiments.sweeps),
    "fig8": lambda experiments: peak_acceleration_over_time_constant(experiments.sweeps),
    "fig8_way_and_speed": lambda experiments: way_and_speed_over_time_constant(experiments.sweeps),
    "table1": lambda experiments: table_comparison(experiments.table1),
    "fig9": lambda experiments: reversal_torques(experiments.reversals),
    "fig10": lambda experiments: error_over_gain(experiments.gain_sweep),
    "fig11": lambda experiments: followed_lines(experiments.line_following),
}
"""How each picture is drawn, by its file's name: that of the output, perhaps with ``_…``."""
