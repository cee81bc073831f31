"""What the offline scripts share: transitions from Minari, networks, and the score."""

from pathlib import Path

import minari
import numpy as np
import torch
from tensordict import TensorDict
from torch import nn

from pter_gym.benchmark import ResultsFolder, from_actions, print_boards, run_scenario


def transitions(dataset_id: str) -> TensorDict:
    """Return all control steps of a data set in the keys of torchrl."""
    parts: dict[str, list[np.ndarray]] = {
        key: [] for key in ("obs", "next", "action", "reward", "terminated", "done")
    }
    for episode in minari.load_dataset(dataset_id).iterate_episodes():
        parts["obs"].append(episode.observations[:-1])
        parts["next"].append(episode.observations[1:])
        parts["action"].append(episode.actions)
        parts["reward"].append(episode.rewards.astype(np.float32)[:, None])
        parts["terminated"].append(episode.terminations[:, None])
        parts["done"].append((episode.terminations | episode.truncations)[:, None])
    tensors = {key: torch.from_numpy(np.concatenate(arrays)) for key, arrays in parts.items()}
    later = {
        "observation": tensors["next"],
        **{key: tensors[key] for key in ("reward", "terminated", "done")},
    }
    return TensorDict(
        {"observation": tensors["obs"], "action": tensors["action"], "next": later},
        len(tensors["obs"]),
    )


class Scaled(nn.Module):
    """Inputs with mean 0 and deviation 1 over a data set."""

    def __init__(self, observations: torch.Tensor) -> None:
        super().__init__()
        self.register_buffer("mean", observations.mean(0))
        self.register_buffer("deviation", observations.std(0) + 1e-3)

    def forward(self, observations: torch.Tensor) -> torch.Tensor:
        return (observations - self.mean) / self.deviation


def layers(inputs: int, outputs: int) -> list[nn.Module]:
    return [
        nn.Linear(inputs, 256),
        nn.ReLU(),
        nn.Linear(256, 256),
        nn.ReLU(),
        nn.Linear(256, outputs),
    ]


def policy_network(observations: torch.Tensor) -> nn.Module:
    """Return a network from observations to normalised actions."""
    return nn.Sequential(Scaled(observations), *layers(observations.shape[1], 4), nn.Tanh())


def score(algorithm: str, network: nn.Module, dataset_id: str, seed: int, out: Path) -> None:
    """Score a network on test episodes of a data set's scenario and print the leaderboards."""
    _, scenario, level = dataset_id.split("/")
    data = minari.load_dataset(dataset_id)
    env = data.recover_environment()
    policy = from_actions(lambda observations: network(torch.from_numpy(observations)), env)
    policies = {f"{algorithm}-{level.removesuffix('-v0')}-{seed}": policy}
    print_boards(run_scenario(scenario, policies, seed=seed, results=ResultsFolder(out)))
