"""The paper's figures from the results of the experiments: one function per figure."""

from collections.abc import Callable, Mapping, Sequence
from typing import Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from pter_gym.benchmark._measures import column
from pter_gym.tools import figures as style
from pter_gym.tools.figures import label, legend_of, styled
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
from pter_gym.tools.paper.path_tests import BEST_GAIN, PAPER_TABLE, PLATEAU_FROM, GainSweep, LineFollowing, Sweep
from pter_gym.tools.paper.printed_values import BREAKAWAY_SMALL_VOLTAGE, TIME_CONSTANT
from pter_gym.tools.paper.study import Study
from pter_gym.units import INCH, to_inch_pounds

Array = NDArray[np.float64]

FAINT = "#8b929c"
"""Colour of marks beside the data."""

MILLIMETRE = 1e-3


def mark(
    axes: Axes,
    text: str,
    position: tuple[float, float],
    offset: tuple[float, float] = (0.0, 0.0),
    *,
    aligned: Literal["left", "center"] = "left",
    colour: str = style.MUTED,
) -> None:
    """Write a remark at a position in the data, moved by an offset in points."""
    axes.annotate(
        text,
        position,
        offset,
        textcoords="offset points",
        ha=aligned,
        color=colour,
        fontsize=style.SMALL,
        annotation_clip=False,
    )


def mark_line(axes: Axes, text: str, x: float, *, top: bool) -> None:
    """Write a remark beside a vertical line, at the top or the bottom of the axes."""
    low, high = axes.get_ylim()
    mark(axes, text, (x, high if top else low), (4.0, -11.0 if top else 5.0))


def name_of(machine: str) -> str:
    """Return a machine's readable name."""
    return NAMES.get(machine, machine.replace("_", " ")).removeprefix("the ")


ZOOM = 0.008
"""Half the time that a close-up of a reversal shows [s]."""


@styled
def single_dof_paths(result: Sequence[SingleDofTest]) -> Figure:
    """Return Fig. 3 for each clutch: the path of the tip on the line that the locked clutch allows."""
    figure = Figure(figsize=(style.WIDTH, 5.8))
    grid = figure.subplots(2, 2)
    for k, (axes, test) in enumerate(zip(grid.flat, result, strict=True)):
        _single_dof_path(axes, test)
        label(axes, "x [m]", "y [m]")
        if k < 2:
            style.inches_above(axes, "x")
        if k % 2:
            style.inches_right(axes, "y")
    legend_of(figure, grid[0, 0])
    return figure


def _single_dof_path(axes: Axes, test: SingleDofTest) -> None:
    tip = test.trajectory.tip_position
    axes.plot(*test.line.T, color=FAINT, linestyle="--", linewidth=1.2, label="single-DOF line")
    axes.plot(*tip.T, color=style.COLOURS[0], linewidth=3.0, label="path of the tip")
    axes.plot(*tip[0], color=style.COLOURS[0], marker="o", markersize=6.5, linestyle="none", label="start")
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_title(f"clutch {test.clutch}, clutch {test.locked} locked")


@styled
def single_dof_torques(result: Sequence[SingleDofTest]) -> Figure:
    """Return Fig. 4 for each clutch: torques over time while the input torque rises."""
    figure = Figure(figsize=(style.WIDTH, 5.4))
    grid = figure.subplots(2, 2)
    for k, (axes, test) in enumerate(zip(grid.flat, result, strict=True)):
        _single_dof_torque(axes, test)
        label(axes, "time [s]" if k > 1 else "", "torque [N·m]" if k % 2 == 0 else "")
        if k % 2:
            style.inch_pounds_right(axes)
    legend_of(figure, grid[0, 0])
    return figure


