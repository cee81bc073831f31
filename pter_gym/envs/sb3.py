"""A ``VecEnv`` of Stable-Baselines3 over many worlds in one compiled call."""

from collections.abc import Iterable
from functools import partial
from typing import Any, cast

import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from pter_gym.errors import ParameterError, needs_extra

try:
    from stable_baselines3.common.vec_env import VecEnv
except ImportError as error:
    raise ImportError(str(needs_extra("pter_gym.envs.sb3", "agents"))) from error

from pter_gym.envs._vector import PathFollowingVectorEnv
from pter_gym.envs.scenario import make_vec

Indices = int | Iterable[int] | None


class PterVecEnv(VecEnv):
    """A ``VecEnv`` of Stable-Baselines3; make one with ``make_sb3_vec_env``.

    A world that ends is reset at once; ``infos[i]`` then holds ``terminal_observation`` and ``TimeLimit.truncated``.
    """

    def __init__(self, env: PathFollowingVectorEnv) -> None:
        self.env = env
        self._actions: Any = None
        super().__init__(env.num_envs, env.single_observation_space, env.single_action_space)

    def reset(self) -> NDArray[np.float32]:
        """Start new episodes, with the seeds of ``seed`` if it was called since the last reset; (N, entries)."""
        if not isinstance(cast("object", self._options), list) or any(self._options):
            raise ParameterError(f"options must be empty, got {self._options}")
        obs, _ = self.env.reset(seed=self._seeds)
        self._reset_seeds()
        self._reset_options()
        self.reset_infos = [{} for _ in range(self.num_envs)]
        return obs

    def step_async(self, actions: NDArray[np.float32]) -> None:
        """Keep the actions (N, 4) for ``step_wait``."""
        self._actions = actions

    def step_wait(self) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.bool_], list[dict[str, Any]]]:
        """Advance all worlds by ``frame_skip`` control periods."""
        obs, rewards, terminated, truncated, infos = self.env.step(self._actions)
        done = terminated | truncated
        listed: list[dict[str, Any]] = [{"TimeLimit.truncated": False} for _ in range(self.num_envs)]
        if done.any():
            success = infos["final_info"]["is_success"]
            for world in map(int, np.flatnonzero(done)):
                listed[world] = {
                    "terminal_observation": infos["final_obs"][world],
                    "TimeLimit.truncated": bool(truncated[world] and not terminated[world]),
                    "is_success": bool(success[world]),
                }
                self.reset_infos[world] = {}
        return obs, rewards.astype(np.float32), done, listed

    def close(self) -> None:
        """Stop the threads."""
        self.env.close()

    def get_images(self) -> list[NDArray[np.uint8] | None]:
        """Return a picture of each world with ``render_mode="rgb_array"``, of which ``render`` makes one."""
        return list(self.env.render() or ())

    def get_attr(self, attr_name: str, indices: Indices = None) -> list[Any]:
        """Return an attribute of the vector environment, once for each chosen world."""
        return [getattr(self.env, attr_name) for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Indices = None) -> None:  # noqa: ARG002
        """Raise an error: the worlds of a batch share their attributes."""
        raise ParameterError(f"{attr_name!r} cannot be set: the worlds of a batch share their attributes")

    def env_method(
        self, method_name: str, *method_args: Any, indices: Indices = None, **method_kwargs: Any
    ) -> list[Any]:
        """Call a method of the vector environment once, and return its result for each chosen world."""
        result = getattr(self.env, method_name)(*method_args, **method_kwargs)
        return [result for _ in self._get_indices(indices)]

    def env_is_wrapped(self, wrapper_class: Any, indices: Indices = None) -> list[bool]:  # noqa: ARG002
        """Return False for each chosen world: they have no wrappers."""
        return [False for _ in self._get_indices(indices)]


def make_sb3_vec_env(
    num_envs: int, *, scenario: str | None = None, action_unit: Any = "normalised", **keywords: Any
) -> PterVecEnv:
    """Return N worlds as a ``VecEnv`` of Stable-Baselines3.

    Parameters
    ----------
    num_envs
        N.
    scenario
        Name of the scenario, such as ``"standard"`` for ``PTER/Standard-v0``; by default the worlds are
        ``PTER/PathFollowing-v0``.
    action_unit
        ``"normalised"``, which suits Stable-Baselines3, or ``"volt"``.
    **keywords
        Of ``PathFollowingVectorEnv``: ``machine``, ``task``, ``sensors``, ``frame_skip``, ``max_episode_steps``,
        ``num_threads``, ``render_mode``; with a scenario also those of ``pter_gym.envs.scenario.training_draws``.
    """
    make = PathFollowingVectorEnv if scenario is None else partial(make_vec, scenario=scenario)
    return PterVecEnv(
        make(
            num_envs,
            action_unit=action_unit,
            autoreset_mode=AutoresetMode.SAME_STEP,
            telemetry=False,
            **keywords,
        )
    )
