"""RLlib's PPO on its new API stack: `python agents/at_scale/rllib_ppo.py --seed 0`, then its leaderboard."""

from pathlib import Path

import torch
import tyro
from ray.rllib.algorithms.ppo import PPOConfig

from pter_gym.benchmark import ResultsFolder, find_policy, from_actions, print_boards, run_scenario


def make_config(seed: int, worlds: int = 16) -> PPOConfig:
    keywords = {"telemetry": False}
    config = PPOConfig().environment("pter_gym:PTER/Standard-v0", env_config=keywords)
    config.env_runners(num_env_runners=0, num_envs_per_env_runner=worlds, gym_env_vectorize_mode="vector_entry_point")
    # the default of vf_clip_param, 10, stops a critic of returns as large as these
    config.debugging(seed=seed).training(lr=1e-3, gamma=0.98, vf_clip_param=1e4)
    return config.training(train_batch_size_per_learner=4096, minibatch_size=256, num_epochs=5)


def learn(seed: int = 0, steps: int = 250_000):
    torch.set_num_threads(1)
    algorithm = make_config(seed).build_algo()
    while algorithm.train()["env_runners"]["num_env_steps_sampled_lifetime"] < steps:
        pass
    module, envs = algorithm.get_module(), algorithm.env_runner.env

    @torch.no_grad()
    def mean(obs):
        return module.forward_inference({"obs": torch.as_tensor(obs)})["action_dist_inputs"].chunk(2, dim=-1)[0]

    return from_actions(mean, envs)


def train(seed: int = 0, steps: int = 250_000, out: Path = Path("stock")) -> None:
    policies = {f"rllib-ppo-{seed}": learn(seed, steps), "torque-feedback": find_policy("torque-feedback")}
    print_boards(run_scenario("standard", policies, seed=seed, results=ResultsFolder(out)))


if __name__ == "__main__":
    tyro.cli(train)
