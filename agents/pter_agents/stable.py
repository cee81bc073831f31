"""Algorithms of Stable-Baselines3 and sb3-contrib on our worlds: what they step, and how they are kept."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from operator import attrgetter
from typing import Any

import numpy as np
import torch
from gymnasium import spaces
from stable_baselines3.common.logger import Logger

from pter_agents.algorithms import State
from pter_agents.networks import MOMENTS, moments_of
from pter_agents.settings import Settings, require_whole
from pter_agents.worlds import Mask, Rows, Worlds
from pter_gym.envs.sb3 import PterVecEnv
from pter_gym.params import require, require_number
from pter_gym.policies.interface import LIMIT


@dataclass(frozen=True, kw_only=True)
class StableSettings(Settings):
    """Hyper-parameters that all algorithms of Stable-Baselines3 have here, in addition to those of ``Settings``.

    Attributes
    ----------
    minibatch
        Samples of a gradient step.
    learning_rate
        Of all networks.
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
        Of the first episodes; world i begins with ``seed + i``.
    reward_scale
        Factor of the rewards.
    """

    def __init__(self, worlds: Worlds, seed: int, reward_scale: float) -> None:
        super().__init__(worlds.env)
        self.observation_space = spaces.Box(-LIMIT, LIMIT, (worlds.size,), np.float32)
        self.action_space = spaces.Box(-1.0, 1.0, (4,), np.float32)
        self._worlds = worlds
        self._first = seed
        self._scale = reward_scale

    def reset(self) -> Rows:
        """Start the first episodes again and return what the networks see, (N, size)."""
        return self._worlds.reset(self._first)

    def step_wait(self) -> tuple[Rows, Rows, Mask, list[dict[str, Any]]]:
        """Advance all worlds by one control period."""
        step = self._worlds.step(self._actions)
        infos: list[dict[str, Any]] = [{"TimeLimit.truncated": False} for _ in range(self.num_envs)]
        for world, last in zip(step.ended.tolist(), step.last, strict=True):
            infos[world] = {"terminal_observation": last, "TimeLimit.truncated": not step.terminated[world]}
        return step.inputs, (self._scale * step.rewards).astype(np.float32), step.terminated | step.truncated, infos


class Stable:
    """A model around an algorithm of Stable-Baselines3: all but the mean action.

    Parameters
    ----------
    algorithm
        Untrained, on the CPU, on ``StableWorlds``; ``learn`` makes its gradient steps after so many control steps.
    worlds
        The same worlds.
    rollout
        Those control steps, of all worlds together.
    """

    def __init__(self, algorithm: Any, worlds: Worlds, rollout: int) -> None:
        self.steps, self.rollout = 0, rollout
        self.algorithm = algorithm
        self._worlds = worlds
        algorithm.set_logger(Logger(None, []))
        algorithm._last_obs = algorithm.env.reset()
        algorithm._last_episode_starts = np.ones(worlds.count, np.bool_)

    def advance(self) -> dict[str, float]:
        """Collect a rollout, learn from it, and return what is worth a log.

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
        """Return copies of all that the training's future depends on."""
        found = {f"weight_{name}": tensor.detach().numpy().copy() for name, tensor in self._weights().items()}
        for optimiser, content in self._optimisers().items():
            for number, moments in content["state"].items():
                found |= {f"{optimiser}_{number}_{name}": moments[name].numpy().copy() for name in MOMENTS}
        return {
            **found,
            **self._worlds.get_state(),
            **random_state(),
            "steps": np.array(self.steps),
            "inputs": self.algorithm._last_obs.copy(),
            "begins": self.algorithm._last_episode_starts.copy(),
        }

    def set_state(self, state: State) -> None:
        """Go on where ``get_state`` was called."""
        self.set_weights(state)
        optimisers = self._optimisers()
        for name, content in optimisers.items() if int(state["steps"]) else ():
            weights = attrgetter(name)(self.algorithm).param_groups[0]["params"]
            content["state"] = {k: moments_of(state, f"{name}_{k}", weight) for k, weight in enumerate(weights)}
        self.algorithm.set_parameters(optimisers, exact_match=False, device="cpu")
        self._worlds.set_state(state)
        self.steps = self.algorithm.num_timesteps = int(state["steps"])
        self.algorithm._last_obs = state["inputs"]
        self.algorithm._last_episode_starts = state["begins"]
        set_random_state(state)

    def set_weights(self, state: State) -> None:
        """Take the networks of a state."""
        with torch.no_grad():
            for name, tensor in self._weights().items():
                tensor.copy_(torch.from_numpy(state[f"weight_{name}"]))

    def close(self) -> None:
        """Stop nothing: there are no threads."""

    def _weights(self) -> Mapping[str, torch.Tensor]:
        """Return the tensors that are learnt, those of the target networks too, by name; not copies."""
        return self.algorithm.policy.state_dict()

    def _finite(self) -> bool:
        """Tell whether all weights are finite."""
        return all(bool(weight.isfinite().all()) for weight in self._weights().values())

    def _optimisers(self) -> dict[str, Any]:
        """Return what the optimisers keep, by name."""
        return {name: kept for name, kept in self.algorithm.get_parameters().items() if name != "policy"}


def random_state() -> State:
    """Return the state of torch's and NumPy's own generators, from which Stable-Baselines3 draws."""
    drawn: Any = np.random.get_state(legacy=False)  # noqa: NPY002
    rest = (drawn["state"]["pos"], drawn["has_gauss"], drawn["gauss"])
    return {
        "torch": torch.get_rng_state().numpy().copy(),
        "numpy": drawn["state"]["key"].copy(),
        "numpy_rest": np.array(rest, np.float64),
    }


def set_random_state(state: State) -> None:
    """Go on where ``random_state`` was called."""
    position, has_gauss, gauss = state["numpy_rest"]
    if not 0 <= position <= len(state["numpy"]):  # NumPy would read beyond its key
        raise ValueError(f"numpy_rest must begin with a place in a key of {len(state['numpy'])}, got {position!r}")
    np.random.set_state(("MT19937", state["numpy"], int(position), int(has_gauss), float(gauss)))  # noqa: NPY002
    torch.set_rng_state(torch.from_numpy(state["torch"]))
