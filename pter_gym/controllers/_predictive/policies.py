"""The two predictive policies: one knows the episode, the other only what a controller can know."""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from pter_gym._compiled.layout import Layout
from pter_gym._engine.batch import Batch
from pter_gym._engine.world import ROW
from pter_gym.controllers import BoundPolicy, Controller
from pter_gym.controllers._base import Plans
from pter_gym.controllers._predictive.honest import HonestPlanner
from pter_gym.controllers._predictive.planner import Array, Observations, Planner, Settings
from pter_gym.errors import ParameterError
from pter_gym.params import Machine, find_machine
from pter_gym.tasks.path_following import IDEAL_SENSING, PathFollowing

Decide = Callable[[Array, Observations], Array]
"""From the true state of a world, (rows,), and its observation with force sensors, (entries,), to volts, (4,)."""


@dataclass(frozen=True, slots=True)
class Predictive(ABC):
    """A policy that plans; once bound, it makes a planner for each world of the batch in which episodes begin.

    Attributes
    ----------
    guide
        A controller whose voltages are one of the plans, and the initial plan.
    settings
        Settings of the search.
    """

    guide: Controller
    settings: Settings = Settings()

    @property
    def sensors(self) -> Literal["force"]:
        """The sensors that it needs."""
        return "force"

    @abstractmethod
    def begin(self, machine: Machine, task: PathFollowing, nominal: Machine, layout: Layout) -> Decide:
        """Return a planner for one episode on a machine, given the nominal machine and the observation layout."""

    def bind(self, machine: Machine, layout: Layout) -> "PlanningPolicy":
        """Return the policy for a nominal machine and the layout of the observations that it will get.

        Raises
        ------
        ParameterError
            If the observations have no force sensors.
        """
        if "force_along" not in layout.names:
            raise ParameterError('predictive policies need force sensors: sensors="force"')
        return PlanningPolicy(self, find_machine(machine), layout)


class PlanningPolicy(BoundPolicy):
    """A policy that plans, ready to act in the worlds of one batch, each with a planner of its own."""

    def __init__(self, policy: Predictive, nominal: Machine, layout: Layout) -> None:
        self.layout = layout
        self.nominal = nominal
        self.plans = Plans(policy.settings.horizon, policy.settings.rollouts)
        self._policy = policy
        self._batch: Batch | None = None
        self._deciders: list[Decide] = []

    def reset(self) -> None:
        """Forget the worlds."""
        self._batch, self._deciders = None, []

    def reset_in(self, batch: Batch) -> None:
        """Begin new episodes: a planner for each world of a batch, which has just been reset."""
        self._batch = batch
        self._deciders = [self._begin(batch, number) for number in batch.context]

    def forget(self, worlds: NDArray[np.bool_]) -> None:
        """Begin new episodes in some worlds of the batch, (N,), which have just been reset."""
        batch = self._batch
        if batch is not None:
            for world in np.flatnonzero(worlds):
                self._deciders[world] = self._begin(batch, batch.context[world])

    def _begin(self, batch: Batch, number: int) -> Decide:
        """Return a planner for an episode with one of a batch's pairs of machine and task."""
        return self._policy.begin(*batch.pairs[number], self.nominal, self.layout)

    def act(self, observations: Observations) -> NDArray[np.float32]:
        """Return clutch voltages [V], float32 (N, 4), for observations, float32 (N, entries); 0 where nothing moves.

        Raises
        ------
        ParameterError
            If ``reset_in`` was not given these worlds.
        """
        if self._batch is None or len(self._deciders) != len(observations):
            raise ParameterError("batch must be given to reset_in first, with as many worlds as there are observations")
        states: Any = states_of(self._batch)
        volts = np.zeros((len(observations), 4), np.float32)
        for world in np.flatnonzero(states[:, ROW.alive]):
            volts[world] = self._deciders[world](states[world], observations[world])
        return volts


def states_of(batch: Batch) -> Array:
    """Return the state of each world as if it were alone in its batch, (N, rows)."""
    worlds = batch.get_state()["worlds"]
    states: Any = worlds.transpose(0, 2, 1).reshape(-1, worlds.shape[1])[: batch.num_worlds]
    states[:, ROW.context_at] = states[:, ROW.draws_from] = 0.0
    states[:, ROW.draws] = 1.0
    return states


@dataclass(frozen=True, slots=True)
class Privileged(Predictive):
    """Model-predictive control that knows the true machine, the true hand and its future: a bound."""

    def begin(self, machine: Machine, task: PathFollowing, nominal: Machine, layout: Layout) -> Decide:  # noqa: ARG002
        """Return a planner for one episode on a machine."""
        return Planner(self.settings, machine, replace(task, sensing=IDEAL_SENSING), self.guide, nominal).decide


@dataclass(frozen=True, slots=True)
class Honest(Predictive):
    """Model-predictive control from the observation, on the nominal machine; see ``honest``."""

    def begin(self, machine: Machine, task: PathFollowing, nominal: Machine, layout: Layout) -> Decide:  # noqa: ARG002
        """Return a planner for one episode, which is given the task's path, pace and workspace but not the machine."""
        planner = HonestPlanner(self.settings, task, self.guide, nominal, layout)
        return lambda state, obs: planner.decide(obs)  # noqa: ARG005


UNPRIVILEGED: tuple[type, ...] = (Honest,)
"""Planning policies that need only what a controller can know; all others, subclasses too, count as privileged."""
