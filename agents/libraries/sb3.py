"""Stable-Baselines3 and sb3-contrib: `python agents/libraries/sb3.py --algorithm tqc --door make_vec_env`."""

from typing import Literal

import gymnasium
import torch
import tyro
from sb3_contrib import TQC
from stable_baselines3 import PPO, SAC
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.vec_env import VecNormalize

from pter_gym.benchmark import examine, from_sb3
from pter_gym.envs.sb3 import PterVecEnv

ID = "PTER/Standard-v0"
NETS = {"learning_rate": 1e-3, "batch_size": 512, "policy_kwargs": {"net_arch": [64, 64]}}
ON = {**NETS, "n_steps": 256, "n_epochs": 5}
OFF = {**NETS, "train_freq": 8, "learning_starts": 4000, "gamma": 0.98, "ent_coef": 0.005}
ALGORITHMS = {
    "ppo": (PPO, 200_000, ON),
    "sac": (SAC, 80_000, {**OFF, "gradient_steps": 16}),
    "tqc": (TQC, 60_000, {**OFF, "gradient_steps": 8}),
}


def train(
    algorithm: Literal["ppo", "sac", "tqc"] = "ppo",
    door: Literal["native", "make_vec_env"] = "native",
    seed: int = 0,
    steps: int | None = None,
    worlds: int = 16,
):
    torch.set_num_threads(1)
    if door == "native":
        options = {"frame_skip": 1, "autoreset_mode": "SAME_STEP", "telemetry": False}
        venv = PterVecEnv(gymnasium.make_vec(ID, worlds, **options))
    else:
        venv = make_vec_env(ID, worlds, seed=seed, env_kwargs={"frame_skip": 1})
    made, enough, settings = ALGORITHMS[algorithm]
    venv = VecNormalize(venv, gamma=settings.get("gamma", 0.99))
    return from_sb3(made("MlpPolicy", venv, seed=seed, device="cpu", **settings).learn(steps or enough), venv)


if __name__ == "__main__":
    for name, verdict in examine({"trained": tyro.cli(train)}).items():
        print(f"{name:>8}  {verdict}")
