"""The paper's standard test (section IV-A) for any policy."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pter_gym.benchmark.episodes import Episodes
from pter_gym.benchmark.rollout import record_episodes
from pter_gym.benchmark.scores import Score, score
from pter_gym.controllers import AnyPolicy
from pter_gym.errors import ParameterError
from pter_gym.params import Machine, find_machine
from pter_gym.tasks.path_following import COLUMN, PathFollowing

STANDARD_TIME_CONSTANTS = (0.01, 0.03, 0.06, 0.105, 0.15, 0.2)
"""Time constants of the clutches [s]; 0.105 is the manufacturer's (section IV-C.3)."""

MOST_STEPS = 1000
"""Control steps after which an episode is truncated."""


@dataclass(frozen=True)
class Run:
    """One episode of one policy, with clutches of one time constant [s].

    ``telemetry``, float64 (steps + 1, len(TELEMETRY)), is the row of the reset, then one row per
    control step.
    """

    time_constant: float
    score: Score
    telemetry: NDArray[np.float64]


@dataclass(frozen=True)
class Result:
    """The standard test on a machine: for each policy by name, one run per time constant."""

    machine: Machine
    task: PathFollowing
    runs: dict[str, tuple[Run, ...]]


def run_standard_test(
    policies: Mapping[str, AnyPolicy],
    *,
    machine: Machine | str | None = None,
    task: PathFollowing | None = None,
    time_constants: Sequence[float] = STANDARD_TIME_CONSTANTS,
    seed: int = 0,
) -> Result:
    """Run the standard test.

    Parameters
    ----------
    policies
        By name: controllers, which are bound to ``machine``, or any ``policy(observations) ->
        volts``, float32 (N, entries) to (N, 4). ``find_policy(name, scenario=None)`` returns a
        built-in one.
    machine, task
        The machine or its name, with the time constant replaced, and the task; PTER and its task by
        default.
    time_constants
        Time constants of the clutches [s]; one episode each.
    seed
        Seed ≥ 0 of the episodes.

    Raises
    ------
    ParameterError
        If there is no policy, machine or time constant, or a time constant is not > 0.
    """
    for name, values in (("policies", policies), ("time_constants", time_constants)):
        if not values:
            raise ParameterError(f"{name} must hold at least one, got none")
    machine, task = find_machine(machine), PathFollowing() if task is None else task
    machines = tuple(
        replace(machine, clutch=replace(machine.clutch, time_constant=tau))
        for tau in time_constants
    )
    count = len(machines)
    episodes = Episodes(
        "",
        machines,
        (task,) * count,
        (seed,) * count,
        ("",) * count,
        machine,
        (MOST_STEPS,) * count,
    )
    runs: dict[str, tuple[Run, ...]] = {}
    for name, policy in policies.items():
        telemetry = record_episodes(policy, episodes).telemetry
        recorded = (rows[np.isfinite(rows[:, COLUMN.time])] for rows in telemetry.swapaxes(0, 1))
        runs[name] = tuple(
            Run(tau, score(rows, task, machine), rows)
            for tau, rows in zip(time_constants, recorded, strict=True)
        )
    return Result(machine, task, runs)
