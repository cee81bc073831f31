"""What separates the laws on the paper's line: how far off and to which side, and what they do with the clutches."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from studies.bounds import DRAWS, SEED, drawn_task

from pter_gym.benchmark.measures import column, four
from pter_gym.benchmark.metrics import score_episodes
from pter_gym.benchmark.naming import find_policy
from pter_gym.benchmark.simulation import sensors_of, simulate, time_limit
from pter_gym.benchmark.statistics import Interval, bootstrap_interval
from pter_gym.engine.batch import Batch
from pter_gym.params import BASELINE
from pter_gym.physics.friction import ClutchMode

Array = NDArray[np.float64]

SATURATED = 1.0 - 1e-6
"""Part of the largest voltage from which a clutch counts as saturated."""


@dataclass(frozen=True)
class ClutchUse:
    """What a law does at one pace, means over all control instants of all draws except for the path error.

    Attributes
    ----------
    path_error
        Interquartile mean over the draws with its 95 % interval [m].
    signed_error
        Distance from the path, positive to its left [m].
    volts
        Of the clutches [V], shape (4,).
    saturated, stuck
        Fraction of the time that each clutch spends at its largest voltage, and without slip, shape (4,).
    any_saturated, one_stuck, at_rest
        Fraction of the time with a clutch at its largest voltage, with one clutch without slip, and with all of them.
    """

    path_error: Interval
    signed_error: float
    volts: Array
    saturated: Array
    stuck: Array
    any_saturated: float
    one_stuck: float
    at_rest: float


def episodes(policy: str, pace: str, *, draws: int = DRAWS, seed: int = SEED) -> Array:
    """Return the telemetry of a policy on training draws of ``standard``, (steps + 1, draws, len(TELEMETRY)).

    Parameters
    ----------
    policy
        Its name, such as ``impedance-tuned``.
    pace
        Name of the commanded pace.
    draws, seed
        Number of draws, and the seed of the first one.
    """
    task = drawn_task(pace)
    found = find_policy(policy, scenario="standard")
    batch = Batch(BASELINE, task, draws, sensors=sensors_of(found))
    return simulate(batch, found, range(seed, seed + draws), time_limit(task))


def stuck_clutches(mode: Array) -> NDArray[np.bool_]:
    """Return which clutches do not slip in the modes of a telemetry (…), shape (…, 4)."""
    return (mode[..., None] == np.arange(1, 5)) | (mode[..., None] == ClutchMode.ZERO_DOF)


def clutch_use(policy: str, pace: str, *, draws: int = DRAWS, seed: int = SEED) -> ClutchUse:
    """Return what a policy does with the clutches; parameters as in ``episodes``."""
    telemetry = episodes(policy, pace, draws=draws, seed=seed)
    steps = telemetry[1:][np.isfinite(column(telemetry[1:], "time"))]
    volts, mode = four(steps, "volts"), column(steps, "mode")
    saturated = volts >= SATURATED * BASELINE.clutch.voltage_max
    at_rest = mode == ClutchMode.ZERO_DOF
    scores = score_episodes(telemetry, [drawn_task(pace)] * draws)
    return ClutchUse(
        path_error=bootstrap_interval(scores["path_error_m"]),
        signed_error=float(column(steps, "normal_error").mean()),
        volts=volts.mean(axis=0),
        saturated=saturated.mean(axis=0),
        stuck=stuck_clutches(mode).mean(axis=0),
        any_saturated=float(saturated.any(axis=1).mean()),
        one_stuck=float(((mode != ClutchMode.TWO_DOF) & ~at_rest).mean()),
        at_rest=float(at_rest.mean()),
    )
