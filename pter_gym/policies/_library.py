"""Models trained with learning libraries, as policies; none of these libraries is imported here."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from types import SimpleNamespace
from typing import Any, NamedTuple, get_args

import numpy as np
from gymnasium import spaces
from gymnasium.wrappers import NormalizeObservation
from gymnasium.wrappers.vector import NormalizeObservation as VectorNormalizeObservation
from numpy.typing import NDArray

from pter_gym._compiled.layout import Layout
from pter_gym.controllers import Policy
from pter_gym.controllers._policy import check_same, names_of
from pter_gym.errors import ParameterError
from pter_gym.params import SLOTS, Machine
from pter_gym.params._named import nominal_machine
from pter_gym.policies._acting import attributes, bounds_of_actions, check_wrappers
from pter_gym.policies._view import View
from pter_gym.tasks.path_following import Sensors

Observations = NDArray[np.float32]
Normalise = Callable[[Observations], Observations]


def from_sb3(
    model: Any, vec_normalize: Any = None, frame_skip: int | None = None, *, env: Any = None
) -> "LibraryController":
    """Return a policy that runs a model deterministically, with a recurrent state for each world.

    Parameters
    ----------
    model
        A model of any algorithm whose ``predict`` takes observations, states and episode starts.
        Its actions are clipped to its action space; they are normalised if the lower bound is
        negative, and volts otherwise.
    vec_normalize
        The wrapper that normalised observations in training: a ``VecNormalize`` or Gymnasium's
        ``NormalizeObservation``. By default, the ``VecNormalize`` of the environment, if any. Its
        statistics are used but not changed.
    frame_skip
        Number of control steps for which each action is held; by default, that of the environment.
    env
        The environment in which the model was trained, or one like it; by default, the one attached
        to the model, otherwise that of ``vec_normalize``. It determines what observations and
        actions mean, which law a model with ``base`` corrects, and which earlier observations a
        model with ``history`` sees.

    Raises
    ------
    ParameterError
        If there is no environment, observations or actions of the model are not those of one of
        this package, another wrapper of it changes them, or ``frame_skip`` is not a whole number
        ≥ 1.
    """
    if env is None:
        env = getattr(model, "env", None) or getattr(
            vec_normalize, "venv", getattr(vec_normalize, "env", None)
        )
    if env is None:
        raise ParameterError(
            "env must be given for a model without one: the environment of its training, or one "
            "like it, as in from_sb3(PPO.load('mine'), env=envs)"
        )
    own = next((each for each in _wrappers(env) if _has_statistics(each)), None)
    check_wrappers(env, known=own)
    normalise = _normalising(own if vec_normalize is None else vec_normalize)
    (view,) = attributes(env, "view")
    view = view if frame_skip is None else replace(view, frame_skip=frame_skip)
    return LibraryController(model, normalise, view, env)


def from_actions(
    act: Callable[[Observations], Any], env: Any, frame_skip: int | None = None
) -> "LibraryController":
    """Return a policy that runs a function from observations to an environment's actions.

    Parameters
    ----------
    act
        Maps observations, float32 (N, entries), to actions, (N, clutches): an array or a torch
        tensor. It has no memory. Its actions are clipped to the action space; they are normalised
        if the lower bound is negative, and volts otherwise.
    env
        The environment that the function was made for.
    frame_skip
        Number of control steps for which each action is held; by default, that of the environment.

    Raises
    ------
    ParameterError
        If it is not an environment of this package, a wrapper changes observations or actions, or
        ``frame_skip`` is not a whole number ≥ 1.
    """
    spaces_of = {
        name: getattr(env, f"single_{name}", getattr(env, name, None))
        for name in ("observation_space", "action_space")
    }
    model = SimpleNamespace(predict=partial(_predict, act), **spaces_of)
    return from_sb3(model, frame_skip=frame_skip, env=env)


def _predict(
    act: Callable[[Observations], Any], observations: Observations, **_: object
) -> tuple[Any, None]:
    """Return what a function returns as ``predict`` of a model does."""
    actions = act(observations)
    return (actions.detach().cpu().numpy() if hasattr(actions, "detach") else actions), None


class LibraryController:
    """A model of a learning library; like a law, it is bound to become a policy.

    Attributes
    ----------
    sensors
        Sensors whose readings its observations include.
    frame_skip
        Control steps for which its actions are held.
    """

    def __init__(self, model: Any, normalise: Normalise, view: View, env: Any) -> None:
        (layout,) = attributes(env, "observation_layout")
        (self._control_period,) = attributes(env, "control_period")
        machine = nominal_machine(attributes(env, "nominal_machine"))
        self._bounds = bounds_of_actions(env, layout, machine)
        self._machine = machine
        space = getattr(model, "observation_space", None)
        if not isinstance(space, spaces.Box) or space.shape != (len(layout),):
            raise ParameterError(
                "model.observation_space must be that of env, with the "
                f"{len(layout)} entries {', '.join(layout.names)}, got {space}"
            )
        expected = spaces.Box(*self._bounds, (len(machine.clutches),), np.float32)
        if (space := getattr(model, "action_space", None)) != expected:
            raise ParameterError(f"model.action_space must be that of env, {expected}, got {space}")
        entries = len(layout) // (1 + len(view.history))
        self._names = layout.names[: entries - (0 if view.base is None else SLOTS)]
        self.sensors = _sensors_of(self._names)
        self._model, self._normalise, self._view = model, normalise, view
        self.frame_skip = view.held_by_worlds

    def bind(self, machine: Machine, layout: Layout) -> Policy:
        """Return the policy for a machine and a layout.

        Raises
        ------
        ParameterError
            If the observations have other entries than the model's, or the machine other clutches
            or another largest voltage than that of its environment.
        """
        check_same(self._names, self._machine, machine, layout)
        view = self._view.bind(machine, layout)

        def act(observations: Observations, memory: Any) -> Any:
            actions = self._actions(observations, memory)
            return actions if self._view.looks else view.volts(actions)

        def start(worlds: int) -> NDArray[np.object_]:
            return np.zeros(worlds, object)

        policy = Policy.from_function(
            act, view.layout, start=start, frame_skip=self._view.frame_skip
        )
        if self._view.looks:
            policy = replace(view.policy(policy), layout=layout)
        made = partial(self.bind, machine, layout)
        return replace(policy, control_period=self._control_period, made=made, machine=machine)

    def _actions(self, observations: Observations, memory: Any) -> NDArray[np.float64]:
        """Return the model's actions, clipped, and keep its state in the memory, objects (N,)."""
        before, begins = [kept for kept in memory if kept], memory == 0
        actions, after = self._model.predict(
            self._normalise(observations),
            state=before[0].state if before else None,
            episode_start=begins,
            deterministic=True,
        )
        for world in range(len(memory)):
            memory[world] = _Kept(after)
        return np.clip(np.asarray(actions, np.float64), *self._bounds)


