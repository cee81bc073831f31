"""The paper's figures from the results of the experiments: one function per figure."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pter_gym.benchmark.measures import column
from pter_gym.tools.figures import (
    CLUTCH_COLOURS,
    COLOURS,
    DASHES,
    MARKERS,
    MILLIMETRE,
    MUTED,
    REFERENCE,
    SMALL,
    WIDTH,
    inch_pounds_right,
    inches_above,
    inches_right,
    label,
    legend_of,
    name_lines,
    numbered,
    rounded_percent,
    scaled,
    styled,
)
from pter_gym.tools.paper.claims import MACHINE_WORDS, TABLE_COLUMNS, TABLE_TOLERANCE
from pter_gym.tools.paper.clutch_tests import (
    FORCE_TIME,
    MEASURED_FROM,
    STEP_VOLTS,
    MaterialCurves,
    Reversal,
    SingleDofTest,
    StepResponse,
)
from pter_gym.tools.paper.parameters import BREAKAWAY_SMALL_VOLTAGE, TIME_CONSTANT
from pter_gym.tools.paper.path_tests import BEST_GAIN, PAPER_TABLE, PLATEAU_FROM, GainSweep, Sweep
from pter_gym.tools.paper.standard_test import Result
from pter_gym.units import INCH, to_inch_pounds

SECOND: dict[str, Any] = {"color": COLOURS[1], "linestyle": DASHES[1]}
GUIDE: dict[str, Any] = {"color": "#8b929c", "linestyle": ":", "linewidth": 1.0}
"""Looks of the second line of a panel, and of lines beside the data."""

ZOOM = 8.0
"""Half the time that a close-up of a reversal shows [ms]."""


def mark(
    axes: Axes, text: str, position: tuple[float, float], offset: tuple[float, float], **looks: Any
) -> None:
    """Write a remark at a position in the data, moved by an offset in points."""
    looks = {"color": MUTED, "fontsize": SMALL, "annotation_clip": False, **looks}
    axes.annotate(text, position, offset, textcoords="offset points", **looks)


def name_of_model(machine: str) -> str:
    """Return a machine's readable name."""
    return MACHINE_WORDS.get(machine, machine.replace("_", " ")).removeprefix("the ")


def _panels(height: float, *shape: int, **options: Any) -> tuple[Figure, Any]:
    """Return a figure of a height [in], and its panel or a grid of them."""
    figure = Figure(figsize=(WIDTH, height))
    return figure, figure.subplots(*shape, **options)


@styled
def single_dof_paths(result: Sequence[SingleDofTest]) -> Figure:
    """Return Figure 3 for each clutch: the tip's path on the line that a locked clutch allows."""
    figure, grid = _panels(5.8, 2, 2)
    for k, (axes, test) in enumerate(zip(grid.flat, result, strict=True)):
        tip = test.trajectory.tip_position.T
        axes.plot(*test.line.T, "--", color=MUTED, linewidth=1.2, label="single-DOF line")
        axes.plot(*tip, linewidth=3.0, label="path of the tip")
        axes.plot(*tip[:, 0], "o", color=COLOURS[0], markersize=6.5, label="start")
        axes.set_aspect("equal", adjustable="datalim")
        axes.set_title(f"clutch {test.clutch}, clutch {test.locked} locked")
        label(axes, "x [m]", "y [m]")
        if k < 2:
            inches_above(axes, "x")
        if k % 2:
            inches_right(axes, "y")
    name_lines(figure, grid[0, 0])
    return figure


@styled
def single_dof_torques(result: Sequence[SingleDofTest]) -> Figure:
    """Return Fig. 4 for each clutch: torques over time while the input torque rises."""
    figure, grid = _panels(5.4, 2, 2)
    level = BREAKAWAY_SMALL_VOLTAGE
    for k, (axes, test) in enumerate(zip(grid.flat, result, strict=True)):
        time = test.trajectory.time
        axes.plot(time, test.input_torque, color=MUTED, linewidth=1.2, label="input torque")
        axes.plot(time, test.torque, label="clutch under test")
        axes.plot(time, np.abs(test.locked_torque), **SECOND, label="locked clutch")
        axes.axhline(level, color=REFERENCE, linestyle=":", linewidth=1.0)
        mark(axes, f"{to_inch_pounds(level):.1f} in·lbf", (0.0, level), (4.0, 4.0))
        axes.set(
            xlim=(0.0, time[-1]),
            ylim=(0.0, 2.6 * level),
            title=f"clutch {test.clutch}, clutch {test.locked} locked",
        )
        label(axes, "time [s]" if k > 1 else "", "" if k % 2 else "torque [N·m]")
        if k % 2:
            inch_pounds_right(axes)
    name_lines(figure, grid[0, 1])
    return figure


