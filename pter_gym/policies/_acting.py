"""Policies that act in environments, with actions in the environment's unit."""

import os
from collections.abc import Callable, Iterator, Sequence
from typing import Any, cast

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.vector import VectorActionWrapper, VectorObservationWrapper
from numpy.typing import NDArray

from pter_gym._compiled.layout import Layout
from pter_gym._internal.files import FilePath
from pter_gym.controllers import AnyPolicy, bind
from pter_gym.errors import ActionError, ParameterError
from pter_gym.params import Machine
from pter_gym.params._named import nominal_machine
from pter_gym.policies.find import find_policy
from pter_gym.tasks.path_following._actions import action_of

Actions = NDArray[np.float32]

CHANGING: Any = (
    gymnasium.ObservationWrapper,
    gymnasium.ActionWrapper,
    VectorObservationWrapper,
    VectorActionWrapper,
)
"""Kinds of wrappers that change what passes between a policy and the worlds."""

LIBRARIES = ("gymnasium.", "stable_baselines3.")

CHANGING_MODULES = (
    "_observation",
    "_action",
    ".vec_frame_stack",
    ".atari_wrappers",
    ".atari_preprocessing",
)
"""Ends of the names of these libraries' modules whose wrappers change it, whatever their kind."""


def load_policy(policy: "FilePath | AnyPolicy", env: Any) -> "ActingPolicy":
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
        (whose_gains,) = attributes(env, "whose_gains")
        policy = find_policy(cast("FilePath", policy), whose_gains)
    return ActingPolicy(policy, env)


class ActingPolicy:
    """A policy in one environment: ``policy(observation) -> action``.

    Call it once per step of the environment, and ``reset`` where episodes begin.

    Parameters
    ----------
    policy
        A law, a trained policy, or any function from observations, float32 (N, entries), to
        volts, (N, clutches). It is bound to ``nominal_machine`` of the environment.
    env
        The environment, with its wrappers: a single one, a vector environment, or a ``VecEnv`` of
        Stable-Baselines3.

    Raises
    ------
    ParameterError
        If the environment is not one of this package, a wrapper changes observations or actions, or
        the policy needs something that the observations lack, or another ``frame_skip`` or
        ``control_period``, or the environment has a base.
    """

    def __init__(self, policy: AnyPolicy, env: Any) -> None:
        check_wrappers(env)
        machine = nominal_machine(attributes(env, "nominal_machine"))
        (layout,) = attributes(env, "observation_layout")
        (skip,) = attributes(env, "frame_skip")
        if attributes(env, "base") != {None}:
            raise ParameterError(
                "env must have no base, since a policy returns voltages and not corrections: "
                "make it without base"
            )
        self._single = isinstance(env, gymnasium.Env)
        self._worlds: int = 1 if self._single else env.num_envs
        self._machine = machine
        self._bounds = bounds_of_actions(env, layout, machine)
        self._policy = bind(policy, machine, layout)
        self._shape = (len(layout),) if self._single else (self._worlds, len(layout))
        frame_skip = self._policy.frame_skip
        if frame_skip != skip and not self._policy.any_frame_skip:
            raise ParameterError(
                f"env must have the frame_skip of the policy, {frame_skip}, got {skip}: "
                f"make it with frame_skip={frame_skip}"
            )
        for period in attributes(env, "control_period"):
            self._policy.check_period(period)
        self._episodes = np.arange(self._worlds)
        self._memory = self._policy.start(self._worlds)

    def reset(self, worlds: NDArray[np.bool_] | None = None) -> None:
        """Clear the memory of some worlds, a bool array (N,), or by default of all.

        Call it after ``env.reset``, and in a vector environment for the worlds whose latest
        observation is the first of an episode: with ``AutoresetMode.SAME_STEP`` those whose episode
        has just ended, with ``NEXT_STEP`` those whose episode ended a step ago.

        Raises
        ------
        ParameterError
            If the worlds are not a bool array (N,).
        """
        begins = np.asarray(np.ones(self._worlds, np.bool_) if worlds is None else worlds)
        if begins.dtype != np.bool_ or begins.shape != (self._worlds,):
            raise ParameterError(
                f"worlds must be a bool array with the shape ({self._worlds},), got {worlds!r:.200}"
            )
        self._episodes[begins] += self._worlds
        fresh = self._policy.start(self._worlds, self._episodes)
        if fresh is not None:
            self._memory[begins] = fresh[begins]

    def __call__(self, observation: Any) -> Actions:
        """Return the action for the latest observation of the environment.

        Parameters
        ----------
        observation
            float32 (entries,) of a single environment, (N, entries) of a vector environment.

        Returns
        -------
        action
            In the unit of the environment, volts or normalised: float32 (clutches,) or (N,
            clutches), a fresh array.

        Raises
        ------
        ParameterError
            If the observation has a wrong shape, or what the policy returns.
        ActionError
            If a voltage is not finite.
        """
        try:
            rows = np.array(observation, np.float32, order="C")
        # ragged, as what reset returns, or a tensor on another device
        except (ValueError, TypeError, RuntimeError):
            rows = np.empty(0, np.float32)
        if rows.shape != self._shape:
            got = rows.shape if rows.size else f"a {type(observation).__name__}"
            raise ParameterError(
                f"observation must be an array of the shape {self._shape}, got {got}"
            )
        volts = self._policy.volts(rows.reshape(self._worlds, -1), self._memory, self._machine)
        if not np.isfinite(volts).all():
            raise ActionError(f"policy must give finite voltages, got {volts!r:.200}")
        actions = action_of(
            volts.astype(np.float32), *self._bounds, self._machine.clutch.voltage_max
        )
        return actions[0] if self._single else actions


