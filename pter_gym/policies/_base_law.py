"""A base under the action: a control law whose voltages actions correct.

The law acts at every control step, in a kernel of its own beside that of the worlds. ``corrected``
says how base and correction are joined, here, in JAX and in trained policies.
"""

from hashlib import sha256
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from numpy.typing import NDArray

from pter_gym._compiled.digests import digest_of
from pter_gym._compiled.layout import Field, Layout
from pter_gym._engine.batch import Observations
from pter_gym._engine.storage import Array
from pter_gym.controllers import Controller
from pter_gym.controllers._gains import RELEASED
from pter_gym.controllers._network import BASE_INPUTS
from pter_gym.controllers._policy import CompiledLaw
from pter_gym.errors import ParameterError
from pter_gym.params import SLOTS, Machine
from pter_gym.policies._history import Floats
from pter_gym.policies._interface import corrected
from pter_gym.policies.find import Kind, find_policy, kind_of

if TYPE_CHECKING:
    import jax

REACH = 1.0 / 3.0
"""What a correction of 1 is by default, as a part of the largest voltage."""

BASES: tuple[Kind, ...] = ("law", "tuned law", "gains", "code", "fault-tolerant")
"""What the name of a base may mean."""

Actions = TypeVar("Actions", NDArray[np.floating], "jax.Array")


def find_base_law(base: object, scenario: str) -> Controller:
    """Return a base by its name, with the gains for a scenario, or as it is.

    Raises
    ------
    ParameterError
        If there is no such law, or it is a trained network.
    """
    law = base
    if isinstance(base, str) and kind_of(base, "base", BASES):
        law = find_policy(base, scenario)
    if not isinstance(law, Controller) or isinstance(law, type):
        raise ParameterError(
            "base must be a control law or the name of one, such as 'single-dof-tuned', "
            f"got {base!r:.200}"
        )
    return law


class BaseLaw:
    """A law under the actions of N worlds, bound to a nominal machine, without its memory.

    Attributes
    ----------
    policy
        The bound law.
    layout
        Layout of observations that end with its voltages.

    Raises
    ------
    ParameterError
        If it is no compiled law, or does not act at every control step.
    """

    def __init__(self, base: Controller, machine: Machine, layout: Layout, reach: float) -> None:
        self.policy = base.bind(machine, layout)
        if self.policy.law is None or self.policy.frame_skip != 1:
            raise ParameterError(
                f"base must be a compiled law that acts at every control step, got {base!r:.200}"
            )
        scale = layout.fields[layout.index("volts_1")].scale
        fields = (Field(name, "V", "voltage of the base", scale) for name in BASE_INPUTS)
        self.layout = Layout((*layout.fields, *fields))
        self._inverse_scale = np.float32(1.0 / scale)
        self._reach, self._voltage_max = reach, machine.clutch.voltage_max
        self._clutches = len(machine.clutches)

    @property
    def law(self) -> CompiledLaw:
        """What the law is compiled from."""
        assert self.policy.law is not None
        return self.policy.law

    @property
    def digest(self) -> str:
        """What a law with its gains is known by."""
        known = f"{digest_of(self.law.function)}{self.law.gains.tolist()}"
        return sha256(known.encode()).hexdigest()

    def start(self, worlds: int) -> Array:
        """Return the law's memory in worlds whose episodes begin, (N, M)."""
        return self.policy.start(worlds, [0] * worlds)

    def act(self, obs: Observations, memory: Array) -> tuple[Observations, Array]:
        """Return the law's voltages [V], float32 (N, 4), and its memory after them.

        That of a clutch that it releases is ``RELEASED``.

        Raises
        ------
        ParameterError
            If a voltage is not finite.
        """
        after = np.array(memory)
        volts = np.zeros((len(obs), SLOTS), np.float32)
        volts[:, : self._clutches] = self.law.act(np.ascontiguousarray(obs), after, RELEASED)
        if not np.isfinite(volts).all():
            world = int(np.isfinite(volts).all(axis=1).argmin())
            raise ParameterError(
                f"base must give finite voltages, got {volts[world, : self._clutches].tolist()}"
            )
        return volts, after

    def seen(self, obs: Floats, base: Floats) -> Floats:
        """Return observations, float32 (N, entries), that end with the law's voltages."""
        library = obs.__array_namespace__()
        volts = library.maximum(base, 0.0)
        return library.concat([obs, volts * self._inverse_scale], axis=1)

    def corrected(self, actions: Actions, base: "Observations | jax.Array") -> Actions:
        """Return the voltages [V], float32, of actions, (N, clutches), on those of the law."""
        return corrected(
            actions.astype(np.float32), base[:, : self._clutches], self._reach, self._voltage_max
        )
