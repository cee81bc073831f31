"""Train Stable-Baselines3's PPO and rank it, in about a minute (extra `agents`)."""

import torch
from stable_baselines3 import PPO

from pter_gym.benchmark import from_sb3, print_boards, run_scenario
from pter_gym.envs.sb3 import make_sb3_vec_env

torch.set_num_threads(1)
envs = make_sb3_vec_env(64, scenario="standard")
model = PPO("MlpPolicy", envs, n_steps=64, batch_size=1024, gae_lambda=0.98, seed=0)
model.learn(1_250_000, progress_bar=True)
policies = {"mine": from_sb3(model), "tuned law": "torque-feedback-tuned"}
print_boards(run_scenario("standard", policies, seed=0))
