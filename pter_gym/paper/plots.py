"""The paper's figures from the results of ``pter_gym.paper.experiments``: one function per figure."""

from collections.abc import Callable, Mapping
from typing import Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from pter_gym.paper.experiments.claims import COLUMNS, NAMES, TABLE_TOLERANCE
from pter_gym.paper.experiments.feedback import BEST_GAIN, FollowedLine, GainSweep, LineFollowing
from pter_gym.paper.experiments.measures import PLATEAU_FROM, paper_units
from pter_gym.paper.experiments.reversal import Reversal, Reversals
from pter_gym.paper.experiments.single_dof import SingleDof, SingleDofTest
from pter_gym.paper.experiments.step_response import StepResponse
from pter_gym.paper.experiments.time_constants import PAPER_TABLE, Sweep, TableRow
from pter_gym.paper.experiments.torque_curves import MEASURED_FROM, TorqueCurves
from pter_gym.params import TIME_CONSTANT
from pter_gym.plots.benchmark import MILLIMETRE
from pter_gym.plots.style import (
    COLOURS,
    DASHES,
    REFERENCE,
    WIDTH,
    inch_pounds_right,
    inches_above,
    inches_right,
    label,
    scaled,
    styled,
)
from pter_gym.units import INCH, to_inch_pounds

Array = NDArray[np.float64]

MARKERS = ("o", "s", "^", "D")
FAINT = "#8b929c"
"""Colour of remarks and marks beside the data."""

ZOOM = 0.008
"""Half the time that a close-up of a reversal shows [s]."""


def mark(
    axes: Axes,
    text: str,
    position: tuple[float, float],
    offset: tuple[float, float] = (0.0, 0.0),
    *,
    aligned: Literal["left", "center"] = "left",
    colour: str = FAINT,
) -> None:
    """Write a remark at a position in the data, moved by an offset in points."""
    axes.annotate(
        text,
        position,
        offset,
        textcoords="offset points",
        ha=aligned,
        color=colour,
        fontsize=8.5,
        annotation_clip=False,
    )


def mark_line(axes: Axes, text: str, x: float, *, top: bool) -> None:
    """Write a remark beside a vertical line, at the top or the bottom of the axes."""
    low, high = axes.get_ylim()
    mark(axes, text, (x, high if top else low), (4.0, -11.0 if top else 5.0))


def headline(figure: Figure, text: str) -> None:
    """Write the title of a figure with several panels."""
    figure.suptitle(text, x=0.01, ha="left", fontsize=11.0)


def legend_below(figure: Figure, axes: Axes, columns: int) -> None:
    """Show the legend of one of several panels below all of them."""
    handles, names = axes.get_legend_handles_labels()
    figure.legend(handles, names, loc="outside lower center", ncols=columns)


# --- section III: the clutch model ---


@styled
def single_dof_paths(result: SingleDof) -> Figure:
    """Return Fig. 3 for each clutch: where the tip went, on the line that the locked clutch leaves it."""
    figure = Figure(figsize=(WIDTH, 6.6))
    grid = figure.subplots(2, 2)
    for k, (axes, test) in enumerate(zip(grid.flat, result.tests, strict=True)):
        _single_dof_path(axes, test)
        label(axes, "x [m]", "y [m]")
        if k < 2:
            inches_above(axes, "x")
        if k % 2:
            inches_right(axes, "y")
    legend_below(figure, grid[0, 0], 3)
    headline(figure, "Single degree-of-freedom tests: path of the tip")
    return figure


def _single_dof_path(axes: Axes, test: SingleDofTest) -> None:
    tip = test.trajectory.tip_position
    axes.plot(*test.line.T, color=FAINT, linestyle="--", linewidth=1.2, label="single-DOF line")
    axes.plot(*tip.T, color=COLOURS[0], linewidth=3.0, label="path of the tip")
    axes.plot(*tip[0], color=COLOURS[0], marker="o", markersize=6.5, linestyle="none", label="start")
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_title(f"clutch {test.clutch}, clutch {test.locked} locked", fontsize=10.0)


