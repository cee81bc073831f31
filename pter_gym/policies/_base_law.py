"""A base under the action: a control law whose voltages actions correct.

The law acts at every control step, in a kernel of its own beside that of the worlds. ``corrected``
says how base and correction are joined, here, in JAX and in trained policies.
"""

from typing import TYPE_CHECKING, TypeVar

import numpy as np

from pter_gym._compiled.layout import Field, Layout
from pter_gym._engine.batch import Observations
from pter_gym._engine.storage import Array
from pter_gym.controllers import CONTROLLERS, Controller
from pter_gym.controllers._network import BASE_INPUTS
from pter_gym.errors import ParameterError
from pter_gym.params import SLOTS, Machine
from pter_gym.policies._interface import corrected
from pter_gym.policies.tuned import find_paced, find_tuned

if TYPE_CHECKING:
    import jax

REACH = 1.0 / 3.0
"""What a correction of 1 is by default, as a part of the largest voltage."""


Numbers = TypeVar("Numbers", Observations, "jax.Array")


def find_base_law(base: object, scenario: str) -> Controller:
    """Return a base by its name, with the gains for a scenario, or as it is.

    Raises
    ------
    ParameterError
        If there is no such law.
    """
    if isinstance(base, str):
        return (find_paced if base in CONTROLLERS else find_tuned)(base, scenario)
    if not isinstance(base, Controller) or isinstance(base, type):
        raise ParameterError(
            "base must be a control law or the name of one, such as 'single-dof-tuned', "
            f"got {base!r:.200}"
        )
    return base


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

    def start(self, worlds: int) -> Array:
        """Return the law's memory in worlds whose episodes begin, (N, M)."""
        return self.policy.start(worlds, [0] * worlds)

    def volts(self, obs: Observations, memory: Array) -> Observations:
        """Return the law's voltages [V], float32 (N, 4), and change its memory."""
        volts = np.zeros((len(obs), SLOTS), np.float32)
        volts[:, : self._clutches] = self.policy.act(np.ascontiguousarray(obs), memory)
        return volts

    def seen(self, obs: Numbers, base: Numbers) -> Numbers:
        """Return observations, float32 (N, entries), that end with the law's voltages."""
        return obs.__array_namespace__().concat([obs, base * self._inverse_scale], axis=1)

    def corrected(self, actions: Numbers, base: Numbers) -> Numbers:
        """Return the voltages [V] of actions, float32 (N, clutches), on those of the law."""
        return corrected(actions, base[:, : self._clutches], self._reach, self._voltage_max)
