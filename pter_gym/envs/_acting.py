"""Policies that act in environments: they notice when episodes begin, and give actions in the environment's unit."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import gymnasium
import numpy as np
from gymnasium.vector import VectorActionWrapper, VectorObservationWrapper
from numpy.typing import NDArray

from pter_gym._engine.batch import Batch
from pter_gym.controllers import Controller, bind
from pter_gym.errors import ActionError, ParameterError, ResetNeededError
from pter_gym.params import BASELINE, Machine

Observations = NDArray[np.float32]
Actions = NDArray[np.float32]
Clock = NDArray[np.uint64]

CHANGING = (gymnasium.ObservationWrapper, gymnasium.ActionWrapper, VectorObservationWrapper, VectorActionWrapper)
"""Wrappers that change what passes between a policy and the worlds."""


class Decision(NamedTuple):
    """What a policy did last: where the worlds were, what it saw, and its actions."""

    clock: Clock
    rows: Observations
    actions: Actions


class ActingPolicy:
    """A policy in one environment: ``policy(observation) -> action``; ``pter_gym.load_policy`` makes one.

    Call it once at each step of the environment, with the latest observation. It reads the worlds' clocks to detect new
    episodes, whether after ``env.reset`` or when the worlds of a vector environment reset at different times. It
    clears its memory when an episode has ended, and refuses to act after steps that it hasn't seen.

    Parameters
    ----------
    policy
        A controller, a trained policy, or any function from observations, float32 (N, entries), to volts, (N, 4).
        It is bound to the machine of the environment, or to the paper's where episodes or worlds have several.
    env
        The environment, with its wrappers: a single one, a vector environment, or a ``VecEnv`` of Stable-Baselines3.

    Raises
    ------
    ParameterError
        If the environment is not one of this package with its worlds in this process, a wrapper changes observations
        or actions, or the policy needs something that the observations lack, or another ``frame_skip``.
    """

    def __init__(self, policy: Controller | Callable[[Observations], Any], env: Any) -> None:
        self._batches = worlds_of(env)
        first = self._batches[0]
        self._worlds = sum(batch.num_worlds for batch in self._batches)
        self._single = isinstance(env, gymnasium.Env)
        self._shape = (len(first.layout),) if self._single else (self._worlds, len(first.layout))
        self._voltage_max = first.machine.clutch.voltage_max
        self._normalised = first.action_low < 0.0
        self._skip = first.frame_skip
        self._acting = bind(policy, nominal_machine(self._batches), first.layout)
        if self._acting.plans is not None and len(self._batches) > 1:
            raise ParameterError("env must simulate all worlds in one call for a policy that plans, as make_vec does")
        held = self._acting.frame_skip
        if held != self._skip and not (held == 1 and self._acting.any_frame_skip):
            raise ParameterError(f"env must have the frame_skip of the policy, {held}, got {self._skip}")
        self._last: Decision | None = None

    def reset(self) -> None:
        """Start with the next observation, as if episodes began there; only needed in the middle of an episode."""
        self._last = None

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
            If the observation has a wrong shape, or is not the environment's.
        ActionError
            If the policy returns anything but finite voltages within the range.
        ResetNeededError
            If the environment was never reset, or has gone on for some control steps without this policy.
        """
        rows = self._rows(observation)
        clock = np.concatenate([batch.clock() for batch in self._batches])
        last = self._last
        if last is None or not np.array_equal(clock, last.clock):
            self._forget(clock)
            volts = np.asarray(self._acting.act(rows), np.float32)
            last = self._last = Decision(clock, rows, self._in_unit(volts))
        elif not np.array_equal(rows, last.rows):
            raise ParameterError(
                "observation must be the latest of the environment that this policy is bound to: there it has acted on "
                "another one at this control step; each environment needs a policy of its own"
            )
        return last.actions[0].copy() if self._single else last.actions.copy()

    def _forget(self, clock: Clock) -> None:
        """Forget episodes that have ended, or raise a ResetNeededError if the policy has missed steps."""
        begun = np.ones(self._worlds, np.bool_) if self._last is None else clock[:, 2] == 0
        if self._last is not None:
            missed = ~begun & (clock != self._last.clock + np.array([0, 0, self._skip], np.uint64)).any(axis=1)
            if missed.any():
                world = missed.argmax()
                raise ResetNeededError(
                    f"the policy has missed control steps: it acted last at step {self._last.clock[world, 2]} of world "
                    f"{world}, which is at step {clock[world, 2]} now; call it once at each control step from the "
                    "start of an episode, or call its reset() to begin with the present observation"
                )
        if begun.all() and self._acting.plans is not None:
            self._acting.reset_in(self._batches[0])
        elif begun.all():
            self._acting.reset()
        elif begun.any():
            self._acting.forget(begun)

    def _rows(self, observation: Any) -> Observations:
        """Return a copy of the observations as rows, (N, entries), or raise a ParameterError."""
        try:
            rows = np.array(observation, np.float32, order="C")
        except (ValueError, TypeError, RuntimeError):  # ragged, as what reset returns, or a tensor on another device
            rows = np.empty(0, np.float32)
        if rows.shape != self._shape:
            found = rows.shape if rows.size else f"a {type(observation).__name__}"
            raise ParameterError(f"observation must be an array of the shape {self._shape}, got {found}")
        return rows.reshape(self._worlds, -1)

    def _in_unit(self, volts: Actions) -> Actions:
        """Return voltages in the unit of the environment; those of a compiled law are clipped, as in the kernel."""
        most = self._voltage_max
        if self._acting.compiled:
            volts = np.clip(volts, 0.0, most)
        if volts.shape != (self._worlds, 4) or not ((volts >= 0.0) & (volts <= most)).all():
            raise ActionError(
                f"policy must give voltages of the shape {(self._worlds, 4)} within [0, {most:g}] V, got {volts!r:.200}"
            )
        return normalised(volts, most) if self._normalised else volts