@styled
def single_dof_torques(result: SingleDof) -> Figure:
    """Return Fig. 4 for each clutch: torques over time while the input torque rises."""
    figure = Figure(figsize=(WIDTH, 6.2))
    grid = figure.subplots(2, 2)
    for k, (axes, test) in enumerate(zip(grid.flat, result.tests, strict=True)):
        _single_dof_torque(axes, test, result.breakaway)
        label(axes, "time [s]" if k > 1 else "", "torque [N·m]" if k % 2 == 0 else "")
        if k % 2:
            inch_pounds_right(axes)
    legend_below(figure, grid[0, 0], 3)
    headline(figure, "Single degree-of-freedom tests: clutch torques")
    return figure


def _single_dof_torque(axes: Axes, test: SingleDofTest, breakaway: float) -> None:
    time = test.trajectory.time
    axes.plot(time, test.input_torque, color=FAINT, linestyle="-", linewidth=1.2, label="input torque")
    axes.plot(time, test.torque, color=COLOURS[0], label="clutch under test")
    axes.plot(time, np.abs(test.locked_torque), color=COLOURS[1], linestyle=DASHES[1], label="locked clutch")
    axes.axhline(breakaway, color=REFERENCE, linestyle=":", linewidth=1.0)
    mark(axes, f"{to_inch_pounds(breakaway):.1f} in·lbf", (0.0, breakaway), (4.0, 4.0))
    axes.set_ylim(0.0, 2.6 * breakaway)
    axes.set_xlim(0.0, time[-1])
    axes.set_title(f"clutch {test.clutch}, clutch {test.locked} locked", fontsize=10.0)


