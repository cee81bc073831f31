"""A base under the action: worlds whose actions correct the voltages of a control law.

The law acts at every control step, in a kernel of its own beside that of the worlds; its memory is
part of the worlds' state. ``corrected`` says how base and correction are joined, here, in JAX and
in trained policies.
"""

from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pter_gym._compiled.layout import Field, Layout
from pter_gym._engine.batch import Batch, Observations, Returns, checked_actions
from pter_gym._engine.storage import Array, Mask
from pter_gym._engine.world import FLAGS, NEXT_STEP, REFUSE, ROW, SAME_STEP, SKIP
from pter_gym.controllers import CONTROLLERS, Controller
from pter_gym.controllers._network import BASE_INPUTS
from pter_gym.errors import ActionError, ParameterError
from pter_gym.params import SLOTS, Machine
from pter_gym.policies._interface import corrected
from pter_gym.policies.tuned import find_paced, find_tuned
from pter_gym.tasks.path_following._telemetry import COLUMN, COLUMNS

if TYPE_CHECKING:
    import jax

REACH = 8.0
"""Default voltage of a correction of 1 [V]."""

PAY = [int(column) for column in (*COLUMN.terms, COLUMN.reward)]
"""Columns of the telemetry that add up over the control steps of an action."""


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


class CorrectedBatch(Batch):
    """Worlds whose actions, within [−1, 1], correct a base by up to ``reach`` volts.

    Further arguments are those of ``Batch`` with normalised actions. Observations end with the
    base's voltages, and a world that ends within ``frame_skip`` control steps then stays as it is.
    """

    def __init__(
        self,
        base: Controller,
        nominal: Machine,
        reach: float,
        *args: Any,
        frame_skip: int,
        **keywords: Any,
    ) -> None:
        super().__init__(*args, **{**keywords, "action_unit": "volt"})
        self.law = BaseLaw(base, nominal, self.layout, reach)
        self.layout, self.frame_skip = self.law.layout, frame_skip
        self.action_low, self.action_high = -1.0, 1.0
        self._memory = self.law.start(self.num_worlds)
        self._base = np.zeros((self.num_worlds, SLOTS), np.float32)

    @property
    def _changing(self) -> dict[str, NDArray[Any]]:
        return {**super()._changing, "memory": self._memory, "base": self._base}

    def reset(self, seeds: Any = None, chosen: Mask | None = None) -> tuple[Observations, Any]:
        """Start new episodes, as ``Batch`` does."""
        chosen = np.ones(self.num_worlds, np.bool_) if chosen is None else chosen
        obs, telemetry = super().reset(seeds, chosen)
        self._memory[chosen] = self.law.start(int(chosen.sum()))
        self._follow(obs, chosen)
        return self.law.seen(obs, self._base), telemetry

    def step(self, actions: ArrayLike, ended: int = REFUSE) -> Returns:
        """Advance all worlds by ``frame_skip`` control periods, as ``Batch`` does."""
        n = self.num_worlds
        alive: Mask = self._worlds[:, ROW.alive].reshape(-1)[:n] != 0.0
        if ended == NEXT_STEP:
            self._check_seeded()
        if ended in (REFUSE, SAME_STEP) and not alive.all():
            self._raise_refusal(int(alive.argmin()))
        given = self._checked(actions, alive)
        obs = np.zeros((n, self._entries), np.float32)
        telemetry = np.full((self._records, n, COLUMNS), np.nan)
        rewards, flags = np.zeros(n), np.zeros((FLAGS, n), np.bool_)
        running = alive.copy()
        for _ in range(self.frame_skip):
            returns = super().step(self.law.corrected(given, self._base), SKIP)
            obs[running] = returns.obs[running]
            rewards += returns.rewards
            returns.telemetry[..., PAY] += np.nan_to_num(telemetry[..., PAY])
            telemetry[:, running] = returns.telemetry[:, running]
            flags |= returns.flags
            self._follow(obs, running)
            terminated, truncated, _ = returns.flags
            running &= ~(terminated | truncated)
            if not running.any():
                break
        seen = final = self.law.seen(obs, self._base)
        terminated, truncated, _ = flags
        over: Mask = ~alive if ended == NEXT_STEP else terminated | truncated
        begins: Mask = over & (ended in (NEXT_STEP, SAME_STEP))
        last = telemetry
        if begins.any():
            first, rows = self.reset(None, begins)
            seen = np.where(begins[:, None], first, seen)
            telemetry = np.where(begins[:, None], rows, telemetry) if self._records else telemetry
        if ended == SAME_STEP:
            telemetry = np.concatenate([telemetry, last])
        return Returns(seen, final, rewards, flags, telemetry)

    def step_alone(self, action: ArrayLike) -> tuple[Any, Any, float, bool, bool, bool]:
        """Advance a batch of one world, as ``step`` with ``REFUSE`` does."""
        row = checked_actions(action, (self.num_actions,))[None]
        obs, _, rewards, flags, telemetry = self.step(row)
        (terminated,), (truncated,), (success,) = flags.tolist()
        return obs[0], telemetry[0, 0], rewards.item(), terminated, truncated, success

    def _checked(self, actions: ArrayLike, alive: Mask) -> Observations:
        """Return actions as float32, or raise an ActionError if one that counts is wrong."""
        given = checked_actions(actions, (self.num_worlds, self.num_actions)).astype(np.float32)
        slack = 4.0 * float(np.spacing(np.float32(self.action_high)))
        with np.errstate(invalid="ignore"):
            wrong = alive & ~(np.abs(given) <= self.action_high + slack).all(axis=1)
        if wrong.any():
            world = int(wrong.argmax())
            raise ActionError(
                f"action of world {world} must be finite and within [-1, 1], "
                f"got {given[world].tolist()}"
            )
        return np.where(alive[:, None], given, np.float32(0.0))

    def _follow(self, obs: Observations, chosen: Mask) -> None:
        """Let the law act in some worlds on their latest observations."""
        if chosen.all():
            self._base[:] = self.law.volts(obs, self._memory)
        elif chosen.any():
            memory = self._memory[chosen]
            self._base[chosen] = self.law.volts(obs[chosen], memory)
            self._memory[chosen] = memory
