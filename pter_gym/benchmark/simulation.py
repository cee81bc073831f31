"""One policy through many episodes."""

import math
import time
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pter_gym.controllers import Controller, Policy
from pter_gym.controllers.predictive import Decide, Predictive
from pter_gym.engine.batch import Batch
from pter_gym.engine.world import SKIP
from pter_gym.params import BASELINE, Machine
from pter_gym.tasks.path_following import COLUMN, PathFollowing

Array = NDArray[np.float64]
AnyPolicy = Callable[[NDArray[np.float32]], Any]


def bind(policy: Controller | AnyPolicy, machine: Machine, batch: Batch) -> AnyPolicy:
    """Return a policy that can act in a batch: a controller is bound to its nominal machine."""
    return policy.bind(machine, batch.layout) if isinstance(policy, Controller) else policy


def simulate(batch: Batch, policy: AnyPolicy, seeds: Sequence[int], max_steps: int) -> Array:
    """Return the telemetry of new episodes, (steps + 1, N, len(TELEMETRY)), NaN after the end of an episode.

    Parameters
    ----------
    batch
        N worlds.
    policy
        A bound controller, whose law runs compiled, or any ``policy(observations) -> volts``, float32 (N, entries) to
        (N, 4). If it has a method ``reset``, that is called first, so that it forgets earlier episodes.
    seeds
        Of the resets, N of them.
    max_steps
        Control steps after which an episode is truncated.
    """
    obs, first = batch.reset(seeds)
    if isinstance(policy, Policy):
        _, rows = batch.rollout(obs, policy.law, policy.gains, max_steps)
        return np.concatenate([first[None], rows])
    forget = getattr(policy, "reset", None)
    if callable(forget):
        forget()
    telemetry = [first]
    while len(telemetry) <= max_steps and not np.nan_to_num(telemetry[-1][:, COLUMN.terminated], nan=1.0).all():
        returns = batch.step(policy(obs), SKIP)
        obs = returns.obs
        telemetry.append(returns.telemetry[0])
    return np.stack(telemetry)


class Episode(NamedTuple):
    """One episode with all that a policy saw and did; a control step is decided at each but the last row.

    Attributes
    ----------
    telemetry
        float64 (T + 1, len(TELEMETRY)): the row of the reset, then one per control step.
    obs
        Observations with force sensors, float32 (T + 1, entries).
    volts
        What was decided [V], float32 (T, 4).
    decision_ms
        Mean processor time of a decision but the first [ms]; 0 where there is no second.
    """

    telemetry: Array
    obs: NDArray[np.float32]
    volts: NDArray[np.float32]
    decision_ms: float


def simulate_alone(
    policy: Controller | Predictive, machine: Machine, task: PathFollowing, seed: int, max_steps: int
) -> Episode:
    """Return an episode of a policy, which may be one that plans, in a world of its own.

    Parameters
    ----------
    policy
        A controller, which is bound to the nominal machine and does without force sensors, or one that plans.
    machine, task, seed
        The episode.
    max_steps
        Control steps after which it is truncated.
    """
    world = Batch(machine, task, 1, sensors="force")
    decide = policy.begin(machine, task) if isinstance(policy, Predictive) else _decide(policy, machine, task)
    obs, first = world.reset([seed])
    seen, telemetry = [obs[0]], [first[0]]
    sent: list[NDArray[np.float32]] = []
    ends: list[float] = []
    while len(sent) < max_steps and telemetry[-1][COLUMN.terminated] != 1.0:
        begin = time.thread_time()
        volts = np.asarray(decide(world, seen[-1]), np.float32)
        ends.append(time.thread_time() - begin)
        returns = world.step(volts[None])
        sent.append(volts)
        seen.append(returns.obs[0])
        telemetry.append(returns.telemetry[0, 0])
    took = 1000.0 * float(np.mean(ends[1:])) if len(ends) > 1 else 0.0
    return Episode(np.array(telemetry), np.array(seen), np.array(sent), took)


def _decide(policy: Controller, machine: Machine, task: PathFollowing) -> Decide:
    """Return what decides in one episode for a controller."""
    layout = Batch(machine, task, 1).layout
    bound: Any = policy.bind(BASELINE, layout)
    return lambda _, obs: bound(obs[None, : len(layout)])[0]


def time_limit(task: PathFollowing) -> int:
    """Return the control steps after which an episode is truncated: three times what the pace needs, at least 300."""
    return max(300, math.ceil(3.0 * task.path.length / (task.pace * task.control_period)))
