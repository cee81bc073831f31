"""A trained policy: its card and network, and the bound policy."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from pter_gym._compiled.layout import Layout
from pter_gym.params import Machine, find_machine, require
from pter_gym.policies._cards import Card
from pter_gym.policies._interface import BoundInterface
from pter_gym.policies._network import Network

Array = NDArray[np.float64]


class Net(Protocol):
    """A function from inputs to outputs that may remember, like ``Network``."""

    def begin(self, worlds: int) -> Array:
        """Return the empty memory of some worlds, a row for each."""
        ...

    def __call__(self, inputs: Array, memory: Array) -> tuple[Array, Array]:
        """Return outputs within [−1, 1], (N, 4), for inputs (N, inputs), and the memory after them."""
        ...


@dataclass(frozen=True, eq=False)
class Neural:
    """A trained policy; like a controller, it is bound to a nominal machine and a layout before it acts.

    Attributes
    ----------
    card
        Its description.
    network
        Maps inputs to outputs.
    """

    card: Card
    network: Network

    def bind(self, machine: Machine, layout: Layout) -> "NeuralPolicy":
        """Return the policy for a nominal machine and the layout of the observations that it will get.

        Raises
        ------
        ParameterError
            If the observations lack an entry that it was trained on, or the largest voltage or W differs.
        """
        machine = find_machine(machine)
        self.card.check_layout(layout)
        top = machine.clutch.voltage_max
        require(top == self.card.voltage_max, machine.clutch, "voltage_max", top, f"{self.card.voltage_max:g} V")
        rows = tuple(each.row for each in machine.clutches)
        require(rows == self.card.clutches, machine, "clutches", rows, f"{self.card.clutches}, as in its training")
        return NeuralPolicy(self.card.interface.bind(machine, layout), self.network)


class NeuralPolicy:
    """A trained policy that is ready to act: ``policy(observation) -> volts``.

    With a history or an LSTM it has memory, and does not detect when an episode begins: call
    ``reset``, with a mask if only some worlds begin.

    Parameters
    ----------
    interface
        The network's inputs and outputs.
    network
        From inputs to outputs.

    Attributes
    ----------
    frame_skip
        Control steps for which a decision should be held.
    """

    def __init__(self, interface: BoundInterface, network: Net) -> None:
        self.frame_skip = interface.frame_skip
        self._interface = interface
        self._network = network
        self._begin(0)

    def reset(self, worlds: NDArray[np.bool_] | None = None) -> None:
        """Begin new episodes in these worlds, (N,), or in all by default."""
        if worlds is None:
            self._begin(0)
        elif self._past.worlds == len(worlds):
            self._past.forget(worlds)
            self._memory = np.where(worlds[:, None], self._network.begin(len(worlds)), self._memory)

    def __call__(self, observation: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return clutch voltages [V].

        Parameters
        ----------
        observation
            float32 (entries,) of one world or (N, entries) of many.

        Returns
        -------
        volts
            float32 (4,) or (N, 4).

        Raises
        ------
        ParameterError
            If the observation does not fit the layout.
        """
        rows = np.atleast_2d(observation)
        if self._past.worlds != len(rows):
            self._begin(len(rows))
        inputs, base = self._interface.see(rows, self._past)
        outputs, self._memory = self._network(inputs, self._memory)
        volts = self._interface.volts(base, outputs)
        return volts[0] if np.ndim(observation) == 1 else volts

    def _begin(self, worlds: int) -> None:
        self._past = self._interface.begin(worlds)
        self._memory = self._network.begin(worlds)
