"""A controller is a frozen set of gains; bound to a machine and an observation layout it is a policy."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from pter_gym.compiled.compiler import compile_kernel
from pter_gym.compiled.layout import Layout
from pter_gym.controllers.laws import built_in
from pter_gym.engine.law import empty_memory
from pter_gym.errors import ParameterError
from pter_gym.params import Machine

Volts = NDArray[np.float32]

law: Any = built_in
"""The law that the kernel below inlines; ``compile_kernel`` binds this name to another one."""


@runtime_checkable
class Controller(Protocol):
    """A control law with its gains, or anything else that acts once it is bound."""

    def bind(self, machine: Machine, layout: Layout) -> Callable[[NDArray[np.float32]], Volts]:
        """Return the policy for a nominal machine and the layout of the observations that it will get.

        It takes observations, float32 (entries,) or (N, entries), and returns volts, (4,) or (N, 4). Where it is a
        ``Policy``, its law runs compiled.
        """
        ...


@dataclass(eq=False)
class Policy:
    """A control law that is ready to act: ``policy(observation) -> volts``.

    Attributes
    ----------
    gains
        Gains of the law, shape (G,).
    layout
        Layout of the observations.
    law
        The scalar law; see ``pter_gym.controllers.laws``. The batch kernel inlines it.
    """

    gains: NDArray[np.float64]
    layout: Layout
    law: Callable[..., Any] = built_in

    def __post_init__(self) -> None:
        """Start with an empty memory."""
        self._scales = self.layout.scales
        self.reset()

    def reset(self) -> None:
        """Forget the past of all worlds."""
        self._memory = self.empty_memory(0)

    def __call__(self, observation: NDArray[np.float32]) -> Volts:
        """Return clutch voltages [V].

        Parameters
        ----------
        observation
            float32 (entries,) of one world or (N, entries) of many, in the order of ``layout``.

        Returns
        -------
        volts
            float32 (4,) or (N, 4).

        Raises
        ------
        ParameterError
            If the observation does not fit the layout.
        """
        rows = np.ascontiguousarray(np.atleast_2d(observation), np.float32)
        if rows.ndim != 2 or rows.shape[1] != len(self.layout):
            raise ParameterError(f"observation must have {len(self.layout)} entries, got the shape {rows.shape}")
        if len(self._memory) != len(rows):
            self._memory = self.empty_memory(len(rows))
        volts = self.act(rows, self._memory)
        return volts[0] if np.ndim(observation) == 1 else volts

    def act(self, rows: NDArray[np.float32], memory: NDArray[np.float64]) -> Volts:
        """Return clutch voltages [V], float32 (N, 4).

        Parameters
        ----------
        rows
            Observations, float32 (N, entries), contiguous.
        memory
            What the law keeps of each world, from ``empty_memory``; it is changed.
        """
        volts = np.empty((len(rows), 4), np.float32)
        _act_kernel(self.law)(rows, self._scales, self.gains, memory, volts)
        return volts

    @staticmethod
    def empty_memory(worlds: int) -> NDArray[np.float64]:
        """Return what a law keeps at the start of an episode, a row for each world: (N, MEMORY)."""
        return empty_memory(worlds)


def _build_act(digest: str) -> Any:
    def act(obs: Any, scales: Any, gains: Any, memory: Any, out: Any) -> None:
        _ = digest
        for world in range(obs.shape[0]):
            volts = law(obs[world], scales, gains, memory[world])
            out[world, 0] = volts.x1
            out[world, 1] = volts.x2
            out[world, 2] = volts.x3
            out[world, 3] = volts.x4

    return act


@cache
def _act_kernel(law: Callable[..., Any]) -> Any:
    return compile_kernel(_build_act, law=law)
