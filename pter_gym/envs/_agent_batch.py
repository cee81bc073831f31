"""Worlds as an agent sees them: with what was observed earlier, and a law under its actions.

Both need every control step, so each is a call of the kernel here; what they remember is part of
the worlds' state.
"""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pter_gym._engine.batch import Batch, Observations, Returns, checked_actions
from pter_gym._engine.storage import Mask
from pter_gym._engine.world import FLAGS, NEXT_STEP, REFUSE, ROW, SAME_STEP, SKIP
from pter_gym.controllers import Controller
from pter_gym.params import SLOTS, Machine
from pter_gym.policies._base_law import BaseLaw
from pter_gym.policies._history import History
from pter_gym.tasks.path_following._telemetry import COLUMN, COLUMNS

PAY = [int(column) for column in (*COLUMN.terms, COLUMN.reward)]
"""Columns of the telemetry that add up over the control steps of an action."""


class AgentBatch(Batch):
    """Worlds whose observations end with earlier ones, or whose actions correct a base.

    Observations are those of ``Batch``, the base's voltages, and the ``history`` of both. With a
    base, actions within [−1, 1] correct it by up to ``reach`` volts. A world that ends within
    ``frame_skip`` control steps then stays as it is.

    Parameters
    ----------
    base, nominal, reach
        The law, the machine that it is bound to, and its reach; None without a base.
    history
        Control steps to look back.
    tells
        Whether to keep ``last_truth``.
    *args, **keywords
        Those of ``Batch``.

    Attributes
    ----------
    law
        The bound base, or None.
    history
        What is seen of the latest observations.
    last_truth
        ``privileged`` before the resets of the latest step.
    """

    def __init__(
        self,
        base: Controller | None,
        nominal: Machine | None,
        reach: float | None,
        history: tuple[int, ...],
        tells: bool,
        *args: Any,
        frame_skip: int,
        **keywords: Any,
    ) -> None:
        unit = {} if base is None else {"action_unit": "volt"}
        super().__init__(*args, **{**keywords, **unit})
        self.law = None
        self._memory = np.zeros((self.num_worlds, 0))
        if base is not None and nominal is not None and reach is not None:
            self.law = BaseLaw(base, nominal, self.layout, reach)
            self.layout, self._memory = self.law.layout, self.law.start(self.num_worlds)
            self.action_low, self.action_high = -1.0, 1.0
        self.history = History(history, self.layout)
        self.layout, self.frame_skip = self.history.layout, frame_skip
        self._base = np.zeros((self.num_worlds, SLOTS), np.float32)
        self._latest = np.zeros((self.num_worlds, *self.history.shape), np.float32)
        self._tells, self.last_truth = tells, np.zeros((0, 0))

    @property
    def _changing(self) -> dict[str, NDArray[Any]]:
        kept = {"memory": self._memory, "base": self._base, "latest": self._latest}
        return {**super()._changing, **kept}

    def reset(self, seeds: Any = None, chosen: Mask | None = None) -> tuple[Observations, Any]:
        """Start new episodes, as ``Batch`` does."""
        chosen = np.ones(self.num_worlds, np.bool_) if chosen is None else chosen
        obs, telemetry = super().reset(seeds, chosen)
        if self.law is not None:
            self._memory[chosen] = self.law.start(int(chosen.sum()))
        self._see(obs, chosen, chosen)
        return self.history.seen(self._latest), telemetry

    def step(self, actions: ArrayLike, ended: int = REFUSE) -> Returns:
        """Advance all worlds by ``frame_skip`` control periods, as ``Batch`` does."""
        n = self.num_worlds
        alive: Mask = self._worlds[:, ROW.alive].reshape(-1)[:n] != 0.0
        if ended == NEXT_STEP:
            self._check_seeded()
        if ended in (REFUSE, SAME_STEP) and not alive.all():
            self._raise_refusal(int(alive.argmin()))
        given = self._checked(actions, alive)
        telemetry = np.full((self._records, n, COLUMNS), np.nan)
        rewards, flags = np.zeros(n), np.zeros((FLAGS, n), np.bool_)
        running = alive.copy()
        for _ in range(self.frame_skip):
            volts = given if self.law is None else self.law.corrected(given, self._base)
            returns = super().step(volts, SKIP)
            rewards += returns.rewards
            returns.telemetry[..., PAY] += np.nan_to_num(telemetry[..., PAY])
            telemetry[:, running] = returns.telemetry[:, running]
            flags |= returns.flags
            self._see(returns.obs, running, np.zeros(n, np.bool_))
            terminated, truncated, _ = returns.flags
            running &= ~(terminated | truncated)
            if not running.any():
                break
        seen = final = self.history.seen(self._latest)
        if self._tells:
            self.last_truth = self.privileged()
        terminated, truncated, _ = flags
        over: Mask = ~alive if ended == NEXT_STEP else terminated | truncated
        begins: Mask = over & (ended in (NEXT_STEP, SAME_STEP))
        last = telemetry
        if begins.any():
            seen, rows = self.reset(None, begins)
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

    def _checked(self, actions: ArrayLike, alive: Mask) -> NDArray[Any]:
        """Return actions, or raise an ActionError if one that counts is wrong."""
        given = checked_actions(actions, (self.num_worlds, self.num_actions))
        given = given if self.law is None else given.astype(np.float32)
        slack = 4.0 * float(np.spacing(np.float32(self.action_high)))
        with np.errstate(invalid="ignore"):
            within = (given >= self.action_low - slack) & (given <= self.action_high + slack)
        wrong = alive & ~within.all(axis=1)
        if wrong.any():
            self._slots[:, : self.num_actions] = given
            self._raise_refusal(int(wrong.argmax()))
        return np.where(alive[:, None], given, given.dtype.type(0))

    def _see(self, obs: Observations, chosen: Mask, begins: Mask) -> None:
        """Let the base act on the latest observations of some worlds, and remember these."""
        if self.law is not None:
            self._follow(self.law, obs, chosen)
            obs = self.law.seen(obs, self._base)
        latest = self.history.after(self._latest, obs, begins)
        self._latest[chosen] = latest[chosen]

    def _follow(self, law: BaseLaw, obs: Observations, chosen: Mask) -> None:
        """Let the base act in some worlds on their latest observations."""
        if chosen.all():
            self._base[:] = law.volts(obs, self._memory)
        elif chosen.any():
            memory = self._memory[chosen]
            self._base[chosen] = law.volts(obs[chosen], memory)
            self._memory[chosen] = memory
