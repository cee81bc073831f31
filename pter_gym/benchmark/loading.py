"""Policies ready to act in an environment, by name, by path or as they are."""

import os
from typing import Any, cast

from pter_gym.benchmark.naming import read_policy
from pter_gym.benchmark.simulation import AnyPolicy
from pter_gym.envs.acting import ActingPolicy
from pter_gym.errors import ParameterError
from pter_gym.internal.files import FilePath

STANDARD = "standard"
"""Scenario whose gains tuned controllers have in an environment that is of none."""


def load_policy(policy: FilePath | AnyPolicy, env: Any, *, seed: int = 0) -> ActingPolicy:
    """Return a policy that is ready to act in an environment: ``action = policy(observation)``.

    It notices by itself when episodes begin, and gives actions in the unit of the environment.

    Parameters
    ----------
    policy
        What ``pter benchmark --policies`` takes: the name of a trained policy or of a controller, the path of an
        exported policy (a string or a ``pathlib.Path``), or ``package.module:attribute``. Or a policy itself: a
        controller, what ``from_sb3`` returns, or a function from observations, float32 (N, entries), to volts, (N, 4).
    env
        The environment in which it acts: of ``gymnasium.make``, ``gymnasium.make_vec`` or ``make_sb3_vec_env``, with
        its wrappers. Tuned gains are those of its scenario.
    seed
        Of the random policy, and of those that plan.

    Raises
    ------
    ParameterError
        If there is no such policy, which tells the nearest, or it cannot act in this environment, which tells why.
    DataError
        If a file of the policy is not what it must be.
    """
    if isinstance(policy, (str, os.PathLike)):
        return ActingPolicy(read_policy(cast("FilePath", policy), seed, _scenario_of(env)), env)
    if not callable(policy) and not hasattr(policy, "bind"):
        raise ParameterError(
            "policy must be a name, the path of an exported policy, a controller, or a function from observations to "
            f"volts, got {policy!r:.200}"
        )
    return ActingPolicy(policy, env)


def _scenario_of(env: Any) -> str:
    """Return the name of the scenario that an environment is of."""
    first = next(iter(getattr(env, "envs", ())), env)
    return getattr(getattr(first, "spec", None), "kwargs", {}).get("scenario", STANDARD)
