"""TD3+BC (arXiv:2106.06860) with torchrl: `python td3_bc.py pter/standard/expert-v0`."""

from pathlib import Path

import torch
import tyro
from common import Scaled, layers, policy_network, score, transitions
from tensordict.nn import TensorDictModule
from torch import nn
from torchrl.modules import ValueOperator
from torchrl.objectives import SoftUpdate, TD3BCLoss


class Worth(nn.Module):
    """The value of an action."""

    def __init__(self, observations: torch.Tensor) -> None:
        super().__init__()
        self.scaled, self.layers = (
            Scaled(observations),
            nn.Sequential(*layers(observations.shape[1] + 4, 1)),
        )

    def forward(self, observation: torch.Tensor, action: torch.Tensor) -> torch.Tensor:
        return self.layers(torch.cat([self.scaled(observation), action], -1))


def train(
    dataset: tyro.conf.Positional[str],
    seed: int = 0,
    steps: int = 10_000,
    batch: int = 256,
    out: Path = Path("offline"),
) -> None:
    torch.set_num_threads(1)
    torch.manual_seed(seed)
    data = transitions(dataset)
    data["next", "reward"] /= data["next", "reward"].std()
    network = policy_network(data["observation"])
    actor = TensorDictModule(network, in_keys=["observation"], out_keys=["action"])
    critic = ValueOperator(Worth(data["observation"]), in_keys=["observation", "action"])
    loss = TD3BCLoss(actor, critic, bounds=(-torch.ones(4), torch.ones(4)), alpha=2.5)
    loss.make_value_estimator(gamma=0.99)
    targets = SoftUpdate(loss, tau=0.005)
    actors, critics = (
        torch.optim.Adam(params.flatten_keys().values(), lr=1e-3)
        for params in (loss.actor_network_params, loss.qvalue_network_params)
    )
    for step in range(steps):
        some = data[torch.randint(len(data), (batch,))]
        critics.zero_grad()
        loss.qvalue_loss(some)[0].backward()
        critics.step()
        if step % 2:
            actors.zero_grad()
            loss.actor_loss(some)[0].backward()
            actors.step()
            targets.step()
    score("td3-bc", network, dataset, seed, out)


if __name__ == "__main__":
    tyro.cli(train)
