"""One policy through many episodes."""

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pter_gym.controllers import Controller, Policy
from pter_gym.envs.batch import Batch
from pter_gym.envs.world import SKIP
from pter_gym.params import Machine
from pter_gym.tasks.path_following import T_TERMINATED, PathFollowing

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
    while len(telemetry) <= max_steps and not np.nan_to_num(telemetry[-1][:, T_TERMINATED], nan=1.0).all():
        returns = batch.step(policy(obs), SKIP)
        obs = returns.obs
        telemetry.append(returns.telemetry[0])
    return np.stack(telemetry)


def time_limit(task: PathFollowing) -> int:
    """Return the control steps after which an episode is truncated: three times what the pace needs, at least 300."""
    return max(300, math.ceil(3.0 * task.path.length / (task.pace * task.control_period)))
