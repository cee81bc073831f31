"""Networks of a policy and of the value of a state."""

import math
from collections.abc import Sequence
from itertools import pairwise

import torch
from torch import nn

Gain = float


class ActorCritic(nn.Module):
    """Two networks with tanh layers: the policy sees the first inputs, the value network all of them.

    Parameters
    ----------
    seen, inputs
        Number of inputs of the policy and of the value network.
    hidden, value_hidden
        Units of their hidden layers.
    start
        Output of the untrained policy.
    """

    def __init__(
        self, seen: int, inputs: int, hidden: Sequence[int], value_hidden: Sequence[int], start: float
    ) -> None:
        super().__init__()
        self.seen = seen
        self.policy = layers((seen, *hidden, 4), 0.01)
        self.value = layers((inputs, *value_hidden, 1), 1.0)
        nn.init.constant_(self.policy[-1].bias, start)  # type: ignore[arg-type]

    def act(self, inputs: torch.Tensor) -> torch.Tensor:
        """Return the mean actions, (N, 4)."""
        return self.policy(inputs[:, : self.seen])

    def worth(self, inputs: torch.Tensor) -> torch.Tensor:
        """Return the values of states, (N,)."""
        return self.value(inputs)[:, 0]


def layers(sizes: Sequence[int], last: Gain) -> nn.Sequential:
    """Return linear layers with tanh between them: orthogonal weights, those of the last one scaled by ``last``."""
    found: list[nn.Module] = []
    for before, after in pairwise(sizes):
        found += [nn.Linear(before, after), nn.Tanh()]
    linear = [layer for layer in found if isinstance(layer, nn.Linear)]
    for layer in linear:
        nn.init.orthogonal_(layer.weight, last if layer is linear[-1] else math.sqrt(2.0))
        nn.init.zeros_(layer.bias)
    return nn.Sequential(*found[:-1])