@styled
def clutch_step(result: StepResponse) -> Figure:
    """Return the step response of the four clutches beside a first-order response."""
    figure = Figure(figsize=(WIDTH, 3.6))
    axes = figure.add_subplot()
    tau = result.machine.clutch.time_constant
    axes.plot(result.time, result.first_order, color=REFERENCE, alpha=0.3, linewidth=5.0, label="first order")
    every = max(len(result.time) // 18, 1)
    for k, torque in enumerate(result.torque):
        offset = k * every // 4
        axes.plot(
            result.time,
            torque,
            color=COLOURS[k],
            linestyle="none",
            marker=MARKERS[k],
            markersize=4.5,
            markevery=(offset, every),
            label=f"clutch {k + 1}",
        )
    rise = (1.0 - np.exp(-1.0)) * result.final
    axes.plot([tau, tau, result.time[0]], [0.0, rise, rise], color=FAINT, linestyle=":", linewidth=1.0)
    mark(axes, f"63% at τ = {tau:g} s", (tau, rise), (8.0, -10.0))
    axes.set_xlim(result.time[0], result.time[-1])
    axes.set_ylim(0.0, 1.08 * result.final)
    label(axes, "time since the step [s]", "generated torque [N·m]")
    inch_pounds_right(axes, "generated torque")
    axes.set_title(f"Step of a clutch's voltage to {result.volts:.2f} V under a constant tip force")
    figure.legend(loc="outside lower center", ncols=5)
    return figure


# --- section IV-B: materials ---


@styled
def torque_over_voltage(result: TorqueCurves) -> Figure:
    """Return Fig. 5: breakaway and dynamic torque of clutch 1, one panel per material."""
    figure = Figure(figsize=(WIDTH, 3.9))
    panels = figure.subplots(1, len(result.materials), sharey=True, squeeze=False)[0]
    for k, (axes, (name, curves)) in enumerate(zip(panels, result.materials.items(), strict=True)):
        axes.axvspan(0.0, MEASURED_FROM, color=REFERENCE, alpha=0.07, linewidth=0.0)
        axes.plot(result.volts, curves.breakaway, color=COLOURS[0], linestyle="-", label="breakaway $T_s$")
        axes.plot(result.volts, curves.dynamic, color=COLOURS[1], linestyle=DASHES[1], label="dynamic $T_k$")
        for torque, colour, marker, size, what in (
            (curves.bench_breakaway, COLOURS[0], "o", 7.5, "first slip"),
            (curves.bench_dynamic, COLOURS[1], "s", 4.0, "slipping"),
        ):
            axes.plot(
                result.bench_volts,
                torque,
                color=colour,
                linestyle="none",
                marker=marker,
                markersize=size,
                markerfacecolor="white",
                clip_on=False,
                zorder=3.0,
                label=f"bench test, {what}",
            )
        axes.set_xlim(0.0, result.volts[-1])
        axes.set_ylim(bottom=0.0)
        axes.set_title(name_of(name), fontsize=10.0)
        label(axes, "voltage [V]", "torque [N·m]" if k == 0 else "")
    axes = panels[0]
    axes.text(
        MEASURED_FROM / 2.0,
        0.97,
        f"not measured below {MEASURED_FROM:g} V",
        rotation=90.0,
        ha="center",
        va="top",
        color=FAINT,
        fontsize=8.5,
        transform=axes.get_xaxis_transform(),
    )
    inch_pounds_right(panels[-1])
    legend_below(figure, axes, 4)
    headline(figure, "Torque of clutch 1 over its voltage")
    return figure


def name_of(machine: str) -> str:
    """Return a machine's name for a reader."""
    return NAMES.get(machine, machine.replace("_", " ")).removeprefix("the ")


# --- section IV-C: path following ---


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
    figure = Figure(figsize=(WIDTH, 4.2))
    axes = figure.add_subplot()
    _draw_sweeps(axes, sweeps, value)
    label(axes, "time constant of the clutches [s]", f"{name} [{unit}]")
    inches_right(axes, name, metres, per)
    mark_line(axes, "manufacturer", TIME_CONSTANT, top=False)
    axes.set_title(f"{name.capitalize()} over the time constant")
    figure.legend(loc="outside lower center", ncols=3)
    return figure


def _draw_sweeps(axes: Axes, sweeps: Mapping[str, Sweep], value: Callable[[Sweep], Array]) -> None:
    axes.axvline(TIME_CONSTANT, color=FAINT, linestyle=":", linewidth=1.0)
    for k, (machine, sweep) in enumerate(sweeps.items()):
        axes.plot(
            sweep.time_constant,
            value(sweep),
            marker=MARKERS[k % len(MARKERS)],
            markersize=5.0,
            linewidth=1.2,
            label=name_of(machine),
        )
        lost = ~sweep.completed
        axes.plot(sweep.time_constant[lost], value(sweep)[lost], color=REFERENCE, marker="x", linestyle="none")
    axes.set_ylim(bottom=0.0)


@styled
def way_and_speed_over_time_constant(sweeps: Mapping[str, Sweep]) -> Figure:
    """Return path length and mean speed of the tip over the time constant (section IV-C.1, in the text only)."""
    figure = Figure(figsize=(WIDTH, 3.8))
    left, right = figure.subplots(1, 2)
    _draw_sweeps(left, sweeps, lambda sweep: sweep.path_length)
    _draw_sweeps(right, sweeps, lambda sweep: sweep.tip_speed)
    left.set_ylim(auto=True)
    left.relim()
    left.autoscale(axis="y")
    label(left, "time constant of the clutches [s]", "path length of the tip [m]")
    label(right, "time constant of the clutches [s]", "mean tip speed [m/s]")
    inches_right(left, "")
    inches_right(right, "mean tip speed", per="/s")
    legend_below(figure, left, 3)
    headline(figure, "Path length and mean speed over the time constant")
    return figure


@styled
def table_comparison(table: Mapping[str, TableRow]) -> Figure:
    """Return Table I as a picture: the paper's numbers with their tolerance, and ours."""
    figure = Figure(figsize=(WIDTH, 3.3))
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
    legend_below(figure, panels[0], 2)
    headline(figure, "Table I: averages over the time constants")
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
        label=f"paper ± {TABLE_TOLERANCE:.0%}" if row == 0 else None,
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
    deviation = f"{ours / paper - 1.0:+.1%}".replace("-", "−")
    mark(axes, deviation, (ours, row), (0.0, 8.0), aligned="center", colour=COLOURS[0])


# --- Fig. 9 ---


@styled
def reversal_torques(result: Reversals) -> Figure:
    """Return Fig. 9: torque of clutch 1 while the motion turns back, and a close-up relative to the dynamic torque."""
    figure = Figure(figsize=(WIDTH, 4.6))
    count = len(result.machines)
    grid = figure.add_gridspec(count, 2, width_ratios=(1.7, 1.0), wspace=0.06)
    whole = figure.add_subplot(grid[:, 0])
    for k, (name, reversal) in enumerate(result.machines.items()):
        time = reversal.trajectory.time
        whole.plot(time, reversal.torque, color=COLOURS[k], linestyle=DASHES[k], label=name_of(name))
        close = figure.add_subplot(grid[k, 1])
        _close_up(close, reversal, COLOURS[k])
        if k < count - 1:
            close.tick_params(labelbottom=False)
        else:
            close.set_xlabel("time from zero slip [ms]")
        if k == count // 2:
            close.set_ylabel("torque / dynamic torque")
    label(whole, "time [s]", "torque of clutch 1 [N·m]")
    inch_pounds_right(whole)
    whole.set_title(f"Clutch 1 at {result.volts:.2f} V; tip force steps to {np.hypot(*result.force):.0f} N at 0.1 s")
    figure.legend(loc="outside lower center", ncols=3)
    return figure


def _close_up(axes: Axes, reversal: Reversal, colour: str) -> None:
    time = 1e3 * (reversal.trajectory.time - reversal.time)
    ratio = reversal.torque / reversal.dynamic
    shown = np.abs(time) < 1e3 * ZOOM + 1.0
    for level in (-1.0, 1.0):
        axes.axhline(level, color=FAINT, linestyle=":", linewidth=1.0)
    axes.plot(time[shown], ratio[shown], color=colour, linestyle="-", drawstyle="steps-pre", linewidth=1.5)
    axes.set_xlim(-1e3 * ZOOM, 1e3 * ZOOM)
    axes.set_ylim(-1.5, 1.5)
    axes.set_yticks([-1.0, 0.0, 1.0])
    axes.text(0.97, 0.62, f"jump {reversal.jump:.0%}", transform=axes.transAxes, ha="right", va="center", color=colour)


# --- section IV-C.3: torque feedback ---


@styled
def error_over_gain(result: GainSweep) -> Figure:
    """Return Fig. 10: position error over the gain of the torque feedback, and how much the clutches saturate."""
    figure = Figure(figsize=(WIDTH, 5.0))
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(2.2, 1.0))
    above.plot(
        result.gain, result.position_error / MILLIMETRE, marker="o", markersize=5.0, linewidth=1.2, clip_on=False
    )
    below.plot(
        result.gain,
        100.0 * result.saturated,
        color=COLOURS[1],
        linestyle="-",
        marker="s",
        markersize=4.5,
        linewidth=1.2,
        clip_on=False,
    )
    for axes in (above, below):
        axes.axvline(BEST_GAIN, color=FAINT, linestyle=":", linewidth=1.0)
        axes.axvspan(PLATEAU_FROM, result.gain[-1], color=REFERENCE, alpha=0.06, linewidth=0.0)
        axes.set_xlim(result.gain[0], result.gain[-1])
        axes.set_ylim(bottom=0.0)
    below.set_ylim(top=max(105.0 * float(result.saturated.max()), 5.0))
    mark_line(above, f"the paper's best gain, {BEST_GAIN:g}", BEST_GAIN, top=False)
    mark_line(above, "the paper: about constant here", PLATEAU_FROM, top=True)
    label(above, "", "average position error [mm]")
    label(below, "gain $K_p$ [V/(in·lbf)]", "saturated\ncommands [%]")
    inches_right(above, "average position error", MILLIMETRE)
    above.secondary_xaxis("top", functions=scaled(to_inch_pounds(1.0))).set_xlabel("gain $K_p$ [V/(N·m)]")
    return figure


@styled
def followed_lines(result: LineFollowing) -> Figure:
    """Return Fig. 11: how far from the line the tip was along it, without and with torque feedback."""
    figure = Figure(figsize=(WIDTH, 3.9))
    axes = figure.add_subplot()
    axes.axhline(0.0, color=REFERENCE, linestyle="-", linewidth=4.0, alpha=0.3, label="desired line")
    _draw_followed(axes, result.without, "without torque feedback")
    _draw_followed(axes, result.with_feedback, f"with torque feedback, $K_p$ = {result.gain:g} V/(in·lbf)")
    axes.set_xlim(0.0, result.task.path.length)
    label(axes, "distance along the line [m]", "distance from the line [mm]")
    inches_above(axes, "distance along the line")
    inches_right(axes, "distance from the line", MILLIMETRE)
    axes.set_title(f"Line-following test, τ = {result.time_constant:g} s")
    figure.legend(loc="outside lower center", ncols=1)
    return figure


def _draw_followed(axes: Axes, run: FollowedLine, name: str) -> None:
    average = f"{run.position_error / MILLIMETRE:.1f} mm on average"
    axes.plot(run.arc_length, run.normal_error / MILLIMETRE, label=f"{name}: {average}")
