"""PPO of skrl: `python agents/libraries/skrl_ppo.py`, then scores on training episodes."""

import gymnasium
import numpy as np
import torch
import tyro
from gymnasium.wrappers.vector import ClipAction
from skrl.agents.torch.ppo import PPO, PPO_CFG
from skrl.envs.wrappers.torch import wrap_env
from skrl.memories.torch import RandomMemory
from skrl.resources.preprocessors.torch import RunningStandardScaler
from skrl.trainers.torch import SequentialTrainer
from skrl.utils import set_seed
from skrl.utils.model_instantiators.torch import deterministic_model, gaussian_model

from pter_gym.benchmark import examine, from_actions

LAYERS = [{"name": "net", "input": "OBSERVATIONS", "layers": [64, 64], "activations": "tanh"}]
SETTINGS = {"learning_epochs": 5, "mini_batches": 8, "learning_rate": 1e-3, "value_loss_scale": 0.5}


class Truncating(PPO):
    """After a truncation skrl uses the next observation's value: not one of another episode."""

    def record_transition(self, *, next_observations, infos, **rest):
        if "final_obs" in infos:
            ended = infos["_final_obs"]
            next_observations = next_observations.clone()
            next_observations[ended] = torch.as_tensor(np.stack(infos["final_obs"][ended]))
        super().record_transition(next_observations=next_observations, infos=infos, **rest)


def train(seed: int = 0, steps: int = 1_500_000, worlds: int = 256, horizon: int = 64):
    set_seed(seed), torch.set_num_threads(1)
    options = {
        "frame_skip": 1,
        "truncation_error": 0.1,
        "autoreset_mode": "SAME_STEP",
        "telemetry": False,
    }
    envs = gymnasium.make_vec("PTER/Standard-v0", worlds, **options)
    env = wrap_env(ClipAction(envs), wrapper="gymnasium")
    spaces = {
        "observation_space": env.observation_space,
        "action_space": env.action_space,
        "device": "cpu",
    }
    policy = gaussian_model(**spaces, network=LAYERS, output="ACTIONS", initial_log_std=-0.7)
    models = {
        "policy": policy,
        "value": deterministic_model(**spaces, network=LAYERS, output="ONE"),
    }
    cfg = PPO_CFG(rollouts=horizon, time_limit_bootstrap=True, **SETTINGS)
    cfg.observation_preprocessor = cfg.value_preprocessor = RunningStandardScaler
    cfg.observation_preprocessor_kwargs, cfg.value_preprocessor_kwargs = (
        {"size": env.observation_space},
        {"size": 1},
    )
    cfg.experiment.write_interval = cfg.experiment.checkpoint_interval = 0
    agent = Truncating(
        models=models, memory=RandomMemory(memory_size=horizon, num_envs=worlds), cfg=cfg, **spaces
    )
    trained = {"timesteps": steps // worlds, "headless": True, "close_environment_at_exit": False}
    SequentialTrainer(env=env, agents=agent, cfg=trained).train()
    agent.enable_training_mode(False)

    def act(obs):
        return agent.act(torch.as_tensor(obs), None, timestep=0, timesteps=0)[1]["mean_actions"]

    return from_actions(act, envs)


if __name__ == "__main__":
    for name, verdict in examine({"skrl": tyro.cli(train)}).items():
        print(f"{name:>8}  {verdict}")
