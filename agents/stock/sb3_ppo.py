"""Stable-Baselines3's PPO with its defaults: `python agents/stock/sb3_ppo.py --seed 0`, then its leaderboard."""

from pathlib import Path

import torch
import tyro
from stable_baselines3 import PPO
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.vec_env import VecNormalize

from pter_gym.benchmark import ResultsFolder, find_policy, from_sb3, print_boards, run_scenario

NEAR = {"truncation_error": 0.1}


def train(seed: int = 0, steps: int = 3_000_000, worlds: int = 4, out: Path = Path("stock")) -> None:
    torch.set_num_threads(1)
    venv = VecNormalize(make_vec_env("PTER/Standard-v0", n_envs=worlds, seed=seed, env_kwargs=NEAR))
    model = PPO("MlpPolicy", venv, seed=seed, device="cpu").learn(steps)
    policies = {f"sb3-ppo-{seed}": from_sb3(model, venv), "torque-feedback": find_policy("torque-feedback")}
    print_boards(run_scenario("standard", policies, seed=seed, results=ResultsFolder(out)))


if __name__ == "__main__":
    tyro.cli(train)
