"""The network of a policy, in numpy: an optional LSTM, hidden layers with tanh, and an output layer."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class LSTM:
    """Long short-term memory (Hochreiter and Schmidhuber, 1997), with torch's gates.

    The rows of its tensors are four gates of U units each: input, forget, cell, output.

    Attributes
    ----------
    weight_inputs, weight_hidden
        Weights from the inputs and from its last outputs to the gates, (4·U, inputs) and (4·U, U).
    bias
        Biases of the gates, (4·U,).
    """

    weight_inputs: Array
    weight_hidden: Array
    bias: Array

    @property
    def units(self) -> int:
        """Number of units, U."""
        return self.weight_hidden.shape[1]

    def __call__(self, inputs: Array, memory: Array) -> Array:
        """Return the memory after the inputs (N, inputs): its outputs, then its cells, (N, 2·U)."""
        hidden, cell = np.split(memory, 2, axis=1)
        gates = inputs @ self.weight_inputs.T + hidden @ self.weight_hidden.T + self.bias
        entered, kept, new, shown = np.split(gates, 4, axis=1)
        cell = sigmoid(kept) * cell + sigmoid(entered) * np.tanh(new)
        return np.concatenate([sigmoid(shown) * np.tanh(cell), cell], axis=1)


@dataclass(frozen=True, eq=False)
class Network:
    """A feed-forward network with an optional LSTM.

    Attributes
    ----------
    weights
        One matrix for each layer, (outputs, inputs).
    biases
        One vector for each layer, (outputs,).
    squashed
        Whether the outputs of the last layer go through tanh like those of the others.
    lstm
        LSTM between the inputs and the first layer, if any.
    """

    weights: tuple[Array, ...]
    biases: tuple[Array, ...]
    squashed: bool = False
    lstm: LSTM | None = None

    def begin(self, worlds: int) -> Array:
        """Return the empty memory of some worlds, a row for each; rows are empty without an LSTM."""
        return np.zeros((worlds, 0 if self.lstm is None else 2 * self.lstm.units))

    def __call__(self, inputs: Array, memory: Array) -> tuple[Array, Array]:
        """Return the outputs (N, outputs) for inputs (N, inputs), and the memory (N, entries) after them."""
        values = inputs
        if self.lstm is not None:
            memory = self.lstm(inputs, memory)
            values = memory[:, : self.lstm.units]
        last = len(self.weights) - 1
        for k, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            values = values @ weight.T + bias
            if k < last or self.squashed:
                values = np.tanh(values)
        return values, memory


def sigmoid(values: Array) -> Array:
    """Return 1/(1 + exp(−x)), which never overflows."""
    return 0.5 + 0.5 * np.tanh(0.5 * values)