@styled
def clutch_step(result: StepResponse) -> Figure:
    """Return the step response of the four clutches and a first-order response."""
    figure, axes = _panels(3.1)
    time, tau, every = result.time, result.time_constant, max(len(result.time) // 18, 1)
    axes.plot(
        time, result.first_order, color=REFERENCE, alpha=0.3, linewidth=5.0, label="first order"
    )
    for k, torque in enumerate(result.torque):
        axes.plot(
            time,
            torque,
            color=CLUTCH_COLOURS[k],
            linestyle="none",
            marker=MARKERS[k],
            markersize=4.5,
            markevery=(k * every // 4, every),
            label=f"clutch {k + 1}",
        )
    rise = (1.0 - np.exp(-1.0)) * result.final
    axes.plot([tau, tau, time[0]], [0.0, rise, rise], **GUIDE)
    mark(axes, f"63 % at τ = {tau:g} s", (tau, rise), (8.0, -10.0))
    axes.set(xlim=(time[0], time[-1]), ylim=(0.0, 1.08 * result.final))
    label(axes, "time since the step [s]", "generated torque [N·m]")
    inch_pounds_right(axes, "generated torque")
    legend_of(figure, axes, f"voltage steps to {STEP_VOLTS:.2f} V under a constant tip force")
    return figure


@styled
def torque_over_voltage(result: Mapping[str, MaterialCurves]) -> Figure:
    """Return Fig. 5: breakaway and dynamic torque of clutch 1, one panel per material."""
    figure, grid = _panels(3.1, 1, len(result), sharey=True, squeeze=False)
    panels = grid[0]
    dots: dict[str, Any] = {"markerfacecolor": "white", "clip_on": False, "zorder": 3.0}
    for axes, (name, curves) in zip(panels, result.items(), strict=True):
        axes.axvspan(0.0, MEASURED_FROM, color=REFERENCE, alpha=0.07, linewidth=0.0)
        axes.plot(curves.volts, curves.breakaway, label="breakaway $T_s$")
        axes.plot(curves.volts, curves.dynamic, **SECOND, label="dynamic $T_k$")
        axes.plot(
            curves.volts, curves.bench_breakaway, "o", color=COLOURS[0], markersize=7.5, **dots
        )
        axes.plot(curves.volts, curves.bench_dynamic, "s", color=COLOURS[1], markersize=4.0, **dots)
        axes.set(xlim=(0.0, curves.volts[-1]), title=name_of_model(name), xlabel="voltage [V]")
        axes.set_ylim(bottom=0.0)
    first = panels[0]
    first.set_ylabel("torque [N·m]")
    first.text(
        MEASURED_FROM / 2.0,
        0.97,
        f"not measured below {MEASURED_FROM:g} V",
        color=MUTED,
        fontsize=SMALL,
        rotation=90.0,
        ha="center",
        va="top",
        transform=first.get_xaxis_transform(),
    )
    inch_pounds_right(panels[-1])
    name_lines(figure, first, "bench test: circles at the first slip, squares while slipping")
    return figure


@styled
def reversal_torques(result: Mapping[str, Reversal]) -> Figure:
    """Return Figure 9: torque of clutch 1 while the motion reverses, and a close-up.

    The close-up is relative to the dynamic torque.
    """
    figure = Figure(figsize=(WIDTH, 3.8))
    count = len(result)
    grid = figure.add_gridspec(count, 2, width_ratios=(1.7, 1.0), wspace=0.06)
    whole = figure.add_subplot(grid[:, 0])
    for k, (name, reversal) in enumerate(result.items()):
        colour, _, dashes = numbered(k)
        time, torque = reversal.trajectory.time, reversal.torque
        whole.plot(time, torque, color=colour, linestyle=dashes, label=name_of_model(name))
        close = figure.add_subplot(grid[k, 1])
        for level in (-1.0, 1.0):
            close.axhline(level, **GUIDE)
        since = 1e3 * (time - time[reversal.index])
        shown = np.abs(since) < ZOOM + 1.0
        ratio = torque[shown] / reversal.dynamic
        close.plot(since[shown], ratio, color=colour, drawstyle="steps-pre")
        close.set(xlim=(-ZOOM, ZOOM), ylim=(-1.5, 1.5), yticks=[-1.0, 0.0, 1.0])
        jump, at = f"jump {rounded_percent(reversal.jump)}", close.transAxes
        close.text(0.97, 0.62, jump, transform=at, ha="right", va="center", color=colour)
        if k < count - 1:
            close.tick_params(labelbottom=False)
        else:
            close.set_xlabel("time from zero slip [ms]")
        if k == count // 2:
            close.set_ylabel("torque / dynamic torque")
    label(whole, "time [s]", "torque of clutch 1 [N·m]")
    inch_pounds_right(whole)
    first = next(iter(result.values()))
    force = f"the force at the tip steps to {first.force:.0f} N at {FORCE_TIME:g} s"
    name_lines(figure, whole, f"clutch 1 at {first.volts:.2f} V; {force}")
    return figure


@styled
def error_over_time_constant(sweeps: Mapping[str, Sweep]) -> Figure:
    """Return Fig. 7: the average position error over the time constant."""
    figure, axes = _panels(3.4)
    _draw_sweeps(axes, sweeps, "position_error", "average position error", "mm", MILLIMETRE)
    mark(axes, "manufacturer", (TIME_CONSTANT, 0.0), (4.0, 5.0))
    name_lines(figure, axes)
    return figure


@styled
def peak_acceleration_over_time_constant(sweeps: Mapping[str, Sweep]) -> Figure:
    """Return Fig. 8: the peak acceleration of the tip over the time constant."""
    figure, axes = _panels(3.4)
    _draw_sweeps(axes, sweeps, "peak_acceleration", "peak tip acceleration", "m/s²")
    mark(axes, "manufacturer", (TIME_CONSTANT, 0.0), (4.0, 5.0))
    name_lines(figure, axes)
    return figure


@styled
def way_and_speed_over_time_constant(sweeps: Mapping[str, Sweep]) -> Figure:
    """Return the tip's path length and mean speed over the time constant (section IV-C.1)."""
    figure, (left, right) = _panels(3.1, 1, 2)
    _draw_sweeps(left, sweeps, "path_length", "path length of the tip", "m")
    _draw_sweeps(right, sweeps, "tip_speed", "mean tip speed", "m/s")
    left.set_ylim(auto=True)
    left.relim()
    left.autoscale(axis="y")
    name_lines(figure, right)
    return figure


def _draw_sweeps(
    axes: Axes, sweeps: Mapping[str, Sweep], quantity: str, name: str, unit: str, size: float = 1.0
) -> None:
    """Draw a quantity of each sweep, in a unit of a size [m], and in inches on the right."""
    axes.axvline(TIME_CONSTANT, **GUIDE)
    for k, (machine, sweep) in enumerate(sweeps.items()):
        _, marker, dashes = numbered(k)
        time, values, lost = sweep.time_constant, getattr(sweep, quantity) / size, ~sweep.completed
        axes.plot(
            time,
            values,
            linestyle=dashes,
            marker=marker,
            linewidth=1.2,
            label=name_of_model(machine),
        )
        axes.plot(time[lost], values[lost], "x", color=REFERENCE)
    axes.set_ylim(bottom=0.0)
    label(axes, "time constant of the clutches [s]", f"{name} [{unit}]")
    inches_right(axes, name, size, unit.lstrip("m"))


@styled
def table_comparison(table: Mapping[str, tuple[float, ...]]) -> Figure:
    """Return Table I as a picture: the paper's numbers with their tolerance, and ours."""
    figure, panels = _panels(2.9, 1, 3, sharey=True)
    rows = range(len(PAPER_TABLE))
    ours, published = (
        np.array([numbers[model] for model in PAPER_TABLE]).T for numbers in (table, PAPER_TABLE)
    )
    name = f"paper ± {rounded_percent(TABLE_TOLERANCE)}"
    for axes, (title, unit), our, paper in zip(panels, TABLE_COLUMNS, ours, published, strict=True):
        axes.errorbar(
            paper,
            rows,
            xerr=TABLE_TOLERANCE * paper,
            fmt="D",
            color=REFERENCE,
            elinewidth=1.2,
            markerfacecolor="white",
            markersize=6.5,
            capsize=4.0,
            label=name,
        )
        axes.plot(our, rows, "o", color=COLOURS[0], markersize=6.5, label="simulated")
        for row in rows:
            text = rounded_percent(our[row] / paper[row] - 1.0, 1, signed=True)
            mark(axes, text, (our[row], row), (0.0, 8.0), ha="center", color=COLOURS[0])
        axes.set_xlim(0.0, 1.15 * axes.get_xlim()[1])
        axes.set_ylim(len(rows) - 0.5, -0.6)
        axes.set_yticks(rows, map(name_of_model, PAPER_TABLE))
        axes.set_xlabel(f"{title} [{unit}]")
        metres = f"[{unit.replace('in', 'm')}]"
        axes.secondary_xaxis("top", functions=scaled(INCH)).set_xlabel(metres)
    legend_of(figure, panels[0])
    return figure


@styled
def error_over_gain(result: GainSweep) -> Figure:
    """Return Figure 10: position error and saturation over the gain of the torque feedback."""
    figure, panels = _panels(4.4, 2, 1, sharex=True, height_ratios=(2.2, 1.0))
    above, below = panels
    looks: dict[str, Any] = {"linewidth": 1.2, "clip_on": False}
    above.plot(result.gain, result.position_error / MILLIMETRE, marker="o", **looks)
    below.plot(
        result.gain, 100.0 * result.saturated, color=COLOURS[1], marker="s", markersize=4.5, **looks
    )
    for axes in panels:
        axes.axvline(BEST_GAIN, **GUIDE)
        axes.axvspan(PLATEAU_FROM, result.gain[-1], color=REFERENCE, alpha=0.06, linewidth=0.0)
        axes.set_xlim(result.gain[0], result.gain[-1])
        axes.set_ylim(bottom=0.0)
    below.set_ylim(top=max(105.0 * result.saturated.max(), 5.0))
    mark(above, f"the paper's best gain, {BEST_GAIN:g}", (BEST_GAIN, 0.0), (4.0, 5.0))
    mark(above, "the paper: about constant here", (PLATEAU_FROM, above.get_ylim()[1]), (4.0, -11.0))
    label(above, "", "average position error [mm]")
    label(below, "gain $K_p$ [V/(in·lbf)]", "saturated\ncommands [%]")
    inches_right(above, "average position error", MILLIMETRE)
    top = above.secondary_xaxis("top", functions=scaled(to_inch_pounds(1.0)))
    top.set_xlabel("gain $K_p$ [V/(N·m)]")
    return figure


@styled
def followed_lines(result: Result) -> Figure:
    """Return Figure 11: the tip's distance from the line, without and with torque feedback."""
    figure, axes = _panels(2.8)
    axes.axhline(0.0, color=REFERENCE, linewidth=4.0, alpha=0.3, label="desired line")
    names = "without torque feedback", f"with torque feedback, $K_p$ = {BEST_GAIN:g} V/(in·lbf)"
    for (run,), name in zip(result.runs.values(), names, strict=True):
        average = f"{run.score.path_average_error_m / MILLIMETRE:.1f} mm on average"
        axes.plot(
            column(run.telemetry, "arc_length"),
            column(run.telemetry, "normal_error") / MILLIMETRE,
            label=f"{name}: {average}",
        )
    axes.set_xlim(0.0, result.task.path.length)
    label(axes, "distance along the line [m]", "distance from the line [mm]")
    inches_above(axes, "distance along the line")
    inches_right(axes, "distance from the line", MILLIMETRE)
    name_lines(figure, axes, f"line-following test, τ = {TIME_CONSTANT:g} s")
    return figure


PICTURES: dict[str, tuple[Callable[[Any], Figure], str]] = {
    "fig3": (single_dof_paths, "single_dof"),
    "fig4": (single_dof_torques, "single_dof"),
    "step": (clutch_step, "step_response"),
    "fig5": (torque_over_voltage, "torque_curves"),
    "fig7": (error_over_time_constant, "sweeps"),
    "fig8": (peak_acceleration_over_time_constant, "sweeps"),
    "fig8_way_and_speed": (way_and_speed_over_time_constant, "sweeps"),
    "table1": (table_comparison, "table1"),
    "fig9": (reversal_torques, "reversals"),
    "fig10": (error_over_gain, "gain_sweep"),
    "fig11": (followed_lines, "line_following"),
}
"""What draws each picture, and what it draws: an attribute of ``Experiments``.

Keys are names of files: that of the output, perhaps with ``_…``.
"""