def _single_dof_torque(axes: Axes, test: SingleDofTest) -> None:
    breakaway = BREAKAWAY_SMALL_VOLTAGE
    time = test.trajectory.time
    axes.plot(time, test.input_torque, color=FAINT, linestyle="-", linewidth=1.2, label="input torque")
    axes.plot(time, test.torque, color=style.COLOURS[0], label="clutch under test")
    axes.plot(
        time, np.abs(test.locked_torque), color=style.COLOURS[1], linestyle=style.DASHES[1], label="locked clutch"
    )
    axes.axhline(breakaway, color=style.REFERENCE, linestyle=":", linewidth=1.0)
    mark(axes, f"{to_inch_pounds(breakaway):.1f} in·lbf", (0.0, breakaway), (4.0, 4.0))
    axes.set_ylim(0.0, 2.6 * breakaway)
    axes.set_xlim(0.0, time[-1])
    axes.set_title(f"clutch {test.clutch}, clutch {test.locked} locked")


@styled
def clutch_step(result: StepResponse) -> Figure:
    """Return the step response of the four clutches beside a first-order response."""
    figure = Figure(figsize=(style.WIDTH, 3.1))
    axes = figure.add_subplot()
    tau = result.time_constant
    axes.plot(result.time, result.first_order, color=style.REFERENCE, alpha=0.3, linewidth=5.0, label="first order")
    every = max(len(result.time) // 18, 1)
    for k, torque in enumerate(result.torque):
        offset = k * every // 4
        axes.plot(
            result.time,
            torque,
            color=style.CLUTCH_COLOURS[k],
            linestyle="none",
            marker=style.numbered(k).marker,
            markersize=4.5,
            markevery=(offset, every),
            label=f"clutch {k + 1}",
        )
    rise = (1.0 - np.exp(-1.0)) * result.final
    axes.plot([tau, tau, result.time[0]], [0.0, rise, rise], color=FAINT, linestyle=":", linewidth=1.0)
    mark(axes, f"63 % at τ = {tau:g} s", (tau, rise), (8.0, -10.0))
    axes.set_xlim(result.time[0], result.time[-1])
    axes.set_ylim(0.0, 1.08 * result.final)
    label(axes, "time since the step [s]", "generated torque [N·m]")
    style.inch_pounds_right(axes, "generated torque")
    legend_of(figure, axes, f"voltage steps to {STEP_VOLTS:.2f} V under a constant tip force")
    return figure


@styled
def torque_over_voltage(result: Mapping[str, MaterialCurves]) -> Figure:
    """Return Fig. 5: breakaway and dynamic torque of clutch 1, one panel per material."""
    figure = Figure(figsize=(style.WIDTH, 3.1))
    panels = figure.subplots(1, len(result), sharey=True, squeeze=False)[0]
    for k, (axes, (name, curves)) in enumerate(zip(panels, result.items(), strict=True)):
        axes.axvspan(0.0, MEASURED_FROM, color=style.REFERENCE, alpha=0.07, linewidth=0.0)
        axes.plot(curves.volts, curves.breakaway, color=style.COLOURS[0], linestyle="-", label="breakaway $T_s$")
        axes.plot(
            curves.volts, curves.dynamic, color=style.COLOURS[1], linestyle=style.DASHES[1], label="dynamic $T_k$"
        )
        for torque, colour, marker, size, what in (
            (curves.bench_breakaway, style.COLOURS[0], "o", 7.5, "first slip"),
            (curves.bench_dynamic, style.COLOURS[1], "s", 4.0, "slipping"),
        ):
            axes.plot(
                curves.bench_volts,
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
        axes.set_xlim(0.0, curves.volts[-1])
        axes.set_ylim(bottom=0.0)
        axes.set_title(name_of(name))
        label(axes, "voltage [V]", "torque [N·m]" if k == 0 else "")
    axes = panels[0]
    axes.text(
        MEASURED_FROM / 2.0,
        0.97,
        f"not measured below {MEASURED_FROM:g} V",
        rotation=90.0,
        ha="center",
        va="top",
        color=style.MUTED,
        fontsize=style.SMALL,
        transform=axes.get_xaxis_transform(),
    )
    style.inch_pounds_right(panels[-1])
    legend_of(figure, axes)
    return figure


@styled
def reversal_torques(result: Mapping[str, Reversal]) -> Figure:
    """Return Fig. 9: torque of clutch 1 while the motion reverses, and a close-up relative to the dynamic torque."""
    figure = Figure(figsize=(style.WIDTH, 3.8))
    count = len(result)
    grid = figure.add_gridspec(count, 2, width_ratios=(1.7, 1.0), wspace=0.06)
    whole = figure.add_subplot(grid[:, 0])
    for k, (name, reversal) in enumerate(result.items()):
        colour, _, dashes = style.numbered(k)
        time = reversal.trajectory.time
        whole.plot(time, reversal.torque, color=colour, linestyle=dashes, label=name_of(name))
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
    note = f"clutch 1 at {first.volts:.2f} V; {force}"
    legend_of(figure, whole, note)
    return figure


def _close_up(axes: Axes, reversal: Reversal, colour: str) -> None:
    time = 1e3 * (reversal.trajectory.time - reversal.trajectory.time[reversal.index])
    ratio = reversal.torque / reversal.dynamic
    shown = np.abs(time) < 1e3 * ZOOM + 1.0
    for level in (-1.0, 1.0):
        axes.axhline(level, color=FAINT, linestyle=":", linewidth=1.0)
    axes.plot(time[shown], ratio[shown], color=colour, linestyle="-", drawstyle="steps-pre", linewidth=1.5)
    axes.set_xlim(-1e3 * ZOOM, 1e3 * ZOOM)
    axes.set_ylim(-1.5, 1.5)
    axes.set_yticks([-1.0, 0.0, 1.0])
    axes.text(
        0.97,
        0.62,
        f"jump {style.percent(reversal.jump)}",
        transform=axes.transAxes,
        ha="right",
        va="center",
        color=colour,
    )


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
def table_comparison(table: Mapping[str, tuple[float, float, float]]) -> Figure:
    """Return Table I as a picture: the paper's numbers with their tolerance, and ours."""
    figure = Figure(figsize=(style.WIDTH, 2.9))
    panels = figure.subplots(1, 3, sharey=True)
    models = list(PAPER_TABLE)
    for place, (axes, (name, unit)) in enumerate(zip(panels, COLUMNS, strict=True)):
        for row, model in enumerate(models):
            _compare(axes, row, PAPER_TABLE[model][place], table[model][place])
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
        average = f"{run.score.mean_error_m / MILLIMETRE:.1f} mm on average"
        arc_length, error = column(run.telemetry, "arc_length"), column(run.telemetry, "normal_error")
        axes.plot(arc_length, error / MILLIMETRE, label=f"{name}: {average}")
    axes.set_xlim(0.0, result.length)
    label(axes, "distance along the line [m]", "distance from the line [mm]")
    style.inches_above(axes, "distance along the line")
    style.inches_right(axes, "distance from the line", MILLIMETRE)
    legend_of(figure, axes, f"line-following test, τ = {result.without.time_constant:g} s")
    return figure


PICTURES: dict[str, Callable[[Study], Figure]] = {
    "fig3": lambda study: single_dof_paths(study.single_dof),
    "fig4": lambda study: single_dof_torques(study.single_dof),
    "step": lambda study: clutch_step(study.step_response),
    "fig5": lambda study: torque_over_voltage(study.torque_curves),
    "fig7": lambda study: error_over_time_constant(study.sweeps),
    "fig8": lambda study: peak_acceleration_over_time_constant(study.sweeps),
    "fig8_way_and_speed": lambda study: way_and_speed_over_time_constant(study.sweeps),
    "table1": lambda study: table_comparison(study.table1),
    "fig9": lambda study: reversal_torques(study.reversals),
    "fig10": lambda study: error_over_gain(study.gain_sweep),
    "fig11": lambda study: followed_lines(study.line_following),
    "policies": lambda study: error_over_time_constant(study.policies),
}
"""How each figure or table is drawn, by the name of its file: that of the product, and what follows a ``_``."""
