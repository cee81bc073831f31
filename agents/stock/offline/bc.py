"""Behaviour cloning with torchrl: `python agents/stock/offline/bc.py pter/standard/expert-v0`."""

from pathlib import Path

import torch
import tyro
from common import policy_network, score, transitions
from tensordict.nn import TensorDictModule
from torchrl.objectives import BCLoss


def train(
    dataset: tyro.conf.Positional[str],
    seed: int = 0,
    steps: int = 10_000,
    batch: int = 512,
    out: Path = Path("offline"),
) -> None:
    torch.set_num_threads(1)
    torch.manual_seed(seed)
    data = transitions(dataset)
    network = policy_network(data["observation"])
    loss = BCLoss(
        TensorDictModule(network, in_keys=["observation"], out_keys=["action"]), loss_function="l2"
    )
    adam = torch.optim.Adam(network.parameters(), lr=1e-3)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(adam, steps)
    data = data.select("observation", "action")
    for _ in range(steps):
        adam.zero_grad()
        loss(data[torch.randint(len(data), (batch,))])["loss_bc"].backward()
        adam.step()
        schedule.step()
    score("bc", network, dataset, seed, out)


if __name__ == "__main__":
    tyro.cli(train)
