"""Figures of one episode under several laws: the tip's paths on the arm, and what the clutches do along the path."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray
from studies.clutch_use import SATURATED, stuck_clutches

from pter_gym.benchmark.measures import column, four, vector
from pter_gym.internal import palette
from pter_gym.params import Arm
from pter_gym.paths import Path
from pter_gym.plots.benchmark import MILLIMETRE
from pter_gym.plots.style import COLOURS, DASHES, REFERENCE, WIDTH, label, styled
from pter_gym.render import style as picture
from pter_gym.render.geometry import five_bar, path_points

Array = NDArray[np.float64]

INSTANTS = (0.0, 1.0 / 3.0, 2.0 / 3.0, 1.0)
"""Parts of the path at which the arm is drawn."""

STUCK = palette.BLACK
FULL = palette.VERMILLION
CLUTCH_COLOURS = (palette.BLUE, palette.ORANGE, palette.GREEN, palette.PURPLE)


@styled
def arm_and_deviation(followed: Mapping[str, Array], arm: Arm, path: Path, title: str) -> Figure:
    """Return where the tips went, with the arm at four instants of the last policy, and their distances magnified.

    Parameters
    ----------
    followed
        Telemetry of one episode by policy, each (T, len(TELEMETRY)).
    arm, path
        Of that episode.
    title
        What it is.
    """
    figure = Figure(figsize=(WIDTH, 7.4))
    world, deviation = figure.subplots(2, 1, height_ratios=[1.55, 1.0])
    _draw_arms(world, list(followed.values())[-1], arm)
    deviation.axhline(0.0, color=REFERENCE, linestyle="-", linewidth=4.0, alpha=0.3)
    world.plot(*path_points(path).T, color=REFERENCE, linestyle="-", linewidth=4.0, alpha=0.3, zorder=3)
    handles = [Line2D([], [], color=REFERENCE, linewidth=4.0, alpha=0.3)]
    for k, telemetry in enumerate(followed.values()):
        look = {"color": COLOURS[k], "linestyle": DASHES[k % len(DASHES)], "linewidth": 1.5}
        (line,) = world.plot(*vector(telemetry, "tip").T, zorder=4, **look)
        deviation.plot(column(telemetry, "arc_length"), column(telemetry, "normal_error") / MILLIMETRE, **look)
        handles.append(line)
    world.set_aspect("equal")
    label(world, "x [m]", "y [m]")
    world.set_title(title)
    label(deviation, "arc length [m]", "normal error [mm]")
    deviation.set_title("Distance from the path, positive to its left")
    deviation.set_xlim(0.0, path.length)
    figure.legend(handles, ["path", *followed], loc="outside lower center", ncols=3)
    return figure


@styled
def clutches_along_path(followed: Mapping[str, Array], path: Path, voltage_max: float, title: str) -> Figure:
    """Return the voltages along the path, a panel for each policy, and when each clutch is stuck or saturated.

    Parameters
    ----------
    followed
        Telemetry of one episode by policy, each (T, len(TELEMETRY)).
    path
        The path [m].
    voltage_max
        Largest voltage of the clutches [V].
    title
        What it is.
    """
    figure = Figure(figsize=(WIDTH, 1.1 + 2.3 * len(followed)))
    panels = figure.subplots(2 * len(followed), 1, sharex=True, height_ratios=[2.6, 1.0] * len(followed))
    for k, (name, telemetry) in enumerate(followed.items()):
        _draw_volts(panels[2 * k], telemetry[1:], name)
        _draw_states(panels[2 * k + 1], telemetry[1:], voltage_max)
    panels[-1].set_xlim(0.0, path.length)
    panels[-1].set_xlabel("arc length [m]")
    handles = [Line2D([], [], color=colour) for colour in CLUTCH_COLOURS] + [Patch(color=FULL), Patch(color=STUCK)]
    names = [*(f"clutch {x}" for x in range(1, 5)), "at the largest voltage", "stuck"]
    figure.legend(handles, names, loc="outside lower center", ncols=3)
    figure.suptitle(title, x=0.01, ha="left", fontsize=11.0)
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


def _draw_volts(axes: Axes, steps: Array, name: str) -> None:
    for volts, colour in zip(four(steps, "volts").T, CLUTCH_COLOURS, strict=True):
        axes.plot(column(steps, "arc_length"), volts, color=colour, linestyle="-", linewidth=1.2)
    axes.set_title(name, fontsize=10.0, pad=4.0)
    axes.set_ylabel("voltage [V]")


def _draw_states(axes: Axes, steps: Array, voltage_max: float) -> None:
    """Draw a bar for each clutch, from above 1 to 4, where it is stuck (upper half) or saturated (lower half)."""
    edges = column(steps, "reached")
    begin, extent = edges[:-1], np.diff(edges)
    saturated = four(steps, "volts") >= SATURATED * voltage_max
    stuck = stuck_clutches(column(steps, "mode"))
    for clutch in range(4):
        for states, colour, low in ((saturated, FULL, -0.05), (stuck, STUCK, -0.4)):
            here = states[1:, clutch] & (extent > 0.0)
            spans: Sequence[tuple[float, float]] = list(zip(begin[here], extent[here], strict=True))
            axes.broken_barh(spans, (clutch + low, 0.4), color=colour, linewidth=0.0)
    axes.set_yticks(range(4), [f"{x}" for x in range(1, 5)], fontsize=8.0)
    axes.set_ylim(3.6, -0.6)
    axes.set_ylabel("clutch", fontsize=9.0)
    axes.grid(visible=False)
