"""The figures of the report."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pter_gym.tools.figures import CLUTCH_COLOURS, MUTED, REFERENCE, WIDTH, inch_pounds_right, label, styled
from pter_gym.tools.identification.identifying import Finding, Identification

COLOURS = {"identified": CLUTCH_COLOURS[0], "uncertain": CLUTCH_COLOURS[1], "kept": MUTED}
MOST_SHOWN = 1.0
"""Widest interval that is drawn, over the scale."""


@styled
def intervals(found: Identification) -> Figure:
    """Draw the interval of each number, relative to its scale."""
    told = [finding for finding in found.findings if finding.status != "kept"]
    figure = Figure(figsize=(WIDTH, 0.6 + 0.21 * max(len(told), 3)))
    axes = figure.subplots()
    widest = max([0.06, *(min(finding.share, MOST_SHOWN) for finding in told)])
    axes.axvspan(-5.0, 5.0, color=MUTED, alpha=0.12, linewidth=0.0)
    for row, finding in enumerate(told):
        half = 100.0 * min(finding.share, MOST_SHOWN)
        axes.errorbar(0.0, row, xerr=half, fmt="o", markersize=3.5, color=COLOURS[finding.status])
    axes.set_yticks(range(len(told)), [finding.quantity.name for finding in told])
    axes.set_ylim(len(told) - 0.4, -0.6)
    axes.set_xlim(-110.0 * widest, 110.0 * widest)
    label(axes, "95 % interval [% of the scale]; grey: ±5 %", "")
    return figure


@styled
def curves(found: Identification) -> Figure:
    """Draw the torque of each clutch over its voltage, with the interval of the mean, and that of the start."""
    figure = Figure(figsize=(WIDTH, 3.0))
    axes = figure.subplots()
    clutch, before = found.machine.clutch, found.start.clutch
    volts = np.linspace(0.0, clutch.voltage_max, 200)
    top = found.fit.shape.top
    axes.axvspan(top, clutch.voltage_max, color=MUTED, alpha=0.12, linewidth=0.0)
    for x, scale in enumerate(found.machine.clutch_scale[: len(found.machine.clutches)]):
        torque = [scale * clutch.dynamic.torque(float(v)) for v in volts]
        axes.plot(volts, torque, color=CLUTCH_COLOURS[x], linestyle="-", label=f"clutch {x + 1}, T_k")
    torque = [clutch.breakaway.torque(float(v)) for v in volts]
    axes.plot(volts, torque, color=REFERENCE, linestyle="--", label="mean, T_s")
    torque = [before.dynamic.torque(float(v)) for v in volts]
    axes.plot(volts, torque, color=MUTED, linestyle=":", label="start, T_k")
    for share in (0.25, 0.5, 0.75, 1.0):
        _mark(axes, share * top, next(f for f in found.findings if f.quantity.name == f"torque_{round(100 * share)}"))
    axes.legend()
    axes.set_xlim(0.0, clutch.voltage_max)
    axes.set_ylim(0.0)
    inch_pounds_right(axes)
    label(axes, "voltage [V]; grey: no clutch slipped here", "torque [N·m]")
    return figure


def _mark(axes: Axes, volts: float, finding: Finding) -> None:
    value = finding.quantity.value
    axes.errorbar(
        volts, value, yerr=[[value - finding.low], [finding.high - value]], fmt="o", markersize=3.5, color=REFERENCE
    )


@styled
def recording(found: Identification) -> Figure:
    """Draw what was recorded: voltages, angles, forces."""
    log = found.log
    every = max(1, len(log.theta) // 4000)
    times = log.times[::every]
    count = 2 if log.force is None else 3
    figure = Figure(figsize=(WIDTH, 1.35 * count + 0.4))
    axes = figure.subplots(count, sharex=True)
    for x in range(len(found.machine.clutches)):
        axes[0].step(times, log.volts[::every, x], where="post", label=f"{x + 1}", **_thin(x))
    axes[0].legend(title="clutch", ncols=4, loc="upper left")
    for k, name in enumerate(("θA", "θB")):
        axes[1].plot(times, log.theta[::every, k], label=name, **_thin(k))
    axes[1].legend(ncols=2)
    label(axes[0], "", "voltage [V]")
    label(axes[1], "", "angle [rad]")
    if log.force is not None:
        for k, name in enumerate(("x", "y")):
            axes[2].plot(times, log.force[::every, k], label=name, **_thin(k))
        axes[2].legend(ncols=2)
        label(axes[2], "", "force [N]")
    axes[-1].set_xlabel("time [s]")
    return figure


def _thin(k: int) -> dict[str, Any]:
    return {"color": CLUTCH_COLOURS[k], "linestyle": "-", "linewidth": 1.0}


@styled
def residuals(found: Identification) -> Figure:
    """Draw what the model does not predict: over time, and how it is distributed beside the noise of the angles."""
    windows = found.fit.windows
    off = 1e3 * found.residuals
    times = found.log.interval * (windows.first[:, None] + np.arange(1, windows.length + 1))
    every = max(1, off[:, :, 0].size // 8000)
    figure = Figure(figsize=(WIDTH, 2.6))
    left, right = figure.subplots(1, 2, width_ratios=(3, 1), sharey=True)
    largest = max(float(np.nanpercentile(np.abs(off), 99.7)), 4e3 * windows.noise)
    for k, name in enumerate(("θA", "θB")):
        colour = CLUTCH_COLOURS[k]
        values = off[:, :, k]
        left.plot(
            times.ravel()[::every], values.ravel()[::every], ".", color=colour, markersize=1.2, label=name, alpha=0.6
        )
        values = values[np.isfinite(values)]
        bins = np.linspace(-largest, largest, 61)
        right.hist(values, bins, orientation="horizontal", density=True, histtype="step", color=colour, linestyle="-")
    left.set_ylim(-largest, largest)
    left.legend(ncols=2, markerscale=6.0)
    label(left, "time [s]", "measured − predicted [mrad]")
    label(right, "density [1/mrad]", "")
    return figure
