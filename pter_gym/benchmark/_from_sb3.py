"""Models trained with learning libraries, as policies; none of these libraries is imported here."""

from collections.abc import Callable, Iterator
from types import SimpleNamespace
from typing import Any, get_args

import numpy as np
from gymnasium import spaces
from gymnasium.wrappers import NormalizeObservation
from gymnasium.wrappers.vector import NormalizeObservation as VectorNormalizeObservation
from numpy.typing import NDArray

from pter_gym._compiled.layout import Layout
from pter_gym._internal.checks import whole_number
from pter_gym.controllers import BoundPolicy
from pter_gym.envs._acting import check_wrappers
from pter_gym.errors import ParameterError
from pter_gym.params import BASELINE, SLOTS, Machine, require
from pter_gym.policies._interface import squared
from pter_gym.tasks.path_following import Sensors, observation_layout

Observations = NDArray[np.float32]
Normalise = Callable[[Observations], Observations]


def from_sb3(
    model: Any, vec_normalize: Any = None, frame_skip: int | None = None, *, env: Any = None
) -> "ModelPolicy":
    """Return a policy that runs a model deterministically in ``run_scenario``, with a recurrent
    state for each world.

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
    return ModelPolicy(model, normalise, whole_number("frame_skip", frame_skip))


def from_actions(
    act: Callable[[Observations], Any], env: Any, frame_skip: int | None = None
) -> "ModelPolicy":
    """Return a policy that runs a function, from any library, that maps observations to an
    environment's actions.

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


class ModelPolicy(BoundPolicy):
    """A model as a policy of a machine with this largest voltage [V]; ``bind`` makes one for
    another machine.

    ``sensors`` names the sensors whose readings the observations must include.
    """

    any_frame_skip = False

    def __init__(
        self,
        model: Any,
        normalise: Normalise,
        frame_skip: int,
        voltage_max: float = BASELINE.clutch.voltage_max,
    ) -> None:
        self.sensors, self.layout = _observed_by(model)
        space = getattr(model, "action_space", None)
        shapes = [(clutches,) for clutches in range(1, SLOTS + 1)]
        if not isinstance(space, spaces.Box) or space.shape not in shapes or not space.is_bounded():
            raise ParameterError(
                f"model.action_space must be a Box with bounds for 1 to {SLOTS} clutches, got {space}"
            )
        self._low, self._high = space.low.astype(np.float64), space.high.astype(np.float64)
        self._model, self._normalise, self._voltage_max = model, normalise, voltage_max
        self.frame_skip = frame_skip
        self._state: Any = None
        self._begins: bool | NDArray[np.bool_] = True

    def bind(self, machine: Machine, layout: Layout) -> "ModelPolicy":
        """Return the policy for a machine and a layout, or raise a ParameterError if either has other entries."""
        if len(layout) != len(self.layout):
            raise ParameterError(
                f"observations must have the {len(self.layout)} entries of the model, got {len(layout)}"
            )
        rows = [clutch.row for clutch in machine.clutches]
        require(
            len(rows) == len(self._low),
            machine,
            "clutches",
            f"{len(self._low)}, as the model's actions",
            got=rows,
        )
        bound = ModelPolicy(
            self._model, self._normalise, self.frame_skip, machine.clutch.voltage_max
        )
        bound.layout = layout
        return bound

    def reset(self, worlds: NDArray[np.bool_] | None = None) -> None:
        """Begin new episodes in these worlds, (N,), in all where None: the model is told in its next decision."""
        if worlds is None:
            self._state = None
        self._begins = True if worlds is None else worlds | self._begins

    def act(self, observations: Observations) -> NDArray[np.float64]:
        """Return clutch voltages [V], (N, clutches), for observations, float32 (N, entries)."""
        begins, self._begins = np.full(len(observations), self._begins), False
        actions, self._state = self._model.predict(
            self._normalise(observations),
            state=self._state,
            episode_start=begins,
            deterministic=True,
        )
        most, low, high = self._voltage_max, self._low, self._high
        linear = (np.clip(np.asarray(actions, np.float64), low, high) - low) * (most / (high - low))
        return np.where(low < 0.0, squared(linear, most), linear)


def _observed_by(model: Any) -> tuple[Sensors, Layout]:
    """Return the sensors whose observations have as many entries as a model's, and their layout."""
    space = getattr(model, "observation_space", None)
    layouts: dict[Sensors, Layout] = {
        each: observation_layout(BASELINE, each) for each in get_args(Sensors)
    }
    for sensors, layout in layouts.items():
        if isinstance(space, spaces.Box) and space.shape == (len(layout),):
            return sensors, layout
    known = " or ".join(f"{len(layout)} ({sensors})" for sensors, layout in layouts.items())
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


def _frame_skip_of(env: Any) -> int:
    """Return for how many control steps an environment holds its actions, or raise a ParameterError."""
    inner = getattr(env, "unwrapped", env)
    try:
        return inner.get_attr("frame_skip")[0] if hasattr(inner, "get_attr") else inner.frame_skip
    except AttributeError:
        raise ParameterError(
            "frame_skip must be given, or env, the environment of the training, which has it: from_sb3(model, "
            f"frame_skip=3) or from_sb3(model, env=env); got env = {env!r:.100}"
        ) from None


def _normalising(wrapper: Any) -> Normalise:
    """Return a function that normalises observations as a wrapper does, without changing its statistics."""
    if wrapper is None:
        return lambda obs: obs
    if not _has_statistics(wrapper):
        raise ParameterError(
            f"vec_normalize must be a VecNormalize or a NormalizeObservation, got {wrapper!r}"
        )
    if hasattr(wrapper, "normalize_obs"):
        return wrapper.normalize_obs
    seen = wrapper.obs_rms
    return lambda obs: ((obs - seen.mean) / np.sqrt(seen.var + wrapper.epsilon)).astype(np.float32)
