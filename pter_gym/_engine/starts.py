"""Where the tip of a world is put at the start of an episode, and the exploring starts of a training."""

from typing import Any

import numpy as np

from pter_gym._compiled.compiler import device, outlined
from pter_gym._compiled.philox import uniform4
from pter_gym._compiled.records import load, store
from pter_gym._engine.step import clipped
from pter_gym._engine.world import ROW
from pter_gym._physics.arm import UnitVector, Vector, moving
from pter_gym._physics.clutch import PerClutch, scaled, steady_torques
from pter_gym.paths._projection import Foot, point_at, project, segment_of
from pter_gym.tasks.path_following._situation import PathVector, motion_at, singular, strayed, to_world
from pter_gym.tasks.path_following._specification import ALONG, ASIDE

_STREAM = np.uint64(0x5354415254)
_KIND, _GRIPS, _MOTION = np.uint64(0), np.uint64(1), np.uint64(2)

COVERED = 0.92
"""Episodes that begin moving do so within this share of the path."""

RELEASED = 0.2
"""Share of the clutches that are released where an episode begins with settled ones."""


@device
def spread(draw: float, half_range: float) -> float:
    """Return an even draw from ±half_range for one from [0, 1)."""
    return half_range * (2.0 * draw - 1.0)


@device
def place(w: Any, i: int, point: Vector, heading: UnitVector, offset: float) -> None:
    """Put the arm at rest with the tip beside a point of the path, to its left by ``offset`` [m]."""
    x = point.x - offset * heading.sin
    y = point.y + offset * heading.cos
    store(w, ROW.motion, i, motion_at(load(w, ROW.machine.arm, i), x, y))


@outlined
def explore(w: Any, i: int, seed: np.uint64, episode: np.uint64, constants: Any) -> None:
    """Begin an episode as ``Starts`` says: some moving, some gripped, the others as they are."""
    kind, along, aside, speed = uniform4(seed, _STREAM, _KIND, episode)
    grips = uniform4(seed, _STREAM, _GRIPS, episode)
    across, _, _, _ = uniform4(seed, _STREAM, _MOTION, episode)
    starts = load(w, ROW.task.starts, i)
    if kind < starts.moving:
        foot = beside(w, i, along, spread(aside, starts.offset), constants)
        set_going(w, i, foot, PathVector(ALONG * speed, spread(across, ASIDE)))
    if kind < starts.moving + starts.gripped:
        grip(w, i, PerClutch(gripping(grips[0]), gripping(grips[1]), gripping(grips[2]), gripping(grips[3])))


@device
def beside(w: Any, i: int, along: float, offset: float, constants: Any) -> Foot:
    """Put the tip at rest beside the path and return its projection.

    ``along`` is a share of ``COVERED`` of the path, ``offset`` the distance from it [m], taken as 0 where the workspace
    has no such place.
    """
    path = load(w, ROW.task.path, i)
    first, count = int(path.first), int(path.arcs)
    s = COVERED * along * path.length
    x, y = point_at(constants, first, count, s)
    foot = project(constants, first, count, segment_of(constants, first, count, s), x, y)
    place(w, i, Vector(x, y), foot.heading, offset)
    width = min(w[ROW.task.error_max, i], w[ROW.task.truncation_error, i])
    if strayed(s, offset, width) | singular(load(w, ROW.motion, i), w[ROW.task.singularity_margin, i]):
        place(w, i, Vector(x, y), foot.heading, 0.0)
    w[ROW.foot.segment, i] = foot.segment
    w[ROW.reached, i] = s
    w[ROW.intent, i] = s
    return foot


@device
def set_going(w: Any, i: int, foot: Foot, speed: PathVector) -> None:
    """Give the tip a speed relative to the commanded pace."""
    pace = w[ROW.task.pace, i]
    velocity = to_world(PathVector(pace * speed.along, pace * speed.across), foot.heading)
    store(w, ROW.motion, i, moving(load(w, ROW.machine.arm, i), load(w, ROW.motion, i), velocity))
    w[ROW.pace_ratio, i] = speed.along


@device
def grip(w: Any, i: int, shares: PerClutch) -> None:
    """Let the clutches have settled at shares of the largest voltage."""
    most = w[ROW.machine.voltage_max, i]
    volts = PerClutch(
        clipped(shares.x1 * most, most),
        clipped(shares.x2 * most, most),
        clipped(shares.x3 * most, most),
        clipped(shares.x4 * most, most),
    )
    machine = load(w, ROW.machine, i)
    store(w, ROW.command, i, volts)
    store(w, ROW.lagged_volts, i, volts)
    store(w, ROW.torques, i, scaled(steady_torques(machine.breakaway, machine.dynamic, volts), machine.scale, 1.0))


@device
def gripping(draw: float) -> float:
    """Return a share of the largest voltage for a draw from [0, 1): 0 if it is below ``RELEASED``, otherwise even."""
    return (draw - RELEASED) / (1.0 - RELEASED) if draw > RELEASED else 0.0
