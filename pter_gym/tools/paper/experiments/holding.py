"""Loads that four engaged clutches hold together (paper section III-A, the lumped actuator approach)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pter_gym._physics.open_loop import initial_state, simulate
from pter_gym.params import Machine, find_machine
from pter_gym.tools.paper.experiments.pose import slip_rows

Array = NDArray[np.float64]

_MARGIN = 0.02
_STEPS = 81


@dataclass(frozen=True)
class Holding:
    """Static loads on four engaged clutches, raised in a random direction until the arm moves; arrays of shape (K,).

    Attributes
    ----------
    limit
        Largest joint torque in that direction [N·m] for which some set of clutch torques balances the load.
    moved_at
        Joint torque at which the arm moved [N·m].
    weakest_slips
        Whether the clutch with the lowest breakaway torque was among those that slipped.
    """

    limit: Array
    moved_at: Array
    weakest_slips: NDArray[np.bool_]


def holding(machine: Machine | str | None = None, loads: int = 200, seed: int = 0) -> Holding:
    """Load the arm at random voltages in random poses and directions until it moves.

    Parameters
    ----------
    machine
        The machine or its name; PTER as it is by default.
    loads
        Number of random loads, K.
    seed
        Seed of the draws.
    """
    machine, random = find_machine(machine), np.random.default_rng(seed)
    rows = [_load(machine, random) for _ in range(loads)]
    limit, moved_at, weakest = (np.array(column) for column in zip(*rows, strict=True))
    return Holding(limit, moved_at, weakest)


def largest_load(capacity: Array, direction: Array) -> float:
    """Return how far the set {Wᵀτ: |τ_x| ≤ capacity_x} extends in a direction (unit vector), up to its nearest edge.

    Parameters
    ----------
    capacity
        Largest torque that each clutch can hold [N·m], shape (4,).
    direction
        Direction of the joint torques, shape (2,).
    """
    rows = slip_rows()
    normals = rows @ np.array([[0.0, 1.0], [-1.0, 0.0]])
    return float(np.min((np.abs(rows @ normals.T).T @ capacity) / np.abs(normals @ direction)))


def _load(machine: Machine, random: np.random.Generator) -> tuple[float, float, bool]:
    volts = random.uniform(0.1, 1.0, 4) * machine.clutch.voltage_max
    state = initial_state(machine, random.uniform(0.0, 2.0 * np.pi, 2), volts=volts)
    angle = random.uniform(0.0, 2.0 * np.pi)
    direction = np.array([np.cos(angle), np.sin(angle)])
    limit = largest_load(np.maximum(state.torque_breakaway, state.torque_dynamic), direction)
    ramp = limit * np.linspace(1.0 - _MARGIN, 1.0 + _MARGIN, _STEPS)
    run = simulate(machine, state, volts, (0.0, 0.0), ramp[:, None] * direction)
    first = int(np.flatnonzero(run.omega.any(axis=1))[0])
    weakest = int(np.argmin(state.torque_breakaway))
    return limit, float(ramp[first]), bool(run.slip_velocity[first, weakest] != 0.0)
