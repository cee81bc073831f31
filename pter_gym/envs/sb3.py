"""A ``VecEnv`` of Stable-Baselines3 over many worlds in one compiled call."""

import time
from collections.abc import Iterable
from typing import Any, cast

import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from pter_gym.errors import ParameterError, needs_extra

try:
    from stable_baselines3.common.monitor import Monitor
    from stable_baselines3.common.vec_env import VecEnv
except ImportError as error:
    raise ImportError(str(needs_extra("pter_gym.envs.sb3", "agents"))) from error

from pter_gym._engine.batch import ActionUnit
from pter_gym.envs._vector import PathFollowingVectorEnv

Indices = int | Iterable[int] | None


class PterVecEnv(VecEnv):
    """A ``VecEnv`` of Stable-Baselines3; make one with ``make_sb3_vec_env``.

    A world that ends is reset at once; ``infos[i]`` then holds ``terminal_observation``,
    ``TimeLimit.truncated``, ``is_success``, and ``episode`` with return, length and time as from
    ``VecMonitor``, which isn't needed.
    """

    def __init__(self, env: PathFollowingVectorEnv) -> None:
        self.env = env
        self._actions: Any = None
        self._began = time.time()
        self._returns = np.zeros(env.num_envs)
        self._lengths = np.zeros(env.num_envs, np.int64)
        super().__init__(env.num_envs, env.single_observation_space, env.single_action_space)

    def reset(self) -> NDArray[np.float32]:
        """Start new episodes, with the seeds of ``seed`` if it was called since the last reset.

        Seeds and options are those of one reset, also if it refuses them.
        """
        seeds, options = self._seeds, cast("object", self._options)
        self._reset_seeds()
        self._reset_options()
        if not isinstance(options, list) or any(cast("list[Any]", options)):
            raise ParameterError(f"options must be empty, got {options!r:.200}")
        obs, _ = self.env.reset(seed=seeds)
        self._returns[:] = self._lengths[:] = 0
        self.reset_infos = [{} for _ in range(self.num_envs)]
        return obs

    def step_async(self, actions: NDArray[np.float32]) -> None:
        """Keep the actions (N, clutches) for ``step_wait``."""
        self._actions = actions

    def step_wait(
        self,
    ) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.bool_], list[dict[str, Any]]]:
        """Advance all worlds by ``frame_skip`` control periods."""
        obs, rewards, terminated, truncated, infos = self.env.step(self._actions)
        done = terminated | truncated
        listed: list[dict[str, Any]] = [
            {"TimeLimit.truncated": False} for _ in range(self.num_envs)
        ]
        self._returns += rewards
        self._lengths += 1
        if done.any():
            elapsed = round(time.time() - self._began, 6)
            success = infos["final_info"]["is_success"]
            for world in map(int, np.flatnonzero(done)):
                listed[world] = {
                    "terminal_observation": infos["final_obs"][world],
                    "TimeLimit.truncated": bool(truncated[world] and not terminated[world]),
                    "is_success": bool(success[world]),
                    "episode": {
                        "r": round(float(self._returns[world]), 6),
                        "l": int(self._lengths[world]),
                        "t": elapsed,
                    },
                }
                self.reset_infos[world] = {}
            self._returns[done] = self._lengths[done] = 0
        return obs, rewards.astype(np.float32), done, listed

    def close(self) -> None:
        """Stop the threads."""
        self.env.close()

    def get_images(self) -> list[NDArray[np.uint8] | None]:
        """Return a picture of each world in the mode ``rgb_array``, which ``render`` tiles."""
        return list(self.env.render() or ())

    def get_attr(self, attr_name: str, indices: Indices = None) -> list[Any]:
        """Return an attribute of the vector environment, once for each chosen world."""
        return [getattr(self.env, attr_name) for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Indices = None) -> None:  # noqa: ARG002
        """Raise an error: the worlds of a batch share their attributes."""
        raise ParameterError(
            f"{attr_name!r} cannot be set: the worlds of a batch share their attributes"
        )

    def env_method(
        self, method_name: str, *method_args: Any, indices: Indices = None, **method_kwargs: Any
    ) -> list[Any]:
        """Call a method of the vector environment once; return its result for each chosen world."""
        result = getattr(self.env, method_name)(*method_args, **method_kwargs)
        return [result for _ in self._get_indices(indices)]

    def env_is_wrapped(self, wrapper_class: Any, indices: Indices = None) -> list[bool]:
        """Return whether it is ``Monitor``, whose records ``infos`` hold, for each world."""
        return [wrapper_class is Monitor for _ in self._get_indices(indices)]


def make_sb3_vec_env(
    num_envs: int, *, action_unit: ActionUnit = "normalised", **arguments: Any
) -> PterVecEnv:
    """Return N worlds as a ``VecEnv`` of Stable-Baselines3.

    Parameters
    ----------
    num_envs
        N.
    action_unit
        ``"normalised"``, which suits Stable-Baselines3, or ``"volt"``.
    **arguments
        Those of ``PathFollowingVectorEnv``, such as ``scenario="standard"`` for the worlds of
        ``PTER/Standard-v0``; by default the worlds are those of ``PTER/PathFollowing-v0``.
    """
    mode = AutoresetMode.SAME_STEP
    return PterVecEnv(
        PathFollowingVectorEnv(
            num_envs, autoreset_mode=mode, telemetry=False, action_unit=action_unit, **arguments
        )
    )
