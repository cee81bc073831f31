"""The two predictive policies: one knows the episode, the other what a controller can know."""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, replace

from pter_gym.controllers import Controller
from pter_gym.controllers.predictive.honest import HonestPlanner
from pter_gym.controllers.predictive.planner import Array, Observations, Planner, Settings
from pter_gym.engine.batch import Batch
from pter_gym.params import Machine
from pter_gym.tasks.path_following import IDEAL_SENSING, PathFollowing

Decide = Callable[[Batch, Observations], Array]
"""From a batch of one world, which stays as it is, and its observation with force sensors (entries,) to volts (4,)."""


@dataclass(frozen=True)
class Predictive(ABC):
    """A policy that plans, and so has to be told of each episode before it begins.

    Attributes
    ----------
    guide
        A controller whose voltages are among the plans, and the first plan.
    settings
        Of the search.
    """

    guide: Controller
    settings: Settings = Settings()

    @property
    @abstractmethod
    def privileged(self) -> bool:
        """Whether it knows what no controller can know, so that its scores are a bound and not a rank."""

    @property
    def identity(self) -> str:
        """What it is, gains of the guide included, so that a finished run need not be repeated."""
        return repr(self)

    @abstractmethod
    def begin(self, machine: Machine, task: PathFollowing) -> Decide:
        """Return what decides in one episode on a machine."""


@dataclass(frozen=True)
class Privileged(Predictive):
    """Model-predictive control that knows the true machine, the true hand and its future: a bound."""

    @property
    def privileged(self) -> bool:
        """It is."""
        return True

    def begin(self, machine: Machine, task: PathFollowing) -> Decide:
        """Return what decides in one episode on a machine."""
        planner = Planner(self.settings, machine, replace(task, sensing=IDEAL_SENSING), self.guide)
        return lambda world, obs: planner.decide(world.get_state()["worlds"][0, :, 0], obs)


@dataclass(frozen=True)
class Honest(Predictive):
    """Model-predictive control from the observation, on the nominal machine; see ``honest``."""

    @property
    def privileged(self) -> bool:
        """It is not."""
        return False

    def begin(self, machine: Machine, task: PathFollowing) -> Decide:  # noqa: ARG002
        """Return what decides in one episode; of the task it keeps path, pace and workspace, of the machine nothing."""
        planner = HonestPlanner(self.settings, task, self.guide)
        return lambda world, obs: planner.decide(obs)  # noqa: ARG005