INSTEAD: dict[str, str] = dict.fromkeys(
    ("FrameStackObservation", "VecFrameStack", "TimeAwareObservation"),
    "; instead make the environment with history=(1, 2, 3), the control steps to look back",
)
"""What to use in place of some wrappers."""


def attributes(env: Any, name: str) -> set[Any]:
    """Return the distinct values of an attribute of the unwrapped environments."""
    base = getattr(env, "unwrapped", env)
    try:
        return set(base.get_attr(name)) if hasattr(base, "get_attr") else {getattr(base, name)}
    except AttributeError:
        raise ParameterError(
            "env must be an environment of this package, "
            f"as gymnasium.make and gymnasium.make_vec return it, "
            f"got {env!r:.100}"
        ) from None


def check_wrappers(env: Any, known: Any = None) -> None:
    """Raise a ParameterError if a wrapper other than ``known`` changes observations or actions.

    Another wrapper of one's own that overrides ``step`` cannot be told from one that only looks on,
    and is let through.
    """
    normalises = hasattr(env, "normalize_obs") and getattr(env, "norm_obs", True)
    if env is not known and (
        normalises or _changes(type(env), is_vec_wrapper=hasattr(env, "venv"))
    ):
        _refuse(type(env).__name__)
    wrapped = (getattr(env, "venv", None), getattr(env, "env", None), *getattr(env, "envs", ()))
    inner = [wrapper for wrapper in wrapped if wrapper is not None]
    for wrapper in inner:
        check_wrappers(wrapper, known)
    ask = getattr(env, "call", getattr(env, "env_method", None))
    if ask and not inner:
        _check_elsewhere(ask)


def _check_elsewhere(ask: Callable[..., Sequence[object]]) -> None:
    """Raise a ParameterError if a wrapper in another process changes observations or actions."""
    for method in ("observation", "action"):
        if any(ask("has_wrapper_attr", method)):
            _refuse(f"with the method {method}")
    chains = "".join(map(str, ask("__str__")))  # such as <TimeLimit<OrderEnforcing<…
    for kind in _kinds_below(gymnasium.Wrapper):
        if f"<{kind.__name__}<" in chains and _changes(kind):
            _refuse(kind.__name__)


def _kinds_below(kind: type) -> Iterator[type]:
    """Yield the classes derived from a class that are loaded."""
    for each in kind.__subclasses__():
        yield each
        yield from _kinds_below(each)


def _changes(kind: Any, *, is_vec_wrapper: bool = False) -> bool:
    """Return whether wrappers of a class change observations or actions."""
    return issubclass(kind, CHANGING) or any(
        (each.__module__.startswith(LIBRARIES) and each.__module__.endswith(CHANGING_MODULES))
        or (
            is_vec_wrapper
            and "step_async" in vars(each)
            and not each.__module__.startswith(LIBRARIES)
        )
        for each in kind.__mro__
    )


def _refuse(wrapper: str) -> None:
    raise ParameterError(
        "env must pass on observations and actions as they are: "
        f"its wrapper {wrapper} changes them{INSTEAD.get(wrapper, '')}"
    )


def bounds_of_actions(env: Any, layout: Layout, machine: Machine) -> tuple[float, float]:
    """Return the bounds of actions, or raise a ParameterError if the spaces are not the worlds'."""
    many = "single_" if hasattr(env, "single_action_space") else ""
    observations, actions = (
        getattr(env, f"{many}{name}_space") for name in ("observation", "action")
    )
    clutches = (len(machine.clutches),)
    for low, high in ((0.0, machine.clutch.voltage_max), (-1.0, 1.0)):
        if observations.shape == (len(layout),) and actions == spaces.Box(
            low, high, clutches, np.float32
        ):
            return low, high
    raise ParameterError(
        "env must pass on observations and actions as they are: "
        f"it has {observations} and {actions}"
    )