def normalised(volts: NDArray[np.floating], voltage_max: float) -> Actions:
    """Return the normalised actions, float32, that stand for voltages [V] within [0, voltage_max]."""
    return (2.0 * np.sqrt(np.asarray(volts, np.float64) / voltage_max) - 1.0).astype(np.float32)


def nominal_machine(batches: list[Batch]) -> Machine:
    """Return the machine of some worlds, or the paper's with their clutches if they have several."""
    machines = {machine for batch in batches for machine, _ in batch.pairs}
    if len(machines) == 1:
        return machines.pop()
    if len(arrangements := {machine.clutches for machine in machines}) > 1:
        raise ParameterError("Machine.clutches of all worlds must be the same for a policy that is bound to a machine")
    return replace(BASELINE, clutches=arrangements.pop())


def worlds_of(env: Any) -> list[Batch]:
    """Return the worlds below an environment's wrappers.

    Raises
    ------
    ParameterError
        If the environment has no worlds in this process, or a wrapper changes observations or actions.
    """
    inner = getattr(env, "venv", None) or getattr(env, "env", None)  # a wrapper's, of either library
    if inner is not None:
        if _changes(env, inner):
            raise ParameterError(
                f"env must pass on observations and actions as they are: its wrapper {type(env).__name__} changes them"
            )
        return worlds_of(inner)
    if getattr(env, "device", "cpu") != "cpu":
        raise ParameterError('env must have its worlds on the CPU: policies act there, got device="cuda"')
    if isinstance(batch := getattr(env, "batch", None), Batch):
        return [batch]
    found = [batch for part in getattr(env, "envs", ()) for batch in worlds_of(part)]
    if not found:
        raise ParameterError(
            "env must be an environment of this package with its worlds in this process, as gymnasium.make and "
            f"gymnasium.make_vec return it, got {env!r:.100}"
        )
    return found


def _changes(env: Any, inner: Any) -> bool:
    """Tell whether a wrapper changes observations or actions: by its kind, its spaces, or as ``VecNormalize`` does."""
    normalises = hasattr(env, "normalize_obs") and getattr(env, "norm_obs", True)
    names = ("observation_space", "action_space")
    return isinstance(env, CHANGING) or normalises or any(_space(env, name) != _space(inner, name) for name in names)


def _space(env: Any, name: str) -> Any:
    """Return a space of one world."""
    return getattr(env, f"single_{name}", None) or getattr(env, name, None)
