"""Train Stable-Baselines3's PPO, save it, and rank it. Needs the extra `agents`; five minutes on one core."""

import os
from pathlib import Path
from tempfile import mkdtemp

import torch
from stable_baselines3 import PPO

from pter_gym.benchmark import find_policy, from_sb3, print_boards, run_scenario
from pter_gym.envs.sb3 import make_sb3_vec_env

STEPS = int(os.environ.get("PTER_STEPS", "5_000_000"))

torch.set_num_threads(1)  # small networks are slower with more
worlds = make_sb3_vec_env(64, scenario="standard", truncation_error=0.1)  # one compiled call steps all of them
model = PPO("MlpPolicy", worlds, n_steps=64, batch_size=1024, gae_lambda=0.98, seed=1000)
model.learn(STEPS)
path = Path(mkdtemp()) / "ppo"
model.save(path)
print(f"saved to {path}.zip")

policies = {"mine": from_sb3(model), "torque-feedback-tuned": find_policy("torque-feedback-tuned")}
episodes = 200 if STEPS > 1_000_000 else 10
print_boards(run_scenario("standard", policies, episodes=episodes, seed=0))
