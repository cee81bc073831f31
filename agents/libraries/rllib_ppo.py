"""PPO of RLlib, on as many workers as you like: `python agents/libraries/rllib_ppo.py --workers 2`.

Each worker steps its own worlds in one batch; then scores on training episodes."""

import math
from typing import Any

import gymnasium
import ray
import torch
import tyro
from gymnasium import VectorizeMode
from ray.rllib.algorithms.ppo import PPOConfig
from ray.rllib.core.rl_module.default_model_config import DefaultModelConfig

from pter_gym.benchmark import examine, from_actions

ID = "pter_gym:PTER/Standard-v0"


def train(
    seed: int = 0, steps: int = 1_250_000, worlds: int = 64, horizon: int = 64, workers: int = 0
) -> Any:
    rollout = worlds * horizon * max(workers, 1)
    network = DefaultModelConfig(  # like Stable-Baselines3's: with others the training gets stuck
        fcnet_hiddens=[64, 64],
        fcnet_activation="tanh",
        fcnet_kernel_initializer="orthogonal_",
        fcnet_kernel_initializer_kwargs={"gain": math.sqrt(2.0)},
        head_fcnet_kernel_initializer="orthogonal_",
        head_fcnet_kernel_initializer_kwargs={"gain": 0.01},
        free_log_std=True,
        vf_share_layers=False,
    )
    config = (
        PPOConfig()
        .environment(ID)
        .env_runners(
            num_env_runners=workers,
            num_envs_per_env_runner=worlds,
            gym_env_vectorize_mode=VectorizeMode.VECTOR_ENTRY_POINT,
            rollout_fragment_length=horizon,
        )
        .rl_module(model_config=network)
        .training(
            train_batch_size_per_learner=rollout,
            minibatch_size=1024,
            num_epochs=10,
            gamma=0.99,
            lambda_=0.98,
            lr=3e-4,
            clip_param=0.2,
            vf_clip_param=float("inf"),
            vf_loss_coeff=0.5,
            use_kl_loss=False,
            grad_clip=0.5,
        )
        .debugging(seed=seed, log_level="ERROR")
    )
    algorithm = config.build_algo()
    for _ in range(max(steps // rollout, 1)):
        found = algorithm.train()["env_runners"]
        print(f"{found['num_env_steps_sampled_lifetime']:>10,.0f} steps, return", end=" ")
        print(f"{found.get('episode_return_mean', float('nan')):.1f}", flush=True)
    module = algorithm.get_module()

    def act(observations: Any) -> torch.Tensor:
        with torch.no_grad():
            outputs = module.forward_inference({"obs": torch.as_tensor(observations)})
        return outputs["action_dist_inputs"][:, :4].clip(-1.0, 1.0)

    policy = from_actions(act, gymnasium.make_vec(ID, 1))
    algorithm.stop()
    return policy


if __name__ == "__main__":
    for name, verdict in examine({"RLlib": tyro.cli(train)}).items():
        print(f"{name:>8}  {verdict}")
    ray.shutdown()
