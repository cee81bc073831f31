"""Worlds as an agent sees them through a view, which is part of their state."""

from collections.abc import Generator
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pter_gym._engine.batch import Batch, Observations, Returns, checked_actions
from pter_gym._engine.storage import Mask
from pter_gym._engine.world import FLAGS, NEXT_STEP, REFUSE, ROW, SAME_STEP, SKIP
from pter_gym.errors import ParameterError
from pter_gym.params import Machine
from pter_gym.policies._view import Memory, View
from pter_gym.tasks.path_following._telemetry import COLUMN, COLUMNS

PAY = [int(column) for column in (*COLUMN.terms, COLUMN.reward)]
"""Columns of the telemetry that add up over the control steps of an action."""


class AgentBatch(Batch):
    """Worlds behind a view, or whose state is told as it was before they begin again.

    A view that looks at each control step has each in a call of the kernel of its own. A world that
    ends within ``frame_skip`` of them then stays as it is.

    Parameters
    ----------
    view
        How the agent sees and acts.
    nominal
        The machine that a base is bound to; None for the worlds' first.
    tells
        Whether to keep ``last_truth``.
    *args, **keywords
        Those of ``Batch``.

    Attributes
    ----------
    view
        The view of these worlds.
    last_truth
        With ``SAME_STEP``, ``privileged`` before the resets of the latest step.
    """

    def __init__(
        self, view: View, nominal: Machine | None, tells: bool, *args: Any, **keywords: Any
    ) -> None:
        own = {"frame_skip": view.held_by_worlds, "action_unit": view.unit_of_worlds}
        super().__init__(*args, **keywords, **own)
        self.view = view.bind(nominal or self.machine, self.layout)
        if self.view.base is not None:
            self.view.base.policy.check_period(self.task.control_period)
        self.layout, self.frame_skip = self.view.layout, view.frame_skip
        self.action_low, self.action_high = self.view.bounds
        self._calls, self._looks = view.frame_skip // view.held_by_worlds, view.looks
        self._memory = self.view.start(self.num_worlds)
        self._tells, self.last_truth = tells, np.zeros((0, 0))

    @property
    def _changing(self) -> dict[str, NDArray[Any]]:
        return {**super()._changing, **self._memory._asdict()}

    def get_state(self) -> dict[str, NDArray[Any]]:
        """Return copies of all that changes, and which law this is for."""
        return {**super().get_state(), "law_digest": np.array(self.view.law_digest)}

    def set_state(self, state: dict[str, NDArray[Any]]) -> None:
        """Bring the worlds to a state from ``get_state``, as ``Batch`` does.

        Raises
        ------
        ParameterError
            Also if it is of another base, or what it remembers is not finite.
        """
        if str(state.get("law_digest", "")) != self.view.law_digest:
            raise ParameterError("state must be of an environment with the same base")
        for name in Memory._fields:
            if not np.isfinite(state.get(name, 0.0)).all():
                raise ParameterError(f"state[{name!r}] must hold finite numbers only")
        super().set_state(state)

    @contextmanager
    def _all_or_nothing(self) -> Generator[None]:
        """Leave everything as it was if anything is raised."""
        before = super().get_state()
        try:
            yield
        except BaseException:
            for name, part in self._changing.items():
                part[:] = before[name]
            raise

    def reset(
        self, seeds: Any = None, chosen: Mask | None = None, *, all_seen: bool = True
    ) -> tuple[Observations, Any]:
        """Start new episodes, as ``Batch`` does."""
        chosen = np.ones(self.num_worlds, np.bool_) if chosen is None else chosen
        with self._all_or_nothing():
            obs, telemetry = super().reset(seeds, chosen, all_seen=all_seen)
            return self._begin(obs, chosen), telemetry

    def step(self, actions: ArrayLike, ended: int = REFUSE) -> Returns:
        """Advance all worlds by ``frame_skip`` control periods, as ``Batch`` does."""
        if not self._looks and ended != SAME_STEP:
            return super().step(actions, ended)
        n = self.num_worlds
        alive: Mask = self._worlds[:, ROW.alive].reshape(-1)[:n] != 0.0
        if ended == NEXT_STEP:
            self._check_seeded()
        if ended in (REFUSE, SAME_STEP) and not alive.all():
            self.raise_refusal(int(alive.argmin()))
        given = self._checked(actions, alive)
        with self._all_or_nothing():
            returns = self._advance(given, alive)
            return self._begin_again(returns, alive, ended)

    def step_alone(self, action: ArrayLike) -> tuple[Any, Any, float, bool, bool, bool]:
        """Advance a batch of one world, as ``step`` with ``REFUSE`` does."""
        if not self._looks:
            return super().step_alone(action)
        row = checked_actions(action, (self.num_actions,))[None]
        obs, _, rewards, flags, telemetry = self.step(row)
        (terminated,), (truncated,), (success,) = flags.tolist()
        return obs[0], telemetry[0, 0], rewards.item(), terminated, truncated, success

    def _begin(self, obs: Observations, chosen: Mask) -> Observations:
        """Return what is seen of all worlds after the first observations of some."""
        if not self._looks:
            return obs
        for part, new in zip(self._memory, self.view.start(int(chosen.sum())), strict=True):
            part[chosen] = new
        return self._look(obs, chosen, begins=True)

    def _advance(self, actions: NDArray[Any], alive: Mask) -> Returns:
        """Return what a step of the agent does in the worlds that are alive."""
        if not self._looks:
            return super().step(actions, SKIP)
        n = self.num_worlds
        telemetry = np.full((self._records, n, COLUMNS), np.nan)
        rewards, flags = np.zeros(n), np.zeros((FLAGS, n), np.bool_)
        running, seen = alive.copy(), np.zeros((n, len(self.layout)), np.float32)
        for _ in range(self._calls):
            given, self._memory = self.view.given(actions, self._memory)
            returns = super().step(given, SKIP)
            rewards += returns.rewards
            returns.telemetry[..., PAY] += np.nan_to_num(telemetry[..., PAY])
            telemetry[:, running] = returns.telemetry[:, running]
            flags |= returns.flags
            seen = self._look(returns.obs, running, begins=False)
            terminated, truncated, _ = returns.flags
            running &= ~(terminated | truncated)
            if not running.any():
                break
        return Returns(seen, self._final_obs, rewards, flags, telemetry)

    def _begin_again(self, returns: Returns, alive: Mask, ended: int) -> Returns:
        """Return what a step does, after new episodes in the worlds that are over."""
        seen, _, rewards, flags, telemetry = returns
        terminated, truncated, _ = flags
        over: Mask = ~alive if ended == NEXT_STEP else terminated | truncated
        begins: Mask = over & (ended in (NEXT_STEP, SAME_STEP))
        final, last = seen, telemetry
        if self._tells:
            self.last_truth = self.privileged()
        if begins.any():
            obs, rows = super().reset(None, begins, all_seen=False)
            seen = np.where(begins[:, None], self._begin(obs, begins), seen)
            telemetry = np.where(begins[:, None], rows, telemetry) if self._records else telemetry
        if ended == SAME_STEP:
            telemetry = np.concatenate([telemetry, last])
        return Returns(seen, final, rewards, flags, telemetry)

    def _checked(self, actions: ArrayLike, alive: Mask) -> NDArray[Any]:
        """Return actions, or raise an ActionError if one that counts is wrong."""
        given = checked_actions(actions, (self.num_worlds, self.num_actions))
        given = given if self.view.base is None else given.astype(np.float32)
        slack = 4.0 * float(np.spacing(np.float32(self.action_high)))
        with np.errstate(invalid="ignore"):
            within = (given >= self.action_low - slack) & (given <= self.action_high + slack)
        wrong = alive & ~within.all(axis=1)
        if wrong.any():
            self._slots[:, : self.num_actions] = given
            self.raise_refusal(int(wrong.argmax()))
        return np.where(alive[:, None], given, given.dtype.type(0))

    def _look(self, obs: Observations, chosen: Mask, *, begins: bool) -> Observations:
        """Look at some worlds' observations; return what is seen of all."""
        rows = slice(None) if chosen.all() else chosen
        obs = obs[rows]
        before = self._memory._make(part[rows] for part in self._memory)
        after = self.view.after(before, obs, np.full(len(obs), begins), self.view.act)
        for part, new in zip(self._memory, after, strict=True):
            part[rows] = new
        return self.view.seen(self._memory)
