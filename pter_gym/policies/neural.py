"""A trained policy: a card, a network, and what acts."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pter_gym.compiled.layout import Layout
from pter_gym.params import Machine, require
from pter_gym.policies.cards import Card
from pter_gym.policies.interface import BoundInterface
from pter_gym.policies.network import Network

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Neural:
    """A trained policy; like a controller, it is bound to a nominal machine and a layout before it acts.

    Attributes
    ----------
    card
        What it is.
    network
        From inputs to outputs.
    """

    card: Card
    network: Network

    def bind(self, machine: Machine, layout: Layout) -> "NeuralPolicy":
        """Return the policy for a nominal machine and the layout of the observations that it will get.

        Raises
        ------
        ParameterError
            If the observations lack an entry that it was trained on, or the largest voltage differs.
        """
        self.card.check_layout(layout)
        top = machine.clutch.voltage_max
        require(top == self.card.voltage_max, machine.clutch, "voltage_max", top, f"{self.card.voltage_max:g} V")
        return NeuralPolicy(self.card.interface.bind(machine, layout), self.network)


class NeuralPolicy:
    """A trained policy that is ready to act: ``policy(observation) -> volts``.

    One with a history remembers; ``reset`` makes it forget.

    Parameters
    ----------
    interface
        What the network sees and does.
    network
        From inputs, (N, inputs), to outputs within [−1, 1], (N, 4).
    """

    def __init__(self, interface: BoundInterface, network: Callable[[Array], NDArray[np.floating]]) -> None:
        self._interface = interface
        self._network = network
        self._past = interface.begin(0)

    def reset(self) -> None:
        """Forget the past: new episodes begin."""
        self._past = self._interface.begin(0)

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
            self._past = self._interface.begin(len(rows))
        inputs, base = self._interface.see(rows, self._past)
        volts = self._interface.volts(base, self._network(inputs))
        return volts[0] if np.ndim(observation) == 1 else volts
