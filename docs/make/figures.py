"""Figures of the pages: error against pace, one episode under several laws, tremors."""

from collections.abc import Mapping, Sequence
from itertools import cycle
from typing import Any

import numpy as np
from classical import stuck_clutches
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from pter_gym.benchmark._measures import column, four, vector
from pter_gym.hands import LibraryTremor, TremorArm
from pter_gym.params import Arm
from pter_gym.paths import Path
from pter_gym.scenarios import PACES
from pter_gym.tools.figures import CLUTCH_COLOURS, INK, MUTED, REFERENCE, WIDTH, label, legend_below, styled
from pter_gym.tools.pictures.plots.legends import scale_bar, shown
from pter_gym.tools.pictures.plots.ticks import plain_ticks
from pter_gym.tools.pictures.render import style as picture
from pter_gym.tools.pictures.render.geometry import five_bar, path_points

Array = NDArray[np.float64]

MARKERS = "os^DvPX<>p*dh"
CLUTCHES = ("1: brakes A", "2: brakes B", "3: couples", "4: inverts")
INSTANTS = (0.0, 1.0 / 3.0, 2.0 / 3.0, 1.0)
"""Parts of the path at which the arm is drawn."""

FILLED = 0.3
"""Opacity of the areas below the voltages."""

STRIP = 0.3
"""Depth of the strip that tells when a clutch sticks, relative to the largest voltage."""


@styled
def error_against_pace(scores: Mapping[str, Sequence[Mapping[str, Any]]], note: str) -> Figure:
    """Return path error over commanded pace, a line for each policy, hollow where a policy has no rank.

    Parameters
    ----------
    scores
        By policy, one for each pace, as `benchmark.json` has them.
    note
        Above the legend: what was run.
    """
    figure = Figure(figsize=(WIDTH, 4.0))
    axes = figure.add_subplot()
    paces = np.array(list(PACES.values()))
    for place, (name, each) in enumerate(scores.items()):
        at = paces * 1.022 ** (place - 0.5 * (len(scores) - 1))  # apart, so intervals do not cover each other
        low, value, high = (1000 * np.array([s["path_error_m"][key] for s in each]) for key in ("low", "value", "high"))
        marker = MARKERS[place % len(MARKERS)]
        (line,) = axes.plot(at, value, marker=marker, label=shown(name))
        colour = line.get_color()
        axes.errorbar(at, value, (value - low, high - value), fmt="none", ecolor=colour, elinewidth=1.2)
        faces = [colour if s["rank"] else "white" for s in each]
        axes.scatter(at, value, 40.0, faces, marker, edgecolors=colour, zorder=4)
    axes.set(xscale="log", yscale="log", xlim=(min(paces) / 1.25, max(paces) * 1.25))
    axes.set_xticks(paces, [f"{pace:g}\n{name}" for name, pace in PACES.items()])
    axes.set_xticks([], minor=True)
    axes.grid(visible=False, axis="x")
    plain_ticks(axes, "y")
    label(axes, "commanded pace [m/s]", "path error [mm]")
    dots = [
        Line2D([], [], color=MUTED, marker="o", linestyle="none", markerfacecolor=face) for face in (MUTED, "white")
    ]
    lines, names = axes.get_legend_handles_labels()
    legend_below(figure, [*lines, *dots], [*names, "ranked", "no rank"], note)
    return figure


@styled
def arm_and_deviation(followed: Mapping[str, Array], arm: Arm, path: Path) -> Figure:
    """Return where the tips went, with the arm at four instants of the last policy, and their distances magnified.

    Parameters
    ----------
    followed
        Telemetry of one episode by policy, each (T, len(TELEMETRY)).
    arm, path
        Of that episode.
    """
    figure = Figure(figsize=(WIDTH, 6.4))
    world, deviation = figure.subplots(2, 1, height_ratios=[1.55, 1.0])
    last = list(followed)[-1]
    _draw_arms(world, followed[last], arm)
    reference: Any = {"color": REFERENCE, "linestyle": "-", "linewidth": 4.0, "alpha": 0.3}
    deviation.axhline(0.0, **reference)
    world.plot(*path_points(path).T, zorder=3, **reference)
    handles: dict[str, Any] = {
        f"the arm under {shown(last)}, four times": Line2D([], [], color=picture.LINK_A, linewidth=4.0, alpha=0.3),
        "path": Line2D([], [], **reference),
    }
    for marker, (name, telemetry) in zip(cycle(MARKERS), followed.items(), strict=False):
        along, error = column(telemetry, "arc_length"), 1000.0 * column(telemetry, "normal_error")
        (line,) = deviation.plot(along, error, marker=marker, markevery=0.22)
        handles[shown(name)] = line
        look: Any = {"color": line.get_color(), "linestyle": "-", "marker": marker, "markevery": 0.22}
        world.plot(*vector(telemetry, "tip").T, zorder=4, markersize=4.0, **look)
    world.set(aspect="equal", xticks=[], yticks=[])
    world.spines[:].set_visible(False)
    scale_bar(world)
    label(deviation, "arc length [m]", "normal error [mm]")
    deviation.set_xlim(0.0, path.length)
    legend_below(figure, [*handles.values()], [*handles], "normal error: positive to the left of the path")
    return figure


