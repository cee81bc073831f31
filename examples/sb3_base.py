"""Train Stable-Baselines3's PPO to correct a control law, and rank it (extra `agents`)."""

import torch
from stable_baselines3 import PPO

from pter_gym.benchmark import from_sb3, print_boards, run_scenario
from pter_gym.envs.sb3 import make_sb3_vec_env
from pter_gym.tasks.path_following import RewardWeights

SEED, STEPS = 0, 5_000_000

torch.set_num_threads(1)
reward = RewardWeights(tracking=10, precision=90, effort=0)
worlds = make_sb3_vec_env(
    128,
    scenario="standard",
    base="single-dof-tuned",
    reward=reward,
    starts="rest",
    error_max=0.05,  # the law never goes that far
)
model = PPO(
    "MlpPolicy",
    worlds,
    n_steps=64,
    batch_size=2048,
    gamma=0.995,
    gae_lambda=0.98,
    use_sde=True,
    sde_sample_freq=8,
    policy_kwargs={"log_std_init": -2.9},
    seed=SEED,
)
model.learn(STEPS, progress_bar=True)
policies = {"mine": from_sb3(model), "tuned law": "single-dof-tuned"}
print_boards(run_scenario("standard", policies, seed=0))
