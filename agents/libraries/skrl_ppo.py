"""PPO of skrl: `python agents/libraries/skrl_ppo.py`, then its scores on training draws."""

import gymnasium
import torch
import tyro
from skrl.envs.wrappers.torch import wrap_env
from skrl.utils.runner.torch import Runner

from pter_gym.benchmark import from_actions
from pter_gym.tuning import examine

LAYERS = [{"name": "net", "input": "OBSERVATIONS", "layers": [64, 64], "activations": "tanh"}]


def settings(seed: int, steps: int, horizon: int) -> dict:
    policy = {"class": "GaussianMixin", "network": LAYERS, "output": "ACTIONS", "initial_log_std": -0.7}
    critic = {"class": "DeterministicMixin", "network": LAYERS, "output": "ONE"}
    ppo = {
        "class": "PPO",
        "rollouts": horizon,
        "learning_epochs": 5,
        "mini_batches": 8,
        "learning_rate": 1e-3,
        "value_loss_scale": 0.5,
        "time_limit_bootstrap": True,
        "observation_preprocessor": "RunningStandardScaler",
        "value_preprocessor": "RunningStandardScaler",
        "rewards_shaper_scale": 0.01,
        "experiment": {"write_interval": 0, "checkpoint_interval": 0},
    }
    return {
        "seed": seed,
        "models": {"separate": True, "policy": {**policy, "clip_actions": True}, "value": critic},
        "memory": {"class": "RandomMemory", "memory_size": -1},
        "agent": ppo,
        "trainer": {"class": "SequentialTrainer", "timesteps": steps, "headless": True},
    }


def train(seed: int = 0, steps: int = 1_500_000, worlds: int = 256, horizon: int = 64):
    torch.set_num_threads(1)
    envs = gymnasium.make_vec("PTER/Standard-v0", worlds, action_unit="normalised", telemetry=False)
    runner = Runner(wrap_env(envs, wrapper="gymnasium"), settings(seed, steps // worlds, horizon))
    runner.run("train")
    agent = runner.agent
    agent.enable_training_mode(False)

    def act(obs):
        return agent.act(torch.as_tensor(obs), None, timestep=0, timesteps=0)[1]["mean_actions"]

    return from_actions(act, envs)


if __name__ == "__main__":
    for name, verdict in examine({"skrl": tyro.cli(train)}).items():
        print(f"{name:>8}  {verdict}")