class _Kept(NamedTuple):
    """The model's state of all worlds, kept by each world whose episode goes on."""

    state: Any


def _sensors_of(names: tuple[str, ...]) -> Sensors:
    """Return the sensors of which observations have entries with these names."""
    for sensors in get_args(Sensors):
        if names_of(sensors) == names:
            return sensors
    raise ParameterError(
        f"env must have the observations of sensors, without context, got {', '.join(names)}"
    )


def _wrappers(env: Any) -> Iterator[Any]:
    """Yield an environment and what it wraps, from the outside in."""
    while env is not None:
        yield env
        env = getattr(env, "venv", getattr(env, "env", None))


def _has_statistics(wrapper: Any) -> bool:
    """Return whether a wrapper is a ``VecNormalize`` or a ``NormalizeObservation``."""
    return isinstance(wrapper, NormalizeObservation | VectorNormalizeObservation) or hasattr(
        wrapper, "normalize_obs"
    )


def _normalising(wrapper: Any) -> Normalise:
    """Return a function that normalises as a wrapper does, whose statistics it does not change."""
    if wrapper is None:
        return np.asarray
    if not _has_statistics(wrapper):
        raise ParameterError(
            f"vec_normalize must be a VecNormalize or a NormalizeObservation, got {wrapper!r}"
        )
    if hasattr(wrapper, "normalize_obs"):
        return wrapper.normalize_obs
    return partial(_normalised, wrapper.obs_rms, wrapper.epsilon)


def _normalised(statistics: Any, epsilon: float, obs: Observations) -> Observations:
    scaled = (obs - statistics.mean) / np.sqrt(statistics.var + epsilon)
    return scaled.astype(np.float32)
