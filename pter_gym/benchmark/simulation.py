"""Run episodes of any policy: a compiled law, a network, or a plain callable."""

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pter_gym._engine.batch import Batch
from pter_gym._engine.world import SKIP
from pter_gym.controllers import BoundPolicy, Controller, Policy, bind
from pter_gym.params import BASELINE, Machine
from pter_gym.tasks.path_following import COLUMN, PathFollowing, Sensors, observation_layout

Array = NDArray[np.float64]
Observations = NDArray[np.float32]
AnyPolicy = Controller | Callable[[Observations], Any]
"""What ``pter_gym.controllers.bind`` takes: a controller, a bound policy or a plain callable."""

Columns = slice | list[int]


class BatchRollout:
    """New episodes in a batch, one in each of its N worlds, advanced by a policy.

    Attributes
    ----------
    obs
        The latest observations, float32 (N, entries); ``seen`` has those at all control steps
        decided one by one.
    steps
        Control steps so far.
    ended
        Which episodes have ended, bool (N,).
    """

    def __init__(
        self,
        batch: Batch,
        policy: BoundPolicy,
        seeds: Sequence[int],
        columns: Columns = slice(None),
    ) -> None:
        self.batch, self.policy = batch, policy
        self.obs, first = batch.reset(seeds)
        policy.reset()
        self.steps = 0
        self.ended = np.zeros(batch.num_worlds, np.bool_)
        self.seen: list[Observations] = [self.obs]
        self._columns = columns
        self._rows = [first[None][..., columns]]
        self._memory: Any = (
            policy.empty_memory(batch.num_worlds) if isinstance(policy, Policy) else None
        )
        self._volts: Any = None

    def step(self) -> None:
        """Advance by one control step; the policy decides at every ``frame_skip``-th."""
        if self.steps % self.policy.frame_skip == 0:
            seen = np.ascontiguousarray(self.obs[:, : len(self.policy.layout)])
            if isinstance(self.policy, Policy):
                volts = self.policy.decide(seen, self._memory)[:, : self.batch.num_actions]
                self._volts = np.clip(volts, 0.0, self.batch.action_high, out=volts)
            else:
                self._volts = self.policy.act(seen.copy())
        returns = self.batch.step(self._volts, SKIP)
        self.seen.append(returns.obs)
        self._keep(returns.obs, returns.telemetry)

    def _keep(self, obs: Observations, rows: Any) -> None:
        """Keep the last observations and the telemetry of further control steps, (T, N, len(TELEMETRY))."""
        self.obs = obs
        self.steps += len(rows)
        self.ended = rows[-1, :, COLUMN.terminated] != 0.0  # NaN after the end
        self._rows.append(rows[..., self._columns])

    @property
    def telemetry(self) -> Array:
        """Telemetry starting with the reset, (steps + 1, N, columns), NaN after the end of an episode; a new array."""
        return np.concatenate(self._rows)


def run(
    batch: Batch,
    policy: AnyPolicy,
    seeds: Sequence[int],
    limits: Sequence[int],
    *,
    columns: Columns = slice(None),
) -> BatchRollout:
    """Run new episodes in N worlds until each has ended or reached its limit.

    Parameters
    ----------
    batch, policy
        The worlds, and a policy, bound to the nominal machine unless it is already bound or a plain
        callable.
    seeds, limits
        Seeds of the resets, and control steps after which an episode is truncated, N each.
    columns
        Columns of the telemetry that are kept; all by default.
    """
    episodes = BatchRollout(batch, bind(policy, BASELINE, batch.layout), seeds, columns)
    last = max(limits)
    while (
        episodes.steps < last and not (episodes.ended | (np.array(limits) <= episodes.steps)).all()
    ):
        episodes.step()
    return episodes


def simulate(batch: Batch, policy: AnyPolicy, seeds: Sequence[int], max_steps: int) -> Array:
    """Return the telemetry of new episodes, (steps + 1, N, len(TELEMETRY)), NaN after the end of an
    episode.

    Arguments are those of ``run``; all episodes are truncated after ``max_steps`` control steps.
    """
    return run(batch, policy, seeds, [max_steps] * batch.num_worlds).telemetry


class Episode(NamedTuple):
    """One episode with everything that a policy saw and did; each row but the last is followed by a
    control step.

    Attributes
    ----------
    telemetry
        float64 (T + 1, len(TELEMETRY)): the row of the reset, then one per control step.
    obs
        Observations with force sensors, float32 (T + 1, entries).
    volts
        Applied voltages [V], float32 (T, 4).
    """

    telemetry: Array
    obs: Observations
    volts: NDArray[np.float32]


def record_episode(
    policy: AnyPolicy,
    machine: Machine,
    task: PathFollowing,
    seed: int,
    max_steps: int,
    *,
    nominal: Machine = BASELINE,
) -> Episode:
    """Return an episode in a world of its own, truncated after ``max_steps`` control steps.

    The policy is bound to the machine ``nominal``, and gets force sensors only if it asks for them.
    """
    acting = bind(policy, nominal, observation_layout(machine, sensors_of(policy)))
    episode = BatchRollout(Batch(machine, task, 1, sensors="force"), acting, [seed])
    while episode.steps < max_steps and not episode.ended.all():
        episode.step()
    telemetry: Any = episode.telemetry[:, 0]
    return Episode(
        telemetry, np.concatenate(episode.seen), telemetry[1:, [*COLUMN.volts]].astype(np.float32)
    )


def sensors_of(policy: AnyPolicy) -> Sensors:
    """Return the sensors that a policy needs: those in its ``sensors``, otherwise torque sensors."""
    return getattr(policy, "sensors", "torque")


def time_limit(task: PathFollowing) -> int:
    """Return the control steps after which an episode is truncated: three times the time at the pace, at least 300."""
    return max(300, math.ceil(3.0 * task.path.length / (task.pace * task.control_period)))
