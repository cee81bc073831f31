"""Truncated quantile critics (Kuznetsov et al., arXiv:2005.04269) of sb3-contrib: soft actor-critic that
estimates quantiles of the return, and drops the largest ones to prevent overestimation.
"""

from dataclasses import dataclass

from sb3_contrib import TQC

from pter_agents.algorithms import Learner
from pter_agents.sac import OffPolicy, SACSettings
from pter_agents.worlds import TrainingWorlds
from pter_gym.params import require

QUANTILES = 25
"""Of each critic."""


@dataclass(frozen=True, kw_only=True)
class TQCSettings(SACSettings):
    """Hyper-parameters of truncated quantile critics, in addition to those of ``SACSettings``.

    Attributes
    ----------
    dropped
        Number of each critic's largest quantiles that are dropped, out of ``QUANTILES``.
    """

    dropped: int

    def __post_init__(self) -> None:
        """Check each number by itself."""
        super().__post_init__()
        whole = type(self.dropped) is int and 0 <= self.dropped < QUANTILES
        require(whole, self, "dropped", self.dropped, f"a whole number from 0 to {QUANTILES - 1}")


def make_tqc(settings: TQCSettings, worlds: TrainingWorlds, total: int, seed: int) -> OffPolicy:  # noqa: ARG001
    """Return an untrained model, see ``Learner``."""
    return OffPolicy(settings, worlds, seed, TQC, top_quantiles_to_drop_per_net=settings.dropped)


LEARNER = Learner(settings=TQCSettings, smoke={"buffer": 8192, "updates": 8}, make_model=make_tqc)
