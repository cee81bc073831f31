"""PPO of rsl-rl: `python agents/libraries/rsl_rl_ppo.py`, then scores on training episodes."""

import gymnasium
import torch
import tyro
from gymnasium.wrappers.vector import TransformReward
from rsl_rl.env import VecEnv
from rsl_rl.runners import OnPolicyRunner
from tensordict import TensorDict

from pter_gym.benchmark import examine, from_actions

NETWORK = {
    "class_name": "MLPModel",
    "hidden_dims": [64, 64],
    "activation": "tanh",
    "obs_normalization": True,
}


class RslRlVecEnv(VecEnv):
    """A vector environment that resets in the same step, as rsl-rl needs it, and clips actions."""

    def __init__(self, envs, seed: int) -> None:
        self.envs, self.cfg, self.device = envs, {}, torch.device("cpu")
        self.num_envs, self.num_actions = envs.action_space.shape
        self.max_episode_length = envs.unwrapped.max_episode_steps or 0
        self.episode_length_buf = torch.zeros(self.num_envs, dtype=torch.long)
        self.obs = self.grouped(envs.reset(seed=seed)[0])

    def grouped(self, obs) -> TensorDict:
        return TensorDict({"policy": torch.as_tensor(obs)}, [self.num_envs])

    def get_observations(self) -> TensorDict:
        return self.obs

    def step(self, actions):
        obs, rewards, *flags, _ = self.envs.step(actions.detach().clamp(-1.0, 1.0).numpy())
        terminated, truncated = map(torch.as_tensor, flags)
        done, self.obs = terminated | truncated, self.grouped(obs)
        self.episode_length_buf = torch.where(done, 0, self.episode_length_buf + 1)
        return (
            self.obs,
            torch.as_tensor(rewards).float(),
            done,
            {"time_outs": truncated & ~terminated},
        )


def settings(horizon: int) -> dict:
    spread = {"class_name": "GaussianDistribution", "init_std": 1.0}
    learning = {
        "schedule": "fixed",
        "learning_rate": 1e-3,
        "num_mini_batches": 8,
        "entropy_coef": 0.0,
    }
    return {
        "num_steps_per_env": horizon,
        "save_interval": 1000,
        "obs_groups": {"actor": ["policy"], "critic": ["policy"]},
        "actor": {**NETWORK, "distribution_cfg": spread},
        "critic": NETWORK,
        "algorithm": {"class_name": "PPO", **learning},
    }


def train(seed: int = 0, steps: int = 600_000, worlds: int = 32, horizon: int = 256):
    torch.manual_seed(seed), torch.set_num_threads(1)
    options = {
        "frame_skip": 1,
        "truncation_error": 0.1,
        "autoreset_mode": "SAME_STEP",
        "telemetry": False,
    }
    envs = TransformReward(
        gymnasium.make_vec("PTER/Standard-v0", worlds, **options), lambda pay: 0.3 * pay
    )
    runner = OnPolicyRunner(RslRlVecEnv(envs, seed), settings(horizon))
    runner.learn(steps // (worlds * horizon))
    act = runner.get_inference_policy()
    return from_actions(
        lambda obs: act(TensorDict({"policy": torch.as_tensor(obs)}, [len(obs)])), envs
    )


if __name__ == "__main__":
    for name, verdict in examine({"rsl-rl": tyro.cli(train)}).items():
        print(f"{name:>8}  {verdict}")
