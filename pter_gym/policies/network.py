"""The network of a policy: hidden layers with tanh, and a linear output, in numpy."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Network:
    """Layers of a network.

    Attributes
    ----------
    weights
        One matrix for each layer, (outputs, inputs).
    biases
        One vector for each layer, (outputs,).
    """

    weights: tuple[Array, ...]
    biases: tuple[Array, ...]

    def __call__(self, inputs: Array) -> Array:
        """Return the outputs (N, outputs) for inputs (N, inputs)."""
        values = inputs
        last = len(self.weights) - 1
        for k, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            values = values @ weight.T + bias
            if k < last:
                values = np.tanh(values)
        return values
