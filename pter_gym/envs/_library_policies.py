"""Models trained with learning libraries, as policies; none of these libraries is imported here."""

from collections.abc import Callable, Iterator
from types import SimpleNamespace
from typing import Any, NamedTuple, get_args

import numpy as np
from gymnasium import spaces
from gymnasium.wrappers import NormalizeObservation
from gymnasium.wrappers.vector import NormalizeObservation as VectorNormalizeObservation
from numpy.typing import NDArray

from pter_gym._compiled.layout import Layout
from pter_gym._internal.checks import whole_number
from pter_gym.controllers import Controller, Policy
from pter_gym.envs._base_law import BaseLaw
from pter_gym.envs._policies import check_wrappers
from pter_gym.errors import ParameterError
from pter_gym.params import BASELINE, SLOTS, Machine, require
from pter_gym.tasks.path_following import Sensors, observation_layout
from pter_gym.tasks.path_following._actions import volts_of

Observations = NDArray[np.float32]
Normalise = Callable[[Observations], Observations]


def from_sb3(
    model: Any, vec_normalize: Any = None, frame_skip: int | None = None, *, env: Any = None
) -> "Model":
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
        Number of control steps for which each action was held in training, and is held here; by
        default, that of the environment.
    env
        The environment in which the model was trained, or one like it; by default, the one attached
        to the model, otherwise that of ``vec_normalize``. A model that was loaded without either
        needs this or ``frame_skip``.

    A model that was trained with ``base`` corrects that law here too: the environment says which.

    Raises
    ------
    ParameterError
        If observations or actions of the model are not those of an environment of this package,
        another wrapper of the environment changes them, or ``frame_skip`` is not known or not a
        whole number ≥ 1.
    """
    if env is None:
        env = getattr(model, "env", None) or getattr(
            vec_normalize, "venv", getattr(vec_normalize, "env", None)
        )
    own = next((each for each in _wrappers(env) if _has_statistics(each)), None)
    check_wrappers(env, known=own)
    normalise = _normalising(own if vec_normalize is None else vec_normalize)
    if frame_skip is None:
        frame_skip = _frame_skip_of(env)
    skip = whole_number("frame_skip", frame_skip)
    base, reach = _attribute_of(env, "base"), _attribute_of(env, "reach")
    return (
        Model(model, normalise, skip)
        if base is None
        else CorrectingModel(model, normalise, skip, base, reach)
    )


def from_actions(
    act: Callable[[Observations], Any], env: Any, frame_skip: int | None = None
) -> "Model":
    """Return a policy that runs a function from observations to an environment's actions.

    Parameters
    ----------
    act
        Maps observations, float32 (N, entries), to actions, (N, clutches): an array or a torch
        tensor. It has no memory. Its actions are clipped to the action space; they are normalised
        if the lower bound is negative, and volts otherwise.
    env
        The environment that the function was made for: one of this package, or any object with its
        spaces.
    frame_skip
        Number of control steps for which each action is held; by default, that of the environment.

    Raises
    ------
    ParameterError
        If observations or actions are not those of an environment of this package, or
        ``frame_skip`` is not known.
    """

    def predict(observations: Observations, **_: Any) -> tuple[Any, None]:
        actions = act(observations)
        return (actions.detach().cpu().numpy() if hasattr(actions, "detach") else actions), None

    spaces_of = {
        name: getattr(env, f"single_{name}", getattr(env, name, None))
        for name in ("observation_space", "action_space")
    }
    return from_sb3(SimpleNamespace(predict=predict, env=env, **spaces_of), frame_skip=frame_skip)


class Model:
    """A model of a learning library as a law, which acts once bound.

    Attributes
    ----------
    sensors
        Sensors whose readings its observations include.
    frame_skip
        Control steps for which its actions are held.
    """

    def __init__(
        self, model: Any, normalise: Normalise, frame_skip: int, *, extra: int = 0
    ) -> None:
        self.sensors, self._entries = _observed_by(model, extra)
        space = getattr(model, "action_space", None)
        shapes = [(clutches,) for clutches in range(1, SLOTS + 1)]
        if not isinstance(space, spaces.Box) or space.shape not in shapes or not space.is_bounded():
            raise ParameterError(
                "model.action_space must be a Box with bounds for 1 to "
                f"{SLOTS} clutches, got {space}"
            )
        self._model, self._normalise, self.frame_skip = model, normalise, frame_skip
        self._bounds = list(zip(space.low.tolist(), space.high.tolist(), strict=True))

    def bind(self, machine: Machine, layout: Layout) -> Policy:
        """Return the policy for a machine and a layout.

        Raises
        ------
        ParameterError
            If one of them has other entries than the model.
        """
        if len(layout) != self._entries:
            raise ParameterError(
                f"observations must have the {self._entries} entries of the model, "
                f"got {len(layout)}"
            )
        clutches = [clutch.row for clutch in machine.clutches]
        accepted = f"{len(self._bounds)}, as the model's actions"
        require(len(clutches) == len(self._bounds), machine, "clutches", accepted, got=clutches)
        return self._policy(machine, layout)

    def _policy(self, machine: Machine, layout: Layout) -> Policy:
        """Return the policy whose actions stand for voltages."""
        top = machine.clutch.voltage_max

        def act(observations: Observations, memory: Any) -> Any:
            actions = self._actions(observations, memory)
            columns = zip(np.asarray(actions, np.float64).T, self._bounds, strict=True)
            volts = [volts_of(np.clip(column, *ends), *ends, top) for column, ends in columns]
            return np.stack(volts, axis=1)

        def start(worlds: int) -> Any:
            return np.zeros(worlds, object)

        return Policy.of_function(act, layout, start=start, frame_skip=self.frame_skip)

    def _actions(self, observations: Observations, memory: Any) -> Any:
        """Return the model's actions, and keep its state in the memory, objects (N,)."""
        before, begins = [kept for kept in memory if kept], memory == 0
        actions, after = self._model.predict(
            self._normalise(observations),
            state=before[0].state if before else None,
            episode_start=begins,
            deterministic=True,
        )
        for world in range(len(memory)):
            memory[world] = _Kept(after)
        return actions


