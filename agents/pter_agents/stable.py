"""Algorithms of Stable-Baselines3 and sb3-contrib on our worlds: their environment, and their checkpoints."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from gymnasium import spaces
from stable_baselines3.common.logger import Logger

from pter_agents.algorithms import State
from pter_agents.settings import TrainingSettings
from pter_agents.worlds import Mask, Rows, TrainingWorlds
from pter_gym.envs.sb3 import PterVecEnv
from pter_gym.params import require, require_number, require_whole
from pter_gym.policies._interface import LIMIT


@dataclass(frozen=True, kw_only=True)
class StableSettings(TrainingSettings):
    """Hyper-parameters of all algorithms of Stable-Baselines3, in addition to those of ``TrainingSettings``.

    Attributes
    ----------
    minibatch
        Samples of a gradient step.
    learning_rate
        Learning rate of all networks.
    discount
        γ for one control step.
    reward_scale
        Factor of the rewards.
    """

    minibatch: int
    learning_rate: float
    discount: float
    reward_scale: float

    def __post_init__(self) -> None:
        """Check each number by itself."""
        super().__post_init__()
        require(not self.privileged, self, "privileged", self.privileged, "False: all networks see the same here")
        require_whole(self, "minibatch")
        for name in ("learning_rate", "reward_scale"):
            require_number(self, name, above=0.0)
        require_number(self, "discount", at_least=0.0, at_most=1.0)


class StableWorlds(PterVecEnv):
    """Worlds as a ``VecEnv``: inputs of the policy as observations, its outputs as actions.

    Parameters
    ----------
    worlds
        N worlds.
    seed
        Seed of the first episodes; world i begins with ``seed + i``.
    reward_scale
        Factor of the rewards.
    """

    def __init__(self, worlds: TrainingWorlds, seed: int, reward_scale: float) -> None:
        super().__init__(worlds.env)
        self.observation_space = spaces.Box(-LIMIT, LIMIT, (worlds.size,), np.float32)
        self.action_space = spaces.Box(-1.0, 1.0, (4,), np.float32)
        self._worlds = worlds
        self._first = seed
        self._scale = reward_scale

    def reset(self) -> Rows:
        """Restart the first episodes and return the networks' inputs, (N, size)."""
        return self._worlds.reset(self._first)

    def step_wait(self) -> tuple[Rows, Rows, Mask, list[dict[str, Any]]]:
        """Advance all worlds by one control period."""
        step = self._worlds.step(self._actions)
        infos: list[dict[str, Any]] = [{"TimeLimit.truncated": False} for _ in range(self.num_envs)]
        for world, last in zip(step.ended.tolist(), step.last, strict=True):
            infos[world] = {"terminal_observation": last, "TimeLimit.truncated": not step.terminated[world]}
        return step.inputs, (self._scale * step.rewards).astype(np.float32), step.terminated | step.truncated, infos


class Stable:
    """A model around an algorithm of Stable-Baselines3; a subclass provides the mean action.

    Parameters
    ----------
    algorithm
        Untrained, on the CPU, on ``StableWorlds``; ``learn`` makes its gradient steps after ``rollout`` control steps.
    worlds
        The same worlds.
    rollout
        Control steps of a rollout, over all worlds.
    """

    def __init__(self, algorithm: Any, worlds: TrainingWorlds, rollout: int) -> None:
        self.steps, self.rollout = 0, rollout
        self.algorithm = algorithm
        self._worlds = worlds
        algorithm.set_logger(Logger(None, []))
        algorithm._last_obs = algorithm.env.reset()
        algorithm._last_episode_starts = np.ones(worlds.count, np.bool_)

    def advance(self) -> dict[str, float]:
        """Collect a rollout, learn from it, and return values for the logs.

        Raises
        ------
        FloatingPointError
            If a loss or a weight is not finite.
        """
        try:
            self.algorithm.learn(self.rollout, reset_num_timesteps=False, log_interval=None)
        except ValueError:  # of torch's distributions, when weights become NaN between two gradient steps
            if self._finite():
                raise
        self.steps += self.rollout
        logger = self.algorithm.logger
        logged = {name: float(value) for name, value in logger.name_to_value.items() if name.startswith("train/")}
        logger.dump()
        losses = [value for name, value in logged.items() if name.endswith("loss")]
        if not (self._finite() and all(map(math.isfinite, losses))):
            raise FloatingPointError("a loss or a weight is not finite")
        returns = self._worlds.finished
        if returns:
            logged["rollout/mean_return"] = float(np.mean(returns))
        returns.clear()
        return logged

    def get_state(self) -> State:
        """Return the complete training state."""
        return {
            "steps": self.steps,
            "networks": self.algorithm.get_parameters(),
            "worlds": self._worlds.get_state(),
            "torch": torch.get_rng_state(),
            "numpy": np.random.get_state(),  # noqa: NPY002  (Stable-Baselines3 draws from it)
            "inputs": self.algorithm._last_obs,
            "begins": self.algorithm._last_episode_starts,
        }

    def set_state(self, state: State) -> None:
        """Restore the state from ``get_state``."""
        self.set_weights(state)
        self._worlds.set_state(state["worlds"])
        self.steps = self.algorithm.num_timesteps = state["steps"]
        self.algorithm._last_obs = np.asarray(state["inputs"])
        self.algorithm._last_episode_starts = np.asarray(state["begins"])
        torch.set_rng_state(state["torch"])
        name, key, *rest = state["numpy"]
        np.random.set_state((name, np.asarray(key), *rest))  # noqa: NPY002

    def set_weights(self, state: State) -> None:
        """Restore the networks of a state and their optimisers' states."""
        self.algorithm.set_parameters(state["networks"], device="cpu")

    def close(self) -> None:
        """Do nothing: there are no threads."""

    def _finite(self) -> bool:
        """Tell whether all weights are finite."""
        return all(bool(weight.isfinite().all()) for weight in self.algorithm.policy.state_dict().values())
