"""Policies that act in environments: bound to their machine and observations, with actions in their unit."""

from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.vector import VectorActionWrapper, VectorEnv, VectorObservationWrapper
from numpy.typing import NDArray

from pter_gym._compiled.layout import Layout
from pter_gym.controllers import Controller, bind
from pter_gym.envs._shared import nominal_machine
from pter_gym.errors import ActionError, ParameterError

Observations = NDArray[np.float32]
Actions = NDArray[np.float32]

CHANGING: Any = (gymnasium.ObservationWrapper, gymnasium.ActionWrapper, VectorObservationWrapper, VectorActionWrapper)
"""Wrappers that change what passes between a policy and the worlds."""


class ActingPolicy:
    """A policy in one environment: ``policy(observation) -> action``; ``pter_gym.load_policy`` makes one.

    Call it once at each step of the environment, and ``reset`` where episodes begin.

    Parameters
    ----------
    policy
        A controller, a trained policy, or any function from observations, float32 (N, entries), to volts, (N, 4).
        It is bound to ``nominal_machine`` of the environment.
    env
        The environment, with its wrappers: a single one, a vector environment, or a ``VecEnv`` of Stable-Baselines3.

    Raises
    ------
    ParameterError
        If the environment is not one of this package, a wrapper changes observations or actions, or the policy needs
        something that the observations lack, or another ``frame_skip``.
    """

    def __init__(self, policy: Controller | Callable[[Observations], Any], env: Any) -> None:
        check_wrappers(env)
        machine = nominal_machine(attributes(env, "nominal_machine"))
        (layout,) = attributes(env, "observation_layout")
        (skip,) = attributes(env, "frame_skip")
        self._single = isinstance(env, gymnasium.Env)
        self._worlds: int = 1 if self._single else env.num_envs
        self._voltage_max = machine.clutch.voltage_max
        self._normalised = check_spaces(env, layout, self._voltage_max)
        self._shape = (len(layout),) if self._single else (self._worlds, len(layout))
        self._policy = bind(policy, machine, layout)
        held = self._policy.frame_skip
        if held != skip and not (held == 1 and self._policy.any_frame_skip):
            raise ParameterError(
                f"env must have the frame_skip of the policy, {held}, got {skip}: make the environment with "
                f"frame_skip={held}"
            )

    def reset(self, worlds: NDArray[np.bool_] | None = None) -> None:
        """Begin new episodes in these worlds, a bool array (N,), or in all by default.

        Call it after ``env.reset``, and in a vector environment with the worlds whose latest observation is the first
        of an episode: those whose episode has just ended with ``AutoresetMode.SAME_STEP``, and those whose episode
        ended a step ago with ``NEXT_STEP``.

        Raises
        ------
        ParameterError
            If the worlds are not a bool array (N,).
        """
        if worlds is not None:
            mask = np.asarray(worlds)
            if mask.dtype != np.bool_ or mask.shape != (self._worlds,):
                raise ParameterError(
                    f"worlds must be a bool array with the shape ({self._worlds},), got {worlds!r:.200}"
                )
            if not mask.any():
                return
            worlds = mask
        self._policy.reset(worlds)

    def __call__(self, observation: Any) -> Actions:
        """Return the action for the latest observation of the environment.

        Parameters
        ----------
        observation
            float32 (entries,) of a single environment, (N, entries) of a vector environment.

        Returns
        -------
        action
            In the unit of the environment, volts or normalised: float32 (4,) or (N, 4), a fresh array.

        Raises
        ------
        ParameterError
            If the observation has a wrong shape.
        ActionError
            If the policy returns anything but finite voltages within the range.
        """
        try:
            rows = np.array(observation, np.float32, order="C")
        except (ValueError, TypeError, RuntimeError):  # ragged, as what reset returns, or a tensor on another device
            rows = np.empty(0, np.float32)
        if rows.shape != self._shape:
            found = rows.shape if rows.size else f"a {type(observation).__name__}"
            raise ParameterError(f"observation must be an array of the shape {self._shape}, got {found}")
        actions = self._in_unit(np.array(self._policy.act(rows.reshape(self._worlds, -1)), np.float32))
        return actions[0] if self._single else actions

    def _in_unit(self, volts: Actions) -> Actions:
        """Return voltages in the unit of the environment; those of a compiled law are clipped, as in the kernel."""
        most = self._voltage_max
        if self._policy.compiled:
            volts = np.clip(volts, 0.0, most)
        if volts.shape != (self._worlds, 4) or not ((volts >= 0.0) & (volts <= most)).all():
            raise ActionError(
                f"policy must give voltages of the shape {(self._worlds, 4)} within [0, {most:g}] V, got {volts!r:.200}"
            )
        return normalised(volts, most) if self._normalised else volts


def normalised(volts: NDArray[np.floating], voltage_max: float) -> Actions:
    """Return the normalised actions, float32, that stand for voltages [V] within [0, voltage_max]."""
    return (2.0 * np.sqrt(np.asarray(volts, np.float64) / voltage_max) - 1.0).astype(np.float32)


def attributes(env: Any, name: str) -> set[Any]:
    """Return the distinct values of an attribute in the environments below the wrappers, or raise a ParameterError."""
    base = getattr(env, "unwrapped", env)
    try:
        return set(base.get_attr(name)) if hasattr(base, "get_attr") else {getattr(base, name)}
    except AttributeError:
        raise ParameterError(
            f"env must be an environment of this package, as gymnasium.make and gymnasium.make_vec return it, "
            f"got {env!r:.100}"
        ) from None


def check_wrappers(env: Any, known: Any = None) -> None:
    """Raise a ParameterError if a wrapper changes observations or actions: by its kind, or as ``VecNormalize`` does.

    ``known`` is a wrapper that may.
    """
    normalises = hasattr(env, "normalize_obs") and getattr(env, "norm_obs", True)
    if env is not known and (isinstance(env, CHANGING) or normalises):
        raise ParameterError(
            f"env must pass on observations and actions as they are: its wrapper {type(env).__name__} changes them"
        )
    for inner in (getattr(env, "venv", None), getattr(env, "env", None), *getattr(env, "envs", ())):
        if inner is not None:
            check_wrappers(inner, known)


def check_spaces(env: Any, layout: Layout, voltage_max: float) -> bool:
    """Return whether actions are normalised, or raise a ParameterError if spaces are not those of the worlds."""
    many = isinstance(env, VectorEnv)
    observed, acted = (
        getattr(env, f"single_{name}" if many else name) for name in ("observation_space", "action_space")
    )
    for normalised_unit, low, high in ((False, 0.0, voltage_max), (True, -1.0, 1.0)):
        if observed.shape == (len(layout),) and acted == spaces.Box(low, high, (4,), np.float32):
            return normalised_unit
    raise ParameterError(
        f"env must pass on observations and actions as they are: its spaces are {observed} and {acted}"
    )
