"""Section III, the clutch model: Figs. 3 and 4 and the step response."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pter_gym.paper.experiments.single_dof import SingleDof, SingleDofTest
from pter_gym.paper.experiments.step_response import StepResponse
from pter_gym.paper.plots.marks import FAINT, mark
from pter_gym.plots.style import (
    CLUTCH_COLOURS,
    COLOURS,
    DASHES,
    REFERENCE,
    WIDTH,
    inch_pounds_right,
    inches_above,
    inches_right,
    label,
    legend_of,
    numbered,
    styled,
)
from pter_gym.units import to_inch_pounds


@styled
def single_dof_paths(result: SingleDof) -> Figure:
    """Return Fig. 3 for each clutch: where the tip went, on the line that the locked clutch leaves it."""
    figure = Figure(figsize=(WIDTH, 5.8))
    grid = figure.subplots(2, 2)
    for k, (axes, test) in enumerate(zip(grid.flat, result.tests, strict=True)):
        _single_dof_path(axes, test)
        label(axes, "x [m]", "y [m]")
        if k < 2:
            inches_above(axes, "x")
        if k % 2:
            inches_right(axes, "y")
    legend_of(figure, grid[0, 0])
    return figure


def _single_dof_path(axes: Axes, test: SingleDofTest) -> None:
    tip = test.trajectory.tip_position
    axes.plot(*test.line.T, color=FAINT, linestyle="--", linewidth=1.2, label="single-DOF line")
    axes.plot(*tip.T, color=COLOURS[0], linewidth=3.0, label="path of the tip")
    axes.plot(*tip[0], color=COLOURS[0], marker="o", markersize=6.5, linestyle="none", label="start")
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_title(f"clutch {test.clutch}, clutch {test.locked} locked")


@styled
def single_dof_torques(result: SingleDof) -> Figure:
    """Return Fig. 4 for each clutch: torques over time while the input torque rises."""
    figure = Figure(figsize=(WIDTH, 5.4))
    grid = figure.subplots(2, 2)
    for k, (axes, test) in enumerate(zip(grid.flat, result.tests, strict=True)):
        _single_dof_torque(axes, test, result.breakaway)
        label(axes, "time [s]" if k > 1 else "", "torque [N·m]" if k % 2 == 0 else "")
        if k % 2:
            inch_pounds_right(axes)
    legend_of(figure, grid[0, 0])
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
    axes.set_title(f"clutch {test.clutch}, clutch {test.locked} locked")


@styled
def clutch_step(result: StepResponse) -> Figure:
    """Return the step response of the four clutches beside a first-order response."""
    figure = Figure(figsize=(WIDTH, 3.1))
    axes = figure.add_subplot()
    tau = result.machine.clutch.time_constant
    axes.plot(result.time, result.first_order, color=REFERENCE, alpha=0.3, linewidth=5.0, label="first order")
    every = max(len(result.time) // 18, 1)
    for k, torque in enumerate(result.torque):
        offset = k * every // 4
        axes.plot(
            result.time,
            torque,
            color=CLUTCH_COLOURS[k],
            linestyle="none",
            marker=numbered(k).marker,
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
    inch_pounds_right(axes, "generated torque")
    legend_of(figure, axes, f"voltage steps to {result.volts:.2f} V under a constant tip force")
    return figure
