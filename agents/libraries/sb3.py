"""Stable-Baselines3 and sb3-contrib through either door: `python agents/libraries/sb3.py --algorithm tqc --door native`."""

from typing import Literal

import gymnasium
import torch
import tyro
from sb3_contrib import TQC, RecurrentPPO
from stable_baselines3 import PPO, SAC
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.vec_env import VecNormalize

from pter_gym.benchmark import from_sb3
from pter_gym.envs.sb3 import PterVecEnv
from pter_gym.tuning import examine

ID = "PTER/Standard-v0"
OFF = {"learning_rate": 1e-3, "batch_size": 512, "train_freq": 8, "gradient_steps": 16, "learning_starts": 4000}
ALGORITHMS = {
    "ppo": (PPO, "MlpPolicy", {"n_steps": 256, "batch_size": 512, "n_epochs": 5}),
    "sac": (SAC, "MlpPolicy", {**OFF, "policy_kwargs": {"net_arch": [64, 64]}}),
    "tqc": (TQC, "MlpPolicy", {**OFF, "policy_kwargs": {"net_arch": [64, 64]}}),
    "recurrent": (RecurrentPPO, "MlpLstmPolicy", {"n_steps": 256, "batch_size": 512, "n_epochs": 3}),
}


def train(
    algorithm: Literal["ppo", "sac", "tqc", "recurrent"] = "ppo",
    door: Literal["native", "make_vec_env"] = "native",
    seed: int = 0,
    steps: int = 200_000,
    worlds: int = 16,
):
    torch.set_num_threads(1)
    if door == "native":
        options = {"action_unit": "normalised", "autoreset_mode": "SAME_STEP", "telemetry": False}
        venv = PterVecEnv(gymnasium.make_vec(ID, worlds, **options))
    else:
        venv = make_vec_env(ID, worlds, seed=seed, env_kwargs={"action_unit": "normalised"})
    made, policy, options = ALGORITHMS[algorithm]
    venv = VecNormalize(venv, norm_reward=algorithm in ("ppo", "recurrent"))
    return from_sb3(made(policy, venv, seed=seed, device="cpu", **options).learn(steps), venv)


if __name__ == "__main__":
    for name, verdict in examine({"trained": tyro.cli(train)}).items():
        print(f"{name:>8}  {verdict}")
