"""Sections III and IV-B, the clutches: Figs. 3, 4, 5 and 9 and the step response."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pter_gym.tools import figures as style
from pter_gym.tools.figures import label, legend_of, styled
from pter_gym.tools.paper.experiments.reversal import FORCE_TIME, Reversal, Reversals
from pter_gym.tools.paper.experiments.single_dof import SingleDof, SingleDofTest
from pter_gym.tools.paper.experiments.step_response import StepResponse
from pter_gym.tools.paper.experiments.torque_curves import MEASURED_FROM, TorqueCurves
from pter_gym.tools.paper.plots.marks import FAINT, mark, name_of
from pter_gym.units import to_inch_pounds

ZOOM = 0.008
"""Half the time that a close-up of a reversal shows [s]."""


@styled
def single_dof_paths(result: SingleDof) -> Figure:
    """Return Fig. 3 for each clutch: the path of the tip on the line that the locked clutch allows."""
    figure = Figure(figsize=(style.WIDTH, 5.8))
    grid = figure.subplots(2, 2)
    for k, (axes, test) in enumerate(zip(grid.flat, result.tests, strict=True)):
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
def single_dof_torques(result: SingleDof) -> Figure:
    """Return Fig. 4 for each clutch: torques over time while the input torque rises."""
    figure = Figure(figsize=(style.WIDTH, 5.4))
    grid = figure.subplots(2, 2)
    for k, (axes, test) in enumerate(zip(grid.flat, result.tests, strict=True)):
        _single_dof_torque(axes, test, result.breakaway)
        label(axes, "time [s]" if k > 1 else "", "torque [N·m]" if k % 2 == 0 else "")
        if k % 2:
            style.inch_pounds_right(axes)
    legend_of(figure, grid[0, 0])
    return figure


def _single_dof_torque(axes: Axes, test: SingleDofTest, breakaway: float) -> None:
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
    tau = result.machine.clutch.time_constant
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
    legend_of(figure, axes, f"voltage steps to {result.volts:.2f} V under a constant tip force")
    return figure


@styled
def torque_over_voltage(result: TorqueCurves) -> Figure:
    """Return Fig. 5: breakaway and dynamic torque of clutch 1, one panel per material."""
    figure = Figure(figsize=(style.WIDTH, 3.1))
    panels = figure.subplots(1, len(result.materials), sharey=True, squeeze=False)[0]
    for k, (axes, (name, curves)) in enumerate(zip(panels, result.materials.items(), strict=True)):
        axes.axvspan(0.0, MEASURED_FROM, color=style.REFERENCE, alpha=0.07, linewidth=0.0)
        axes.plot(result.volts, curves.breakaway, color=style.COLOURS[0], linestyle="-", label="breakaway $T_s$")
        axes.plot(
            result.volts, curves.dynamic, color=style.COLOURS[1], linestyle=style.DASHES[1], label="dynamic $T_k$"
        )
        for torque, colour, marker, size, what in (
            (curves.bench_breakaway, style.COLOURS[0], "o", 7.5, "first slip"),
            (curves.bench_dynamic, style.COLOURS[1], "s", 4.0, "slipping"),
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
def reversal_torques(result: Reversals) -> Figure:
    """Return Fig. 9: torque of clutch 1 while the motion reverses, and a close-up relative to the dynamic torque."""
    figure = Figure(figsize=(style.WIDTH, 3.8))
    count = len(result.machines)
    grid = figure.add_gridspec(count, 2, width_ratios=(1.7, 1.0), wspace=0.06)
    whole = figure.add_subplot(grid[:, 0])
    for k, (name, reversal) in enumerate(result.machines.items()):
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
    force = f"the force at the tip steps to {np.hypot(*result.force):.0f} N at {FORCE_TIME:g} s"
    note = f"clutch 1 at {result.volts:.2f} V; {force}"
    legend_of(figure, whole, note)
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
    axes.text(
        0.97,
        0.62,
        f"jump {style.percent(reversal.jump)}",
        transform=axes.transAxes,
        ha="right",
        va="center",
        color=colour,
    )
