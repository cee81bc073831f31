"""Policies: a *controller* has ``bind``; the *bound policy* that it returns turns observations into
volts.

A controller is a frozen set of gains, a trained network, or anything else that fits a nominal
machine and the layout of its observations. ``bind`` also turns a plain callable into a bound
policy.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from pter_gym._compiled.layout import Layout
from pter_gym._engine.law import Memory, empty_memory
from pter_gym._internal.checks import whole_number
from pter_gym.controllers._law_kernel import errors_of, kernel_of
from pter_gym.controllers._laws import built_in
from pter_gym.errors import ParameterError
from pter_gym.params import Machine, find_machine

Observations = NDArray[np.float32]
Volts = NDArray[np.float32]
Mask = NDArray[np.bool_]


class BoundPolicy(ABC):
    """A policy that is ready to act: ``policy(observation) -> volts``.

    Attributes
    ----------
    layout
        Layout of the observations that it gets.
    frame_skip
        Control steps for which its actions are held, as in training.
    any_frame_skip
        Whether it may act with any ``frame_skip``, as control laws may.
    compiled
        Whether its law runs inside the kernel, where several threads can run it at once.
    """

    layout: Layout
    frame_skip: int = 1
    any_frame_skip: bool = True
    compiled: bool = False

    def reset(self, worlds: Mask | None = None) -> None:  # noqa: B027
        """Begin new episodes in these worlds, a bool array (N,), or in all by default."""

    @abstractmethod
    def act(self, observations: Observations) -> Any:
        """Return clutch voltages [V], (N, clutches), for observations, float32 (N, entries),
        contiguous.

        A compiled law has four, and those of clutches that a machine lacks have no effect.
        """

    def __call__(self, observation: Observations) -> Volts:
        """Return clutch voltages [V].

        Parameters
        ----------
        observation
            float32 (entries,) of one world or (N, entries) of many, in the order of ``layout``.

        Returns
        -------
        volts
            As ``act``, float32, without the first axis for one world.

        Raises
        ------
        ParameterError
            If the observation does not fit the layout.
        """
        rows = np.ascontiguousarray(np.atleast_2d(observation), np.float32)
        if rows.ndim != 2 or rows.shape[1] != len(self.layout):
            raise ParameterError(
                f"observation must have {len(self.layout)} entries, got the shape {rows.shape}"
            )
        volts = np.asarray(self.act(rows), np.float32)
        return volts[0] if np.ndim(observation) == 1 else volts


@runtime_checkable
class Controller(Protocol):
    """A control law with its gains, or anything else that acts once bound."""

    def bind(self, machine: Machine, layout: Layout) -> Callable[[Observations], Volts]:
        """Return the policy for a nominal machine and the layout of the observations that it will
        get.

        It is a ``BoundPolicy``, or any callable that takes observations, float32 (N, entries), and
        returns volts, (N, clutches). The law of a ``Policy`` runs compiled.
        """
        ...


class PlainPolicy(BoundPolicy):
    """A callable from observations to volts as a policy, with its ``reset(worlds=None)`` and ``frame_skip`` if any."""

    def __init__(self, function: Callable[[Observations], Any], layout: Layout) -> None:
        self.layout = layout
        self.frame_skip = whole_number("frame_skip", getattr(function, "frame_skip", 1))
        self.any_frame_skip = not hasattr(function, "frame_skip")
        self._function = function

    def reset(self, worlds: Mask | None = None) -> None:
        """Call the function's ``reset``, without an argument where episodes begin in all worlds."""
        reset = getattr(self._function, "reset", None)
        if callable(reset):
            reset() if worlds is None or worlds.all() else reset(worlds)

    def act(self, observations: Observations) -> Any:
        """Return the callable's voltages."""
        return self._function(observations)


def bind(
    policy: Controller | Callable[[Observations], Any],
    machine: Machine | str | None,
    layout: Layout,
) -> BoundPolicy:
    """Return a policy that is ready to act; this is where plain callables become policies.

    Parameters
    ----------
    policy
        A controller, a bound policy, or any ``policy(observations) -> volts``, float32 (N, entries)
        to (N, clutches).
    machine
        The nominal machine or its name; None for the default PTER.
    layout
        Layout of the observations.

    Raises
    ------
    ParameterError
        If it is none of these, or it cannot be bound to this machine and layout.
    """
    acting = (
        policy.bind(find_machine(machine), layout) if isinstance(policy, Controller) else policy
    )
    if isinstance(acting, BoundPolicy):
        return acting
    if not callable(acting):
        raise ParameterError(f"policy must have a method bind or be callable, got {policy!r:.200}")
    return PlainPolicy(acting, layout)


@dataclass(eq=False)
class Policy(BoundPolicy):
    """A compiled control law that is ready to act: ``policy(observation) -> volts``.

    Attributes
    ----------
    gains
        Gains of the law, shape (G,); a list of numbers becomes one.
    layout
        Layout of the observations.
    law
        The scalar law; see ``pter_gym.controllers._laws``. The batch kernel inlines it.
    memory
        Record of the law's state in each world, a ``NamedTuple`` of floats; all are zero when an
        episode begins, except an entry ``world``, which is the number of the world.
    """

    gains: NDArray[np.float64]
    layout: Layout
    law: Callable[..., Any] = built_in
    memory: type[Any] = Memory

    compiled = True

    def __post_init__(self) -> None:
        """Check the law, and start with an empty memory."""
        self.gains = np.asarray(self.gains, np.float64)
        self._scales = self.layout.scales
        self._kernel = kernel_of(self.law)
        self.reset()

    def reset(self, worlds: Mask | None = None) -> None:
        """Begin new episodes in these worlds, (N,), or in all by default."""
        if worlds is None:
            self._memory = self.empty_memory(0)
        elif len(worlds) == len(self._memory):
            self._memory[worlds] = self.empty_memory(len(worlds))[worlds]

    def act(self, observations: Observations) -> Any:
        """Return clutch voltages [V], (N, 4), for observations, float32 (N, entries), contiguous."""
        if len(self._memory) != len(observations):
            self._memory = self.empty_memory(len(observations))
        return self.decide(observations, self._memory)

    def decide(self, observations: Observations, memory: NDArray[np.float64]) -> Any:
        """Return clutch voltages [V], (N, 4), and change the law's memory, (N, M)."""
        volts = np.empty((len(observations), 4))
        lengths = f"obs and scales have {len(self._scales)} entries, gains {len(self.gains)}, memory {memory.shape[1]}"
        with errors_of(self.law, lengths):
            self._kernel(observations, self._scales, self.gains, memory, volts)
        return volts

    def empty_memory(self, worlds: int) -> NDArray[np.float64]:
        """Return the law's state at the start of an episode, a row for each world: (N, numbers of the record)."""
        return empty_memory(worlds, self.memory)
