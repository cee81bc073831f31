"""Section IV-B and Fig. 9: the clutches' materials, their torques and what happens where the motion turns back."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pter_gym.paper.experiments.reversal import Reversal, Reversals
from pter_gym.paper.experiments.torque_curves import MEASURED_FROM, TorqueCurves
from pter_gym.paper.plots.marks import FAINT, name_of
from pter_gym.plots.legends import legend_of
from pter_gym.plots.style import (
    COLOURS,
    DASHES,
    LOOKS,
    MUTED,
    REFERENCE,
    SMALL,
    WIDTH,
    inch_pounds_right,
    label,
    percent,
    styled,
)

ZOOM = 0.008
"""Half the time that a close-up of a reversal shows [s]."""


@styled
def torque_over_voltage(result: TorqueCurves) -> Figure:
    """Return Fig. 5: breakaway and dynamic torque of clutch 1, one panel per material."""
    figure = Figure(figsize=(WIDTH, 3.1))
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
        color=MUTED,
        fontsize=SMALL,
        transform=axes.get_xaxis_transform(),
    )
    inch_pounds_right(panels[-1])
    legend_of(figure, axes)
    return figure


@styled
def reversal_torques(result: Reversals) -> Figure:
    """Return Fig. 9: torque of clutch 1 while the motion turns back, and a close-up relative to the dynamic torque."""
    figure = Figure(figsize=(WIDTH, 3.8))
    count = len(result.machines)
    grid = figure.add_gridspec(count, 2, width_ratios=(1.7, 1.0), wspace=0.06)
    whole = figure.add_subplot(grid[:, 0])
    for k, (name, reversal) in enumerate(result.machines.items()):
        colour, _, dashes = LOOKS[k]
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
    inch_pounds_right(whole)
    note = f"clutch 1 at {result.volts:.2f} V; the force at the tip steps to {np.hypot(*result.force):.0f} N at 0.1 s"
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
        0.97, 0.62, f"jump {percent(reversal.jump)}", transform=axes.transAxes, ha="right", va="center", color=colour
    )
