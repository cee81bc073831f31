"""PPO of torchrl: `python agents/libraries/torchrl_ppo.py`, then scores on training episodes."""

import gymnasium
import torch
import tyro
from tensordict.nn import TensorDictModule
from torch import nn
from torchrl.collectors import Collector
from torchrl.envs import GymWrapper, RewardScaling, TransformedEnv
from torchrl.modules import NormalParamExtractor, ProbabilisticActor, TanhNormal, ValueOperator
from torchrl.objectives import ClipPPOLoss
from torchrl.objectives.value import GAE

from pter_gym.benchmark import examine, from_actions
from pter_gym.tasks.path_following import RewardWeights


def network(inputs: int, *outputs: nn.Module) -> nn.Sequential:
    return nn.Sequential(nn.Linear(inputs, 64), nn.Tanh(), nn.Linear(64, 64), nn.Tanh(), *outputs)


def train(seed: int = 0, steps: int = 1_500_000, worlds: int = 256, horizon: int = 64):
    torch.manual_seed(seed), torch.set_num_threads(1)
    options = {
        "frame_skip": 1,
        "truncation_error": 0.1,
        "reward": RewardWeights(effort=0),  # in so few steps, the cost keeps it from learning
        "autoreset_mode": "DISABLED",
        "telemetry": False,
    }
    envs = gymnasium.make_vec("PTER/Standard-v0", worlds, **options)
    (size,) = envs.single_observation_space.shape
    world = TransformedEnv(GymWrapper(envs), RewardScaling(0.0, 0.1))
    world.set_seed(seed)
    body = network(size, nn.Linear(64, 8), NormalParamExtractor("biased_softplus_0.5"))
    mean = TensorDictModule(body, ["observation"], ["loc", "scale"])
    actor = ProbabilisticActor(
        mean, in_keys=["loc", "scale"], distribution_class=TanhNormal, return_log_prob=True
    )
    critic = ValueOperator(network(size, nn.Linear(64, 1)), in_keys=["observation"])
    advantage = GAE(gamma=0.99, lmbda=0.95, value_network=critic, average_gae=True)
    loss = ClipPPOLoss(actor, critic, entropy_coeff=0.0, critic_coeff=0.5, normalize_advantage=True)
    adam = torch.optim.Adam(loss.parameters(), lr=1e-3)
    for data in Collector(world, actor, frames_per_batch=worlds * horizon, total_frames=steps):
        with torch.no_grad():
            advantage(data)
        rows = data.reshape(-1)
        for part in (part for _ in range(5) for part in torch.randperm(len(rows)).chunk(8)):
            losses = loss(rows[part])
            adam.zero_grad()
            sum(losses[name] for name in ("loss_objective", "loss_critic")).backward()
            nn.utils.clip_grad_norm_(loss.parameters(), 0.5)
            adam.step()
    return from_actions(lambda obs: body(torch.as_tensor(obs))[0].tanh(), envs)


if __name__ == "__main__":
    for name, verdict in examine({"torchrl": tyro.cli(train)}).items():
        print(f"{name:>8}  {verdict}")
