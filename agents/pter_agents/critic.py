"""A value network that sees more than the policy: inputs of both first, then those of the value network alone."""

from itertools import pairwise
from typing import Any

import torch
from stable_baselines3.common.policies import ActorCriticPolicy
from torch import nn


class TwoViews(nn.Module):
    """Hidden layers of policy and value, where the policy sees the first inputs only.

    Parameters
    ----------
    seen
        Number of inputs that the policy sees.
    inputs
        Number of inputs that the value network sees.
    hidden, value_hidden
        Units of the hidden layers of policy and value.
    """

    def __init__(self, seen: int, inputs: int, hidden: list[int], value_hidden: list[int]) -> None:
        super().__init__()
        self.seen = seen
        self.policy_net = _layers(seen, hidden)
        self.value_net = _layers(inputs, value_hidden)
        self.latent_dim_pi = hidden[-1]
        self.latent_dim_vf = value_hidden[-1]

    def forward(self, features: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Return what both heads read, from inputs (N, inputs)."""
        return self.forward_actor(features), self.forward_critic(features)

    def forward_actor(self, features: torch.Tensor) -> torch.Tensor:
        """Return what the action head reads, from inputs (N, seen) or (N, inputs)."""
        return self.policy_net(features[:, : self.seen])

    def forward_critic(self, features: torch.Tensor) -> torch.Tensor:
        """Return what the value head reads, from inputs (N, inputs)."""
        return self.value_net(features)


class TwoViewsPolicy(ActorCriticPolicy):
    """Stable-Baselines3's policy with ``TwoViews`` between inputs and heads.

    Parameters
    ----------
    seen
        Number of inputs that the policy sees.
    """

    def __init__(self, *arguments: Any, seen: int, **keywords: Any) -> None:
        self._seen = seen
        super().__init__(*arguments, **keywords)

    def _build_mlp_extractor(self) -> None:
        arch: Any = self.net_arch
        self.mlp_extractor: Any = TwoViews(self._seen, self.features_dim, arch["pi"], arch["vf"])


def _layers(inputs: int, hidden: list[int]) -> nn.Sequential:
    sizes = [inputs, *hidden]
    layers: list[nn.Module] = []
    for before, after in pairwise(sizes):
        layers += [nn.Linear(before, after), nn.Tanh()]
    return nn.Sequential(*layers)
