"""The figure of a machine's displayable forces: polygons at several poses, and a map."""

import math
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Polygon
from numpy.typing import NDArray

from pter_gym._internal.files import FilePath
from pter_gym.haptics import force_extremes, force_region, link_angles
from pter_gym.params import Machine, find_machine
from pter_gym.tools import palette
from pter_gym.tools.figures import MUTED, WIDTH, label, legend_of, save, styled
from pter_gym.tools.pictures.drawing import LINK_A, LINK_B, five_bar

Array = NDArray[np.float64]

SPEED = 0.25
"""Speed of the tip [m/s]: the medium pace."""

TIPS = ((-0.55, 0.7), (0.0, 0.75), (0.52, 0.55), (-0.45, 0.1), (0.45, -0.1))
"""Positions of the tip for which polygons are drawn, over the sum of the links' lengths."""

SIZE = 0.25
"""Length of the largest drawn force [m]."""

DRAWN_MARGIN = 0.2
"""Smallest ``|sin(θA − θB)|`` that is drawn; the tasks have the same by default."""

MIN_TOP = 10.0
"""Smallest range of the colours [N], so that no steering force does not look like some."""


def draw_force_region(machine: Machine | str, path: FilePath) -> Path:
    """Draw ``force_map`` into a PNG or PDF file; return its path."""
    return save(force_map(machine), path)


@styled
def force_map(machine: Machine | str) -> Figure:
    """Return the figure of a machine, or of one that ``find_machine`` knows.

    The map shows ``ForceExtremes.least_steering``, which depends on the distance from the drive
    alone.
    """
    machine = find_machine(machine)
    figure = Figure(figsize=(WIDTH, 3.6))
    left, right = figure.subplots(1, 2, sharex=True, sharey=True)
    newtons = _draw_polygons(left, machine)
    _draw_steering(figure, right, machine)
    for axes in (left, right):
        axes.add_patch(Circle((0.0, 0.0), 0.02, color=MUTED))
        axes.set_aspect("equal")
        label(axes, "x [m]", "y [m]")
    legend_of(figure, left, f"links A (blue) and B (orange); 0.1 m is {0.1 * newtons:.3g} N")
    return figure


def _draw_polygons(axes: Axes, machine: Machine) -> float:
    """Draw the displayable forces at several poses, at rest and in motion; return N per m."""
    arm = machine.arm
    theta = link_angles(arm, (arm.length_a + arm.length_b) * np.array(TIPS))
    theta = theta[np.sin(theta[:, 1] - theta[:, 0]) >= DRAWN_MARGIN]
    looks: list[dict[str, Any]] = [
        {"facecolor": "none", "edgecolor": MUTED, "linestyle": "--", "label": "at rest"},
        {"facecolor": palette.SKY_BLUE, "edgecolor": palette.BLUE, "label": "moving to the right"},
    ]
    regions = [
        [force_region(machine, angles, velocity) for velocity in ((0.0, 0.0), (SPEED, 0.0))]
        for angles in theta
    ]
    newtons = max(float(np.abs(regions).max()), MIN_TOP) / SIZE
    for angles, polygons in zip(theta, regions, strict=True):
        bar = five_bar(arm, *angles)
        for ends, colour in (((bar.base, bar.elbow_a), LINK_A), ((bar.elbow_a, bar.tip), LINK_B)):
            axes.plot(*np.transpose(ends), color=colour, linewidth=1.5, alpha=0.45, zorder=1.0)
        axes.plot(*bar.tip, "o", color=palette.BLACK, markersize=2.5)
        for polygon, look in zip(polygons, looks, strict=True):
            axes.add_patch(Polygon(bar.tip + polygon / newtons, **look))
            look["label"] = None  # once in the legend
    axes.set_title("displayable forces on the hand")
    return newtons


def _draw_steering(figure: Figure, axes: Axes, machine: Machine) -> None:
    """Draw the smallest steering force over the workspace."""
    arm = machine.arm
    elbow: Array = np.linspace(math.asin(DRAWN_MARGIN), math.pi - math.asin(DRAWN_MARGIN), 200)
    least = force_extremes(
        machine, np.stack([0.0 * elbow, elbow], axis=-1), speed=SPEED
    ).least_steering
    radius: Array = np.abs(arm.length_a + arm.length_b * np.exp(1j * elbow))
    grid = float(radius[0]) * np.linspace(-1.0, 1.0, 401)
    distance = np.hypot(grid, grid[:, None])
    values = np.interp(distance, radius[::-1], least[::-1].clip(0.0), left=np.nan, right=np.nan)
    top = max(MIN_TOP, float(least.max()))
    mesh = axes.pcolormesh(grid, grid, values, cmap="cividis", vmin=0.0, vmax=top, rasterized=True)
    figure.colorbar(mesh, ax=axes, label="smallest steering force [N]", shrink=0.75)
    axes.set_title("to either side, in the worst direction")