class CorrectingModel(Model):
    """A model whose actions correct a base: the law acts at every control step."""

    def __init__(
        self, model: Any, normalise: Normalise, frame_skip: int, base: Controller, reach: float
    ) -> None:
        super().__init__(model, normalise, frame_skip, extra=SLOTS)
        self._base, self._reach, self._entries = base, reach, self._entries - SLOTS
        self._hold, self.frame_skip = frame_skip, 1

    def _policy(self, machine: Machine, layout: Layout) -> Policy:
        base = BaseLaw(self._base, machine, layout, self._reach)
        laws, actions = len(base.start(1)[0]), len(self._bounds)

        def act(observations: Observations, memory: Any) -> Any:
            state, held, age = memory["state"], memory["action"], memory["age"]
            volts = base.volts(observations, memory["law"])
            if (age % self._hold == 0).any():
                now = self._actions(base.seen(observations, volts), state)
                decides = age % self._hold == 0
                held[decides] = np.asarray(now, np.float32)[decides]
            age += 1
            return base.corrected(held, volts)

        def start(worlds: int) -> Any:
            kept = np.zeros(
                worlds,
                [
                    ("state", object),
                    ("law", np.float64, (laws,)),
                    ("action", np.float32, (actions,)),
                    ("age", np.int64),
                ],
            )
            kept["law"] = base.start(worlds)
            return kept

        return Policy.of_function(act, layout, start=start, frame_skip=None)


class _Kept(NamedTuple):
    """The model's state of all worlds, kept by each world whose episode goes on."""

    state: Any


def _observed_by(model: Any, extra: int) -> tuple[Sensors, int]:
    """Return the sensors of a model's observations, and how many entries with ``extra`` more."""
    space = getattr(model, "observation_space", None)
    lengths: dict[Sensors, int] = {
        sensors: len(observation_layout(BASELINE, sensors)) + extra for sensors in get_args(Sensors)
    }
    for sensors, entries in lengths.items():
        if isinstance(space, spaces.Box) and space.shape == (entries,):
            return sensors, entries
    known = " or ".join(f"{entries} ({sensors})" for sensors, entries in lengths.items())
    raise ParameterError(f"model.observation_space must be a Box of {known} entries, got {space}")


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


def _attribute_of(env: Any, name: str) -> Any:
    """Return an attribute of an environment, or None if there is none."""
    inner = getattr(env, "unwrapped", env)
    try:
        return inner.get_attr(name)[0] if hasattr(inner, "get_attr") else getattr(inner, name)
    except AttributeError:
        return None


def _frame_skip_of(env: Any) -> int:
    """Return the ``frame_skip`` of an environment, or raise a ParameterError."""
    if (skip := _attribute_of(env, "frame_skip")) is None:
        raise ParameterError(
            "frame_skip must be given, or env, the environment of the training, which has it: "
            "from_sb3(model, "
            f"frame_skip=3) or from_sb3(model, env=env); got env = {env!r:.100}"
        )
    return skip


def _normalising(wrapper: Any) -> Normalise:
    """Return a function that normalises as a wrapper does, whose statistics it does not change."""
    if wrapper is None:
        return lambda obs: obs
    if not _has_statistics(wrapper):
        raise ParameterError(
            f"vec_normalize must be a VecNormalize or a NormalizeObservation, got {wrapper!r}"
        )
    if hasattr(wrapper, "normalize_obs"):
        return wrapper.normalize_obs
    statistics = wrapper.obs_rms
    return lambda obs: ((obs - statistics.mean) / np.sqrt(statistics.var + wrapper.epsilon)).astype(
        np.float32
    )
