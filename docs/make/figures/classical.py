"""Figures of one episode under several laws: the tip's paths on the arm, and what the clutches do along the path."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray
from studies.clutch_use import SATURATED, stuck_clutches

from pter_gym.benchmark.measures import column, four, vector
from pter_gym.internal import palette
from pter_gym.internal.looks import looks
from pter_gym.params import Arm
from pter_gym.paths import Path
from pter_gym.plots.benchmark import MILLIMETRE
from pter_gym.plots.legends import dots, entries, legend_below, scale_bar, shown
from pter_gym.plots.style import CLUTCH_COLOURS, REFERENCE, SMALL, WIDTH, label, styled
from pter_gym.render import style as picture
from pter_gym.render.geometry import five_bar, path_points

Array = NDArray[np.float64]

INSTANTS = (0.0, 1.0 / 3.0, 2.0 / 3.0, 1.0)
"""Parts of the path at which the arm is drawn."""

STUCK = palette.BLACK
FULL = palette.VERMILLION


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
    deviation.axhline(0.0, color=REFERENCE, linestyle="-", linewidth=4.0, alpha=0.3)
    world.plot(*path_points(path).T, color=REFERENCE, linestyle="-", linewidth=4.0, alpha=0.3, zorder=3)
    by_policy = looks(followed)
    for place, (name, telemetry) in enumerate(followed.items()):
        colour, marker, dashes = by_policy[name]
        look: Any = {"color": colour, "linestyle": dashes, "marker": marker, "markevery": dots(place, len(followed))}
        world.plot(*vector(telemetry, "tip").T, zorder=4, markersize=4.0, **look)
        deviation.plot(column(telemetry, "arc_length"), column(telemetry, "normal_error") / MILLIMETRE, **look)
    world.set(aspect="equal", xticks=[], yticks=[])
    world.spines[:].set_visible(False)
    scale_bar(world)
    label(deviation, "arc length [m]", "normal error [mm]")
    deviation.set_xlim(0.0, path.length)
    scene = {
        f"the arm under {shown(last)}, four times": Line2D([], [], color=picture.LINK_A, linewidth=4.0, alpha=0.3),
        "path": Line2D([], [], color=REFERENCE, linewidth=4.0, alpha=0.3),
    }
    handles = [*scene.values(), *entries(by_policy)]
    legend_below(figure, handles, [*scene, *map(shown, by_policy)], "normal error: positive to the left of the path")
    return figure


@styled
def clutches_along_path(followed: Mapping[str, Array], path: Path, voltage_max: float) -> Figure:
    """Return the voltages along the path, a panel for each policy, and when each clutch is stuck or saturated.

    Parameters
    ----------
    followed
        Telemetry of one episode by policy, each (T, len(TELEMETRY)).
    path
        The path [m].
    voltage_max
        Largest voltage of the clutches [V].
    """
    figure = Figure(figsize=(WIDTH, 0.9 + 2.0 * len(followed)))
    panels = figure.subplots(2 * len(followed), 1, sharex=True, height_ratios=[2.6, 1.0] * len(followed))
    for k, (name, telemetry) in enumerate(followed.items()):
        _draw_volts(panels[2 * k], telemetry[1:], name)
        _draw_states(panels[2 * k + 1], telemetry[1:], voltage_max)
    panels[-1].set_xlim(0.0, path.length)
    panels[-1].set_xlabel("arc length [m]")
    handles = [Line2D([], [], color=colour) for colour in CLUTCH_COLOURS] + [Patch(color=FULL), Patch(color=STUCK)]
    names = [*(f"clutch {x}" for x in range(1, 5)), "at the largest voltage", "stuck"]
    legend_below(figure, handles, names)
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
    axes.set_title(shown(name), pad=4.0)
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
    axes.set_yticks(range(4), [f"{x}" for x in range(1, 5)], fontsize=SMALL)
    axes.set_ylim(3.6, -0.6)
    axes.set_ylabel("clutch")
    axes.grid(visible=False)
