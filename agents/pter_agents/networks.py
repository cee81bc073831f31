"""Policy and value networks."""

import math
from collections.abc import Sequence
from copy import deepcopy
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Actor:
    """The mean action of a policy; called like ``pter_gym.policies.Network``, to which it is exported.

    Attributes
    ----------
    layers
        Linear layers with tanh between them, to the four outputs.
    squashed
        Whether the outputs go through tanh.
    lstm
        One LSTM layer between the inputs and the other layers; None for none.
    """

    layers: nn.Sequential
    squashed: bool = False
    lstm: nn.LSTM | None = None

    @property
    def units(self) -> int:
        """Units of the LSTM; 0 if there is none."""
        return 0 if self.lstm is None else self.lstm.hidden_size

    def exact(self) -> "Actor":
        """Return a copy that computes in float64, like an exported policy."""
        return Actor(deepcopy(self.layers).double(), self.squashed, deepcopy(self.lstm).double() if self.lstm else None)

    def begin(self, worlds: int) -> Array:
        """Return the empty memory of that many worlds, a row for each."""
        return np.zeros((worlds, 2 * self.units))

    @torch.no_grad()
    def __call__(self, inputs: Array, memory: Array) -> tuple[Array, Array]:
        """Return the outputs (N, 4) for inputs (N, inputs) and the memory after them, in the weights' precision."""
        kind = next(self.layers.parameters()).dtype
        values = torch.as_tensor(inputs, dtype=kind)
        if self.lstm is not None:
            before = [torch.as_tensor(each, dtype=kind)[None] for each in np.split(memory, 2, axis=1)]
            _, after = self.lstm(values[None], (before[0].contiguous(), before[1].contiguous()))
            values = after[0][0]
            memory = torch.cat(after, dim=2)[0].numpy().astype(np.float64)
        outputs = self.layers(values)
        return (torch.tanh(outputs) if self.squashed else outputs).numpy().astype(np.float64), memory


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


def layers(sizes: Sequence[int], last: float) -> nn.Sequential:
    """Return linear layers with tanh between them: orthogonal weights, with the last layer's scaled by ``last``."""
    found: list[nn.Module] = []
    for before, after in pairwise(sizes):
        found += [nn.Linear(before, after), nn.Tanh()]
    linear = [layer for layer in found if isinstance(layer, nn.Linear)]
    for layer in linear:
        nn.init.orthogonal_(layer.weight, last if layer is linear[-1] else math.sqrt(2.0))
        nn.init.zeros_(layer.bias)
    return nn.Sequential(*found[:-1])
