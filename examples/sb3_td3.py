"""Train Stable-Baselines3's TD3 and rank its best model, in about ten minutes (extra `agents`).

With less `effort` some seeds hold a clutch locked and learn nothing more.
"""

import numpy as np
import torch
from stable_baselines3 import TD3
from stable_baselines3.common.noise import NormalActionNoise

from pter_gym.benchmark import from_sb3, print_boards, run_scenario
from pter_gym.envs.sb3 import PathErrorCallback, make_sb3_vec_env
from pter_gym.tasks.path_following import RewardWeights

torch.set_num_threads(1)
envs = make_sb3_vec_env(16, scenario="standard", reward=RewardWeights(effort=60))
noise = NormalActionNoise(np.zeros(4), np.full(4, 0.2))
model = TD3("MlpPolicy", envs, action_noise=noise, gradient_steps=4, seed=1)
model.learn(100_000, PathErrorCallback(5_000, "td3"), progress_bar=True)
best = from_sb3(TD3.load("td3/best_model", envs))
print_boards(run_scenario("standard", {"mine": best, "tuned law": "torque-feedback-tuned"}, seed=0))
