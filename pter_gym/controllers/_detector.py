"""Which clutch does not do what it is told, from what a policy observes."""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pter_gym._compiled.layout import Layout
from pter_gym.params import SLOTS, Machine
from pter_gym.tasks.path_following._observation import OBS, observation_layout

LEAST = 3.0
"""Torque [N·m] that a clutch should exert before one that does not is suspected."""

DEAD, HOLDS = 0.1, 2.0
"""A dead clutch reads less than this share of the torque that it should have; one that is stuck on
reads more than ``LEAST`` beyond so many times the torque that it can have."""

SLIPS = 0.05
"""Slip velocity [rad/s] from which on a clutch surely slips, whatever noise there is."""

IN_A_ROW = 8
"""Observations in a row after which a suspicion becomes a verdict."""


@dataclass(frozen=True)
class FailureDetector:
    """Names the clutch of a machine that is dead or stuck on, if its torque sensors show one.

    A clutch that slips exerts its dynamic torque, so one that should exert some and reads none is
    dead; no clutch exerts much more than its breakaway torque, so one that does is stuck on. A
    clutch that sticks or should exert little tells nothing, nor can a weak clutch be told from one
    of another material.

    Attributes
    ----------
    machine
        The machine as it should be.
    period
        Time from one observation to the next [s].
    """

    machine: Machine
    period: float = 0.01

    def start(self, worlds: int) -> NDArray[np.float64]:
        """Return what is remembered of each world, (N, 2·4): expected torques, suspicions."""
        return np.repeat([[np.nan] * SLOTS + [0.0] * SLOTS], worlds, axis=0)

    def look(
        self, observations: NDArray[np.float32], memory: NDArray[np.float64]
    ) -> NDArray[np.intp]:
        """Return the number of the clutch that has failed in each world, 0 where none has, (N,).

        Parameters
        ----------
        observations
            Those of a control instant with torque sensors, (N, entries ≥ 24); later entries are not
            looked at.
        memory
            From ``start``, (N, 8). It changes, and a world's verdict may change with it.
        """
        seen: Any = observations[:, : len(self._layout)] * self._layout.scales
        expected, suspicion = memory[:, :SLOTS], memory[:, SLOTS:]
        steady = self._steady(seen[:, [*OBS.volts]])
        lag = math.exp(-self.period / self.machine.clutch.time_constant)
        expected[:] = np.where(np.isnan(expected), steady, steady + lag * (expected - steady))
        read = np.abs(seen[:, [*OBS.torque]])
        slip = np.abs(seen[:, [OBS.omega_a, OBS.omega_b]] @ np.array(self.machine.slot_rows).T)
        is_dead = (expected > LEAST) & (slip > SLIPS) & (read < DEAD * expected)
        holds = read > HOLDS * expected + LEAST
        suspicion[:] = np.where(is_dead | holds, suspicion + 1.0, 0.0)
        found = suspicion >= IN_A_ROW
        return np.where(found.any(axis=1), 1 + found.argmax(axis=1), 0)

    def _steady(self, volts: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the dynamic torques [N·m] that clutches settle to at voltages, (N, 4)."""
        curve, scale = self.machine.clutch.dynamic, np.array(self.machine.slot_scale)
        beyond = np.maximum(volts - curve.knee, 0.0)
        return scale * (curve.slope * volts + curve.curvature * beyond**2 + curve.off_state)

    @cached_property
    def _layout(self) -> Layout:
        return observation_layout(self.machine, "torque")
