"""A ``VecEnv`` of rsl-rl over a vector environment; its tensors share the memory of the arrays."""

import importlib
from typing import Any

from gymnasium.vector import AutoresetMode

from pter_gym.errors import ParameterError, needs_extra

try:
    torch: Any = importlib.import_module("torch")
    VecEnv: Any = importlib.import_module("rsl_rl.env").VecEnv
    TensorDict: Any = importlib.import_module("tensordict").TensorDict
except ImportError as error:
    raise ImportError(str(needs_extra("pter_gym.envs.rsl_rl", "libraries"))) from error


class RslRlVecEnv(VecEnv):
    """A ``VecEnv`` of rsl-rl, whose observations are one group, ``"policy"``.

    Observations are tensors that share memory with the arrays that each step returns, so nothing is copied and later
    steps do not change them. Rewards are float32, as rsl-rl expects. With worlds on a CUDA device all data stay there.

    Actions beyond the bounds are clipped, since rsl-rl draws them from a normal distribution. ``extras["time_outs"]``
    marks the episodes that were truncated and not terminated.

    Parameters
    ----------
    env
        An environment from ``gymnasium.make_vec`` with ``autoreset_mode="SAME_STEP"``, with its wrappers; it is reset
        here.
    seed
        Seed of the first episodes; world i begins with ``seed + i``.

    Raises
    ------
    ParameterError
        If the environment has another ``autoreset_mode``: rsl-rl would learn from a step that does nothing.
    """

    def __init__(self, env: Any, seed: int | None = None) -> None:
        if env.metadata["autoreset_mode"] != AutoresetMode.SAME_STEP:
            raise ParameterError(f"autoreset_mode must be SAME_STEP, got {env.metadata['autoreset_mode'].name}")
        self.env = env
        self.cfg: dict[str, Any] = {}
        self.device = torch.device(env.unwrapped.device)
        self.num_envs, self.num_actions = env.action_space.shape
        self.max_episode_length = env.unwrapped.max_episode_steps or 0
        self._low, self._high = (
            float(bound[0]) for bound in (env.single_action_space.low, env.single_action_space.high)
        )
        self._steps = torch.zeros(self.num_envs, dtype=torch.long, device=self.device)
        self._obs = self._grouped(env.reset(seed=seed)[0])

    @property
    def episode_length_buf(self) -> Any:
        """Control steps of each world's episode so far, (N,)."""
        return self._steps

    @episode_length_buf.setter
    def episode_length_buf(self, steps: Any) -> None:  # noqa: ARG002
        """Refuse: the worlds count their steps themselves."""
        raise ParameterError(
            "init_at_random_ep_len must be False: episodes begin anywhere along the path by themselves"
        )

    def get_observations(self) -> Any:
        """Return the latest observations, float32 (N, entries), as the group ``"policy"``."""
        return self._obs

    def step(self, actions: Any) -> tuple[Any, Any, Any, dict[str, Any]]:
        """Advance all worlds by ``frame_skip`` control periods; actions are (N, 4)."""
        clipped = actions.detach().clamp(self._low, self._high)
        given = clipped if self.device.type == "cuda" else clipped.numpy()
        obs, rewards, *flags, _ = self.env.step(given)
        terminated, truncated = map(torch.as_tensor, flags)
        done = terminated | truncated
        self._steps = torch.where(done, 0, self._steps + 1)
        self._obs = self._grouped(obs)
        return self._obs, torch.as_tensor(rewards).float(), done, {"time_outs": truncated & ~terminated}

    def close(self) -> None:
        """Stop the threads."""
        self.env.close()

    def _grouped(self, obs: Any) -> Any:
        """Return observations as rsl-rl expects them, sharing the same memory."""
        return TensorDict({"policy": torch.as_tensor(obs)}, [self.num_envs], device=self.device)
