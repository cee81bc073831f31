"""Train Stable-Baselines3's SAC and rank its best model, in eight minutes (extra `agents`)."""

import torch
from stable_baselines3 import SAC

from pter_gym.benchmark import from_sb3, print_boards, run_scenario
from pter_gym.envs.sb3 import PathErrorCallback, make_sb3_vec_env

torch.set_num_threads(1)
envs = make_sb3_vec_env(16, scenario="standard")
model = SAC("MlpPolicy", envs, ent_coef="auto_0.01", gradient_steps=4, seed=0)
model.learn(100_000, PathErrorCallback(5_000, "sac"), progress_bar=True)
best = from_sb3(SAC.load("sac/best_model", envs))
print_boards(run_scenario("standard", {"mine": best, "tuned law": "torque-feedback-tuned"}, seed=0))