def _draw_arms(axes: Axes, telemetry: Array, arm: Arm) -> None:
    """Draw the two links, link A from the base, as they were at the instants."""
    reached = column(telemetry, "reached")
    for part in INSTANTS:
        row = telemetry[int(np.argmax(reached >= part * reached[-1]))]
        base, elbow, _, tip = five_bar(arm, float(column(row, "theta_a")), float(column(row, "theta_b")))
        for start, end, colour in ((base, elbow, picture.LINK_A), (elbow, tip, picture.LINK_B)):
            both = np.stack([start, end])
            axes.plot(*both.T, color=colour, linestyle="-", linewidth=4.0, solid_capstyle="round", alpha=0.3, zorder=1)
        axes.plot(*elbow, color=picture.INK, marker="o", markersize=4.0, markerfacecolor="white", zorder=2)
    axes.plot(0.0, 0.0, color=picture.INK, marker="o", markersize=5.0, markerfacecolor="white", zorder=2)


@styled
def clutches(followed: Mapping[str, Array], voltage_max: float) -> Figure:
    """Return what policies do in an episode: distance from the path, and voltage and sticking of each clutch.

    Parameters
    ----------
    followed
        Telemetry by policy, (T + 1, len(TELEMETRY)) each: the row of the reset, then one per control step.
    voltage_max
        Largest voltage of the clutches [V].
    """
    figure = Figure(figsize=(WIDTH, 6.4))
    panels = figure.subplots(
        5, len(followed), sharex=True, sharey="row", height_ratios=(2.2, 1, 1, 1, 1), squeeze=False
    )
    for drawn, (name, telemetry) in zip(panels.T.tolist(), followed.items(), strict=True):
        _draw_clutches(drawn, telemetry, voltage_max)
        drawn[0].set_title(shown(name, 90 // len(followed)))
    panels[0, 0].set_ylabel("distance from\nthe path [mm]")
    for name, axes in zip(CLUTCHES, panels[1:, 0], strict=True):
        axes.set_ylabel(f"{name}\n[V]")
        axes.set_yticks([0.0, voltage_max])
        axes.set_ylim(-STRIP * voltage_max, 1.1 * voltage_max)
    panels[0, 0].set_xlim(0.0, max(float(column(each, "time")[-1]) for each in followed.values()))
    figure.align_ylabels(list(panels[:, 0]))
    legend_below(figure, [Patch(color=MUTED, alpha=FILLED), Patch(color=INK)], ["voltage", "the clutch sticks"])
    return figure


def _draw_clutches(panels: Sequence[Axes], telemetry: Array, voltage_max: float) -> None:
    """Draw one policy's episode: the distance in the first panel, a clutch in each of the others."""
    time, volts = column(telemetry, "time"), four(telemetry, "volts")
    stuck = stuck_clutches(column(telemetry, "mode"))
    panels[0].axhline(0.0, color=REFERENCE, linestyle="-", linewidth=4.0, alpha=0.3)
    panels[0].plot(time, 1000.0 * column(telemetry, "normal_error"), color=INK, linestyle="-", linewidth=1.5)
    for clutch, axes in enumerate(panels[1:]):
        colour, top = CLUTCH_COLOURS[clutch], -0.4 * STRIP * voltage_max
        axes.fill_between(time, 0.0, volts[:, clutch], step="pre", color=colour, alpha=FILLED, linewidth=0.0)
        axes.plot(time, volts[:, clutch], color=colour, linestyle="-", linewidth=1.0, drawstyle="steps-pre")
        sticks = np.append(stuck[1:, clutch], False)  # a row tells of the step that ends there
        axes.fill_between(time, top, -STRIP * voltage_max, where=sticks, step="post", color=INK, linewidth=0.0)
    panels[-1].set_xlabel("time [s]")


@styled
def force_and_spectrum(hands: Mapping[str, TremorArm], measured: Mapping[str, LibraryTremor]) -> Figure:
    """Return the force of tremors over time, and its spectrum with the band of its entry."""
    figure = Figure(figsize=(WIDTH, 1.45 * len(hands)))
    panels = figure.subplots(len(hands), 2, sharex="col", squeeze=False)
    times = np.arange(0.0, 20.0, 0.001)
    window = np.hanning(len(times))
    frequencies = np.fft.rfftfreq(len(times), 0.001)
    for (name, hand), (left, right), colour in zip(hands.items(), panels, CLUTCH_COLOURS, strict=False):
        force = hand.tremor(times)
        left.plot(times, force, color=colour, linestyle="-", linewidth=1.0)
        left.set_title(name.removeprefix("tremor-").capitalize())
        right.axvspan(*measured[name].band, color=MUTED, alpha=0.15, linewidth=0.0)
        right.plot(frequencies, 2.0 * np.abs(np.fft.rfft(window * force)) / window.sum(), color=colour, linestyle="-")
        label(left, "", "force [N]")
        label(right, "", "amplitude [N]")
    panels[-1, 0].set(xlim=(0.0, 4.0), xlabel="time [s]")
    panels[-1, 1].set(xlim=(0.0, 16.0), xlabel="frequency [Hz]")
    figure.align_ylabels(panels)
    return figure
