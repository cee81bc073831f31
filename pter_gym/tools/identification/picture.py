# pyright: standard
"""Pictures of identifications: torque curves with intervals and residuals; one clutch's loop."""

import numpy as np
from matplotlib.figure import Figure

from pter_gym.tools.figures import (
    CLUTCH_COLOURS,
    MUTED,
    REFERENCE,
    WIDTH,
    inch_pounds_right,
    label,
    styled,
)
from pter_gym.tools.identification.bench import BenchResult
from pter_gym.tools.identification.identifying import Identification

POINTS = 4000
"""Most points of a picture that stand for a branch."""


@styled
def picture(found: Identification) -> Figure:
    """Draw the torque of each clutch over voltage, and the residuals of the angles over time."""
    figure = Figure(figsize=(WIDTH, 5.6))
    curves, residuals = figure.subplots(2, 1, height_ratios=(3, 2))
    clutch, before, top = found.machine.clutch, found.start.clutch, found.fit.shape.top
    volts = np.linspace(0.0, clutch.voltage_max, 200).tolist()
    curves.axvspan(top, clutch.voltage_max, color=MUTED, alpha=0.12, linewidth=0.0)
    for x, scale in enumerate(found.machine.clutch_scale[: len(found.machine.clutches)]):
        torque = [scale * clutch.dynamic.torque(v) for v in volts]
        curves.plot(volts, torque, "-", color=CLUTCH_COLOURS[x], label=f"clutch {x + 1}, $T_k$")
    for curve, style, colour, name in (
        (clutch.breakaway, "--", REFERENCE, "mean, $T_s$"),
        (before.dynamic, ":", MUTED, "start, $T_k$"),
    ):
        curves.plot(volts, [curve.torque(v) for v in volts], style, color=colour, label=name)
    for finding in found.findings:
        share, value = finding.quantity.name.removeprefix("torque_"), finding.quantity.value
        if share.isdigit():
            half = finding.half_width if np.isfinite(finding.half_width) else 0.0
            look = {"fmt": "o", "markersize": 3.5, "color": REFERENCE}
            curves.errorbar(0.01 * float(share) * top, value, yerr=half, **look)
    curves.legend()
    curves.set_xlim(0.0, clutch.voltage_max)
    curves.set_ylim(0.0)
    inch_pounds_right(curves)
    label(curves, "voltage [V]; grey: no clutch slipped here", "torque [N·m]")
    windows, off = found.fit.windows, 1e3 * found.residuals
    times = found.log.interval * (windows.first[:, None] + np.arange(1, windows.length + 1))
    largest = max(float(np.nanpercentile(np.abs(off), 99.7)), 4e3 * windows.noise)
    for k, name in enumerate(("θA", "θB")):
        look = {"color": CLUTCH_COLOURS[k], "markersize": 1.2, "alpha": 0.6, "rasterized": True}
        residuals.plot(times.ravel(), off[:, :, k].ravel(), ".", label=name, **look)
    residuals.set_ylim(-largest, largest)
    residuals.legend(ncols=2, markerscale=6.0)
    label(residuals, "time [s]", "measured − predicted [mrad]")
    return figure


@styled
def bench_picture(found: BenchResult, drive: str) -> Figure:
    """Draw settled torque over voltage, as measured and by the clutch, as it rises and falls."""
    figure = Figure(figsize=(WIDTH, 3.6))
    axes, clutch = figure.subplots(), found.clutch
    volts = np.linspace(0.0, clutch.voltage_max, 200)
    half = clutch.hysteresis
    risen = np.maximum(volts - half, half)
    fallen = np.minimum(volts + half, clutch.voltage_max - half)
    at, torque, falls = found.settled
    for k, (name, rows, held) in enumerate((("rises", ~falls, risen), ("falls", falls, fallen))):
        shown = np.flatnonzero(rows)[:: max(int(rows.sum()) // POINTS, 1)]
        look = {"color": CLUTCH_COLOURS[k], "markersize": 1.5, "alpha": 0.4, "rasterized": True}
        axes.plot(at[shown], torque[shown], ".", **look)
        curve = [clutch.dynamic.torque(v) for v in held.tolist()]
        axes.plot(volts, curve, color=CLUTCH_COLOURS[k], label=f"voltage {name}")
    axes.legend()
    axes.set_xlim(0.0, clutch.voltage_max)
    axes.set_ylim(0.0)
    inch_pounds_right(axes)
    label(axes, "voltage [V]" if drive == "V" else "current [A]", "dynamic torque [N·m]")
    return figure
