"""Policies ready to act in an environment, by name, by path or as objects."""

import os
from typing import Any, cast

from pter_gym._internal.files import FilePath
from pter_gym.benchmark.policies import find_policy
from pter_gym.controllers import AnyPolicy
from pter_gym.policies._acting import ActingPolicy, attributes


def load_policy(policy: "FilePath | AnyPolicy", env: Any) -> ActingPolicy:
    """Return a policy that is ready to act in an environment: ``action = policy(observation)``.

    It returns actions in the environment's unit. Call its ``reset()`` after ``env.reset()``, and
    ``reset(worlds)`` with a mask where worlds of a vector environment begin new episodes.

    Parameters
    ----------
    policy
        What ``pter benchmark --policies`` takes: the name of a trained policy or of a law,
        the path of an exported policy (a string or a ``pathlib.Path``), or
        ``package.module:attribute``. Or a policy itself: a law, what ``from_sb3`` returns,
        or a function from observations, float32 (N, entries), to volts, (N, 4).
    env
        Environment in which it acts: from ``gymnasium.make``, ``gymnasium.make_vec`` or
        ``make_sb3_vec_env``, with its wrappers. Control laws have the gains of its scenario; on a
        path of your own, those of ``paths``.

    Raises
    ------
    ParameterError
        If there is no such policy, or it cannot act in this environment; the message says why.
    DataError
        If a file of the policy is damaged.
    """
    if isinstance(policy, str | os.PathLike):
        (gains,) = attributes(env, "gains")
        policy = find_policy(cast("FilePath", policy), gains)
    return ActingPolicy(policy, env)
